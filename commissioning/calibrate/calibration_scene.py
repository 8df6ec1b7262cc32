"""The scene of a calibration: without items, and with a target where it has none of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import yaml

from ...calibration.targets import targets
from ...errors import PicktreeError
from ...files.shipped_files import find_file
from ...perception.expectation.backdrop import table_of
from ...world.scene.description import SceneDescription
from ...world.scene.loading.scene_loading import SHIPPED, load_scene, parse_scene
from ...world.shapes import top
from ..plan_trial.target_syntax import quantity

NAME = "calibration_target"
SIZE = (0.18, 0.16, 0.05)
"""Of the target that is put there, m."""
YAW = math.radians(20.0)
"""How it is turned: edges that lie along a camera's rows of pixels are the worst that can be measured."""
CARELESS = (0.005, math.radians(2.0))
"""How far from its place whoever puts it there may put it, m and rad: where it stands is found out."""
AHEAD = 0.5
"""In front of the origin, where no area for items says better, m."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where a target is put, m and rad."""

    x: float
    y: float
    yaw: float = YAW


def parse_place(text: str) -> Place:
    """`0.5,0,20deg`: x and y, and the yaw if need be. Raises PicktreeError.

    >>> parse_place("500 mm,0")
    Place(x=0.5, y=0.0, yaw=0.3490658503988659)
    """
    parts = text.split(",")
    if len(parts) not in (2, 3):
        raise PicktreeError(f"--at {text}: write X,Y or X,Y,YAW, as in --at 0.5,0,20deg")
    x, y, *yaw = (quantity("--at", part.strip(), unit) for part, unit in zip(parts, ("m", "m", "rad")))  # noqa: B905
    return Place(x, y, yaw[0] if yaw else YAW)


def staged(name: str, place: Place | None) -> SceneDescription:
    """The scene without its items, and with one target more where it has none. It stands without `name`: its
    text is whole, for the log. Raises PicktreeError."""
    path = find_file(name, SHIPPED, Path.cwd(), "scene")
    scene = load_scene(name, Path.cwd())
    own: dict[str, object] = {"picktree": 1, "kind": "scene", "base": _base(path)}
    if scene.spawn:
        own["spawn"] = None
    if scene.deliveries:
        own["feed"] = None
    if not targets(scene.fixtures):
        own["fixtures"] = {NAME: _target(scene, place or _middle(scene))}
    beside = Path.cwd() if path.parent == SHIPPED else path.parent
    return parse_scene(yaml.safe_dump(own, sort_keys=False), beside / f"{path.stem}.yaml")


def _base(path: Path) -> str:
    return path.stem if path.parent == SHIPPED else str(path.resolve())


def _target(scene: SceneDescription, place: Place) -> dict[str, object]:
    table = table_of(scene)
    ground = 0.0 if table is None else top(table.shape, table.pose)
    return {
        "marker": list(SIZE),
        "at": [place.x, place.y, ground + SIZE[2] / 2],
        "yaw": place.yaw,
        "uncertainty": {"position": CARELESS[0], "angle": CARELESS[1]},
    }


def _middle(scene: SceneDescription) -> Place:
    """Of where items lie, for there cameras look and the arm reaches."""
    for load in scene.loads:
        (x0, y0), (x1, y1) = load.area
        return Place((x0 + x1) / 2, (y0 + y1) / 2)
    return Place(AHEAD, 0.0)
