"""Velocity control of the tool on the stiff joint servo.

The same functions as MoveIt Servo (`moveit_servo` of MoveIt 2): damped inverse kinematics, and slowing down
near singularities, joint limits and the edge of the workspace.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import pinocchio as pin

from picktree.world import (
    Array,
    Bounds,
    JointState,
    Vector3,
)
from picktree.world.robot_model import RobotModel

from .commands import Controller, JointCommand, Twist
from .soft_limits import SOFT_LIMIT_MARGIN, distance_to_workspace_edge

MAX_TWIST_GROWTH, MAX_TWIST_DECREASE = (1.0, 4.0), (2.0, 8.0)
"""Greatest growth and greatest decrease of a twist, each m/s² and rad/s²."""


JOG_JOINT_SPEED_SHARE = 0.8
"""Greatest joint speeds, as a share of their limits."""


JOG_STOPPING_SHARE = 0.5
"""Share of the joints' acceleration limits that is available to stop before a limit."""


MIN_EDGE_APPROACH_TIME = 0.25
"""Least time in which a joint uses up the distance to its limit, and the tool that to the workspace's edge,
s."""


SLOW_SINGULAR_VALUE, STOP_SINGULAR_VALUE = 0.08, 0.02
"""Smallest singular values of the Jacobian (m and rad mixed) below which a jog slows down, and stops."""


DAMPED_SINGULAR_VALUE, MAX_INVERSE_DAMPING = 0.05, 0.04
"""Smallest singular value below which the inverse is damped, and its greatest damping."""


COMMAND_TIME = 0.15
"""Longest time without a new command before a jog brakes, s."""


@dataclass(slots=True, eq=False)
class JogState:
    """Set-point of a jog: joints (n,) rad and (n,) rad/s, the followed twist (6,) in the world, remaining TCP
    travel, m."""

    q: Array
    v: Array
    twist: Array
    left: float = math.inf

    def copy(self) -> JogState:
        return JogState(self.q.copy(), self.v.copy(), self.twist.copy(), self.left)


@dataclass(frozen=True, slots=True)
class SpeedRestriction:
    """Reason why a jog is slower than commanded."""

    kind: Literal["collision", "joint_limit", "singularity", "workspace"]
    detail: str = ""
    """Pairs of bodies that would touch, or the joint; empty for a singularity and the workspace."""

    def __str__(self) -> str:
        return f"{self.kind} {self.detail}".rstrip()


class JogSetpointGenerator:
    """Generator of the jog's set-points. Every limit only slows the twist down and keeps its direction."""

    def __init__(self, model: RobotModel, workspace: Bounds) -> None:
        self._model = model
        self._workspace = workspace
        self._data = model.arm.createData()
        self._lower: Array = model.lower + SOFT_LIMIT_MARGIN
        self._upper: Array = model.upper - SOFT_LIMIT_MARGIN
        self.restriction: SpeedRestriction | None = None
        """Reason why the last step was slower than commanded; None: it was not."""

    def step(self, state: JogState, wanted: Twist, dt: float) -> None:
        """Move `state` on by `dt` s."""
        q = state.q
        # The Jacobian halfway through the step keeps the tool on its line.
        jacobian, rotation, tool = self._kinematics(q + (0.5 * dt) * state.v)
        least = _smallest_singular_value(jacobian)
        self.restriction = None
        target = np.array([*wanted.linear, *wanted.angular])
        if wanted.frame == "tool":
            target = np.concatenate([rotation @ target[:3], rotation @ target[3:]])
        speed = float(np.linalg.norm(target[:3]))
        if speed > 0.0 and state.left < math.inf:
            # The steps brake a little late, so braking before the end counts on less than the remaining
            # travel.
            target = target * min(1.0, math.sqrt(1.6 * MAX_TWIST_DECREASE[0] * max(state.left, 0.0)) / speed)
        target = target * self._singular(q, jacobian, least, target)
        target = target * self._inside(tool, target)
        twist = _ramped(state.twist, target, dt)
        v = _inverse(jacobian, least) @ twist
        share = self._share(q, v)
        twist, v = twist * share, v * share
        change = v - state.v
        most = self._model.acceleration_limit * dt
        v = state.v + change * min(1.0, float((most / np.maximum(np.abs(change), 1e-12)).min()))
        state.left -= float(np.linalg.norm(jacobian[:3] @ v)) * dt
        state.q = np.clip(q + (0.5 * dt) * (state.v + v), *self._span(q))
        state.v, state.twist = v, twist

    def tool_speed(self, state: JogState) -> tuple[float, float]:
        """Return the speed of the set-point's TCP, m/s, and its angular speed, rad/s."""
        twist = self._kinematics(state.q)[0] @ state.v
        return float(np.linalg.norm(twist[:3])), float(np.linalg.norm(twist[3:]))

    def _kinematics(self, q: Array) -> tuple[Array, Array, Vector3]:
        model, data = self._model, self._data
        pin.computeJointJacobians(model.arm, data, q)
        jacobian = pin.getFrameJacobian(model.arm, data, model.tcp_frame, pin.LOCAL_WORLD_ALIGNED)
        placement = pin.updateFramePlacement(model.arm, data, model.tcp_frame)
        x, y, z = placement.translation.tolist()
        return jacobian.copy(), placement.rotation.copy(), (x, y, z)

    def _singular(self, q: Array, jacobian: Array, least: float, target: Array) -> float:
        if least >= SLOW_SINGULAR_VALUE or not target.any():
            return 1.0
        v = _inverse(jacobian, least) @ target
        ahead = q + v * (0.02 / max(float(np.abs(v).max()), 1e-9))  # rad of joint travel
        if _smallest_singular_value(self._kinematics(ahead)[0]) >= least:
            return 1.0
        self.restriction = SpeedRestriction("singularity")
        return max(0.0, (least - STOP_SINGULAR_VALUE) / (SLOW_SINGULAR_VALUE - STOP_SINGULAR_VALUE))

    def _inside(self, tool: Vector3, target: Array) -> float:
        speed = float(np.linalg.norm(target[:3]))
        if speed < 1e-9:
            return 1.0
        room = distance_to_workspace_edge(self._workspace, tool, target[:3] / speed)
        most = min(math.sqrt(1.6 * MAX_TWIST_DECREASE[0] * room), room / MIN_EDGE_APPROACH_TIME)
        if most >= speed:
            return 1.0
        self.restriction = SpeedRestriction("workspace")
        return most / speed

    def _share(self, q: Array, v: Array) -> float:
        """Return the share of the joints' speeds that their limits allow, 0 … 1."""
        room = np.maximum(np.where(v > 0.0, self._upper - q, q - self._lower), 0.0)
        stopping = np.sqrt(2.0 * JOG_STOPPING_SHARE * self._model.acceleration_limit * room)
        near = np.minimum(stopping, room / MIN_EDGE_APPROACH_TIME)
        fast = JOG_JOINT_SPEED_SHARE * self._model.velocity_limit
        shares = np.minimum(near, fast) / np.maximum(np.abs(v), 1e-9)
        k = int(shares.argmin())
        share = float(shares[k])
        if share < 1.0 and near[k] < fast[k]:
            self.restriction = SpeedRestriction("joint_limit", self._model.description.joints[k])
        return min(1.0, share)

    def _span(self, q: Array) -> tuple[Array, Array]:
        """Return the joint ranges. A joint that begins beyond its limit may stay there, and not go
        further."""
        return np.minimum(self._model.lower, q), np.maximum(self._model.upper, q)


class JogController:
    """Controller that follows twist commands and brakes when they stay away."""

    name: ClassVar[str] = "Jog"

    def __init__(
        self, model: RobotModel, period: float, workspace: Bounds, distance: float = math.inf
    ) -> None:
        """`distance`: TCP travel after which the jog stops, m."""
        self.law = JogSetpointGenerator(model, workspace)
        self.done = False
        self._period = period
        self._distance = distance
        self._command = Twist()
        self._until = -math.inf
        self._braking = False
        self.is_late = False
        """Whether the jog brakes because no command came in time."""

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        self._time = now
        self._until = now + COMMAND_TIME
        self.state = JogState(setpoint.position.copy(), setpoint.velocity.copy(), np.zeros(6), self._distance)

    def command(self, wanted: Twist) -> None:
        """Follow the twist `wanted` for `COMMAND_TIME`."""
        self._command = wanted
        self._until = self._time + COMMAND_TIME

    def update(self, now: float, state: JointState) -> JointCommand:
        self._time = now
        if now > self._until and not self._braking:
            self._braking = self.is_late = True
        self.law.step(self.state, Twist() if self._braking else self._command, self._period)
        at = self.state
        if self._braking and float(np.abs(at.v).max()) < 1e-4:
            at.v = np.zeros_like(at.v)
            self.done = True
        return JointCommand(at.q.copy(), at.v.copy())

    def brake(self) -> Controller:
        self._braking = True
        return self

    def ahead(self, wanted: Twist, time: float, step: float) -> Array:
        """Return configurations (k, n), one each `step` s, for `time` s of a twist and braking after it."""
        state = self.state.copy()
        restriction = self.law.restriction
        path = [state.q]
        for k in range(120):
            self.law.step(state, wanted if k * step < time else Twist(), step)
            path.append(state.q)
            if k * step >= time and float(np.abs(state.v).max()) < 1e-3:
                break
        self.law.restriction = restriction
        return np.array(path)


def _ramped(now: Array, target: Array, dt: float) -> Array:
    """Return the twist (6,) after `dt` s on its way to another."""
    change = target - now
    share = 1.0
    for part, k in ((slice(0, 3), 0), (slice(3, 6), 1)):
        slower = float(np.linalg.norm(target[part])) < float(np.linalg.norm(now[part]))
        most = (MAX_TWIST_DECREASE if slower else MAX_TWIST_GROWTH)[k] * dt
        size = float(np.linalg.norm(change[part]))
        share = min(share, most / size) if size > most else share
    return now + change * share


def _smallest_singular_value(jacobian: Array) -> float:
    return float(np.linalg.svd(jacobian, compute_uv=False)[-1])


def _inverse(jacobian: Array, least: float) -> Array:
    """Return the inverse (n, 6) of the Jacobian, damped near singularities."""
    damping = (
        0.0
        if least >= DAMPED_SINGULAR_VALUE
        else (1.0 - (least / DAMPED_SINGULAR_VALUE) ** 2) * MAX_INVERSE_DAMPING**2
    )
    square: Array = jacobian @ jacobian.T
    square[np.diag_indices(6)] += damping + 1e-12
    return jacobian.T @ np.asarray(np.linalg.inv(square), np.float64)
