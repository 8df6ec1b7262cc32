"""Plant: the cell's bodies in MuJoCo, the robot's own servo at 1 kHz, its gripper, its sensors and its
guards.

The servo follows the commanded positions by itself: between commands along their previews, after
`SILENCE` s without one it brakes. The guards stop the arm for speed, limits, workspace and force. None of
them is a safety function.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from picktree.drivers import protocol

from .cell_description import Cell
from .cell_faults import CellFaults
from .cell_model import STEP, CellModel, build_model
from .robot_model import MakersModel

SILENCE = 0.15
"""Time without a command after which the robot brakes, s."""
EXTRAPOLATION = 0.01
"""Time for which a set-point without previews goes on, s."""
SERVO_FREQUENCY = 80.0
"""Natural frequency of each joint under its servo, rad/s; critically damped."""
BRAKING_SHARE = 0.6
"""Share of the joints' accelerations with which the robot brakes."""
SPEED_MARGIN, LIMIT_MARGIN, WORKSPACE_MARGIN = 1.3, 0.02, 0.02
"""What the guards allow beyond the limits: share of the speed, rad, m."""
SPEED_ALLOWANCE = 0.02
"""What a set-point, and thrice what a joint may be faster than a client's share of the speeds, rad/s:
vibration."""
FOLLOWING_ERROR = 0.05
"""Greatest distance of a joint to its set-point, rad."""
FORCE_MARGIN = 1.5
"""Share of the file's force at which the robot stops: picktree's own limit comes first."""
FORCE_FILTER = 0.01
"""Time constant of the force that the guard judges, s."""
SETTLING_TIME = 0.7
"""Time for which items settle before the clock runs, s."""
FINGER_GAIN, FINGER_DAMPING, FINGER_LEAD = 20000.0, 60.0, 0.006
"""Servo of each finger: N/m, Ns/m, and the greatest lead of its target, m."""
BUSY_DISTANCE, BUSY_RATE = 1e-3, 2e-3
"""Distance to the commanded opening, m, and its rate, m/s, beyond which the gripper may be busy."""
BUSY_START_TIME = 0.05
"""Time after a command in which fingers that do not move yet are busy, s."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Reading:
    """Readings of all sensors at one time."""

    time: float
    position: Array
    velocity: Array
    torque: Array
    gripper: tuple[float, float, float]
    wrench: Array
    busy: bool


@dataclass(frozen=True, slots=True)
class PathPoint:
    """Point of the commanded path: time after the command, s, position (n,) and rate (n,)."""

    time: float
    position: Array
    rate: Array


def between(one: PathPoint, other: PathPoint, time: float) -> tuple[Array, Array]:
    """Return position and rate at a time between two points: a cubic without steps of the rate.

    Steps would show in the wrist sensor as forces of the hand's inertia.
    """
    span = other.time - one.time
    u = (time - one.time) / span
    way = other.position - one.position
    a, b = one.rate * span, other.rate * span
    cubic, square = a + b - 2.0 * way, 3.0 * way - 2.0 * a - b
    position = one.position + u * (a + u * (square + u * cubic))
    return position, (a + u * (2.0 * square + u * 3.0 * cubic)) / span


class Plant:
    """Robot cell that advances in steps of 1 ms. Its clock is 0 once the items have settled."""

    def __init__(self, cell: Cell, faults: CellFaults, seed: int, makers: MakersModel | None = None) -> None:
        """Build the model and let the items settle; `makers`: the robot's model in place of its URDF.

        Raises CellError for a cell that is no model.
        """
        self.cell = cell
        self.parts: CellModel = build_model(cell, faults, seed, makers)
        self.faults = faults
        self.data = mujoco.MjData(self.parts.model)
        robot = cell.robot
        self._rng = np.random.default_rng([seed, 2])
        self._home = np.array(robot.home)
        self._lower = np.array([j.lower for j in robot.joints])
        self._upper = np.array([j.upper for j in robot.joints])
        self._fastest = np.array([j.velocity for j in robot.joints])
        self._strongest = np.array([j.torque for j in robot.joints])
        self._braking = BRAKING_SHARE * np.array([j.acceleration for j in robot.joints])
        self._widths = np.array(robot.gripper.widths)
        self._drives = np.array([row[0] for row in robot.gripper.positions])
        order = np.argsort(self._drives)
        self._drive_order, self._width_order = self._drives[order], self._widths[order]
        workspace = np.array(cell.workspace)
        self._least, self._greatest = workspace[:3] - WORKSPACE_MARGIN, workspace[3:] + WORKSPACE_MARGIN
        self._start()

    def _start(self) -> None:
        data, parts, gripper = self.data, self.parts, self.cell.robot.gripper
        n = len(self._home)
        data.qpos[parts.arm_q] = self._home
        data.qpos[parts.finger_q] = gripper.positions[-1]
        mujoco.mj_forward(parts.model, data)
        inertia = np.zeros((parts.model.nv, parts.model.nv))
        mujoco.mj_fullM(parts.model, data, inertia)
        own = np.diagonal(inertia)[parts.arm_v]
        self._stiffness = SERVO_FREQUENCY**2 * own
        self._damping = 2.0 * SERVO_FREQUENCY * own
        self.steps = 0
        self.stop = protocol.Stop.NONE
        self.speed = 1.0
        """Share of the joints' speeds that the client may use."""
        self.greatest_force = 0.0
        """Greatest contact force at the wrist so far, by the true sensor, N."""
        self._mode = protocol.Mode.HOLD
        self._setpoint, self._rate = self._home.copy(), np.zeros(n)
        self._torque = np.zeros(n)
        self._drive_torque = np.zeros(n)
        self._path: list[PathPoint] = []
        self._commanded = 0.0
        self._waiting: deque[tuple[int, protocol.Command]] = deque()
        self.command = 0
        """Sequence of the last command in force."""
        self._grip = protocol.GripCommand(gripper.max_width, gripper.max_force)
        self._grip_since = -1.0
        self._waiting_grips: deque[tuple[int, protocol.GripCommand]] = deque()
        self._target = gripper.max_width
        self._finger_force = 0.0
        self._felt = np.zeros(3)
        self._hand_weight = 9.81 * float(parts.model.body_subtreemass[parts.hand])
        self._past: deque[Reading] = deque(maxlen=round(self.faults.state_latency / STEP) + 1)
        self._delays = self._past.maxlen != 1
        for _ in range(round(SETTLING_TIME / STEP)):
            self._drive()
            mujoco.mj_step(parts.model, data)
        self._felt = self._contact_force()
        self.greatest_force = 0.0
        self._past.append(self._read(self._rng))

    @property
    def time(self) -> float:
        """Time of the robot's clock, s."""
        return self.steps * STEP

    def take(self, command: protocol.Command) -> None:
        """Accept a command; it takes effect after the command latency."""
        self._waiting.append((self.steps + round(self.faults.command_latency / STEP), command))
        if command.grip is not None:
            due = self.steps + round((self.faults.command_latency + self.faults.gripper_latency) / STEP)
            self._waiting_grips.append((due, command.grip))

    def halt(self, reason: protocol.Stop) -> None:
        """Brake at once, and stay stopped until `clear`."""
        if self.stop is protocol.Stop.NONE:
            self.stop = reason
        self._mode, self._path = protocol.Mode.HOLD, []

    def clear(self) -> None:
        """End a stop; the robot holds its position."""
        self.stop = protocol.Stop.NONE
        self._setpoint, self._rate = self._arm(self.data.qpos, self.parts.arm_q), np.zeros(len(self._home))

    def advance(self, seconds: float) -> None:
        """Let time pass, in whole steps."""
        for _ in range(round(seconds / STEP)):
            while self._waiting and self._waiting[0][0] <= self.steps:
                self._follow(self._waiting.popleft()[1])
            while self._waiting_grips and self._waiting_grips[0][0] <= self.steps:
                self._grip, self._grip_since = self._waiting_grips.popleft()[1], self.time
            self._move_setpoint()
            self._drive()
            mujoco.mj_step(self.parts.model, self.data)
            self.steps += 1
            self._guard()
            if self._delays:
                self._past.append(self._read(self._rng))

    def reading(self, rng: np.random.Generator | None = None) -> Reading:
        """Return the readings that the robot reports now; `rng`: noise that changes no other reading."""
        return self._past[0] if self._delays else self._read(rng or self._rng)

    def tcp(self) -> tuple[Array, Array]:
        """Return the TCP's true position (3,) and rotation (3, 3) in the world."""
        data, site = self.data, self.parts.tcp
        return data.site_xpos[site].copy(), data.site_xmat[site].reshape(3, 3).copy()

    @property
    def width(self) -> float:
        """True opening of the gripper, m."""
        return self._opening()[0]

    def _follow(self, command: protocol.Command) -> None:
        self.command = command.sequence
        self._commanded = self.time
        if self.stop is not protocol.Stop.NONE:
            return
        self._mode = command.mode
        if command.mode is protocol.Mode.TORQUE:
            self._torque = np.array(command.torque)
            self._path = []
            return
        if command.mode is protocol.Mode.HOLD:
            self._path = []
            return
        period = command.advance or STEP
        goal = np.array(command.position)
        allowed = self._fastest * SPEED_MARGIN * period + 0.01
        if bool((np.abs(goal - self._setpoint) > allowed).any()):
            self.halt(protocol.Stop.JUMP)
            return
        rate = np.array(command.velocity)
        if self.speed < 1.0 and self._is_too_fast(command, goal, rate):
            self.halt(protocol.Stop.SPEED)
            return
        self._path = [PathPoint(0.0, self._setpoint, self._rate), PathPoint(period, goal, rate)]
        ahead = [
            (at, np.array(position))
            for at, position in zip(protocol.PREVIEW_TIMES, command.ahead, strict=False)
            if at > period
        ]
        for k, (at, position) in enumerate(ahead):
            before, after = self._path[-1], ahead[min(k + 1, len(ahead) - 1)]
            mean = (after[1] - before.position) / (after[0] - before.time)
            self._path.append(PathPoint(at, position, mean))
        if not ahead:
            self._path.append(PathPoint(period + EXTRAPOLATION, goal + EXTRAPOLATION * rate, rate))

    def _is_too_fast(self, command: protocol.Command, goal: Array, rate: Array) -> bool:
        """Return whether a command exceeds the client's share of the speeds, its path ahead included."""
        points = [(0.0, self._setpoint), (command.advance or STEP, goal)]
        points += [
            (at, np.array(ahead))
            for at, ahead in zip(protocol.PREVIEW_TIMES, command.ahead, strict=False)
            if at > points[1][0]
        ]
        rates = [rate, *((b[1] - a[1]) / (b[0] - a[0]) for a, b in itertools.pairwise(points))]
        return bool((np.abs(rates) > self.speed * self._fastest + SPEED_ALLOWANCE).any())

    def _move_setpoint(self) -> None:
        """Move the set-point along the commanded path; beyond its end brake."""
        data, parts = self.data, self.parts
        since = self.time - self._commanded
        if self._mode is protocol.Mode.TORQUE:
            self._setpoint, self._rate = self._arm(data.qpos, parts.arm_q), self._arm(data.qvel, parts.arm_v)
            if since > EXTRAPOLATION:
                self._mode = protocol.Mode.HOLD
            return
        ahead = since + STEP
        path = self._path
        if path and ahead <= min(path[-1].time, SILENCE) + 1e-9:
            k = next(k for k, point in enumerate(path[1:], 1) if ahead <= point.time + 1e-9)
            self._setpoint, self._rate = between(path[k - 1], path[k], ahead)
            return
        moves = bool(path) and bool(self._rate.any())
        if moves and since > SILENCE and self.stop is protocol.Stop.NONE:
            self.stop = protocol.Stop.SILENCE
        self._path = []
        slower = np.maximum(np.abs(self._rate) - self._braking * STEP, 0.0)
        self._rate = np.sign(self._rate) * slower
        self._setpoint = self._setpoint + self._rate * STEP

    def _drive(self) -> None:
        """Set the motors for one step."""
        data, parts = self.data, self.parts
        q, v = self._arm(data.qpos, parts.arm_q), self._arm(data.qvel, parts.arm_v)
        if self._mode is protocol.Mode.TORQUE and self.stop is protocol.Stop.NONE:
            torque = self._torque + self._own_weight()
        else:
            torque = self._stiffness * (self._setpoint - q) + self._damping * (self._rate - v)
            torque += self._arm(data.qfrc_bias, parts.arm_v)
        self._drive_torque = np.clip(torque, -self._strongest, self._strongest)
        data.ctrl[: len(q)] = self._drive_torque
        self._drive_fingers(len(q))

    def _drive_fingers(self, first: int) -> None:
        gripper, grip = self.cell.robot.gripper, self._grip
        width, rate, per_rad = self._opening()
        speed = 2.0 * min(grip.speed or gripper.speed, gripper.speed)
        goal = min(max(grip.width, self._widths[0]), self._widths[-1])
        self._target += min(max(goal - self._target, -speed * STEP), speed * STEP)
        self._target = min(max(self._target, width - FINGER_LEAD), width + FINGER_LEAD)
        most = min(grip.force, gripper.max_force)
        force = FINGER_GAIN * (self._target - width) / 2 - FINGER_DAMPING * rate / 2
        self._finger_force = min(max(force, -most), most)
        self.data.ctrl[first:] = self._finger_force * per_rad

    def _opening(self) -> tuple[float, float, float]:
        """Return the opening, m, its rate, m/s, and its derivative by the driven joint."""
        data, parts = self.data, self.parts
        q, v = data.qpos[parts.finger_q], data.qvel[parts.finger_v]
        if self.cell.robot.gripper.sliders:
            return float(q.sum()), float(v.sum()), 1.0
        angle = float(q[0])
        step = abs(self._drive_order[-1] - self._drive_order[0]) / 64
        low, high = angle - step, angle + step
        at, below, above = np.interp([angle, low, high], self._drive_order, self._width_order)
        inside = min(high, self._drive_order[-1]) - max(low, self._drive_order[0])
        per_rad = float(above - below) / max(inside, step)
        return float(at), float(per_rad * v[0]), float(per_rad)

    def _own_weight(self) -> Array:
        """Return the torques (n,) that carry the robot's own weight, Nm."""
        model, data, base = self.parts.model, self.data, self.parts.base
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacSubtreeCom(model, data, jacobian, base)
        return 9.81 * float(model.body_subtreemass[base]) * jacobian[2, self.parts.arm_v]

    def _wrench(self) -> Array:
        """Return the wrench (6,) of hand and load on the wrist, flange axes, without noise.

        MuJoCo's sensors give what the arm exerts on the hand.
        """
        return -self.data.sensordata[:6]

    def _contact_force(self) -> Array:
        """Return the force (3,) at the wrist without the weight of the hand, flange axes, N."""
        data, wrist = self.data, self.parts.wrist
        # Gravity along the world's z: its axis in the flange is the third row of the rotation.
        return self._hand_weight * data.site_xmat[wrist][6:9] - data.sensordata[:3]

    def _guard(self) -> None:
        """Stop the arm beyond its limits."""
        data, parts = self.data, self.parts
        self._felt += (self._contact_force() - self._felt) * (STEP / FORCE_FILTER)
        x, y, z = self._felt.tolist()
        force = math.sqrt(x * x + y * y + z * z)
        self.greatest_force = max(self.greatest_force, force)
        if self.stop is not protocol.Stop.NONE:
            return
        q, v = data.qpos[parts.arm_q], data.qvel[parts.arm_v]
        at = data.site_xpos[parts.tcp]
        if force > FORCE_MARGIN * self.cell.force:
            self.halt(protocol.Stop.FORCE)
        elif bool((np.abs(v) > SPEED_MARGIN * self.speed * self._fastest + 3 * SPEED_ALLOWANCE).any()):
            self.halt(protocol.Stop.SPEED)
        elif self._mode is not protocol.Mode.TORQUE and bool(
            (np.abs(self._setpoint - q) > FOLLOWING_ERROR).any()
        ):
            self.halt(protocol.Stop.TRACKING)
        elif bool((q < self._lower - LIMIT_MARGIN).any() or (q > self._upper + LIMIT_MARGIN).any()):
            self.halt(protocol.Stop.POSITION)
        elif bool((at < self._least).any() or (at > self._greatest).any()):
            self.halt(protocol.Stop.WORKSPACE)

    def _read(self, rng: np.random.Generator) -> Reading:
        data, parts, faults = self.data, self.parts, self.faults
        q, v = self._arm(data.qpos, parts.arm_q), self._arm(data.qvel, parts.arm_v)
        if faults.encoder_noise > 0.0:
            q += faults.encoder_noise * rng.standard_normal(len(q))
            v += 10.0 * faults.encoder_noise * rng.standard_normal(len(v))
        width, rate, _ = self._opening()
        noise = faults.wrench_noise * rng.standard_normal(6) * np.repeat([1.0, 0.05], 3)
        return Reading(
            self.time,
            q,
            v,
            self._drive_torque.copy(),
            (width, rate, abs(self._finger_force)),
            self._wrench() + noise,
            self._busy(width, rate),
        )

    def _busy(self, width: float, rate: float) -> bool:
        if self._waiting_grips:
            return True
        started = self.time - self._grip_since >= BUSY_START_TIME
        far = abs(width - self._grip.width) > BUSY_DISTANCE
        return bool(far and (abs(rate) > BUSY_RATE or not started))

    @staticmethod
    def _arm(values: Array, at: NDArray[np.intp]) -> Array:
        return np.array(values[at])
