"""Belt drive of both backends: surface, speed ramps, light barrier, and the state for checkpoints."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, replace

from ...files.errors import PicktreeError
from ...world.scene.description import Belt, Fixture
from ...world.shapes import Box
from ...world.values import ObjectId, Pose, Vector3

BELT_ACCELERATION = 0.25
"""Acceleration of a belt when it starts and stops, m/s².

A ball or lying cylinder of radius r stays in its place on the belt while g·c/r is greater. With rolling
friction c of 1 mm and r of 20 mm that is 0.49 m/s². A standing body would slip only at g times its friction.
A can topples only at g times its radius over half its height: ten times as much.
"""
BEAM_HEIGHT = 0.004
"""Height of the light barrier above the belt, m: half a plate's thickness."""


@dataclass(frozen=True, slots=True)
class BeltState:
    """Complete state of a belt."""

    id: ObjectId
    wanted: bool = False
    """Whether the belt has the command to run."""
    speed: float = 0.0
    """Commanded speed in the last step, m/s; it follows ramps."""
    travelled: float = 0.0
    """Travel of the surface since the run began, m."""
    offset: float = 0.0
    """Offset of the slab from its place, m; 0 without physics."""

    @property
    def moving(self) -> bool:
        return self.wanted or self.speed > 0.0

    def after(self, top_speed: float, period: float) -> BeltState:
        """Return the state one control period later."""
        aim = top_speed if self.wanted else 0.0
        change = BELT_ACCELERATION * period
        speed = min(max(aim, self.speed - change), self.speed + change)
        return replace(self, speed=speed, travelled=self.travelled + speed * period)


@dataclass(frozen=True, slots=True)
class BeltSurface:
    """Level top of a belt. `pose` is its middle in the world, with x along the direction of travel."""

    pose: Pose
    length: float
    width: float

    @classmethod
    def of(cls, fixture: Fixture) -> BeltSurface:
        assert isinstance(fixture.shape, Box)
        length, width, height = fixture.shape.size
        return cls(fixture.pose @ Pose((0.0, 0.0, height / 2)), length, width)

    @property
    def height(self) -> float:
        """Height of the surface in the world, m."""
        return self.pose.position[2]

    def at(self, along: float, across: float = 0.0, above: float = 0.0) -> Vector3:
        """Return the point in the world at an offset in m from the middle."""
        return (self.pose @ Pose((along, across, above))).position

    def beam(self, along: float) -> tuple[Vector3, Vector3]:
        """Return the ends in the world of a light barrier that crosses the belt at `along` m from the
        middle."""
        half = self.width / 2
        return self.at(along, -half, BEAM_HEIGHT), self.at(along, half, BEAM_HEIGHT)

    def place(self, point: Vector3) -> tuple[float, float]:
        """Return how far along and across from the middle a point in the world lies, seen from above, m."""
        along, across, _ = (self.pose.inverse() @ Pose(point)).position
        return along, across

    def carries(self, point: Vector3) -> bool:
        """Return whether a point in the world lies over the belt, seen from above."""
        along, across = self.place(point)
        return abs(along) <= self.length / 2 and abs(across) <= self.width / 2


class BeltDrive(ABC):
    """One belt as the feed sees it."""

    def __init__(self, belt: Belt, fixture: Fixture) -> None:
        self.belt = belt
        self.track = BeltSurface.of(fixture)
        self.state = BeltState(belt.id)

    @property
    def id(self) -> ObjectId:
        return self.belt.id

    @property
    def moving(self) -> bool:
        """Whether the belt runs, starts or stops."""
        return self.state.moving

    @property
    def travelled(self) -> float:
        """Travel of the surface since the run began, m."""
        return self.state.travelled

    def go(self) -> None:
        """Start the belt, if it does not run already."""
        self.state = replace(self.state, wanted=True)

    def halt(self) -> None:
        """Stop the belt by its ramp."""
        self.state = replace(self.state, wanted=False)

    @abstractmethod
    def interrupted(self) -> bool:
        """Return whether something interrupts the light barrier now."""


def check_belts(saved: Iterable[BeltState], belts: Iterable[ObjectId]) -> None:
    """Raise PicktreeError when a checkpoint is of other belts than the scene's."""
    names, known = [s.id for s in saved], list(belts)
    if names != known:
        raise PicktreeError(f"the checkpoint's belts are {names}, but the scene has {known}")
