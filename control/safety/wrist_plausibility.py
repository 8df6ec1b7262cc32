"""Plausibility of the wrist sensor: the joints' efforts check its bias, the payload and contacts."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from ...robots.model import RobotModel
from ...world.events.skill_events import WristBiasEvent
from ...world.values import GRAVITY, Array, JointState, Vector3
from ..joints.external_torque import MIN_EXPLAINED_SHARE, EffortCheck
from ..wrist.wrist_wrench import MAX_BIAS_STEP, MAX_QUIET_DEVIATION, WristWrench
from .motion_lease import ForceGuard
from .safety_monitor import SafetyMonitor

WRIST_WINDOW = 0.1
"""Time over which the wrist is read for a tare or a load, s."""


class WristPlausibility:
    """Cross-check of wrist sensor and joint efforts, for the safety monitor."""

    def __init__(
        self, model: RobotModel, monitor: SafetyMonitor, wrist: WristWrench, *, feels_effort: bool
    ) -> None:
        """`feels_effort`: whether the hardware measures the joints' efforts."""
        self._model = model
        self._monitor = monitor
        self._wrist = wrist
        self._feels_effort = feels_effort
        self._efforts = EffortCheck(model)
        self.doubts_wrist = False
        """Whether the joints' efforts contradict the wrist sensor."""

    def contact(
        self, state: JointState, velocity: Array, period: float, force: Vector3, guard: ForceGuard
    ) -> Vector3:
        """Return the contact force on the hand, N: the wrist force without the inertia of hand and payload.

        It is computed only where the wrist force exceeds the guard's limit. Drives that stop abruptly are no
        contact.
        """
        if guard.size(force) <= guard.limit or not self._feels_effort:
            return force
        payload = self._wrist.payload
        mass = self._model.hand_mass + (0.0 if payload is None else payload.mass)
        jacobian, tcp = self._model.jacobian(state.position), self._model.tcp(state.position)
        arm = self._model.flange(state.position).rotation() @ np.array(self._model.hand_com)
        arm += np.array(self._model.flange(state.position).position) - np.array(tcp.position)
        linear, angular = np.split(jacobian @ ((state.velocity - velocity) / period), 2)
        x, y, z = (np.array(force) + mass * (linear + np.cross(angular, arm))).tolist()
        return (x, y, z)

    def come_to_rest(self, state: JointState) -> None:
        """Learn the bias when the arm has just come to rest, if there is none or it is in doubt."""
        if not self._wrist.zeroed:
            # A run begins with an empty hand in free space.
            self._wrist.zero(WRIST_WINDOW, state.position)
        elif self._monitor.pressed or self.doubts_wrist:
            self.doubts_wrist = not self.learn_bias(state)

    def learn_bias(self, state: JointState) -> bool:
        """Learn the bias as `WristWrench.zero`.

        A wrench that the joints do not carry is bias, however large.
        """
        before = self._wrist.force
        anew = self._wrist.zeroed
        learnt = self._wrist.zero(WRIST_WINDOW, state.position, partial(self._borne, state))
        by = math.dist(before, self._wrist.force)
        if learnt and anew and by > MAX_BIAS_STEP:
            self._monitor.forget_efforts()
            words = (
                f"the wrist felt {by:.1f} N that no joint carries: its bias has jumped, and is learnt anew"
            )
            self._monitor.note(WristBiasEvent(words, force=by))
        return learnt

    def _borne(self, state: JointState, claimed: Array) -> bool:
        """Return whether the joints, at rest, carry the wrench (6,) that the wrist reads beyond the
        payload."""
        return self._efforts.believes(state, claimed, self._known_load(state))

    def check_load(self, state: JointState) -> bool:
        """Check the payload at rest, and return whether a stop was latched. A bias that has jumped is learnt
        first."""
        mass = -self._wrist.force[2] / GRAVITY
        doubtful = self._monitor.overburdened(mass) and self._feels_effort
        if doubtful and (self._wrist.unrest(WRIST_WINDOW) > MAX_QUIET_DEVIATION or self.learn_bias(state)):
            return False
        return self._monitor.check_load(mass)

    def check_efforts(self, state: JointState, acceleration: Array, elapsed: float) -> bool:
        if self._monitor.blind:
            # A retreat is slow: the hand's inertial force is small against the limit.
            left = self._without_wrist(state, acceleration)
            return self._monitor.check_efforts(self._monitor.explained(left, elapsed))
        turn = self._model.tcp(state.position).rotation()
        left = self._efforts.unexplained(state, acceleration, self._wrist.unbiased(turn))
        explained = self._monitor.explained(left, elapsed)
        if not explained and self._doubtful(state, acceleration, left):
            self.doubts_wrist = explained = True
        return self._monitor.check_efforts(explained)

    def _without_wrist(self, state: JointState, acceleration: Array) -> Array:
        """Return the unexplained efforts (n,), Nm, if nothing but the payload acts on the hand."""
        return self._efforts.without_wrist(state, acceleration, self._known_load(state))

    def _known_load(self, state: JointState) -> Array:
        """Return the wrench (6,) of the known payload on the wrist at rest, world axes."""
        payload, turn = self._wrist.payload, self._model.tcp(state.position).rotation()
        return np.zeros(6) if payload is None else payload.wrench(turn, self._wrist.sensor_in_tool)

    def _doubtful(self, state: JointState, acceleration: Array, left: Array) -> bool:
        """Return whether the efforts fit better without the wrist reading: then the wrist sensor is wrong."""
        otherwise = self._without_wrist(state, acceleration)
        limit = self._model.torque_limit
        return float(np.linalg.norm(otherwise / limit)) < MIN_EXPLAINED_SHARE * float(
            np.linalg.norm(left / limit)
        )
