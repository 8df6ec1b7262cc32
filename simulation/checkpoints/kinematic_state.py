"""Checkpoint of the kinematic backend: numbers and names only, exact in JSON."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

from pydantic import TypeAdapter, ValidationError

from ...errors import PicktreeError
from ...world.scene.description import Fixture
from ...world.values import ObjectId, Pose
from ..feed.belt_drive import BeltState
from ..feed.feeder import FeederState
from ..spawning.inventory import InventoryState


@dataclass(frozen=True, slots=True)
class ItemState:
    """Item in a checkpoint: pose in the world, and properties that faults can change."""

    id: ObjectId
    pose: Pose
    friction: float
    mass: float
    present: bool
    scale: float = 1.0
    """Scale by faults, as a multiple of the catalogue's size."""


@dataclass(frozen=True, slots=True)
class KinematicState:
    """Complete state of the kinematic backend, besides scene, robot and seed."""

    seed: int
    periods: int
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    width: float
    target: float
    force: float
    gripped: float
    item_in_tcp: Pose | None
    held: ObjectId | None
    items: tuple[ItemState, ...]
    """Items that did not leave with a bin, in the order of their numbers."""
    belts: tuple[BeltState, ...] = ()
    inventory: InventoryState | None = None
    """Items that came after the start or left; None when there are none, as in older logs."""
    feeder: FeederState | None = None
    obstacles: tuple[Fixture, ...] | None = None
    """Obstacles that the robot does not know; None: those of the scene, as in older logs."""

    def to_plain(self) -> dict[str, Any]:
        """Return the state as JSON types. Floats survive exactly."""
        return _adapter().dump_python(self, mode="json")

    @classmethod
    def from_plain(cls, plain: object) -> KinematicState:
        """Read a state from JSON types. Raises PicktreeError when they are no checkpoint of this backend."""
        try:
            return _adapter().validate_python(plain)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"])
            raise PicktreeError(f"no checkpoint of the kinematic backend: {where}: {first['msg']}") from None


@cache  # built on first use: a run needs that of its own backend only
def _adapter() -> TypeAdapter[KinematicState]:
    return TypeAdapter(KinematicState)
