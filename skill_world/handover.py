"""Handover between skills: a carried object and the motion that takes it to its release pose."""

from __future__ import annotations

from dataclasses import dataclass

from ..planning.requests import MotionPlan
from ..world.values import ObjectId, Pose


@dataclass(frozen=True, slots=True)
class PlaceCandidate:
    """Place candidate: release pose of an object over a bin."""

    into: ObjectId
    spot: str
    """Name of the bin's cell."""
    height: float
    """Height of the heap in this cell above the bin's floor, m."""
    above: Pose
    """Pose of the TCP in the world over the bin: start and end of all motions that are not straight lines."""
    drop: float
    """Straight way down from `above` to the pose in which the fingers open, m."""
    name: str = ""
    """Short description for the log."""

    @property
    def release(self) -> Pose:
        """Pose of the TCP in the world in which the fingers open."""
        return self.above.shifted((0.0, 0.0, -self.drop))


@dataclass(frozen=True, slots=True, eq=False)
class Handover:
    """Carried object and the motion to its release pose, which one skill leaves to the next."""

    object: ObjectId
    object_in_tcp: Pose
    landing: PlaceCandidate
    plan: MotionPlan
    """Lift, transfer and descent as one motion."""
    version: int
    """Belief version at the handover."""


class HandoverSlot:
    """Slot for at most one handover, which the next skill takes.

    It is no part of a checkpoint: those are taken with an empty hand and the arm at rest.
    """

    def __init__(self) -> None:
        self._left: Handover | None = None

    def leave(self, carriage: Handover) -> None:
        self._left = carriage

    def take(self) -> Handover | None:
        """Return the handover and empty the slot; None when it is empty."""
        left, self._left = self._left, None
        return left

    def drop(self) -> None:
        """Discard the handover."""
        self._left = None
