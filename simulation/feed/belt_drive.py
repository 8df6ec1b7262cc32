"""How a belt is driven, whichever backend moves it: its place, its speed and ramps, its light barrier."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, replace

from ...errors import PicktreeError
from ...world.scene.description import Fixture
from ...world.scene.feed import Belt
from ...world.shapes import Box
from ...world.values import ObjectId, Pose, Vector3

ACCELERATION = 0.25
"""m/s², when it stops too. A ball or lying cylinder of radius r stays where it is on the belt as long as
g·c/r is more, c being its rolling friction: 0.49 m/s² at 1 mm and 20 mm. What stands would slip at g times
its friction only, and a can topple at g times its radius over half its height: ten times as much."""
BEAM_HEIGHT = 0.004
"""Of the light barrier over the belt, m: half a plate's thickness."""


@dataclass(frozen=True, slots=True)
class BeltState:
    """All of a belt that its future depends on."""

    id: ObjectId
    wanted: bool = False
    """Whether it is to run."""
    speed: float = 0.0
    """That its drive is told for the last step, m/s; it rises and falls by ramps."""
    travelled: float = 0.0
    """Since the run began, m."""
    offset: float = 0.0
    """How far its surface stands from its place, m; only physics has that."""

    @property
    def moving(self) -> bool:
        return self.wanted or self.speed > 0.0

    def after(self, top_speed: float, period: float) -> BeltState:
        """What the drive is told for one period more."""
        aim = top_speed if self.wanted else 0.0
        change = ACCELERATION * period
        speed = min(max(aim, self.speed - change), self.speed + change)
        return replace(self, speed=speed, travelled=self.travelled + speed * period)


@dataclass(frozen=True, slots=True)
class BeltSurface:
    """A belt's level top. `pose` is its middle, x along the way that items ride."""

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
        """In the world, m."""
        return self.pose.position[2]

    def at(self, along: float, across: float = 0.0, above: float = 0.0) -> Vector3:
        """The point in the world, m from the middle."""
        return (self.pose @ Pose((along, across, above))).position

    def beam(self, along: float) -> tuple[Vector3, Vector3]:
        """The ends of a light barrier that crosses it."""
        half = self.width / 2
        return self.at(along, -half, BEAM_HEIGHT), self.at(along, half, BEAM_HEIGHT)

    def place(self, point: Vector3) -> tuple[float, float]:
        """How far along and across from the middle the point lies, as seen from above, m."""
        along, across, _ = (self.pose.inverse() @ Pose(point)).position
        return along, across

    def carries(self, point: Vector3) -> bool:
        """Whether the point lies over it, as seen from above."""
        along, across = self.place(point)
        return abs(along) <= self.length / 2 and abs(across) <= self.width / 2


class BeltDrive(ABC):
    """One belt, as whoever feeds it sees it."""

    def __init__(self, belt: Belt, fixture: Fixture) -> None:
        self.belt = belt
        self.track = BeltSurface.of(fixture)
        self.state = BeltState(belt.id)

    @property
    def id(self) -> ObjectId:
        return self.belt.id

    @property
    def moving(self) -> bool:
        """Whether it runs, starts or stops; else it stands as still as a table."""
        return self.state.moving

    @property
    def travelled(self) -> float:
        """The way of its surface since the run began, m."""
        return self.state.travelled

    def go(self) -> None:
        """Start, if it does not run already."""
        self.state = replace(self.state, wanted=True)

    def halt(self) -> None:
        """Stop; it takes a moment."""
        self.state = replace(self.state, wanted=False)

    @abstractmethod
    def interrupted(self) -> bool:
        """Whether something is in the light barrier now."""


def check_belts(saved: Iterable[BeltState], belts: Iterable[ObjectId]) -> None:
    """Raises PicktreeError when a checkpoint is of other belts than the scene's."""
    names, known = [s.id for s in saved], list(belts)
    if names != known:
        raise PicktreeError(f"the checkpoint's belts are {names}, but the scene has {known}")
