"""Thresholds of a contact in a joint-impedance motion, and the result of such a motion."""

from __future__ import annotations

from dataclasses import dataclass

from ...world.causes import Failure
from ...world.values import Vector3


@dataclass(frozen=True, slots=True)
class ContactThresholds:
    """What counts as a contact, beyond what is felt without one."""

    torque: float
    """External torques of all joints, Euclidean norm, Nm: felt wherever on the arm it acts."""
    force: float
    """At the wrist, N."""


@dataclass(frozen=True, slots=True)
class JointImpedanceResult:
    """How a soft motion ended, at rest."""

    completed: bool
    progress: float
    """Of the trajectory, s."""
    touched: bool
    """Something was in the way: the arm gave way to it, and stands."""
    torque: float
    """The greatest external torque that was met, Nm."""
    force: float
    """The greatest force at the wrist that was met, N."""
    push: Vector3 = (0.0, 0.0, 0.0)
    """How what was touched pushed at the hand, N in the world; nothing where it touched another part."""
    noticed: Failure | None = None
    """Why it was stopped, where `watch` said so."""
