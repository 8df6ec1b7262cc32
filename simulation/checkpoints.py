"""Checkpoints of the two backends: numbers and names only, exact in JSON, no pickle."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal, TypeAlias, TypeVar, cast

import orjson
from pydantic import TypeAdapter, ValidationError

from picktree.files import PicktreeError
from picktree.world import GripperCommand, ObjectId, Pose, Quaternion, Vector3
from picktree.world.scene import Fixture

from .belt_feed import BeltState
from .feeder import FeederState
from .inventory import SavedInventory

Backend: TypeAlias = Literal["physics", "kinematic"]
"""Name of a simulation backend."""


def json_bytes(value: object) -> bytes:
    """Encode dataclasses, tuples and mappings as JSON. Floats survive exactly.

    A pydantic adapter would take 20 ms to build; only reading needs one.
    """
    return orjson.dumps(value, _plain_container, orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_NON_STR_KEYS)


def json_values(value: object) -> Any:
    """Return dataclasses, tuples and mappings as JSON types. Floats survive exactly."""
    return orjson.loads(json_bytes(value))


def _plain_container(value: object) -> dict[object, object] | list[str]:
    if isinstance(value, Mapping):
        return dict(cast("Mapping[object, object]", value))
    if isinstance(value, frozenset | set):
        return sorted(cast("set[str]", value))
    raise TypeError(f"{type(value).__name__} has no place in a checkpoint")


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
    """Greatest force while the fingers had the command to close, N; other forces were bumps."""

    @property
    def crushed(self) -> bool:
        return self.force > self.limit


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
    inventory: SavedInventory = None
    """Items that came after the start or left; None without such items, as in older logs."""
    feeder: FeederState | None = None
    obstacles: tuple[Fixture, ...] | None = None
    """Obstacles that are unknown to the robot; None: those of the scene, as in older logs."""
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

    def to_plain(self, departed: int = 0) -> dict[str, Any]:
        """Return the checkpoint as JSON types, without the first `departed` items that left. Floats survive
        exactly."""
        return json_values(replace(self, inventory=self.inventory and self.inventory.since(departed)))

    @classmethod
    def from_plain(cls, plain: object) -> Checkpoint:
        """Read a checkpoint from JSON types. Raises PicktreeError when they are no checkpoint of the
        simulation."""
        return _validated(cls, plain, "the simulation")


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
    inventory: SavedInventory = None
    """Items that came after the start or left; None without such items, as in older logs."""
    feeder: FeederState | None = None
    obstacles: tuple[Fixture, ...] | None = None
    """Obstacles that are unknown to the robot; None: those of the scene, as in older logs."""

    def to_plain(self, departed: int = 0) -> dict[str, Any]:
        """Return the state as JSON types, without the first `departed` items that left. Floats survive
        exactly."""
        return json_values(replace(self, inventory=self.inventory and self.inventory.since(departed)))

    @classmethod
    def from_plain(cls, plain: object) -> KinematicState:
        """Read a state from JSON types. Raises PicktreeError when they are no checkpoint of this backend."""
        return _validated(cls, plain, "the kinematic backend")


T = TypeVar("T")


def _validated(kind: type[T], plain: object, of: str) -> T:
    adapter: TypeAdapter[T] = _adapter(kind)
    try:
        return adapter.validate_python(plain)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise PicktreeError(f"not a valid checkpoint of {of}: {where}: {first['msg']}") from None


@cache  # built on first use: a run needs that of its own backend only
def _adapter(kind: type[Any]) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


@dataclass(frozen=True, slots=True)
class RestSnapshot:
    """Snapshot of a simulation in which nothing moves, and the arm's configuration in it."""

    plain: dict[str, Any]
    """Plain values of the checkpoint, as `build_hardware` takes them."""
    position: tuple[float, ...]
    """Configuration of the arm, rad."""


def snapshot_at_rest(backend: Backend, snapshot: Mapping[str, Any], joints: int) -> RestSnapshot:
    """Return a snapshot with all velocities set to zero. The arm has `joints` joints and holds its
    configuration; the fingers keep their last command.

    Raises PicktreeError when `snapshot` is no checkpoint of the backend.
    """
    if backend == "kinematic":
        stood = KinematicState.from_plain(snapshot)
        return RestSnapshot(
            replace(stood, velocity=tuple(0.0 for _ in stood.velocity)).to_plain(), stood.position
        )
    saved = Checkpoint.from_plain(snapshot)
    position = saved.robot.position[:joints]
    still = replace(
        saved,
        arm=ArmCommand("follow", position, (0.0,) * joints, ()),
        robot=replace(saved.robot, velocity=tuple(0.0 for _ in saved.robot.velocity)),
        items=tuple(replace(item, velocity=(0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0)) for item in saved.items),
    )
    return RestSnapshot(still.to_plain(), position)
