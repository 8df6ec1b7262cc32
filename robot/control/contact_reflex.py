"""Contact reflex: gravity compensation that takes a moving arm out of a contact, and brings it to rest."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ...world.robot_model.model import RobotModel
from ...world.values import Array, JointState
from .commands import Controller, JointCommand, TorqueCommand
from .soft_controller import GravityCompensationController
from .soft_limits import SoftJointLimits

MAX_REFLEX_TIME = 1.0
"""Longest reflex to a contact, s."""


class ContactReflex(GravityCompensationController):
    """Reflex of a moving arm to a contact: it gives way until nothing presses any more and it stands.

    The stiff servo would keep pressing while it brakes: 165 N at 0.5 mm. So it takes over only from an arm
    that is calm, or after `MAX_REFLEX_TIME`. Joints keep their soft limits (`SoftJointLimits`).
    """

    name: ClassVar[str] = "Comply"

    def __init__(self, model: RobotModel, period: float, carried: Array) -> None:
        """`carried` (6,): wrench of the load on the hand, world axes about the TCP, N and Nm."""
        super().__init__(model, period, carried[:3])
        self._carried = carried
        self._bounds = SoftJointLimits(model)
        self._elapsed = 0.0

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        super().start(now, state, setpoint)
        # The efforts of a moving arm do not show what presses on it.
        self._hardest, self._off = 0.0, np.zeros_like(state.position)

    def update(self, now: float, state: JointState) -> TorqueCommand:
        torque = super().update(now, state).torque
        self._elapsed += self._period
        self.done = self.calm or self._elapsed >= MAX_REFLEX_TIME
        self._driven = self._bounds.held(state.position, state.velocity, torque)
        return TorqueCommand(self._driven)

    def brake(self) -> Controller:
        return self
