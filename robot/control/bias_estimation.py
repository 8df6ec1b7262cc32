"""Estimation of the wrist sensor's bias: when it is learnt, and what the joints' efforts say about it."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from ...world.robot_model.model import RobotModel
from ...world.skill_events import WristBiasEvent
from ...world.values import Array, JointState
from .external_torque import EffortCheck
from .safety_monitor import SafetyMonitor
from .wrist_wrench import MAX_BIAS_STEP, WristWrench

WRIST_WINDOW = 0.1
"""Time over which the wrist is read for a tare or a load, s."""


class BiasEstimator:
    """Estimator of the wrist sensor's bias at rest."""

    def __init__(self, model: RobotModel, monitor: SafetyMonitor, wrist: WristWrench) -> None:
        self._model = model
        self._monitor = monitor
        self._wrist = wrist
        self.efforts = EffortCheck(model)
        self.doubtful = False
        """Whether the joints' efforts contradict the wrist sensor."""

    def come_to_rest(self, state: JointState) -> None:
        """Learn the bias when the arm has just come to rest, if there is none or it is in doubt."""
        if not self._wrist.zeroed:
            # A run begins with an empty hand in free space.
            self._wrist.zero(WRIST_WINDOW, state.position)
        elif self._monitor.pressed or self.doubtful:
            self.doubtful = not self.learn(state)

    def learn(self, state: JointState) -> bool:
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

    def zero_empty(self, state: JointState, *, rested: bool) -> bool:
        """Learn the bias of the empty hand, and tare. False: the reading cannot be a bias, and the known one
        stays."""
        self._wrist.carry(None)
        learnt = rested and self.learn(state)
        if self._wrist.zeroed:
            self._wrist.untare()
        else:
            self._wrist.tare(WRIST_WINDOW, state.position)
        return learnt

    def known_load(self, state: JointState) -> Array:
        """Return the wrench (6,) of the known payload on the wrist at rest, world axes."""
        payload, turn = self._wrist.payload, self._model.tcp(state.position).rotation()
        return np.zeros(6) if payload is None else payload.wrench(turn, self._wrist.sensor_in_tool)

    def _borne(self, state: JointState, claimed: Array) -> bool:
        """Return whether the joints, at rest, carry the wrench (6,) that the wrist reads beyond the
        payload."""
        return self.efforts.believes(state, claimed, self.known_load(state))
