"""Recipe of a run: mission, scene, robot, seed and settings, independent of their source. Sources are files
on the disk, a log, or an archive.

A `RunRequest` names the files; `read_recipe` reads and checks them.

`Unpacking` unpacks the files of a recipe from a log or an archive into a folder for the usual loaders.
"""

from __future__ import annotations

import hashlib
import io
import os
import tempfile
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, assert_never, cast

from pydantic import TypeAdapter, ValidationError

from picktree.files import PicktreeError, file_system
from picktree.files.yaml import read_document
from picktree.logs import log_files, log_records
from picktree.simulation import Backend, NominalPart, fault_entries, load_faults, parse_faults
from picktree.trees import Mission, Plugin, RecordedFiles, name_of
from picktree.trees.loading import NodeRegistry, load_surroundings, parse_mission
from picktree.world import CompoundMesh, StreamVariant, convex_decomposition, mesh_reader
from picktree.world.robot_model import RobotDescription, load_robot, urdf_parser
from picktree.world.scene import SceneDescription, load_scene

from .cell_unpacking import (
    ASSORTMENT_MESHES,
    ROBOT_MESHES,
    CellUnpacking,
    beside,
    inside_name,
    plain_reference,
    scene_mesh_names,
    yaml_text,
)
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


ROBOT_BACKEND: Final = "robot"
"""Backend in the log of a run on a robot."""
DEFAULT_TIME_LIMIT = 3600.0
"""Default limit of a run, simulated s."""


@dataclass(frozen=True, slots=True)
class StartCheckpoint:
    """Checkpoint from which a run resumes."""

    state: RunState
    continues: log_records.ResumedFrom
    """Run that the checkpoint belongs to."""
    adopt: bool = False
    """Whether the mission differs from the saved one: nodes that match keep their state, the others start
    afresh."""
    changed: tuple[str, ...] = ()
    """Names of the parameters that have other values now. Running nodes read them once more."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """Complete input of a run, read and checked. Two runs of the same recipe are the same."""

    mission: Mission
    scene: SceneDescription
    robot: RobotDescription
    seed: int = 0
    faults: fault_entries.FaultFile | None = None
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
    robot_at: str = ""
    """Address of the robot's process, see `drivers`; empty: a simulation."""
    speed: float = 1.0
    """Share of the joints' speeds and accelerations that a robot may use."""
    perception_at: str = ""
    """Address of the process that recognises items for a robot; empty: they are recognised by colour."""
    shadow: bool = False
    """Read the robot and send it nothing: a predicted arm carries the mission out."""
    variant: StreamVariant | None = None
    """Other noise of the simulated sensors and other planner seeds; None: those of the seed."""
    nominal: tuple[NominalPart, ...] = ()
    """Parts of the simulation that no fault affects, from the start of the run or its checkpoint on."""


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
    """Yield the files that a scene names: meshes, and folders of meshes as archives.

    A mesh is `mesh/hexagon.obj`, or `mesh/KIND/hexagon.obj` where two share a name. Files whose content is
    already in the text (`base`), or that have an attachment of their own (`robot`), are left out.
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
                yield Attachment(
                    convex_decomposition.parts_name(name, shape.scale),
                    convex_decomposition.parts_text(shape, content),
                    "model/mesh",
                )


def with_materials(name: str, mesh: Path) -> Iterator[tuple[str, Path]]:
    """Yield name and file of a mesh, and of the libraries of materials that it names."""
    yield name, mesh
    if mesh.suffix.lower() == ".obj":
        for library, file in mesh_reader.material_files(mesh.read_bytes(), mesh.parent).items():
            yield beside(name, os.fsdecode(library)), file


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
    drawn = set(urdf_parser.mesh_paths(urdf))
    named = sorted((path, name) for path, name in _references(urdf) if path in drawn)
    return tuple(dict(both for path, name in named for both in with_materials(name, Path(path))).items())


def _references(urdf: str) -> Iterator[tuple[str, str]]:
    for mesh in urdf_parser.parsed_urdf(Path(urdf)).iter("mesh"):
        filename = mesh.get("filename", "")
        if (file := urdf_parser.mesh_file(Path(urdf), filename)) is not None:
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
    rotation: log_files.Rotation = log_files.NO_ROTATION
    """Limits at which the log continues in a further file."""


@dataclass(frozen=True)
class RunRequest:
    """Request for a run: the files and settings of its recipe, and the folder of its log."""

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
    rotation: log_files.Rotation = log_files.NO_ROTATION
    """Limits at which the log continues in a further file."""
    robot_at: str = ""
    """Address of the robot's process, see `drivers`; empty: a simulation."""
    speed: float = 1.0
    """Share of the joints' speeds and accelerations that a robot may use."""
    perception_at: str = ""
    """Address of the process that recognises items for a robot; empty: they are recognised by colour."""
    shadow: bool = False
    """Read the robot and send it nothing: a predicted arm carries the mission out."""
    confirm: bool = False
    """Ask the interrupters before each motion of the arm, as for help; without their yes the run ends."""


def read_recipe(request: RunRequest, mission: Mission | None = None) -> Recipe:
    """Read and check the files of a request. Raises PicktreeError (FileError with all faults).

    `mission` replaces the request's file, which need not be there.
    """
    mission = mission or _checked_mission(request)
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
        robot_at=request.robot_at,
        speed=request.speed,
        perception_at=request.perception_at,
        shadow=request.shadow,
    )


def _checked_mission(request: RunRequest) -> Mission:
    """Return the request's mission without errors for its scene and robot, those of the linter included.

    Names of scene and robot are left to the run where settings may replace them.
    """
    from picktree.authoring import check_mission  # a run from a log needs no check

    known = load_surroundings(request.scene, robot=request.robot) if request.scene else None
    check = check_mission(read_document(request.mission, "mission"), NodeRegistry(), known, request.robot)
    if request.parameters:
        check = replace(check, faults=tuple(fault for fault in check.faults if fault.code != "P240"))
    return check.required()


_MAX_MISSION_BYTES = 200
"""Maximum length of the mission in the name of a run's folder, bytes."""


def make_folder(out: Path | None, mission: str, seed: int) -> Path:
    """Make a new folder for the run in `out`, by default `runs`. Raises PicktreeError when it cannot be
    made."""
    parent = out or Path("runs")
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    stem = f"{file_system.fitted(mission, _MAX_MISSION_BYTES)}-{seed}-{stamp}"
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


class Unpacking(CellUnpacking):
    """Reader of all files of one run, from its log or from the recipe of a batch."""

    def recipe(self, seed: int, start: StartCheckpoint | None = None) -> Recipe:
        """Return the recipe with that seed, and the checkpoint from which it starts."""
        info, backend = self._info, self._info.backend
        if backend == ROBOT_BACKEND:
            raise PicktreeError(
                f"{self._log.path}: the run was on a robot, whose sensors cannot be computed again; "
                "`explain`, `report` and `replay` read its log"
            )
        if backend not in ("physics", "kinematic"):
            raise PicktreeError(f"{self._log.path}: the log is of the unknown backend {backend!r}")
        return Recipe(
            self.mission(),
            self.scene(),
            self.robot(),
            seed,
            self.faults(),
            dict(info.parameters),
            backend,
            info.verify,
            DEFAULT_TIME_LIMIT if info.limit is None else info.limit,
            info.own_scene,
            start,
            {name: words.partition(" ")[2] for name, words in info.files.items()},
            variant=info.variant,
            nominal=tuple(map(NominalPart.from_words, info.nominal)),
        )

    def mission(self, edit: str = "") -> Mission:
        """Return the mission with its includes and plug-ins. `edit`: folder in the log of an edited
        version."""
        prefix = f"{edit}/" if edit else ""
        folder = self._folder / "mission"
        text = self._text(f"{prefix}mission.yaml")
        includes = {name: self._text(at) for name, at in self._below(f"{prefix}include/")}
        for name, at in self._below(f"{prefix}plugin/"):
            self._put(folder / inside_name(name), self._log.attachment(at))
        path = folder / f"{self._stem('mission.yaml', self._info.mission)}.yaml"
        return parse_mission(text, path, files=RecordedFiles(includes, folder))

    def faults(self) -> fault_entries.FaultFile | None:
        if "faults.yaml" not in self._names:
            return None
        text = self._text("faults.yaml")
        path = self._folder / f"{self._stem('faults.yaml', 'faults')}.yaml"
        data = cast("dict[str, Any]", read_document(path, "faults", text).data)
        # The scene is named for the check alone, which the file has passed.
        named = data.pop("scene", None) is not None
        return replace(parse_faults(yaml_text(data) if named else text, path), text=text)


HEADER_NAME = "recipe.json"
_FILE_TIME = (1980, 1, 1, 0, 0, 0)
"""Time stamp of all files in an archive, so that equal recipes give equal archives."""


_HEADER_ADAPTER = TypeAdapter(log_records.RunInfo)


def write_recipe(recipe: Recipe, path: Path) -> None:
    """Write a recipe without its seed. Raises PicktreeError when the file cannot be written."""
    files = list(recipe_files(recipe))
    card = log_records.RunInfo(
        mission=recipe.mission.name,
        scene=recipe.scene.name,
        robot=recipe.robot.name,
        seed=None,
        backend=recipe.backend,
        parameters=dict(recipe.parameters),
        verify=recipe.verify,
        limit=recipe.limit,
        own_scene=recipe.own_scene,
        variant=recipe.variant,
        nominal=tuple(each.words() for each in recipe.nominal),
        files=fingerprints(recipe, files),
    )
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo(HEADER_NAME, _FILE_TIME), _HEADER_ADAPTER.dump_json(card, indent=1))
        for file in files:
            archive.writestr(zipfile.ZipInfo(file.name, _FILE_TIME), file.data, zipfile.ZIP_DEFLATED)
    with file_system.whole([path], path) as (beside,):
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
            raise PicktreeError(f"{path}: not a recipe of a batch, or a damaged recipe") from None
        self.attachments = tuple(name for name in self._archive.namelist() if name != HEADER_NAME)
        self._folder = tempfile.TemporaryDirectory(prefix="picktree-")

    def close(self) -> None:
        self._archive.close()
        self._folder.cleanup()

    def __enter__(self) -> RecipeFile:
        return self

    def __exit__(self, *_: object) -> None:
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
        return Unpacking(self, Path(self._folder.name)).recipe(seed)
