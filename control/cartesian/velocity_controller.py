"""Cartesian velocity commands on the stiff joint servo: twists in, joint set-points out.

What it does is what MoveIt Servo (`moveit_servo` of MoveIt 2) does: damped inverse kinematics, slowing down
towards singularities, joint limits, the edge of the workspace and what is in the way, a stop when commands
stay away. Damping: Nakamura and Hanafusa, "Inverse kinematic solutions with singularity robustness for robot
manipulator control", Journal of Dynamic Systems, Measurement, and Control 108 (1986).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin

from ...robots.model import RobotModel
from ...world.values import Array, Bounds, JointState, Vector3
from ..commands import Controller, JointCommand
from .soft_limits import ROOM, distance_to_workspace_edge
from .twist import Twist

GAIN, LOSS = (1.0, 4.0), (2.0, 8.0)
"""How fast a twist may grow, and how fast it may shrink: m/s² and rad/s²."""
JOINT_SPEED = 0.8
"""Share of the joints' speed limits."""
STOPPING = 0.5
"""Share of the joints' acceleration limits that stopping before a limit counts on."""
APPROACH = 0.25
"""A joint goes towards its limit no faster than the room that is left in this time, s; so does the tool
towards the edge of the workspace."""
SLOW, STOP = 0.08, 0.02
"""Smallest singular values of the Jacobian (m and rad mixed): from the first on it goes slower, and at the
second it stops."""
DAMPED, DAMPING = 0.05, 0.04
"""Smallest singular value from which the inverse is damped, and its greatest damping."""
NUDGE = 0.02
"""How far ahead it is asked whether a motion leads towards a singularity, rad."""
AHEAD_STEPS = 120
"""Of the look ahead, at most."""
COMMAND_TIME = 0.15
"""After this time without a new command it brakes, s."""


@dataclass(slots=True, eq=False)
class JogState:
    """Where the set-point is: (n,) rad, (n,) rad/s, the twist (6,) in the world that it follows, and the way
    of the TCP that it may still go, m."""

    q: Array
    v: Array
    twist: Array
    left: float = math.inf

    def copy(self) -> JogState:
        return JogState(self.q.copy(), self.v.copy(), self.twist.copy(), self.left)


class JogSetpointGenerator:
    """One step of the set-point under a twist. Every limit only makes it slower: its direction is kept."""

    def __init__(self, model: RobotModel, workspace: Bounds) -> None:
        self._model = model
        self._workspace = workspace
        self._data = model.arm.createData()
        self._lower: Array = model.lower + ROOM
        self._upper: Array = model.upper - ROOM
        self.held_by = ""
        """What made the last step slower than it was told: `joint_limit panda_joint1`, `singularity`,
        `workspace`, or nothing."""

    def step(self, state: JogState, wanted: Twist, dt: float) -> None:
        """Move `state` on by `dt` s."""
        q = state.q
        # Halfway through the step, or the tool would drift off its line.
        jacobian, rotation, tool = self._kinematics(q + (0.5 * dt) * state.v)
        least = _least(jacobian)
        self.held_by = ""
        target = np.array([*wanted.linear, *wanted.angular])
        if wanted.frame == "tool":
            target = np.concatenate([rotation @ target[:3], rotation @ target[3:]])
        speed = float(np.linalg.norm(target[:3]))
        if speed > 0.0 and state.left < math.inf:
            # Braking before the end counts on a little less than there is: it is done in steps.
            target = target * min(1.0, math.sqrt(1.6 * LOSS[0] * max(state.left, 0.0)) / speed)
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
        """Of the set-point: m/s of the TCP, rad/s."""
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
        if least >= SLOW or not target.any():
            return 1.0
        v = _inverse(jacobian, least) @ target
        ahead = q + v * (NUDGE / max(float(np.abs(v).max()), 1e-9))
        if _least(self._kinematics(ahead)[0]) >= least:
            return 1.0
        self.held_by = "singularity"
        return max(0.0, (least - STOP) / (SLOW - STOP))

    def _inside(self, tool: Vector3, target: Array) -> float:
        speed = float(np.linalg.norm(target[:3]))
        if speed < 1e-9:
            return 1.0
        room = distance_to_workspace_edge(self._workspace, tool, target[:3] / speed)
        most = min(math.sqrt(1.6 * LOSS[0] * room), room / APPROACH)
        if most >= speed:
            return 1.0
        self.held_by = "workspace"
        return most / speed

    def _share(self, q: Array, v: Array) -> float:
        """Of the joints' speeds that their limits leave."""
        room = np.maximum(np.where(v > 0.0, self._upper - q, q - self._lower), 0.0)
        stopping = np.sqrt(2.0 * STOPPING * self._model.acceleration_limit * room)
        near = np.minimum(stopping, room / APPROACH)
        fast = JOINT_SPEED * self._model.velocity_limit
        shares = np.minimum(near, fast) / np.maximum(np.abs(v), 1e-9)
        k = int(shares.argmin())
        share = float(shares[k])
        if share < 1.0 and near[k] < fast[k]:
            self.held_by = f"joint_limit {self._model.description.joints[k]}"
        return min(1.0, share)

    def _span(self, q: Array) -> tuple[Array, Array]:
        """A joint that begins beyond its limit may stay there, and not go further."""
        return np.minimum(self._model.lower, q), np.maximum(self._model.upper, q)


class JogController:
    """A controller that follows twists as they come, and brakes when they stay away."""

    name: ClassVar[str] = "Jog"

    def __init__(
        self, model: RobotModel, period: float, workspace: Bounds, distance: float = math.inf
    ) -> None:
        """`distance`: way of the TCP after which it stops, m."""
        self.law = JogSetpointGenerator(model, workspace)
        self.done = False
        self._period = period
        self._distance = distance
        self._wanted = Twist()
        self._until = -math.inf
        self._braking = False
        self.late = False
        """No command came in time."""

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        self._now = now
        self._until = now + COMMAND_TIME
        self.state = JogState(setpoint.position.copy(), setpoint.velocity.copy(), np.zeros(6), self._distance)

    def command(self, wanted: Twist) -> None:
        """From now on, and for COMMAND_TIME."""
        self._wanted = wanted
        self._until = self._now + COMMAND_TIME

    def update(self, now: float, state: JointState) -> JointCommand:
        self._now = now
        if now > self._until and not self._braking:
            self._braking = self.late = True
        self.law.step(self.state, Twist() if self._braking else self._wanted, self._period)
        at = self.state
        if self._braking and float(np.abs(at.v).max()) < 1e-4:
            at.v = np.zeros_like(at.v)
            self.done = True
        return JointCommand(at.q.copy(), at.v.copy())

    def brake(self) -> Controller:
        self._braking = True
        return self

    def ahead(self, wanted: Twist, time: float, step: float) -> Array:
        """Configurations (k, n), one each `step` s, when it follows a twist for `time` s and brakes then."""
        state = self.state.copy()
        held_by = self.law.held_by
        path = [state.q]
        for k in range(AHEAD_STEPS):
            self.law.step(state, wanted if k * step < time else Twist(), step)
            path.append(state.q)
            if k * step >= time and float(np.abs(state.v).max()) < 1e-3:
                break
        self.law.held_by = held_by
        return np.array(path)


def _ramped(now: Array, target: Array, dt: float) -> Array:
    """The twist (6,) after dt s on its way from one to another."""
    change = target - now
    share = 1.0
    for part, k in ((slice(0, 3), 0), (slice(3, 6), 1)):
        slower = float(np.linalg.norm(target[part])) < float(np.linalg.norm(now[part]))
        most = (LOSS if slower else GAIN)[k] * dt
        size = float(np.linalg.norm(change[part]))
        share = min(share, most / size) if size > most else share
    return now + change * share


def _least(jacobian: Array) -> float:
    return float(np.linalg.svd(jacobian, compute_uv=False)[-1])


def _inverse(jacobian: Array, least: float) -> Array:
    """(n, 6): damped where it would be large."""
    damping = 0.0 if least >= DAMPED else (1.0 - (least / DAMPED) ** 2) * DAMPING**2
    square: Array = jacobian @ jacobian.T
    square[np.diag_indices(6)] += damping + 1e-12
    return jacobian.T @ np.asarray(np.linalg.inv(square), np.float64)
