"""What one skill leaves to the next: an object on its way to where it belongs, in a hand that moves."""

from __future__ import annotations

from dataclasses import dataclass

from ..planning.requests import MotionPlan
from ..world.values import ObjectId, Pose


@dataclass(frozen=True, slots=True)
class PlaceCandidate:
    """Where an object is let go over a bin."""

    into: ObjectId
    spot: str
    """Name of the bin's cell."""
    height: float
    """Of the heap there above the bin's floor, m."""
    above: Pose
    """TCP in the world over the bin, where all motions end and begin that are not straight."""
    drop: float
    """Straight down from there to where the fingers open, m."""
    name: str = ""
    """In a few words, for the record."""

    @property
    def release(self) -> Pose:
        """TCP in the world where the fingers open."""
        return self.above.shifted((0.0, 0.0, -self.drop))


@dataclass(frozen=True, slots=True, eq=False)
class Handover:
    """An object that is carried to its landing by a motion that was handed over."""

    object: ObjectId
    object_in_tcp: Pose
    landing: PlaceCandidate
    plan: MotionPlan
    """Lift, transfer and the way down as one motion."""
    version: int
    """Of the belief that it was handed over in."""


class HandoverSlot:
    """At most one carriage, for the skill that comes next.

    It is no part of a checkpoint: those are taken with an empty hand and the arm at rest.
    """

    def __init__(self) -> None:
        self._left: Handover | None = None

    def leave(self, carriage: Handover) -> None:
        self._left = carriage

    def take(self) -> Handover | None:
        """What was left, once."""
        left, self._left = self._left, None
        return left

    def drop(self) -> None:
        """Nothing is on its way any more."""
        self._left = None
