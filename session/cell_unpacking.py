"""Scene and robot of a run, read from the files in its log or recipe. No fault or ground truth is read."""

from __future__ import annotations

import hashlib
import io
import os
import posixpath
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any, Final, Protocol, assert_never, cast

import yaml

from picktree.files import FileError, Location, PicktreeError
from picktree.files.yaml import Document, file_models, read_document
from picktree.logs import log_records
from picktree.world import mesh_reader
from picktree.world.robot_model import RobotDescription, parse_robot, robot_file, urdf_parser
from picktree.world.scene import MESH_SETS, SceneDescription, SceneFile, scene_loading

ASSORTMENT_MESHES: Final = "assortment.zip"
"""Attachment with the OBJ files of the scene's assortment: the drawn items depend on all of them."""
ROBOT_MESHES: Final = "robot/"
"""Folder of the attachments with the URDF's meshes, each under the name that the URDF uses."""


def scene_mesh_names(loc: Location, file: str) -> tuple[str, str]:
    """Return the names in a log of the mesh at `loc` of a scene: by its file alone, and by its owner, too."""
    section, owner = str(loc[0]), str(loc[1])
    return (
        f"mesh/{file}",
        f"mesh/{owner}/{file}" if section == "catalogue" else f"mesh/{section}/{owner}/{file}",
    )


def beside(name: str, reference: str) -> str:
    """Return the name in a log of a file that the file `name` names; it stays inside of its top folder."""
    top = name.partition("/")[0]
    inner = posixpath.join(posixpath.dirname(name.removeprefix(f"{top}/")), reference)
    return f"{top}/{plain_reference(inner)}"


def plain_reference(filename: str) -> str:
    """Return a mesh's name in a URDF as a path that stays inside its folder."""
    for prefix in ("package://", "file://"):
        filename = filename.removeprefix(prefix)
    parts = [p for p in posixpath.normpath(filename.replace("\\", "/")).split("/") if p not in ("", ".")]
    return "/".join("up" if part == ".." else part for part in parts)


class RunFiles(Protocol):
    """Files of one run: its log, or the recipe of a batch."""

    @property
    def path(self) -> Path: ...
    @property
    def run(self) -> log_records.RunInfo: ...
    @property
    def attachments(self) -> Sequence[str]: ...
    def attachment(self, name: str) -> bytes: ...


class CellUnpacking:
    """Reader of the scene and the robot of one run.

    All methods raise PicktreeError for a file that the log lacks, and FileError where this version of
    picktree no longer accepts a file.
    """

    def __init__(self, log: RunFiles, folder: Path) -> None:
        """`folder`: files that the scene and the robot name are written there."""
        self._log = log
        self._folder = folder
        self._names = log.attachments
        self._info = log.run

    def scene(self) -> SceneDescription:
        text, folder = self._text("scene.yaml"), self._folder / "scene"
        path = folder / f"{inside_name(self._info.scene)}.yaml"
        document = read_document(path, "scene", text)
        data = cast("dict[str, Any]", document.data)
        places = {name: self._place(name, folder) for name in file_models.file_names(SceneFile, data)}
        moved = {name.loc: place for name, place in places.items() if place != name.text}
        document = (
            read_document(path, "scene", yaml_text(file_models.renamed(data, moved))) if moved else document
        )
        return replace(scene_loading.check_scene(document).required(), text=text)

    def robot(self) -> RobotDescription:
        text, folder = self._text("robot.yaml"), self._folder / "robot"
        path = folder / f"{inside_name(self._info.robot)}.yaml"
        urdf = self._log.attachment("robot.urdf")
        document = read_document(path, "robot", text)
        data = cast("dict[str, Any]", document.data)
        installed: Path | None = None
        if ":" in str(data.get("urdf")):
            # A gripper from a file beside the robot file is in the log, not beside this text.
            robot = _checked_or_none(document)
            if robot is not None:
                installed = Path(robot.urdf)
                if installed.read_bytes() == urdf:
                    return robot
        data["urdf"] = "robot.urdf"
        for done in robot_file.COMPOSED:
            data.pop(done, None)  # the URDF of the log has it already
        self._put(folder / "robot.urdf", self._with_meshes(urdf, folder, installed))
        return replace(parse_robot(yaml_text(data), path), text=text)

    def _place(self, name: file_models.FileName, folder: Path) -> str:
        """Put the file that a scene names into the folder, unless it is shipped. Return its name there."""
        match name.role:
            case "mesh":
                return self._place_mesh(name, folder)
            case "mesh folder":
                return name.text if name.text in MESH_SETS else self._place_meshes(name.text, folder)
            case "robot" if name.text in robot_file.robot_names():
                return name.text
            case "robot":
                # The scene's text only needs a robot file that exists; `robot` reads its content.
                self._put(folder / "robot" / "robot.yaml", self._log.attachment("robot.yaml"))
                return "robot/robot.yaml"
            case "scene" | "urdf":
                return name.text  # the text of the log stands without a base
            case _:
                assert_never(name.role)

    def _place_mesh(self, mesh: file_models.FileName, folder: Path) -> str:
        """Put the mesh and its materials where the scene names it, if that is inside of the folder."""
        alone, apart = scene_mesh_names(mesh.loc, PurePosixPath(mesh.text).name)
        name = next((n for n in (apart, alone) if n in self._names), None)
        if name is None:
            raise PicktreeError(f"{self._log.path}: the mesh {mesh.text} of the scene is not in the log")
        plain = plain_reference(mesh.text)
        place = plain if plain == posixpath.normpath(mesh.text) else name
        content = self._log.attachment(name)
        self._put(folder / place, content)
        for held in self._names:
            if held.startswith(f"{name}@"):  # its convex parts at a scale
                self._put(folder / f"{place}{held.removeprefix(name)}", self._log.attachment(held))
        for library in map(os.fsdecode, mesh_reader.material_names(content)):
            if (held := beside(name, library)) in self._names:
                at = plain_reference(posixpath.join(posixpath.dirname(place), library))
                self._put(folder / at, self._log.attachment(held))
        return place

    def _place_meshes(self, meshes: str, folder: Path) -> str:
        """Put the meshes of an assortment into a folder of their own."""
        if ASSORTMENT_MESHES not in self._names:
            raise PicktreeError(
                f"{self._log.path}: the meshes {meshes} of the assortment are not in the log; "
                "it was made by an older version"
            )
        with zipfile.ZipFile(io.BytesIO(self._log.attachment(ASSORTMENT_MESHES))) as archive:
            for name in archive.namelist():
                self._put(folder / "assortment" / Path(name).name, archive.read(name))
        return "assortment"

    def _with_meshes(self, urdf: bytes, folder: Path, installed: Path | None) -> bytes:
        """Return the URDF, with its meshes beside it: those of the log, else the same ones of the installed
        package."""
        root = urdf_parser.parse_urdf(urdf, "robot")
        for mesh in root.iter("mesh"):
            filename = mesh.get("filename", "")
            plain = plain_reference(filename)
            name = f"{ROBOT_MESHES}{plain}"
            if name in self._names:
                content = self._log.attachment(name)
            else:
                content = self._installed_mesh(name, filename, installed)
            self._put(folder / plain, content)
            mesh.set("filename", plain)
        for name, held in self._below(ROBOT_MESHES):
            if not (folder / name).exists():  # a library of materials, which a mesh names
                self._put(folder / name, self._log.attachment(held))
        return ElementTree.tostring(root)

    def _installed_mesh(self, name: str, filename: str, installed: Path | None) -> bytes:
        digest, _, path = self._info.files.get(name, "").partition(" ")
        # A mesh of an installed package is found by its name alone, whatever file is beside the URDF here.
        beside = installed or self._folder / "robot" / "robot.urdf"
        for file in (Path(path) if path else None, urdf_parser.mesh_file(beside, filename)):
            if file is not None and file.is_file():
                content = file.read_bytes()
                if not digest or hashlib.sha256(content).hexdigest() == digest:
                    return content
        raise PicktreeError(
            f"{self._log.path}: the mesh {filename} of the robot is not in the log, "
            "and this machine does not have the same version"
        )

    def _below(self, prefix: str) -> list[tuple[str, str]]:
        """Return the attachments whose name starts with `prefix`: the rest of the name, the name."""
        return [(name.removeprefix(prefix), name) for name in self._names if name.startswith(prefix)]

    def _text(self, name: str) -> str:
        try:
            return self._log.attachment(name).decode()
        except UnicodeDecodeError:
            raise PicktreeError(f"{self._log.path}: the file {name!r} in the log is damaged") from None

    def _stem(self, name: str, otherwise: str) -> str:
        """Return the stem of the file's original name; it names a mission that has no name of its own."""
        path = self._info.files.get(name, "").partition(" ")[2]
        return Path(path).stem if path else inside_name(otherwise)

    def _put(self, path: Path, content: bytes) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def inside_name(name: str) -> str:
    """Return the name as one that leads out of no folder."""
    return plain_reference(name) or "unnamed"


def yaml_text(data: Mapping[str, Any]) -> str:
    """Return a file's content as YAML, with its keys in their order."""
    return yaml.safe_dump(dict(data), default_flow_style=None, sort_keys=False, allow_unicode=True)


def _checked_or_none(document: Document) -> RobotDescription | None:
    """Check a robot file. None when the package of its URDF is not installed here, or has another one that
    does not fit."""
    try:
        return robot_file.check_robot(document).required()
    except FileError:
        return None
