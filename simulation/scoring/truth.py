"""What is really there. Only the simulation's backends, the faults, the scorer and `/truth/*` may hold it."""

from __future__ import annotations

from dataclasses import dataclass

from ...world.scene.description import CatalogueEntry, Fixture, Form
from ...world.shapes import Shape
from ...world.values import ObjectId, Pose, Vector3
from .seats import Seat


@dataclass(frozen=True, slots=True)
class TrueBody:
    """An item as it really is."""

    id: ObjectId
    kind: str
    form: Form
    shape: Shape
    colour: str
    pose: Pose
    """In the world."""
    velocity: Vector3 = (0.0, 0.0, 0.0)
    """Of the centre, m/s."""
    spin: Vector3 = (0.0, 0.0, 0.0)
    """rad/s"""
    present: bool = True
    """False when a fault or somebody with its bin has taken it away; the pose is where it was last."""
    taken_with: ObjectId | None = None
    """The bin with which it left when that was exchanged."""
    crushed: float = 0.0
    """Force of a finger that it did not survive, N; 0 while it is whole."""
    brought_by: int | None = None
    """Which entry of the feed has brought it; None: it was there when the run began."""
    seat: Seat | None = None
    """How it is in a hole; None when it is in none."""

    @property
    def role(self) -> str:
        return "item"

    @classmethod
    def of(cls, item_id: ObjectId, entry: CatalogueEntry, colour: str, pose: Pose) -> TrueBody:
        """An item of the catalogue at rest at `pose`."""
        return cls(item_id, entry.kind, entry.form, entry.shape, colour, pose)


@dataclass(frozen=True, slots=True)
class TrueObstacle:
    """Something that the robot was not told of, as it really stands. No item: nobody scores it."""

    id: ObjectId
    shape: Shape
    colour: str
    pose: Pose
    """In the world."""

    @property
    def kind(self) -> str:
        return "unknown"

    @property
    def form(self) -> str:
        return "unknown"

    @property
    def role(self) -> str:
        return "obstacle"

    @classmethod
    def of(cls, body: Fixture) -> TrueObstacle:
        return cls(body.id, body.shape, body.colour, body.pose)
