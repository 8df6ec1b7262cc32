"""Checkpoint of the physics backend: numbers and names only, exact in JSON, no pickle."""

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
    """Whether the item is at rest with nothing moving near it, so that the engine skips it."""


@dataclass(frozen=True, slots=True)
class ArmCommand:
    """Last command to the arm: `follow` with position and velocity, or `torque`. Arrays (n,), rad, rad/s,
    Nm."""

    mode: Literal["follow", "torque"]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    torque: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class GripperCommand:
    """Command to the gripper: opening, m, force of each finger, N, and speed of each finger, m/s; None: full
    speed."""

    width: float
    force: float
    speed: float | None = None


@dataclass(frozen=True, slots=True)
class RobotReading:
    """Noise-free sensor readings after the last step; the arm's joints first, then the fingers'."""

    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]
    wrench: tuple[float, ...]
    """Force and torque on the wrist in the world's axes, (6,), N and Nm."""
    turn: Quaternion = (0.0, 0.0, 0.0, 1.0)
    """Orientation of the wrist sensor in the world."""


@dataclass(frozen=True, slots=True)
class PressedItem:
    """Greatest force of a finger on a fragile item so far, and the force that the item survives, N."""

    id: ObjectId
    force: float
    limit: float
    gripped: float = 0.0
    """Greatest force while the fingers had the command to close, N."""


@dataclass(frozen=True, slots=True)
class DynamicsChange:
    """Entry of the ledger: permanent change of an item by a fault."""

    item: ObjectId
    friction: float | None = None
    mass: float | None = None
    scale: float | None = None
    """Factor by which the fault scaled the item's size."""


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Complete state of the physics backend, besides scene, robot and seed."""

    seed: int
    step: int
    captures: Mapping[str, int]
    arm: ArmCommand
    gripper: GripperCommand
    robot: RobotReading
    items: tuple[BodyState, ...]
    """Items that did not leave with a bin, in the order of their numbers."""
    initial: tuple[BodyState, ...]
    ledger: tuple[DynamicsChange, ...]
    belts: tuple[BeltState, ...] = ()
    inventory: InventoryState | None = None
    """Items that came after the start or left; None when there are none, as in older logs."""
    feeder: FeederState | None = None
    obstacles: tuple[Fixture, ...] | None = None
    """Obstacles that the robot does not know; None: those of the scene, as in older logs."""
    pressed: tuple[PressedItem, ...] = ()
    """Fragile items that have been between the fingers."""
    time: int | None = None
    """Time since time 0, in units of 1/`engine.RESOLUTION` s; None: all steps had the everyday length."""

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
        """Return the checkpoint as JSON types. Floats survive exactly."""
        return _adapter().dump_python(self, mode="json")

    @classmethod
    def from_plain(cls, plain: object) -> Checkpoint:
        """Read a checkpoint from JSON types. Raises PicktreeError when they are no checkpoint of the
        simulation."""
        try:
            return _adapter().validate_python(plain)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"])
            raise PicktreeError(f"no checkpoint of the simulation: {where}: {first['msg']}") from None


@cache  # built on first use: a run needs that of its own backend only
def _adapter() -> TypeAdapter[Checkpoint]:
    return TypeAdapter(Checkpoint)
