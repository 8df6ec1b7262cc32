"""Cartesian impedance: the tool as a damped spring about a moving target (Hogan 1985; Ott 2008)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin

from ..robot.model import RobotModel
from ..values import Array, JointState
from .boundaries import JointBounds
from .commands import Controller, JointCommand, TorqueCommand
from .joint_controllers import Brake

REFRESH = 12
"""Control periods between two computations of what depends on the inertia."""
JOINT_SPEED = 0.4
"""Share of the joints' speed limits that following the target may take."""
TORQUE_RATE = 1000.0
"""Nm/s"""
LIMIT_ROOM = 0.2
"""The posture keeps so far from the joints' limits, rad, where the task leaves it room."""
BESIDE, TURNED = 0.004, 0.03
"""Where a joint is at its limit and the tool is so far beside its line or turned away, it goes no further: m,
rad."""
POSTURE = 25.0
"""Stiffness of the null-space posture over inertia, 1/s²; critically damped."""


@dataclass(frozen=True, slots=True)
class Stiffness:
    """Of the spring between tool and target: N/m and Nm/rad; share of the critical damping."""

    linear: float = 1500.0
    angular: float = 40.0
    damping: float = 0.9


FIRM = Stiffness()
SOFT = Stiffness(linear=400.0, angular=20.0, damping=1.0)
COMPLY_TIME = 0.3
"""Length of the reflex to a contact, s."""


class Target(Protocol):
    """Where the spring is anchored in the world: position (3,) m, rotation (3, 3), velocity (3,) m/s,
    acceleration (3,) m/s²."""

    position: Array
    rotation: Array
    velocity: Array
    acceleration: Array

    def start(self, position: Array, rotation: Array) -> None:
        """Called once with the tool's pose, so that the motion begins with zero error."""
        ...

    @property
    def direction(self) -> Array:
        """Unit vector (3,) along which it moves, or zero."""
        ...

    def advance(self, position: Array) -> None:
        """One control period passes, the tool being at `position`."""
        ...

    def limit(self, speed: float) -> None:
        """From now on no faster than `speed` m/s: near a singularity the joints could not follow."""
        ...


class StillTarget:
    """The pose at which it began."""

    def start(self, position: Array, rotation: Array) -> None:
        self.position = position
        self.rotation = rotation
        self.velocity: Array = np.zeros(3)
        self.acceleration: Array = np.zeros(3)

    @property
    def direction(self) -> Array:
        return np.zeros(3)

    def advance(self, position: Array) -> None:
        pass

    def limit(self, speed: float) -> None:
        pass


class CartesianImpedance:
    """τ = Jᵀ(K e + D ė + Λ ẍ + f) + N M (posture) + bias(q, v), limited in size and rate.

    D follows K and the tool's inertia Λ by double diagonalisation (Albu-Schäffer et al. 2003). `preload`
    (6,): a constant wrench f that the hand exerts, such as what carries a held object; world axes, about
    the TCP. Joints keep their soft limits (`JointBounds`), and the target slows down for them.
    """

    def __init__(
        self,
        model: RobotModel,
        period: float,
        target: Target,
        stiffness: Stiffness = FIRM,
        preload: Array | None = None,
        torque_rate: float = TORQUE_RATE,
    ) -> None:
        self._model = model
        self._period = period
        self.target = target
        k, r = stiffness.linear, stiffness.angular
        self._stiffness: Array = np.array([k, k, k, r, r, r])
        self._damping_ratio = stiffness.damping
        self._preload: Array = np.zeros(6) if preload is None else preload
        self._data = model.arm.createData()
        self._error = np.zeros(6)
        self._aim = np.zeros(6)
        self._step: float = torque_rate * period
        self._age = 0
        self._bounds = JointBounds(model)
        self.blocked_by = ""
        """The joint whose limit has stopped the target."""
        self.done = False

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        q = state.position
        inner = np.minimum(LIMIT_ROOM, (self._model.upper - self._model.lower) / 2)
        self._posture: Array = np.clip(q, self._model.lower + inner, self._model.upper - inner)
        pin.computeJointJacobians(self._model.arm, self._data, q)
        jacobian = self._jacobian()
        tool = pin.updateFramePlacement(self._model.arm, self._data, self._model.tcp_frame)
        self.target.start(tool.translation.copy(), tool.rotation.copy())
        self._torque: Array = self._model.gravity(q) + jacobian.T @ self._preload
        self._refresh(q, jacobian)

    def update(self, now: float, state: JointState) -> TorqueCommand:
        q, v = state.position, state.velocity
        arm, data, model, target = self._model.arm, self._data, self._model, self.target
        pin.computeJointJacobians(arm, data, q)
        jacobian = self._jacobian()
        tool = pin.updateFramePlacement(arm, data, model.tcp_frame)
        position, rotation = tool.translation, tool.rotation
        target.advance(position)
        error, aim = self._error, self._aim
        error[:3] = target.position - position
        turn = target.rotation @ rotation.T
        error[3] = 0.5 * (turn[2, 1] - turn[1, 2])
        error[4] = 0.5 * (turn[0, 2] - turn[2, 0])
        error[5] = 0.5 * (turn[1, 0] - turn[0, 1])
        aim[:3] = target.velocity
        self._age += 1
        if self._age >= REFRESH:
            self._refresh(q, jacobian)
        wrench = self._stiffness * error + self._damping @ (aim - jacobian @ v) + self._preload
        wrench += self._along @ target.acceleration
        posture = self._null @ (POSTURE * (self._posture - q) - (2.0 * math.sqrt(POSTURE)) * v)
        torque = jacobian.T @ wrench + posture + pin.nonLinearEffects(arm, data, q, v)
        torque = np.minimum(np.maximum(torque, self._torque - self._step), self._torque + self._step)
        torque = np.minimum(np.maximum(torque, -model.torque_limit), model.torque_limit)
        self._torque = self._bounds.held(q, v, torque)
        return TorqueCommand(self._torque)

    def brake(self) -> Controller:
        return Brake(self._model, self._period)

    def _jacobian(self) -> Array:
        return pin.getFrameJacobian(
            self._model.arm, self._data, self._model.tcp_frame, pin.LOCAL_WORLD_ALIGNED
        )

    def _strayed(self) -> bool:
        """Whether the tool is beside the line of its target, or turned: contacts push it along the line."""
        direction, off = self.target.direction, self._error[:3]
        beside = off - direction * float(direction @ off)
        return float(beside @ beside) > BESIDE**2 or float(self._error[3:] @ self._error[3:]) > TURNED**2

    def _refresh(self, q: Array, jacobian: Array) -> None:
        """Damping and null-space projector at q."""
        self._age = 0
        mass = self._model.mass_matrix(q)
        by_mass = np.linalg.solve(mass, jacobian.T)
        inertia = np.linalg.inv(jacobian @ by_mass + 1e-6 * np.eye(6))
        inertia = (inertia + inertia.T) / 2
        self._along: Array = inertia[:, :3]
        speed = self._bounds.target_speed(q, mass, jacobian, self.target.direction, JOINT_SPEED)
        self.target.limit(speed.most)
        self.blocked_by = speed.blocked_by or (self._bounds.at_limit(q) if self._strayed() else "")
        lower = np.linalg.cholesky(inertia)
        inverse = np.linalg.inv(lower)
        squares, modes = np.linalg.eigh((inverse * self._stiffness) @ inverse.T)
        shape = lower @ modes
        self._damping: Array = (shape * (2.0 * self._damping_ratio * np.sqrt(squares))) @ shape.T
        self._null: Array = mass - jacobian.T @ inertia @ jacobian


class Comply(CartesianImpedance):
    """The reflex to a contact: soft and damped about the pose where it was felt, for a moment.

    The stiff servo would go on pressing (165 N at 0.5 mm) while it brakes.
    """

    def __init__(self, model: RobotModel, period: float, preload: Array) -> None:
        super().__init__(model, period, StillTarget(), SOFT, preload, torque_rate=math.inf)
        self._until = math.inf

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        super().start(now, state, setpoint)
        self._until = now + COMPLY_TIME

    def update(self, now: float, state: JointState) -> TorqueCommand:
        self.done = now >= self._until
        return super().update(now, state)

    def brake(self) -> Controller:
        return self
