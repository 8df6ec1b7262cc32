"""What a run is made from, apart from where that came from: files on the disk, a log, or a plan."""

from __future__ import annotations

import hashlib
import posixpath
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Final, TypedDict

from ..errors import PicktreeError
from ..files.yaml.document import read_document
from ..logs.recording.rotation import NEVER, Rotation
from ..logs.schema.records import ResumedFrom
from ..robots.description import RobotDescription
from ..robots.loading import load_robot
from ..robots.mesh_files import mesh_file
from ..robots.urdf_tree import UrdfMesh, link_geometry
from ..simulation.backends import Backend
from ..simulation.fault_files.fault_entries import FaultFile
from ..simulation.fault_files.fault_loading import load_faults
from ..trees.loading.loader import load_mission
from ..trees.loading.registry import NodeRegistry
from ..trees.mission import Mission, Plugin, name_of
from ..world.scene.description import SceneDescription
from ..world.scene.loading.scene_loading import load_scene
from ..world.shapes import ConvexMesh
from .checkpoints import RunState


@dataclass(frozen=True, slots=True)
class Attachment:
    name: str
    content: str | bytes
    media_type: str
    source: Path | None = None
    """The file that it was read from."""

    @property
    def data(self) -> bytes:
        return self.content.encode() if isinstance(self.content, str) else self.content


def mission_files(mission: Mission) -> Iterator[Attachment]:
    """The mission, what it includes under the names by which it does so, and the sources of its plug-ins:
    `plugin/wave.py` lies beside it, `module/a.b.py` is installed."""
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
    """Versions of the distributions that its installed plug-ins come from, by name."""
    known = (plugin.distribution.rpartition(" ") for plugin in mission.sources if plugin.distribution)
    return {name: version for name, _, version in known}


def _name(plugin: Plugin, file: Path, folder: Path) -> str:
    if not plugin.name.endswith(".py"):
        return f"module/{plugin.name}.py"
    beside = file.is_relative_to(folder)
    return f"plugin/{file.relative_to(folder).as_posix() if beside else plugin.name}"


LIMIT = 3600.0
"""Simulated seconds after which a run is ended, unless told otherwise."""


@dataclass(frozen=True, slots=True)
class StartCheckpoint:
    """A checkpoint from which a run goes on."""

    state: RunState
    continues: ResumedFrom
    """Whose checkpoint it is."""
    adopt: bool = False
    """The mission is another than the one of which the state was saved: what fits goes on, the rest begins
    anew."""
    changed: tuple[str, ...] = ()
    """Parameters that are set otherwise now: who runs and had read them reads them again."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """Everything on which a run depends, read and checked. Two runs of the same recipe are the same."""

    mission: Mission
    scene: SceneDescription
    robot: RobotDescription
    seed: int = 0
    faults: FaultFile | None = None
    parameters: Mapping[str, str] = field(default_factory=dict[str, str])
    """As `--set` gives them."""
    backend: Backend = "physics"
    verify: bool = False
    """Judge every trajectory by the second, independent collision checker."""
    limit: float = LIMIT
    """Simulated seconds."""
    own_scene: bool = True
    """The scene is the one that the mission names, not another that was given."""
    start: StartCheckpoint | None = None
    """None: from the beginning."""
    paths: Mapping[str, str] = field(default_factory=dict[str, str])
    """Of a recipe from a log: where its files stood when they were first read, by name of the attachment."""


ROBOT_MESHES: Final = "robot/"
"""Where the meshes that a URDF names stand, each under the name that it has there."""


def recipe_files(recipe: Recipe) -> Iterator[Attachment]:
    """Mission, scene, robot and faults, with what they name.

    The meshes of a robot whose URDF is in an installed package are not among them: see `installed_meshes`.
    """
    yield from mission_files(recipe.mission)
    scene, robot = recipe.scene, recipe.robot
    yield Attachment("scene.yaml", scene.text, "application/yaml", Path(scene.source))
    yield from scene_meshes(scene)
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
    """SHA-256 and original path of each file, by the name that it has in the log."""
    found = {
        file.name: f"{hashlib.sha256(file.data).hexdigest()} {recipe.paths.get(file.name, file.source or '')}"
        for file in files
    }
    return {**found, **installed_meshes(recipe.robot)}


def scene_meshes(scene: SceneDescription) -> Iterator[Attachment]:
    """The meshes of the catalogue: `mesh/hexagon.obj`; with the kind before it where two have one name."""
    files = {e.kind: Path(e.shape.source) for e in scene.catalogue if isinstance(e.shape, ConvexMesh)}
    named = Counter(file.name for file in set(files.values()))
    given: set[str] = set()
    for kind, file in files.items():
        name = f"mesh/{file.name}" if named[file.name] == 1 else f"mesh/{kind}/{file.name}"
        if name not in given:
            given.add(name)
            yield Attachment(name, file.read_bytes(), "model/mesh", file)


def installed_meshes(robot: RobotDescription) -> Mapping[str, str]:
    """As `fingerprints`, of the meshes of a robot that comes with an installed package."""
    return _hashed_meshes(robot.urdf) if is_installed(robot) else {}


def is_installed(robot: RobotDescription) -> bool:
    """Whether its URDF, and that of a mounted gripper, are named as `package:path`."""
    data = read_document(robot.text, Path(robot.source), "robot").data
    mount = data.get("mount")
    named = [str(data.get("urdf"))]
    if isinstance(mount, dict):
        named.append(str(mount.get("urdf")))
    return all(":" in each for each in named)


def robot_meshes(urdf: str) -> tuple[tuple[str, Path], ...]:
    """All meshes that a URDF names, visual and collision, each once: name in the log, file."""
    named = dict(_references(urdf))
    found = [*link_geometry(urdf, "visual"), *link_geometry(urdf, "collision")]
    files = {g.path: Path(g.path) for g in found if isinstance(g, UrdfMesh)}
    return tuple((named[path], file) for path, file in sorted(files.items()) if path in named)


def plain_reference(filename: str) -> str:
    """The name of a mesh in a URDF as a path that leads nowhere else."""
    for prefix in ("package://", "file://"):
        filename = filename.removeprefix(prefix)
    parts = [p for p in posixpath.normpath(filename.replace("\\", "/")).split("/") if p not in ("", ".")]
    return "/".join("up" if part == ".." else part for part in parts)


def _references(urdf: str) -> Iterator[tuple[str, str]]:
    for mesh in ElementTree.parse(urdf).getroot().iter("mesh"):
        filename = mesh.get("filename", "")
        if (file := mesh_file(Path(urdf), filename)) is not None:
            yield str(file), f"{ROBOT_MESHES}{plain_reference(filename)}"


@lru_cache(maxsize=4)
def _hashed_meshes(urdf: str) -> Mapping[str, str]:
    return {
        name: f"{hashlib.sha256(file.read_bytes()).hexdigest()} {file}" for name, file in robot_meshes(urdf)
    }


@dataclass(frozen=True)
class RunRequest:
    """What is to be run, and how."""

    mission: Path
    scene: str | None = None
    """Instead of the mission's own."""
    robot: str | None = None
    """Shipped robot or robot file, instead of the scene's."""
    seed: int = 0
    parameters: Mapping[str, str] = field(default_factory=dict[str, str])
    faults: Path | None = None
    out: Path | None = None
    """Folder in which the run's folder is made; by default `runs`."""
    backend: Backend = "physics"
    verify: bool = False
    """Judge every trajectory by the second, independent collision checker."""
    limit: float = LIMIT
    """Simulated seconds."""
    watch: bool = False
    """Take over an edited mission between two items."""
    rotation: Rotation = NEVER
    """When the log goes on in a further file."""


class RunOptions(TypedDict, total=False):
    """The fields of `RunRequest` besides the mission, for `run`."""

    scene: str | None
    robot: str | None
    seed: int
    parameters: Mapping[str, str]
    faults: Path | None
    out: Path | None
    backend: Backend
    verify: bool
    limit: float
    watch: bool
    rotation: Rotation


def read_recipe(request: RunRequest) -> Recipe:
    """Read and check the files of a request. Raises PicktreeError (FileError with all faults)."""
    mission = load_mission(request.mission, NodeRegistry())
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


def make_folder(out: Path | None, mission: str, seed: int) -> Path:
    """A new folder for the run in `out`, by default `runs`. Raises PicktreeError when it cannot be made."""
    parent = out or Path("runs")
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    stem = f"{mission}-{seed}-{stamp}"
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
