"""Cartesian impedance: the tool as a damped spring about a moving anchor (Hogan 1985; Ott 2008)."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
import pinocchio as pin

from ...world.robot_model.model import RobotModel
from ...world.values import Array, JointState
from .commands import Controller, JointCommand, TorqueCommand
from .compliant_motion import (
    FIRM_STIFFNESS,
    CartesianStiffness,
    CompliantMotion,
    ContactState,
)
from .joint_controllers import BrakeController
from .soft_limits import SoftJointLimits
from .wrist_wrench import TcpWrench

INERTIA_UPDATE_TIME = 0.05
"""Time between two computations of the terms that depend on the inertia, s."""
ANCHOR_JOINT_SPEED_SHARE = 0.4
"""Share of the joints' speed limits that following the anchor may take."""
TORQUE_RATE = 1000.0
"""Greatest rate of a joint torque, Nm/s."""
POSTURE_LIMIT_MARGIN = 0.2
"""Distance that the null-space posture keeps from the joints' limits, rad."""
MAX_LINE_OFFSET, MAX_LINE_ROTATION = 0.004, 0.03
"""Offset from the line, m, and rotation, rad, of the tool at which a joint at its limit ends the motion."""
POSTURE_STIFFNESS = 25.0
"""Stiffness of the null-space posture over inertia, 1/s²; critically damped."""


class CartesianImpedance:
    """τ = Jᵀ(K e + D ė + Λ ẍ + f) + N M (posture) + bias(q, v), limited in size and rate.

    K and D: see `CartesianStiffness`; Λ is the tool's inertia. `preload` (6,): constant wrench f that the
    hand exerts, for example to carry an object; world axes, about the TCP. Joints keep their soft limits
    (`SoftJointLimits`), and the anchor slows down for them.
    """

    name: ClassVar[str] = "CartesianImpedance"

    def __init__(
        self,
        model: RobotModel,
        period: float,
        course: CompliantMotion,
        stiffness: CartesianStiffness = FIRM_STIFFNESS,
        preload: Array | None = None,
        feeling: TcpWrench | None = None,
    ) -> None:
        """`feeling`: source of the contact wrench for the motion. None: it is zero."""
        self._model = model
        self._period = period
        self.course = course
        self._stiffness = stiffness
        self._feeling = feeling
        self._elapsed = 0.0
        self._preload: Array = np.zeros(6) if preload is None else preload
        self._data = model.arm.createData()
        self._error = np.zeros(6)
        self._spring: Array = np.zeros((6, 6))
        self._damping: Array = np.zeros((6, 6))
        self._aim = np.zeros(6)
        self._step: float = TORQUE_RATE * period
        self._age = 0.0
        self._bounds = SoftJointLimits(model)
        self.blocked_by = ""
        """Name of the joint whose limit has stopped the anchor; empty: none."""
        self.done = False

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        q = state.position
        inner = np.minimum(POSTURE_LIMIT_MARGIN, (self._model.upper - self._model.lower) / 2)
        self._posture: Array = np.clip(q, self._model.lower + inner, self._model.upper - inner)
        pin.computeJointJacobians(self._model.arm, self._data, q)
        jacobian = self._jacobian()
        tool = pin.updateFramePlacement(self._model.arm, self._data, self._model.tcp_frame)
        self.course.start(tool.translation.copy(), tool.rotation.copy())
        self._torque: Array = self._model.gravity(q) + jacobian.T @ self._preload
        self._refresh(q, jacobian, tool.rotation)

    def update(self, now: float, state: JointState) -> TorqueCommand:
        q, v = state.position, state.velocity
        arm, data, model, course = self._model.arm, self._data, self._model, self.course
        pin.computeJointJacobians(arm, data, q)
        jacobian = self._jacobian()
        tool = pin.updateFramePlacement(arm, data, model.tcp_frame)
        position, rotation = tool.translation, tool.rotation
        course.advance(self._felt(position, rotation))
        error, aim = self._error, self._aim
        error[:3] = course.position - position
        turn = course.rotation @ rotation.T
        error[3] = 0.5 * (turn[2, 1] - turn[1, 2])
        error[4] = 0.5 * (turn[0, 2] - turn[2, 0])
        error[5] = 0.5 * (turn[1, 0] - turn[0, 1])
        aim[:3], aim[3:] = course.velocity, course.spin
        self._age += self._period
        if self._age >= INERTIA_UPDATE_TIME - 1e-9:
            self._refresh(q, jacobian, rotation)
        wrench = self._spring @ error + self._damping @ (aim - jacobian @ v) + self._preload + course.wrench
        wrench += self._along @ course.acceleration
        posture = self._null @ (
            POSTURE_STIFFNESS * (self._posture - q) - (2.0 * math.sqrt(POSTURE_STIFFNESS)) * v
        )
        torque = jacobian.T @ wrench + posture + pin.nonLinearEffects(arm, data, q, v)
        torque = np.minimum(np.maximum(torque, self._torque - self._step), self._torque + self._step)
        torque = np.minimum(np.maximum(torque, -model.torque_limit), model.torque_limit)
        self._torque = self._bounds.held(q, v, torque)
        return TorqueCommand(self._torque)

    def brake(self) -> Controller:
        return BrakeController(self._model, self._period)

    def _jacobian(self) -> Array:
        return pin.getFrameJacobian(
            self._model.arm, self._data, self._model.tcp_frame, pin.LOCAL_WORLD_ALIGNED
        )

    def _felt(self, position: Array, rotation: Array) -> ContactState:
        self._elapsed += self._period
        force = torque = np.zeros(3)
        if self._feeling is not None:
            force, torque = self._feeling.read(rotation)
        return ContactState(self._elapsed, self._period, force, torque, position.copy(), rotation.copy())

    def _strayed(self) -> bool:
        """Return whether contacts have pushed the tool off the line of its anchor, or turned it."""
        direction, off = self.course.direction, self._error[:3]
        beside = off - direction * float(direction @ off)
        return (
            float(beside @ beside) > MAX_LINE_OFFSET**2
            or float(self._error[3:] @ self._error[3:]) > MAX_LINE_ROTATION**2
        )

    def _refresh(self, q: Array, jacobian: Array, rotation: Array) -> None:
        """Update spring, damping and null-space projector at q (n,); `rotation` (3, 3): tool in the world."""
        self._age = 0.0
        mass = self._model.mass_matrix(q)
        by_mass = np.linalg.solve(mass, jacobian.T)
        inertia = np.linalg.inv(jacobian @ by_mass + 1e-6 * np.eye(6))
        inertia = (inertia + inertia.T) / 2
        self._along: Array = inertia[:, :3]
        speed = self._bounds.target_speed(q, mass, jacobian, self.course.direction, ANCHOR_JOINT_SPEED_SHARE)
        self.course.limit(speed.most)
        led = bool(self.course.direction.any())
        self.blocked_by = speed.blocked_by or (self._bounds.at_limit(q) if led and self._strayed() else "")
        self._spring, self._damping = self._stiffness.sampled(inertia, rotation, self._period)
        self._null: Array = mass - jacobian.T @ inertia @ jacobian
