"""What is to be run, how, and where its record goes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TypedDict

from ..errors import PicktreeError
from ..logs.recording.rotation import NEVER, Rotation
from ..robots.loading import load_robot
from ..simulation.backends import Backend
from ..simulation.fault_files.fault_loading import load_faults
from ..trees.loading.loader import load_mission
from ..trees.loading.registry import NodeRegistry
from ..world.scene.loading.scene_loading import load_scene
from .recipe import LIMIT, Recipe


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
