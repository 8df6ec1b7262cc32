"""A whole candidate: one grasp, and one place that it leads to."""

from __future__ import annotations

from dataclasses import dataclass

from ...cell.handover import Landing
from ...planning.requests import Plan
from ...world.values import Array, ObjectId, Pose
from ..grasp.grasp_candidates import GraspCandidate


@dataclass(frozen=True, slots=True, eq=False)
class PickAndPlace:
    """A grasp and where the object goes from it, with the configurations (n,) rad that belong to it."""

    object: ObjectId
    grasp: GraspCandidate
    landing: Landing | None
    """None: no rule says where the object belongs."""
    object_in_tcp: Pose
    """As it will be held, if all is as believed."""
    over: Array
    """Above the grasp, where the straight way down begins."""
    at: Array
    """Where the fingers close."""
    above: Array | None
    """Over the landing; None without one."""
    cost: float
    """Lower is better, see `stream`."""
    approach: Plan
    """From where the arm is to the pre-grasp and straight down, as one motion."""
