"""A saved state of the physical simulation: numbers and names only, exact in JSON, no pickle."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

from ...errors import PicktreeError
from ...world.scene.description import Fixture
from ...world.values import ObjectId, Quaternion, Vector3
from ..feed.belt_drive import BeltState
from ..feed.feeder import FeederState
from ..spawning.inventory import InventoryState


@dataclass(frozen=True, slots=True)
class BodyState:
    """An item's pose and velocities in the world."""

    id: ObjectId
    position: Vector3
    orientation: Quaternion
    velocity: Vector3
    spin: Vector3
    present: bool
    asleep: bool = False
    """It has come to rest, and nothing near it moves."""


@dataclass(frozen=True, slots=True)
class ArmCommand:
    """What the arm was last told: `follow` with position and velocity, or `torque`. Each (n,)."""

    mode: Literal["follow", "torque"]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    torque: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class GripperCommand:
    """Opening, m, force a finger, N, and speed of each, m/s; without one as fast as it can."""

    width: float
    force: float
    speed: float | None = None


@dataclass(frozen=True, slots=True)
class RobotReading:
    """What the noise-free sensors said after the last step; the arm's joints first, then the fingers'."""

    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]
    wrench: tuple[float, ...]
    """Force and torque on the wrist in the world's axes, (6,)."""
    turn: Quaternion = (0.0, 0.0, 0.0, 1.0)
    """Orientation of the wrist sensor in the world."""


@dataclass(frozen=True, slots=True)
class PressedItem:
    """The greatest force of a finger on a fragile item so far, and what it survives, N."""

    id: ObjectId
    force: float
    limit: float
    gripped: float = 0.0
    """The greatest while the fingers were told to close."""


@dataclass(frozen=True, slots=True)
class DynamicsChange:
    """An entry of the ledger: what a fault changed on an item for good."""

    item: ObjectId
    friction: float | None = None
    mass: float | None = None
    scale: float | None = None
    """How many times as large as before it was made."""


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Everything in the simulation that the future depends on, besides scene, robot and seed."""

    seed: int
    step: int
    captures: Mapping[str, int]
    arm: ArmCommand
    gripper: GripperCommand
    robot: RobotReading
    items: tuple[BodyState, ...]
    """All that did not leave with a bin, in the order of their numbers."""
    initial: tuple[BodyState, ...]
    ledger: tuple[DynamicsChange, ...]
    belts: tuple[BeltState, ...] = ()
    inventory: InventoryState | None = None
    """What came after the beginning and what left; None when nothing did, as in older logs."""
    feeder: FeederState | None = None
    obstacles: tuple[Fixture, ...] | None = None
    """What stands there that the robot was not told of; None: what the scene has, as in older logs."""
    pressed: tuple[PressedItem, ...] = ()
    """Fragile items that were between the fingers."""
    time: int | None = None
    """Since time 0, in parts of a second (`pace.RESOLUTION`); None: all steps were of the everyday length."""

    def require_fit(self, seed: int, spawned: list[ObjectId], cameras: Iterable[str]) -> None:
        """Raise PicktreeError when the run has another seed, other initial items or other cameras."""
        if self.seed != seed:
            raise PicktreeError(f"the checkpoint is of seed {self.seed}, but this run has seed {seed}")
        if (ids := [s.id for s in self.initial]) != spawned:
            raise PicktreeError(f"the checkpoint's initial items are {ids}, but the scene spawns {spawned}")
        if sorted(self.captures) != sorted(cameras):
            raise PicktreeError(
                f"the checkpoint's cameras are {sorted(self.captures)}, but the scene has {sorted(cameras)}"
            )

    def to_plain(self) -> dict[str, Any]:
        """As JSON knows it. Floats survive exactly."""
        return _adapter().dump_python(self, mode="json")

    @classmethod
    def from_plain(cls, plain: object) -> Checkpoint:
        """Raises PicktreeError when this is no checkpoint of the simulation."""
        try:
            return _adapter().validate_python(plain)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"])
            raise PicktreeError(f"no checkpoint of the simulation: {where}: {first['msg']}") from None


@cache  # built on first use: a run needs that of its own backend only
def _adapter() -> TypeAdapter[Checkpoint]:
    return TypeAdapter(Checkpoint)
