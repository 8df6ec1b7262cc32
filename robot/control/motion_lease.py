"""Lease: the exclusive right to move the arm, held by its last acquirer."""

from __future__ import annotations

import math
from types import TracebackType
from typing import Protocol

import numpy as np

from picktree.files import PicktreeError
from picktree.world import Array, JointState, Vector3, cross
from picktree.world.robot_model import RobotModel

from .commands import Controller
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


class LeaseIssuer(Protocol):
    """Issuer of leases: the control loop."""

    def holds(self, lease: Lease) -> bool: ...
    def run(self, controller: Controller, guard: ForceGuard | None) -> None: ...
    def brake(self) -> None: ...
    def leave(self) -> None: ...


class Lease:
    """Lease on the arm from `ControlLoop.acquire`; as a context manager it is released on every exit.

    Release brakes the arm while the lease is valid. Release of a stale lease does nothing. When a new branch
    takes the arm before the old skill is halted, the old skill must not stop the new motion.
    """

    def __init__(self, lessor: LeaseIssuer, owner: str) -> None:
        self._lessor = lessor
        self.owner = owner

    @property
    def valid(self) -> bool:
        return self._lessor.holds(self)

    def run(self, controller: Controller, guard: ForceGuard | None = None) -> None:
        """Let `controller` move the arm from the next control period on."""
        if not self.valid:
            raise PicktreeError(f"{self.owner or 'a motion'} commands the arm, but another has taken it over")
        self._lessor.run(controller, guard)

    def release(self) -> None:
        if self.valid:
            self._lessor.brake()

    def hand_over(self) -> None:
        """Return the lease without braking: the controller goes on until another skill takes it over.

        The controller must brake by itself when none does (`TrajectoryController.hand_over`).
        """
        if not self.valid:
            raise PicktreeError(
                f"{self.owner or 'a motion'} hands its motion over, but another has taken it over"
            )
        self._lessor.leave()

    def __enter__(self) -> Lease:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()
