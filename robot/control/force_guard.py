"""Guards of motions against contact: a limit of force beyond a baseline, inertia taken off."""

from __future__ import annotations

import math

import numpy as np

from picktree.world import Array, JointState, Vector3, cross
from picktree.world.robot_model import RobotModel

from .wrist_wrench import WristWrench


def above_limit(force: float, limit: float) -> str:
    """Return the words for a contact force above the scene's limit, N; empty: it is within the limit."""
    return f", above the limit of {limit:.0f} N" if force > limit else ""


class ForceGuard:
    """Guard of a free motion: it stops at a contact force of `limit` N above the baseline."""

    def __init__(self, limit: float, baseline: Vector3) -> None:
        self.limit = limit
        self._baseline = baseline
        self.contact: Vector3 | None = None
        """Force that stopped the motion beyond the baseline, N in the world. None: no contact."""

    def size(self, force: Vector3) -> float:
        """Return the size of `force` beyond the baseline, N."""
        return math.dist(force, self._baseline)

    def touched(self, force: Vector3) -> bool:
        x, y, z = force
        bx, by, bz = self._baseline
        x, y, z = x - bx, y - by, z - bz
        if x * x + y * y + z * z <= self.limit * self.limit:
            return False
        self.contact = (x, y, z)
        return True


class ContactGuard:
    """Guard of the present motion, with the inertia of hand and payload taken off the wrist force."""

    def __init__(self, model: RobotModel, wrist: WristWrench, *, feels_effort: bool) -> None:
        """`feels_effort`: whether the hardware measures the joints' efforts."""
        self._model, self._wrist = model, wrist
        self._feels_effort = feels_effort
        self.guard: ForceGuard | None = None
        """Guard of the present motion; None: the motion has none."""

    def exceeded(self, force: Vector3) -> bool:
        """Return whether the wrist force, N, with all inertia in it, is above the limit of the present
        motion."""
        guard = self.guard
        return guard is not None and guard.size(force) > guard.limit

    def touched(self, state: JointState, acceleration: Array, force: Vector3) -> bool:
        """Return whether the present motion has met a contact; `force` is the wrist force, N.

        Drives that stop abruptly are no contact.
        """
        guard = self.guard
        if guard is None or not self.exceeded(force):
            return False
        return guard.touched(
            self._without_inertia(state, acceleration, force) if self._feels_effort else force
        )

    def _without_inertia(self, state: JointState, acceleration: Array, force: Vector3) -> Vector3:
        """Return the contact force on the hand, N: wrist force less that of the inertia of hand and load."""
        payload = self._wrist.payload
        mass = self._model.hand_mass + (0.0 if payload is None else payload.mass)
        jacobian, tcp = self._model.jacobian(state.position), self._model.tcp(state.position)
        flange = self._model.flange(state.position)
        arm = flange.rotation() @ np.array(self._model.hand_com)
        arm += np.array(flange.position) - np.array(tcp.position)
        linear, angular = np.split(jacobian @ acceleration, 2)
        x, y, z = (np.array(force) + mass * (linear + cross(angular, arm))).tolist()
        return (x, y, z)
