"""Impedance control: the tool as a damped spring about a moving anchor (Hogan 1985; Ott 2008), joints as
springs along a trajectory, and gravity compensation.

Contacts at any part of the arm are met gently: the trajectory is slowed where a part would be fast or hit
hard, and a reflex takes the moving arm out of a contact.

The effective mass of a point in the direction u of its motion is 1 / (uᵀ J M⁻¹ Jᵀ u). Khatib, "Inertial
properties in robotic manipulation: an object-level framework", International Journal of Robotics Research 14
(1995). Times the point's speed it is the impulse with which a rigid obstacle stops the point.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
import pinocchio as pin

from picktree.world import Array, JointState, Trajectory, Vector3
from picktree.world.robot_model import RobotModel

from .commands import Controller, JointCommand, TorqueCommand
from .compliant_motion import FIRM_STIFFNESS, CartesianStiffness, CompliantMotion, ContactState
from .external_torque import ExternalTorqueObserver, static_external_torque
from .joint_controllers import BrakeController, TrajectoryController
from .soft_limits import SoftJointLimits
from .wrist_wrench import TcpWrench, WristWrench

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
        course.advance(self._contact_state(position, rotation))
        self._measure_error(position, rotation)
        error, aim = self._error, self._aim
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

    def _measure_error(self, position: Array, rotation: Array) -> None:
        """Set error and rate of the anchor for a tool at `position` (3,) with `rotation` (3, 3)."""
        course, error, aim = self.course, self._error, self._aim
        error[:3] = course.position - position
        turn = course.rotation @ rotation.T
        error[3] = 0.5 * (turn[2, 1] - turn[1, 2])
        error[4] = 0.5 * (turn[0, 2] - turn[2, 0])
        error[5] = 0.5 * (turn[1, 0] - turn[0, 1])
        aim[:3], aim[3:] = course.velocity, course.spin

    def _contact_state(self, position: Array, rotation: Array) -> ContactState:
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
        self._limit_course(q, mass, jacobian)
        self._spring, self._damping = self._stiffness.sampled(inertia, rotation, self._period)
        self._null: Array = mass - jacobian.T @ inertia @ jacobian

    def _limit_course(self, q: Array, mass: Array, jacobian: Array) -> None:
        """Slow the anchor down for joints near their limits, and name one that blocks it."""
        speed = self._bounds.target_speed(q, mass, jacobian, self.course.direction, ANCHOR_JOINT_SPEED_SHARE)
        self.course.limit(speed.most)
        led = bool(self.course.direction.any())
        self.blocked_by = speed.blocked_by or (self._bounds.at_limit(q) if led and self._strayed() else "")


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
"""External torque, Nm, and joint speed, rad/s, below which the contact has ended and the arm is at rest."""
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
        self._max_torque, self._max_force = torque, force
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
            back = return_configuration(self.trajectory, self.progress, self._period)
            self._anchor: Array = back + spring.yield_motion(external - self._usual)
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
        if torque > self._max_torque or size > self._max_force:
            self.touched = True
            x, y, z = (force - self._force).tolist()
            self.push = (x, y, z)
            return True
        share = self._period / (USUAL_TIME_CONSTANT + self._period)
        self._usual = self._usual + share * (external - self._usual)
        self._force = self._force + share * (force - self._force)
        return False


def return_configuration(trajectory: Trajectory, progress: float, period: float) -> Array:
    """Return the configuration (n,) on a path to which the arm goes back after a contact at `progress` s,
    rad."""
    here, s = trajectory.sample(progress)[0], progress
    while s > 0.0:
        s = max(0.0, s - 2 * period)
        there = trajectory.sample(s)[0]
        if float(np.linalg.norm(there - here)) >= BACK_OFF_DISTANCE:
            return there
    return trajectory.sample(0.0)[0]


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
        """Whether the contact has ended and the arm is at rest."""
        return self._calm >= CALM_TIME

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        q, model = state.position, self._model
        self._initial_configuration: Array = q.copy()
        self._anchor: Array = q.copy()
        self._driven: Array = state.effort.copy()
        self._release_anchor(
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
            self._release_anchor(external, spring)
        anchor = self._led(q)
        if self._since > 2 * FOLLOWING_TIME:
            self.pressed = float(np.linalg.norm(external))
            quiet = self.pressed < CALM_TORQUE and float(np.abs(v).max()) < CALM_SPEED
            self._calm = self._calm + self._period if quiet else 0.0
            if self._since > 4 * FOLLOWING_TIME and self.pressed >= CALM_TORQUE:
                self._release_anchor(external, spring)
                self._since = 0.0
        torque = model.inverse_dynamics(q, v, np.zeros_like(v)) - hanging
        torque += spring.torque(anchor - q, -v)
        self._driven = np.clip(torque, -model.torque_limit, model.torque_limit)
        return TorqueCommand(self._driven)

    def brake(self) -> Controller:
        return BrakeController(self._model, self._period)

    def _release_anchor(self, external: Array, spring: JointSpring) -> None:
        """Let the anchor move along these external torques (n,), Nm, once it has followed the arm."""
        self._hardest = float(np.linalg.norm(external))
        self._release_offset: Array = spring.yield_motion(external)

    def _led(self, q: Array) -> Array:
        """Return the anchor (n,) of the spring, rad: first the arm's configuration, then away from the
        contact."""
        if self._since <= FOLLOWING_TIME:
            self._anchor = np.clip(
                q, self._initial_configuration - MAX_DRIFT, self._initial_configuration + MAX_DRIFT
            )
            return self._anchor
        return self._anchor + min(1.0, (self._since - FOLLOWING_TIME) / FOLLOWING_TIME) * self._release_offset


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


MAX_REFLEX_TIME = 1.0
"""Longest reflex to a contact, s."""


class ContactReflex(GravityCompensationController):
    """Reflex of a moving arm to a contact: it gives way until the contact has ended and the arm is at rest.

    The stiff servo would keep pressing while it brakes: 165 N at 0.5 mm. So the servo takes over only from a
    calm arm, or after `MAX_REFLEX_TIME`. Joints keep their soft limits (`SoftJointLimits`).
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
        self._hardest, self._release_offset = 0.0, np.zeros_like(state.position)

    def update(self, now: float, state: JointState) -> TorqueCommand:
        torque = super().update(now, state).torque
        self._elapsed += self._period
        self.done = self.calm or self._elapsed >= MAX_REFLEX_TIME
        self._driven = self._bounds.held(state.position, state.velocity, torque)
        return TorqueCommand(self._driven)

    def brake(self) -> Controller:
        return self


MAX_IMPULSE = 0.75
"""Greatest impulse of any part of the arm on a rigid obstacle, Ns.

It comes before the arm can give way. As a mean over the 37.5 ms of the safety monitor it is 20 N.
"""
HOUSING_RADIUS = 0.05
"""Radius of the housing around a joint, m. An obstacle meets the surface, no point inside of it."""
SMOOTHING_SAMPLES = 3
"""Number of samples, on either side, over which the slowdown begins and ends."""


def slowed_trajectory(model: RobotModel, trajectory: Trajectory, speed: float) -> Trajectory:
    """Return the trajectory on the same path, slowed down where a part of the arm would be too fast.

    Neither tool nor joints exceed `speed` m/s or `MAX_IMPULSE`; where they do not, the speed is kept.
    """
    share = _allowed_share(model, trajectory, speed)
    if bool((share >= 1.0).all()):
        return trajectory
    # The squared rate is linear in time between samples; its derivative is the rate's acceleration, doubled.
    squared = _smoothed(share**2)
    rate = np.sqrt(squared)
    change = np.gradient(squared, trajectory.times) / 2.0
    steps = 2.0 * np.diff(trajectory.times) / (rate[1:] + rate[:-1])
    acceleration = trajectory.acceleration * squared[:, None] + trajectory.velocity * change[:, None]
    stretch = max(1.0, float(np.sqrt((np.abs(acceleration) / model.acceleration_limit).max())))
    return Trajectory(
        np.concatenate([[0.0], np.cumsum(steps)]) * stretch,
        trajectory.position,
        trajectory.velocity * rate[:, None] / stretch,
        acceleration / stretch**2,
    )


def _allowed_share(model: RobotModel, trajectory: Trajectory, speed: float) -> Array:
    """Return the share (m,) of its speed at which each sample keeps both limits, at most 1.

    The impulse of a link that turns about an axis grows without limit towards the axis. A joint whose centre
    is that near counts with the impulse at the radius of its housing.
    """
    arm = model.arm
    data = arm.createData()
    excess = np.ones(len(trajectory.times))
    for k, (q, v) in enumerate(zip(trajectory.position, trajectory.velocity, strict=True)):
        if not v.any():
            continue
        pin.computeJointJacobians(arm, data, q)
        mass = model.mass_matrix(q)
        points = [pin.getJointJacobian(arm, data, j, pin.LOCAL_WORLD_ALIGNED) for j in range(1, model.n + 1)]
        points.append(pin.getFrameJacobian(arm, data, model.tcp_frame, pin.LOCAL_WORLD_ALIGNED))
        linear = np.array(points)[:, :3]
        # The centre of a joint is a point of the link before it; the TCP is a point at the surface.
        turning = np.zeros(len(points))
        turning[1:-1] = np.linalg.norm(np.array(points[:-2])[:, 3:] @ v, axis=1)
        motions: Array = linear @ v
        # With w = Jᵀ u |v|, speed times effective mass is |v|³ / (wᵀ M⁻¹ w).
        pulls: Array = np.einsum("pxn,px->pn", linear, motions)
        speeds = np.linalg.norm(motions, axis=1)
        mobility = np.einsum("pn,pn->p", pulls, np.linalg.solve(mass, pulls.T).T)
        impulses = np.divide(speeds**3, mobility, out=np.zeros_like(speeds), where=mobility > 0.0)
        impulses *= speeds / np.maximum(np.maximum(speeds, HOUSING_RADIUS * turning), 1e-12)
        excess[k] = max(1.0, float(speeds.max()) / speed, float(impulses.max()) / MAX_IMPULSE)
    return 1.0 / excess


def _smoothed(limit: Array) -> Array:
    """Return values (m,) that change smoothly and are nowhere above `limit` (m,)."""
    n = SMOOTHING_SAMPLES
    windows = np.lib.stride_tricks.sliding_window_view
    lowest = windows(np.pad(limit, 2 * n, mode="edge"), 2 * n + 1).min(axis=1)
    mean = windows(lowest, n + 1).mean(axis=1)
    return windows(mean, n + 1).mean(axis=1)
