"""Files of a recipe, in a log or in an archive, unpacked into a folder in which the usual loaders read them.

The archive is a ZIP file from which the recipe can be run on any machine at any time.

A text is read as it is, unless it names a file that cannot be placed there. Then a copy is read that names it
elsewhere, and the value keeps the text of the log.
"""

from __future__ import annotations

import hashlib
import io
import os
import posixpath
import tempfile
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Any, Protocol, assert_never, cast

import yaml
from pydantic import TypeAdapter, ValidationError

from ..files.atomic_write import whole
from ..files.errors import PicktreeError
from ..files.marks import FileError
from ..files.yaml.document import Document, read_document
from ..files.yaml.named_files import FileName, file_names, renamed
from ..simulation.backends import Backend
from ..simulation.faults.fault_entries import FaultFile
from ..simulation.faults.fault_loading import parse_faults
from ..trees.loading.loader import parse_mission
from ..trees.mission import Mission, RecordedFiles
from ..world.mesh_reader import material_names
from ..world.robot_model.description import RobotDescription
from ..world.robot_model.loading import COMPOSED, check_robot, parse_robot, robot_names
from ..world.robot_model.mesh_files import mesh_file
from ..world.robot_model.urdf_text import parse_urdf
from ..world.scene.description import MESH_SETS, SceneDescription
from ..world.scene.scene_loading import check_scene
from ..world.scene.scene_schema import SceneFile
from .recipe import (
    ASSORTMENT_MESHES,
    DEFAULT_TIME_LIMIT,
    ROBOT_MESHES,
    Recipe,
    beside,
    fingerprints,
    plain_reference,
    recipe_files,
    scene_mesh_names,
)


class RecordedFileNames(Protocol):
    """Names of a run's files, as `RunInfo` has them."""

    @property
    def mission(self) -> str: ...
    @property
    def scene(self) -> str: ...
    @property
    def robot(self) -> str: ...
    @property
    def files(self) -> Mapping[str, str]: ...


class RecordedFileStore(Protocol):
    """Store of a run's files: its log, or a recipe of a batch."""

    @property
    def path(self) -> Path: ...
    @property
    def run(self) -> RecordedFileNames: ...
    @property
    def attachments(self) -> tuple[str, ...]: ...
    def attachment(self, name: str) -> bytes:
        """Return a file's content. Raises PicktreeError when it is missing."""
        ...


class Unpacking:
    """Reader of one run's files.

    All methods raise PicktreeError for a file that the log lacks, and FileError where this version of
    picktree no longer accepts a file.
    """

    def __init__(self, log: RecordedFileStore, folder: Path) -> None:
        self._log = log
        self._folder = folder
        self._names = log.attachments
        self._info = log.run

    def mission(self, edit: str = "") -> Mission:
        """Return the mission with its includes and plug-ins. `edit`: folder in the log of an edited
        version."""
        prefix = f"{edit}/" if edit else ""
        folder = self._folder / "mission"
        text = self._text(f"{prefix}mission.yaml")
        includes = {name: self._text(at) for name, at in self._below(f"{prefix}include/")}
        for name, at in self._below(f"{prefix}plugin/"):
            self._put(folder / _inside(name), self._log.attachment(at))
        path = folder / f"{self._stem('mission.yaml', self._info.mission)}.yaml"
        return parse_mission(text, path, files=RecordedFiles(includes, folder))

    def scene(self) -> SceneDescription:
        text, folder = self._text("scene.yaml"), self._folder / "scene"
        path = folder / f"{_inside(self._info.scene)}.yaml"
        document = read_document(path, "scene", text)
        data = cast("dict[str, Any]", document.data)
        places = {name: self._place(name, folder) for name in file_names(SceneFile, data)}
        moved = {name.loc: place for name, place in places.items() if place != name.text}
        document = read_document(path, "scene", _dumped(renamed(data, moved))) if moved else document
        return replace(check_scene(document).required(), text=text)

    def robot(self) -> RobotDescription:
        text, folder = self._text("robot.yaml"), self._folder / "robot"
        path = folder / f"{_inside(self._info.robot)}.yaml"
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
        for done in COMPOSED:
            data.pop(done, None)  # the URDF of the log has it already
        self._put(folder / "robot.urdf", self._with_meshes(urdf, folder, installed))
        return replace(parse_robot(_dumped(data), path), text=text)

    def faults(self) -> FaultFile | None:
        if "faults.yaml" not in self._names:
            return None
        text = self._text("faults.yaml")
        path = self._folder / f"{self._stem('faults.yaml', 'faults')}.yaml"
        data = _data(text, path, "faults")
        # The scene is named for the check alone, which the file has passed.
        named = data.pop("scene", None) is not None
        return replace(parse_faults(_dumped(data) if named else text, path), text=text)

    def _place(self, name: FileName, folder: Path) -> str:
        """Put the file that a scene names into the folder, unless it is shipped. Return its name there."""
        match name.role:
            case "mesh":
                return self._place_mesh(name, folder)
            case "mesh folder":
                return name.text if name.text in MESH_SETS else self._place_meshes(name.text, folder)
            case "robot" if name.text in robot_names():
                return name.text
            case "robot":
                # The scene's text only needs a robot file that exists; `robot` reads its content.
                self._put(folder / "robot" / "robot.yaml", self._log.attachment("robot.yaml"))
                return "robot/robot.yaml"
            case "scene" | "urdf":
                return name.text  # the text of the log stands without a base
            case _:
                assert_never(name.role)

    def _place_mesh(self, mesh: FileName, folder: Path) -> str:
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
        for library in map(os.fsdecode, material_names(content)):
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
        root = parse_urdf(urdf, "robot")
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
        for file in (Path(path) if path else None, mesh_file(beside, filename)):
            if file is not None and file.is_file():
                content = file.read_bytes()
                if not digest or hashlib.sha256(content).hexdigest() == digest:
                    return content
        raise PicktreeError(
            f"{self._log.path}: the mesh {filename} of the robot is not in the log, "
            "and this machine does not have it as it was"
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
        return Path(path).stem if path else _inside(otherwise)

    def _put(self, path: Path, content: bytes) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def _inside(name: str) -> str:
    """Return the name as one that leads out of no folder."""
    return plain_reference(name) or "unnamed"


def _data(text: str, path: Path, kind: str) -> dict[str, Any]:
    return cast("dict[str, Any]", read_document(path, kind, text).data)


def _dumped(data: Mapping[str, Any]) -> str:
    return yaml.safe_dump(dict(data), default_flow_style=None, sort_keys=False, allow_unicode=True)


def _checked_or_none(document: Document) -> RobotDescription | None:
    """Check a robot file. None when the package of its URDF is not installed here, or has another one that
    does not fit."""
    try:
        return check_robot(document).required()
    except FileError:
        return None


HEADER_NAME = "recipe.json"
_FILE_TIME = (1980, 1, 1, 0, 0, 0)
"""Time stamp of all files in an archive, so that equal recipes give equal archives."""


@dataclass(frozen=True, slots=True)
class RecipeHeader:
    """Settings of a recipe besides its files and the seed."""

    mission: str
    scene: str
    robot: str
    parameters: Mapping[str, str] = field(default_factory=dict[str, str])
    backend: Backend = "physics"
    verify: bool = False
    limit: float = DEFAULT_TIME_LIMIT
    own_scene: bool = True
    files: Mapping[str, str] = field(default_factory=dict[str, str])
    """SHA-256 in hex and path of the original file, by name in the archive."""


_HEADER_ADAPTER = TypeAdapter(RecipeHeader)


def write_recipe(recipe: Recipe, path: Path) -> None:
    """Write a recipe without its seed. Raises PicktreeError when the file cannot be written."""
    files = list(recipe_files(recipe))
    card = RecipeHeader(
        recipe.mission.name,
        recipe.scene.name,
        recipe.robot.name,
        dict(recipe.parameters),
        recipe.backend,
        recipe.verify,
        recipe.limit,
        recipe.own_scene,
        fingerprints(recipe, files),
    )
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo(HEADER_NAME, _FILE_TIME), _HEADER_ADAPTER.dump_json(card, indent=1))
        for file in files:
            archive.writestr(zipfile.ZipInfo(file.name, _FILE_TIME), file.data, zipfile.ZIP_DEFLATED)
    with whole([path], path) as (beside,):
        path.parent.mkdir(parents=True, exist_ok=True)
        beside.write_bytes(data.getvalue())


class RecipeFile:
    """Recipe archive that is open for reading. Its files are unpacked into a folder that exists until
    `close`.

    Raises PicktreeError for a file that is no archive of a recipe, or damaged. Raises FileError where this
    version of picktree no longer accepts a file in it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._archive = zipfile.ZipFile(path)
            self.run = _HEADER_ADAPTER.validate_json(self._archive.read(HEADER_NAME))
        except OSError as error:
            raise PicktreeError(f"{path}: the recipe cannot be read: {error.strerror}") from None
        except (zipfile.BadZipFile, KeyError, ValidationError):
            raise PicktreeError(f"{path}: no recipe of a batch, or a damaged one") from None
        self.attachments = tuple(name for name in self._archive.namelist() if name != HEADER_NAME)
        self._folder = tempfile.TemporaryDirectory(prefix="picktree-")

    def close(self) -> None:
        self._archive.close()
        self._folder.cleanup()

    def __enter__(self) -> RecipeFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def attachment(self, name: str) -> bytes:
        """Return a file's content. Raises PicktreeError when it is missing or was changed since it was
        written."""
        try:
            data = self._archive.read(name)
        except (KeyError, zipfile.BadZipFile, OSError):
            raise PicktreeError(f"{self.path}: {name!r} is missing in it, or damaged") from None
        if hashlib.sha256(data).hexdigest() != self.run.files.get(name, "").partition(" ")[0]:
            raise PicktreeError(f"{self.path}: {name!r} in it was changed since it was written")
        return data

    def recipe(self, seed: int) -> Recipe:
        """Return the recipe with that seed."""
        unpacking, card = Unpacking(self, Path(self._folder.name)), self.run
        made = Recipe(
            unpacking.mission(),
            unpacking.scene(),
            unpacking.robot(),
            seed,
            unpacking.faults(),
            dict(card.parameters),
            card.backend,
            card.verify,
            card.limit,
            card.own_scene,
        )
        return replace(made, paths={name: words.partition(" ")[2] for name, words in card.files.items()})
