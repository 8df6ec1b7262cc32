"""Recipe of a run: mission, scene, robot, seed and settings, independent of their source. Sources are files
on the disk, a log, or an archive.

A `RunRequest` names the files; `read_recipe` reads and checks them.
"""

from __future__ import annotations

import hashlib
import io
import os
import posixpath
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Final, assert_never

from ..files.errors import PicktreeError
from ..files.file_names import fitted
from ..files.marks import Location
from ..files.yaml.document import read_document
from ..logs.recording.rotated_log import NO_ROTATION, Rotation
from ..logs.schema.records import ResumedFrom
from ..simulation.backends import Backend
from ..simulation.faults.fault_entries import FaultFile
from ..simulation.faults.fault_loading import load_faults
from ..trees.loading.loader import load_mission
from ..trees.loading.registry import NodeRegistry
from ..trees.mission import Mission, Plugin, name_of
from ..world.convex_parts import parts_name, parts_text
from ..world.mesh_reader import material_files
from ..world.robot_model.description import RobotDescription
from ..world.robot_model.loading import load_robot
from ..world.robot_model.mesh_files import mesh_file
from ..world.robot_model.urdf_geometry import mesh_paths
from ..world.robot_model.urdf_text import parsed_urdf
from ..world.scene.description import SceneDescription
from ..world.scene.scene_loading import load_scene
from ..world.shapes import CompoundMesh
from .checkpoints import RunState


@dataclass(frozen=True, slots=True)
class Attachment:
    name: str
    content: str | bytes
    media_type: str
    source: Path | None = None
    """File that the content was read from; None: it is not from a file."""

    @property
    def data(self) -> bytes:
        return self.content.encode() if isinstance(self.content, str) else self.content


def mission_files(mission: Mission) -> Iterator[Attachment]:
    """Yield the mission, its includes under the names that it uses, and the sources of its plug-ins.

    `plugin/wave.py` is a file beside the mission, `module/a.b.py` an installed module.
    """
    yield Attachment("mission.yaml", mission.text, "application/yaml", mission.document.path)
    folder = mission.document.path.parent
    for document in mission.included:
        name = f"include/{name_of(document.path, folder)}"
        yield Attachment(name, document.text, "application/yaml", document.path)
    folder = folder.resolve()
    for plugin in mission.sources:
        if plugin.file is not None:
            yield Attachment(_name(plugin, plugin.file, folder), plugin.source, "text/x-python", plugin.file)


def plugin_versions(mission: Mission) -> dict[str, str]:
    """Versions of the distributions that a mission's installed plug-ins come from, by name."""
    known = (plugin.distribution.rpartition(" ") for plugin in mission.sources if plugin.distribution)
    return {name: version for name, _, version in known}


def _name(plugin: Plugin, file: Path, folder: Path) -> str:
    if not plugin.name.endswith(".py"):
        return f"module/{plugin.name}.py"
    beside = file.is_relative_to(folder)
    return f"plugin/{file.relative_to(folder).as_posix() if beside else plugin.name}"


DEFAULT_TIME_LIMIT = 3600.0
"""Default limit of a run, simulated s."""


@dataclass(frozen=True, slots=True)
class StartCheckpoint:
    """Checkpoint from which a run resumes."""

    state: RunState
    continues: ResumedFrom
    """Run that the checkpoint belongs to."""
    adopt: bool = False
    """Whether the mission differs from the saved one: nodes that match keep their state, the others start
    afresh."""
    changed: tuple[str, ...] = ()
    """Names of the parameters that have other values now. Running nodes read them once more."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """Everything on which a run depends, read and checked. Two runs of the same recipe are the same."""

    mission: Mission
    scene: SceneDescription
    robot: RobotDescription
    seed: int = 0
    faults: FaultFile | None = None
    parameters: Mapping[str, str] = field(default_factory=dict[str, str])
    """Values of the mission's parameters by name, as `--set` gives them."""
    backend: Backend = "physics"
    verify: bool = False
    """Check every trajectory with the verifier, an independent collision checker."""
    limit: float = DEFAULT_TIME_LIMIT
    """Simulated seconds after which the run is ended."""
    own_scene: bool = True
    """Whether the scene is the one that the mission names."""
    start: StartCheckpoint | None = None
    """Checkpoint to start from; None: start from the beginning."""
    paths: Mapping[str, str] = field(default_factory=dict[str, str])
    """Original paths of the files of a recipe from a log, by name of the attachment."""


ASSORTMENT_MESHES: Final = "assortment.zip"
"""Attachment with the OBJ files of the scene's assortment: what is drawn depends on all of them."""
ROBOT_MESHES: Final = "robot/"
"""Folder of the attachments with the URDF's meshes, each under the name that the URDF uses."""


def recipe_files(recipe: Recipe) -> Iterator[Attachment]:
    """Yield mission, scene, robot and faults, with the files that they name.

    The meshes of a robot whose URDF is in an installed package are not among them: see `installed_meshes`.
    """
    yield from mission_files(recipe.mission)
    scene, robot = recipe.scene, recipe.robot
    yield Attachment("scene.yaml", scene.text, "application/yaml", Path(scene.source))
    yield from scene_files(scene)
    urdf = Path(robot.urdf)
    yield Attachment("robot.yaml", robot.text, "application/yaml", Path(robot.source))
    yield Attachment("robot.urdf", urdf.read_bytes(), "application/xml", urdf)
    if not is_installed(robot):
        for name, file in robot_meshes(robot.urdf):
            yield Attachment(name, file.read_bytes(), "model/mesh", file)
    if recipe.faults is not None:
        faults = recipe.faults
        yield Attachment("faults.yaml", faults.text, "application/yaml", Path(faults.source))


def fingerprints(recipe: Recipe, files: Iterator[Attachment] | list[Attachment]) -> dict[str, str]:
    """Return SHA-256 and original path of each file, by its name in the log."""
    found = {
        file.name: f"{hashlib.sha256(file.data).hexdigest()} {recipe.paths.get(file.name, file.source or '')}"
        for file in files
    }
    return {**found, **installed_meshes(recipe.robot)}


def scene_files(scene: SceneDescription) -> Iterator[Attachment]:
    """Yield the files that a scene names, in whatever form: meshes, and folders of them as archives.

    A mesh is `mesh/hexagon.obj`, or `mesh/KIND/hexagon.obj` where two share a name. What stands in the text
    already (`base`), or has an attachment of its own (`robot`), is left out.
    """
    meshes: list[tuple[dict[str, Path], dict[str, Path]]] = []
    for name in scene.files:
        path = Path(name.text)
        match name.role:
            case "mesh":
                alone, apart = scene_mesh_names(name.loc, path.name)
                meshes.append((dict(with_materials(alone, path)), dict(with_materials(apart, path))))
            case "mesh folder":
                yield Attachment(ASSORTMENT_MESHES, packed_folder(path), "application/zip", path)
            case "robot" | "scene" | "urdf":
                pass
            case _:
                assert_never(name.role)
    sources = Counter(name for name, _ in {both for alone, _ in meshes for both in alone.items()})
    named: dict[str, Path] = {}
    for alone, apart in meshes:
        named |= apart if any(sources[name] > 1 for name in alone) else alone
    for name, file in named.items():
        yield Attachment(name, content := file.read_bytes(), "model/mesh", file)
        for shape in dict.fromkeys(e.shape for e in scene.catalogue if isinstance(e.shape, CompoundMesh)):
            if shape.source == str(file):
                yield Attachment(parts_name(name, shape.scale), parts_text(shape, content), "model/mesh")


def scene_mesh_names(loc: Location, file: str) -> tuple[str, str]:
    """Return the names in a log of the mesh at `loc` of a scene: by its file alone, and by its owner, too."""
    section, owner = str(loc[0]), str(loc[1])
    return (
        f"mesh/{file}",
        f"mesh/{owner}/{file}" if section == "catalogue" else f"mesh/{section}/{owner}/{file}",
    )


def with_materials(name: str, mesh: Path) -> Iterator[tuple[str, Path]]:
    """Yield name and file of a mesh, and of the libraries of materials that it names."""
    yield name, mesh
    if mesh.suffix.lower() == ".obj":
        for library, file in material_files(mesh.read_bytes(), mesh.parent).items():
            yield beside(name, os.fsdecode(library)), file


def beside(name: str, reference: str) -> str:
    """Return the name in a log of a file that the file `name` names; it stays inside of its top folder."""
    top = name.partition("/")[0]
    inner = posixpath.join(posixpath.dirname(name.removeprefix(f"{top}/")), reference)
    return f"{top}/{plain_reference(inner)}"


@lru_cache(maxsize=2)
def packed_folder(folder: Path) -> bytes:
    """Return the OBJ files of a folder as a ZIP archive; equal files give equal archives."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for file in sorted(folder.glob("*.obj")):
            archive.writestr(zipfile.ZipInfo(file.name), file.read_bytes(), zipfile.ZIP_DEFLATED)
    return data.getvalue()


def installed_meshes(robot: RobotDescription) -> Mapping[str, str]:
    """Return the fingerprints of the meshes of a robot from an installed package; empty for another robot."""
    return _hashed_meshes(robot.urdf) if is_installed(robot) else {}


def is_installed(robot: RobotDescription) -> bool:
    """Whether the robot's URDF, and that of a mounted gripper, are named as `package:path`."""
    return _names_packages(robot.text)


@lru_cache(maxsize=4)
def _names_packages(text: str) -> bool:
    data = read_document(Path("robot.yaml"), "robot", text).data
    mount = data.get("mount")
    named = [str(data.get("urdf"))]
    if isinstance(mount, dict):
        named.append(str(mount.get("urdf")))
    return all(":" in each for each in named)


def robot_meshes(urdf: str) -> tuple[tuple[str, Path], ...]:
    """Return all meshes that a URDF names, visual and collision, with their materials, each once: name in
    the log, file."""
    drawn = set(mesh_paths(urdf))
    named = sorted((path, name) for path, name in _references(urdf) if path in drawn)
    return tuple(dict(both for path, name in named for both in with_materials(name, Path(path))).items())


def plain_reference(filename: str) -> str:
    """Return a mesh's name in a URDF as a path that stays inside its folder."""
    for prefix in ("package://", "file://"):
        filename = filename.removeprefix(prefix)
    parts = [p for p in posixpath.normpath(filename.replace("\\", "/")).split("/") if p not in ("", ".")]
    return "/".join("up" if part == ".." else part for part in parts)


def _references(urdf: str) -> Iterator[tuple[str, str]]:
    for mesh in parsed_urdf(Path(urdf)).iter("mesh"):
        filename = mesh.get("filename", "")
        if (file := mesh_file(Path(urdf), filename)) is not None:
            yield str(file), f"{ROBOT_MESHES}{plain_reference(filename)}"


@lru_cache(maxsize=4)
def _hashed_meshes(urdf: str) -> Mapping[str, str]:
    return {
        name: f"{hashlib.sha256(file.read_bytes()).hexdigest()} {file}" for name, file in robot_meshes(urdf)
    }


@dataclass(frozen=True, slots=True)
class Recording:
    """Place and size of a run's log."""

    out: Path | None = None
    """Folder in which the run's folder is made; None: `runs`."""
    rotation: Rotation = NO_ROTATION
    """Limits at which the log continues in a further file."""


@dataclass(frozen=True)
class RunRequest:
    """Request for a run: the files and settings that make its recipe, and where its log goes."""

    mission: Path
    scene: str | None = None
    """Name or path of the scene; None: the mission's own."""
    robot: str | None = None
    """Shipped robot or robot file; None: the scene's robot."""
    seed: int = 0
    parameters: Mapping[str, str] = field(default_factory=dict[str, str])
    faults: Path | None = None
    out: Path | None = None
    """Folder in which the run's folder is made; None: `runs`."""
    backend: Backend = "physics"
    verify: bool = False
    """Check every trajectory with the verifier, an independent collision checker."""
    limit: float = DEFAULT_TIME_LIMIT
    """Simulated seconds after which the run is ended."""
    watch: bool = False
    """Take over an edited mission between two items."""
    rotation: Rotation = NO_ROTATION
    """Limits at which the log continues in a further file."""


def read_recipe(request: RunRequest, mission: Mission | None = None) -> Recipe:
    """Read and check the files of a request. Raises PicktreeError (FileError with all faults).

    `mission` replaces the request's file, which need not be there.
    """
    mission = mission or load_mission(request.mission, NodeRegistry())
    wanted = request.scene or mission.scene
    if wanted is None:
        raise PicktreeError(f"{request.mission}: the mission names no scene; add 'scene:' or give --scene")
    beside = Path.cwd() if request.scene else request.mission.parent
    scene = load_scene(wanted, beside)
    wanted_robot = (request.robot, Path.cwd()) if request.robot else (scene.robot, Path(scene.source).parent)
    robot = load_robot(*wanted_robot)
    return Recipe(
        mission,
        scene,
        robot,
        request.seed,
        load_faults(request.faults, scene, robot) if request.faults else None,
        request.parameters,
        request.backend,
        request.verify,
        request.limit,
        own_scene=request.scene is None,
    )


_MAX_MISSION_BYTES = 200
"""Maximum length of the mission in the name of a run's folder, bytes."""


def make_folder(out: Path | None, mission: str, seed: int) -> Path:
    """Make a new folder for the run in `out`, by default `runs`. Raises PicktreeError when it cannot be
    made."""
    parent = out or Path("runs")
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    stem = f"{fitted(mission, _MAX_MISSION_BYTES)}-{seed}-{stamp}"
    for number in range(1000):
        folder = parent / (stem if number == 0 else f"{stem}-{number}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            if not parent.is_dir():
                raise PicktreeError(f"{parent} is a file; --out takes a folder for runs") from None
            continue
        except OSError as error:
            raise PicktreeError(f"the folder {folder} cannot be made: {error.strerror}") from None
        return folder
    raise PicktreeError(f"{parent} has no room for another run named {stem}")
