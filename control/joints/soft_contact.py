"""Thresholds of a contact in a joint-impedance motion, and the result of such a motion."""

from __future__ import annotations

from dataclasses import dataclass

from ...world.causes import Failure
from ...world.values import Vector3


@dataclass(frozen=True, slots=True)
class ContactThresholds:
    """Thresholds of a contact, beyond the readings without one."""

    torque: float
    """External torque of all joints, Euclidean norm, Nm. It shows contacts at any part of the arm."""
    force: float
    """Force at the wrist, N."""


@dataclass(frozen=True, slots=True)
class JointImpedanceResult:
    """Result of a joint-impedance motion, at rest."""

    completed: bool
    progress: float
    """Followed part of the trajectory, s."""
    touched: bool
    """Whether the arm touched something, gave way to it and stands."""
    torque: float
    """Greatest external torque, Nm."""
    force: float
    """Greatest force at the wrist, N."""
    push: Vector3 = (0.0, 0.0, 0.0)
    """Contact force on the hand, N in the world; zero for a contact at another part."""
    noticed: Failure | None = None
    """Failure from `watch` that stopped the motion. None: there was none."""
