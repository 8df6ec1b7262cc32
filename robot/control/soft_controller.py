"""Joint impedance along a trajectory, and gravity compensation: contacts at any part of the arm are met
gently."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from ...world.robot_model.model import RobotModel
from ...world.trajectory import Trajectory
from ...world.values import Array, JointState, Vector3
from .commands import Controller, JointCommand, TorqueCommand
from .external_torque import ExternalTorqueObserver, static_external_torque
from .joint_controllers import BrakeController, TrajectoryController
from .wrist_wrench import WristWrench

STIFFNESS_PER_TORQUE = 6.0
"""Stiffness of a joint over its torque limit, 1/rad."""
JOINT_FREQUENCY = 32.0
"""Greatest natural frequency of a joint's spring with the inertia that the joint sees alone, rad/s."""
MODE_FREQUENCY = 80.0
"""Greatest natural frequency of any mode of the arm on its springs, rad/s.

Joints that turn together, as where axes are in line, have modes of far less inertia than either joint alone.
Damping d, 1/s, sampled with the period h and one period of delay is stable for h·d < 1. Here h·d is 0.6 at
240 Hz, whatever the arm.
"""
JOINT_DAMPING_RATIO = 0.9
"""Damping ratio."""
CONTACT_STIFFNESS_SHARE = 0.2
"""Share of the stiffness that remains after a contact."""
BACK_OFF_DISTANCE = 0.010
"""Distance that the arm goes back on its path after a contact, Euclidean norm over the joints, rad."""
YIELD_DISTANCE = 0.003
"""Distance that the arm moves along the contact force, rad. The stiff servo holds the encoder reading: in
contact, a tenth of a millimetre of encoder noise is 20 N."""
YIELD_TIME = 0.35
"""Time for which the arm gives way, s."""
ZERO_WINDOW = 0.05
"""Time at rest over which the wrist force before a motion is averaged, s."""
FOLLOWING_TIME = 0.15
"""Time for which the anchor of gravity compensation follows the arm before it leaves a contact, s."""
PRESSING_FORCE = 1.5
"""Force at the wrist beyond the load above which something presses on it, N."""
CALM_TORQUE, CALM_SPEED = 1.0, 0.02
"""External torque, Nm, and joint speed, rad/s, below which nothing presses and the arm stands."""
CALM_TIME = 0.1
"""Time below these limits until the arm counts as calm, s."""
MAX_DRIFT = 0.03
"""Greatest drift of a joint that is pushed, rad."""
USUAL_TIME_CONSTANT = 0.6
"""Time constant with which the usual readings follow slow changes, as of a load that is turned, s."""


class JointImpedanceController(TrajectoryController):
    """Joint impedance along a trajectory.

    τ = K (q_d − q) + D (v_d − v) + M a_d + h(q, v) − Jᵀ w, with the load's wrench w. An exact model leaves no
    error without a contact. A contact is more than `torque` Nm of external torque, or more than `force` N at
    the wrist, beyond the usual readings. The torque is the Euclidean norm over the joints. The arm then gives
    way, soft and damped about the contact, and is done.
    """

    name: ClassVar[str] = "SoftTrack"

    def __init__(
        self,
        trajectory: Trajectory,
        model: RobotModel,
        period: float,
        *,
        wrist: WristWrench,
        carried: Array,
        torque: float,
        force: float,
    ) -> None:
        """`carried` (3,): weight on the tool, N in the world."""
        super().__init__(trajectory, model, period)
        self._model = model
        self._wrist = wrist
        self._carried = np.concatenate([carried, np.zeros(3)])
        self._most_torque, self._most_force = torque, force
        self._elapsed = 0.0
        self._until = math.inf
        self.touched = False
        """Whether the arm touched something."""
        self.push: Vector3 = (0.0, 0.0, 0.0)
        """Contact force on the hand, N in the world."""
        self.torque = 0.0
        """Greatest external torque, Nm."""
        self.force = 0.0
        """Greatest force at the wrist, N."""

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        super().start(now, state, JointCommand(state.position.copy(), np.zeros_like(state.position)))
        q, model = state.position, self._model
        pressing = static_external_torque(model, state)
        self._driven: Array = state.effort.copy()
        self._observer = ExternalTorqueObserver(model, self._period, pressing)
        self._usual: Array = pressing - model.jacobian(q).T @ self._carried
        self._force: Array = self._wrist.over(ZERO_WINDOW, q)[:3]

    def update(self, now: float, state: JointState) -> TorqueCommand:  # pyright: ignore[reportIncompatibleMethodOverride]
        q, v, model = state.position, state.velocity, self._model
        self._elapsed += self._period
        hanging = model.jacobian(q).T @ self._carried
        external = self._observer.watch(state, self._driven) - hanging
        before = self.progress
        command = super().update(now, state)
        aim, speed = command.position, command.velocity
        mass = model.mass_matrix(q)
        spring = JointSpring(model, mass)
        if not self.touched and self._feels(external):
            self._anchor: Array = self._behind() + spring.yield_motion(external - self._usual)
            self._until = self._elapsed + YIELD_TIME
        if self.touched:
            spring = JointSpring(model, mass, CONTACT_STIFFNESS_SHARE)
            self.progress = before
            aim, speed = self._anchor, np.zeros_like(v)
            self.done = self._elapsed >= self._until
            feed = np.zeros_like(v)
        else:
            feed = self._acceleration()
        torque = model.inverse_dynamics(q, v, feed) - hanging
        torque += spring.torque(aim - q, speed - v)
        self._driven = np.clip(torque, -model.torque_limit, model.torque_limit)
        return TorqueCommand(self._driven)

    def brake(self) -> Controller:
        super().brake()
        return self

    def _eased(self, force: Array) -> bool:
        """Return whether an initial contact force at the wrist has decreased."""
        carried = self._carried[:3]
        before = float(np.linalg.norm(self._force - carried))
        return before > PRESSING_FORCE and float(np.linalg.norm(force - carried)) < before

    def _behind(self) -> Array:
        """Return the configuration (n,) on the path to which the arm goes back, rad."""
        here, s = self._sample_at(self.progress), self.progress
        while s > 0.0:
            s = max(0.0, s - 2 * self._period)
            there = self._sample_at(s)
            if float(np.linalg.norm(there - here)) >= BACK_OFF_DISTANCE:
                return there
        return self._sample_at(0.0)

    def _sample_at(self, s: float) -> Array:
        return self.trajectory.sample(s)[0]

    def _acceleration(self) -> Array:
        """Return the acceleration (n,) of the trajectory now, rad/s²; zero while it brakes."""
        if self._rate != 1.0 or self.done:
            return np.zeros(self._model.n)
        c, t = self._coefficients[self._segment], self.progress - self._times[self._segment]
        return 2.0 * c[2] + t * (6.0 * c[3] + t * (12.0 * c[4] + t * 20.0 * c[5]))

    def _feels(self, external: Array) -> bool:
        """Update the usual readings, and return whether something touches the arm. `external` (n,): external
        torque without the load's, Nm."""
        force = np.array(self._wrist.force)
        # Pressure from the start that decreases is released: that is no contact.
        if self._eased(force):
            self._force = force
        if float(np.linalg.norm(external)) < float(np.linalg.norm(self._usual)):
            self._usual = external
        torque = float(np.linalg.norm(external - self._usual))
        size = float(np.linalg.norm(force - self._force))
        self.torque, self.force = max(self.torque, torque), max(self.force, size)
        if torque > self._most_torque or size > self._most_force:
            self.touched = True
            x, y, z = (force - self._force).tolist()
            self.push = (x, y, z)
            return True
        share = self._period / (USUAL_TIME_CONSTANT + self._period)
        self._usual = self._usual + share * (external - self._usual)
        self._force = self._force + share * (force - self._force)
        return False


class GravityCompensationController:
    """Gravity compensation: the arm carries itself and the load, and drifts, damped, where something pushes
    it.

    The drift is at most `MAX_DRIFT`. Then the arm moves a little away from the contact; where that
    persists, it
    begins again.
    """

    name: ClassVar[str] = "GivingWay"
    done = False

    def __init__(self, model: RobotModel, period: float, carried: Array) -> None:
        """`carried` (3,): weight on the tool, N in the world."""
        self._model = model
        self._period = period
        self._carried = np.concatenate([carried, np.zeros(3)])
        self._observer = ExternalTorqueObserver(model, period)
        self._since = 0.0
        self._calm = 0.0
        self.pressed = math.inf
        """Remaining external torque, Euclidean norm, Nm; inf: not measured yet."""

    @property
    def calm(self) -> bool:
        """Whether nothing presses any more and the arm stands."""
        return self._calm >= CALM_TIME

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        q, model = state.position, self._model
        self._begun: Array = q.copy()
        self._anchor: Array = q.copy()
        self._driven: Array = state.effort.copy()
        self._take_off(
            static_external_torque(model, state) - model.jacobian(q).T @ self._carried,
            JointSpring(model, model.mass_matrix(q)),
        )

    def update(self, now: float, state: JointState) -> TorqueCommand:
        q, v, model = state.position, state.velocity, self._model
        hanging = model.jacobian(q).T @ self._carried
        external = self._observer.watch(state, self._driven) - hanging
        self._since += self._period
        spring = JointSpring(model, model.mass_matrix(q))
        if self._since <= FOLLOWING_TIME and float(np.linalg.norm(external)) > self._hardest:
            self._take_off(external, spring)
        anchor = self._led(q)
        if self._since > 2 * FOLLOWING_TIME:
            self.pressed = float(np.linalg.norm(external))
            quiet = self.pressed < CALM_TORQUE and float(np.abs(v).max()) < CALM_SPEED
            self._calm = self._calm + self._period if quiet else 0.0
            if self._since > 4 * FOLLOWING_TIME and self.pressed >= CALM_TORQUE:
                self._take_off(external, spring)
                self._since = 0.0
        torque = model.inverse_dynamics(q, v, np.zeros_like(v)) - hanging
        torque += spring.torque(anchor - q, -v)
        self._driven = np.clip(torque, -model.torque_limit, model.torque_limit)
        return TorqueCommand(self._driven)

    def brake(self) -> Controller:
        return BrakeController(self._model, self._period)

    def _take_off(self, external: Array, spring: JointSpring) -> None:
        """Let the anchor move along these external torques (n,), Nm, once it has followed the arm."""
        self._hardest = float(np.linalg.norm(external))
        self._off: Array = spring.yield_motion(external)

    def _led(self, q: Array) -> Array:
        """Return the anchor (n,) of the spring, rad: first the arm's configuration, then away from the
        contact."""
        if self._since <= FOLLOWING_TIME:
            self._anchor = np.clip(q, self._begun - MAX_DRIFT, self._begun + MAX_DRIFT)
            return self._anchor
        return self._anchor + min(1.0, (self._since - FOLLOWING_TIME) / FOLLOWING_TIME) * self._off


class JointSpring:
    """Damped spring between an arm and its anchor, for the inertia `mass` (n, n) that the arm has now.

    Each joint has a stiffness of its own; modes of the arm that would be faster than `MODE_FREQUENCY` become
    softer. Damping is by double diagonalisation of stiffness and inertia, as for the tool.
    """

    def __init__(self, model: RobotModel, mass: Array, share: float = 1.0) -> None:
        """`share`: share of the stiffness that remains."""
        wanted = np.minimum(STIFFNESS_PER_TORQUE * model.torque_limit, JOINT_FREQUENCY**2 * np.diagonal(mass))
        lower = np.linalg.cholesky(mass)
        inverse = np.linalg.inv(lower)
        squares, modes = np.linalg.eigh((inverse * wanted) @ inverse.T)
        squares = share * np.clip(squares, 0.0, MODE_FREQUENCY**2)
        shape = lower @ modes
        self.stiffness: Array = (shape * squares) @ shape.T
        """Stiffness (n, n), Nm/rad."""
        self.damping: Array = (shape * (2.0 * JOINT_DAMPING_RATIO * np.sqrt(squares))) @ shape.T
        """Damping (n, n), Nm·s/rad."""

    def torque(self, offset: Array, speed: Array) -> Array:
        """Return the torque (n,), Nm, for an anchor that is `offset` rad ahead and `speed` rad/s faster."""
        return self.stiffness @ offset + self.damping @ speed

    def yield_motion(self, torque: Array) -> Array:
        """Return a joint motion (n,) of length `YIELD_DISTANCE` along these torques, rad; zero when the
        torques are negligible."""
        if float(np.linalg.norm(torque)) <= CALM_TORQUE / 2:
            return np.zeros_like(torque)
        way: Array = np.asarray(np.linalg.solve(self.stiffness, torque), np.float64)
        return way * (YIELD_DISTANCE / float(np.linalg.norm(way)))
