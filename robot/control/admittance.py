"""Admittance control: contact for an arm that takes positions only, by the force that its wrist sensor feels.

A virtual mass at the tool moves under the felt wrench, a spring and a damper; the arm follows it (Hogan
1985; Ott, Mukherjee and Nakamura, "Unified impedance and admittance control", ICRA 2010). Courses,
stiffnesses and results are those of impedance control. Contacts at other parts of the arm are not felt.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
import pinocchio as pin

from picktree.world import Array, JointState, Trajectory, Vector3
from picktree.world.robot_model import RobotModel

from .commands import Controller, JointCommand
from .impedance import (
    CALM_SPEED,
    CALM_TIME,
    MAX_REFLEX_TIME,
    PRESSING_FORCE,
    USUAL_TIME_CONSTANT,
    YIELD_TIME,
    ZERO_WINDOW,
    CartesianImpedance,
    return_configuration,
)
from .joint_controllers import BrakeController, TrajectoryController
from .wrist_wrench import WristWrench

VIRTUAL_MASS = np.repeat([6.0, 0.12], 3)
"""Least mass, kg, and inertia, kg·m², of the virtual body at the tool."""
MIN_INERTIA_RATIO = 2.0
"""Least ratio of the virtual mass and inertia to those of the hand.

The wrist feels the inertia of the hand, too, one period late. A virtual body that is lighter than the hand
answers each of its own accelerations with a greater one.
"""
VIRTUAL_DAMPING = np.repeat([250.0, 4.0], 3)
"""Damping against the resting world, Ns/m and Nms/rad: a stiff contact does not bounce.

It is that of an arm that reacts within `REACTION_TIME`. A contact of stiffness k stays stable while k times
the delay is below the damping, so that it grows with what is late.
"""
REACTION_TIME = 0.015
"""Time in which the arm reacts to a contact without a latency of its hardware, s."""
SPRING_DAMPING_RATIO = 0.9
"""Damping ratio of the spring with the virtual mass."""
SPEED_SHARE = 0.6
"""Share of the joints' speed limits that the virtual body may use."""
POSTURE_RATE = 2.0
"""Rate at which the arm returns to its posture in the null space, 1/s."""
INVERSE_DAMPING = 1e-4
"""Damping of the inverse Jacobian near singularities."""
LIMIT_DISTANCE = 0.01
"""Distance that the set-point keeps from the joints' limits, rad."""
TRACK_STIFFNESS = 500.0
"""Stiffness with which a soft motion returns to its path, N/m."""
REFLEX_DEAD_BAND = 2.0
"""Force that a reflex leaves alone, N: inertia of the hand and noise."""


class VirtualBody:
    """Damped body at the tool that wrenches move, and the joint speeds that follow it."""

    def __init__(self, model: RobotModel, period: float, latency: float, damping: float = 1.0) -> None:
        """`latency`: latency of the hardware, s. `damping`: factor of `VIRTUAL_DAMPING`."""
        self._model = model
        self._period = period
        hand = np.repeat([model.hand_mass, model.hand_inertia], 3)
        self.mass: Array = np.maximum(VIRTUAL_MASS, MIN_INERTIA_RATIO * hand)
        """Mass, kg, and inertia, kg·m², of the body, three times each."""
        late = (REACTION_TIME + latency) / REACTION_TIME
        self._own_damping = np.diag(damping * late * VIRTUAL_DAMPING)
        self._step: Array = model.acceleration_limit * period
        self.twist = np.zeros(6)
        """Velocity of the body, m/s and rad/s, world axes."""
        self.speed = np.zeros(model.n)
        """Joint speeds (n,) of the last step, rad/s."""

    def start(self, twist: Array, speed: Array) -> None:
        """Begin with a velocity of the tool (6,) and the joint speeds (n,) of it."""
        self.twist, self.speed = twist, speed

    def move(self, spring: Array, error: Array, aim: Array, push: Array) -> None:
        """Move the body by one period.

        `spring` (6, 6), `error` (6,) to the anchor, `aim` (6,): velocity of the anchor, `push` (6,): wrench.
        """
        root = np.sqrt(self.mass)
        damping = (
            2.0 * SPRING_DAMPING_RATIO * root[:, None] * _square_root(spring / np.outer(root, root)) * root
        )
        damping += self._own_damping
        # Implicit in the damping, which is stable for any period.
        inertia = np.diag(self.mass)
        driven = spring @ error + damping @ aim + push
        self.twist = np.linalg.solve(
            inertia + self._period * damping, self.mass * self.twist + self._period * driven
        )

    def follow(self, jacobian: Array, posture: Array) -> Array:
        """Return the joint speeds (n,) that move the tool with the body, within speed and acceleration.

        `posture` (n,): wanted joint speeds in the null space, rad/s.
        """
        square = jacobian @ jacobian.T + INVERSE_DAMPING * np.eye(6)
        own = posture - jacobian.T @ np.linalg.solve(square, jacobian @ posture)
        speed = jacobian.T @ np.linalg.solve(square, self.twist) + own
        excess = float((np.abs(speed) / (SPEED_SHARE * self._model.velocity_limit)).max())
        wanted = speed / max(1.0, excess)
        held = np.clip(wanted, self.speed - self._step, self.speed + self._step)
        if excess > 1.0 or not np.array_equal(held, wanted):
            self.twist = jacobian @ held
        self.speed = held
        return held


class CartesianAdmittance(CartesianImpedance):
    """Admittance of the tool about a moving anchor: what `CartesianImpedance` is for an arm that takes
    torques.

    M a = K e + D (anchor rate - v) + contact wrench + wrench of the course; a and v are those of the
    commanded tool. Without contact it follows the anchor like the spring.
    """

    name: ClassVar[str] = "CartesianAdmittance"
    latency = 0.0
    """Latency of the hardware, s; set before the start."""

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        super().start(now, state, setpoint)
        self._q: Array = setpoint.position.copy()
        self._body = VirtualBody(self._model, self._period, self.latency, self.course.damping)
        position, rotation = self._commanded()
        self.course.start(position, rotation)

    def update(self, now: float, state: JointState) -> JointCommand:  # pyright: ignore[reportIncompatibleMethodOverride]
        arm, data, model, course = self._model.arm, self._data, self._model, self.course
        pin.computeJointJacobians(arm, data, state.position)
        tool = pin.updateFramePlacement(arm, data, model.tcp_frame)
        felt = self._contact_state(tool.translation, tool.rotation)
        course.advance(felt)
        position, rotation = self._commanded()
        jacobian = self._jacobian()
        self._measure_error(position, rotation)
        self._age += self._period
        if self._age >= 0.05 - 1e-9:
            self._refresh(self._q, jacobian, rotation)
        push = np.concatenate([felt.force, felt.torque]) + course.wrench
        push[:3] += self._body.mass[:3] * course.acceleration
        self._body.move(self._spring, self._error, self._aim, push)
        speed = self._body.follow(jacobian, POSTURE_RATE * (self._posture - self._q))
        low, high = model.lower + LIMIT_DISTANCE, model.upper - LIMIT_DISTANCE
        self._q = np.clip(self._q + self._period * speed, low, high)
        return JointCommand(self._q.copy(), speed.copy())

    def brake(self) -> Controller:
        return BrakeController(self._model, self._period)

    def _commanded(self) -> tuple[Array, Array]:
        """Return position (3,) and rotation (3, 3) of the commanded tool."""
        pin.computeJointJacobians(self._model.arm, self._data, self._q)
        tool = pin.updateFramePlacement(self._model.arm, self._data, self._model.tcp_frame)
        return tool.translation.copy(), tool.rotation.copy()

    def _refresh(self, q: Array, jacobian: Array, rotation: Array) -> None:
        """Update the spring; the virtual mass replaces the arm's inertia."""
        self._age = 0.0
        self._limit_course(q, self._model.mass_matrix(q), jacobian)
        self._spring = self._stiffness.matrix(rotation)


class AdmittanceTrack(TrajectoryController):
    """Soft motion along a trajectory: the hand gives way to a contact, and the arm goes back a little.

    A contact is more than `force` N at the wrist beyond the usual reading, which follows slow changes.
    """

    name: ClassVar[str] = "SoftTrackByPosition"

    def __init__(
        self,
        trajectory: Trajectory,
        model: RobotModel,
        period: float,
        *,
        wrist: WristWrench,
        force: float,
        latency: float,
    ) -> None:
        super().__init__(trajectory, model, period)
        self._wrist = wrist
        self._max_force = force
        self._elapsed = 0.0
        self._until = math.inf
        self._body = VirtualBody(model, period, latency)
        self._offset_in_world = np.zeros(6)
        self._shift = np.zeros(model.n)
        self._spring = np.diag(np.repeat([TRACK_STIFFNESS, 10.0], 3))
        self.touched = False
        """Whether the hand touched something."""
        self.push: Vector3 = (0.0, 0.0, 0.0)
        """Contact force on the hand, N in the world."""
        self.torque = 0.0
        """Greatest external torque, Nm: none is felt."""
        self.force = 0.0
        """Greatest force at the wrist, N."""

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        super().start(now, state, setpoint)
        self._usual: Array = self._wrist.over(ZERO_WINDOW, state.position)[:3]

    def update(self, now: float, state: JointState) -> JointCommand:
        self._elapsed += self._period
        before = self.progress
        force = np.array(self._wrist.force)
        push = force - self._usual
        size = float(np.linalg.norm(push))
        self.force = max(self.force, size)
        if not self.touched and size > self._max_force:
            self.touched = True
            x, y, z = push.tolist()
            self.push = (x, y, z)
            self._from = self.trajectory.sample(before)[0]
            self._back = return_configuration(self.trajectory, before, self._period)
            self._until = self._elapsed + YIELD_TIME
        if not self.touched:
            share = self._period / (USUAL_TIME_CONSTANT + self._period)
            self._usual = self._usual + share * push
            command = super().update(now, state)
            if not self._offset_in_world.any() and size < PRESSING_FORCE:
                return command
            return self._shifted(command, push if size > PRESSING_FORCE else np.zeros(3))
        self.progress = before
        x = min(1.0, 1.0 - (self._until - self._elapsed) / YIELD_TIME)
        way = x * x * (3.0 - 2.0 * x)
        aim = self._from + way * (self._back - self._from)
        self.done = self._elapsed >= self._until
        return self._shifted(JointCommand(aim, np.zeros_like(aim)), push)

    def brake(self) -> Controller:
        super().brake()
        return self

    def _shifted(self, command: JointCommand, push: Array) -> JointCommand:
        """Return the command with the offset by which the hand gives way to `push` (3,), N."""
        wrench = np.concatenate([push, np.zeros(3)])
        self._body.move(self._spring, -self._offset_in_world, np.zeros(6), wrench)
        speed = self._body.follow(
            self._model.jacobian(command.position + self._shift), np.zeros(self._model.n)
        )
        self._offset_in_world = self._offset_in_world + self._period * self._body.twist
        self._shift = self._shift + self._period * speed
        return JointCommand(command.position + self._shift, command.velocity + speed)


class AdmittanceReflex:
    """Giving way to whatever pushes the hand: no spring, only damping. It ends once nothing pushes and the
    arm is at rest.

    It is the reflex of a moving arm to a contact, and releases the pressure of a contact at rest.
    """

    name: ClassVar[str] = "ComplyByPosition"

    def __init__(
        self,
        model: RobotModel,
        period: float,
        wrist: WristWrench,
        carried: Array,
        *,
        latency: float,
        ends: bool = True,
    ) -> None:
        """`carried` (6,): wrench of the load on the hand, world axes, N and Nm. `ends`: whether it is done
        when calm, or after `MAX_REFLEX_TIME`."""
        self._model, self._period, self._wrist = model, period, wrist
        self._carried = carried[:3]
        self._ends = ends
        self._elapsed = self._calm = 0.0
        self._body = VirtualBody(model, period, latency)
        self.done = False
        self.pressed = math.inf
        """Remaining external torque by the force at the wrist, Euclidean norm, Nm; inf: not measured yet."""

    @property
    def calm(self) -> bool:
        """Whether nothing pushes the hand and the arm is at rest."""
        return self._calm >= CALM_TIME

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        self._q: Array = setpoint.position.copy()
        self._body.start(self._model.jacobian(self._q) @ setpoint.velocity, setpoint.velocity.copy())

    def update(self, now: float, state: JointState) -> JointCommand:
        model = self._model
        push = np.array(self._wrist.force) - self._carried
        size = float(np.linalg.norm(push))
        jacobian = model.jacobian(self._q)
        self.pressed = float(np.linalg.norm(jacobian[:3].T @ push))
        left = push * (max(0.0, size - REFLEX_DEAD_BAND) / max(size, 1e-9))
        self._body.move(np.zeros((6, 6)), np.zeros(6), np.zeros(6), np.concatenate([left, np.zeros(3)]))
        speed = self._body.follow(jacobian, np.zeros(model.n))
        self._elapsed += self._period
        quiet = size <= REFLEX_DEAD_BAND and float(np.abs(speed).max()) < CALM_SPEED
        self._calm = self._calm + self._period if quiet else 0.0
        self.done = self._ends and (self.calm or self._elapsed >= MAX_REFLEX_TIME)
        if self.done:
            speed = np.zeros(model.n)
        low, high = model.lower + LIMIT_DISTANCE, model.upper - LIMIT_DISTANCE
        self._q = np.clip(self._q + self._period * speed, low, high)
        return JointCommand(self._q.copy(), speed)

    def brake(self) -> Controller:
        return BrakeController(self._model, self._period) if not self._ends else self


def _square_root(matrix: Array) -> Array:
    """Return the square root of a symmetric, positive semidefinite matrix."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    return (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
