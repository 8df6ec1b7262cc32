"""Controllers on the stiff joint servo: hold, brake, follow a trajectory."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from picktree.world import Array, JointState, Trajectory
from picktree.world.robot_model import RobotModel

from .commands import Controller, JointCommand

OFFSET_FADE_TIME = 0.25
"""Time in which a small offset to the start of a trajectory fades out, s."""
MIN_PATH_DECELERATION = 1.0
"""Least deceleration of the progress along a path, 1/s²: braking on the path ends within a second in any
case."""
PATH_BRAKING_SHARE = 0.6
"""Acceleration of braking on a path, as a share of its limits."""
MAX_PATH_DECELERATION = 60.0
BRAKING_TORQUE_SHARE = 0.85
"""Share of the torque limits that braking takes: the servo and a held object need the rest."""
TORQUE_RELAXATIONS = 8
"""Iterations that redistribute torque from joints with a reserve to joints that lack it."""
MIN_BRAKING_SHARE = 0.15
"""Least share of the remaining braking that is applied in any case."""
MAX_UNATTENDED_TIME = 0.1
"""Time for which a handed-over motion continues before it brakes by itself, s."""

_FIRST_DERIVATIVE = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
_SECOND_DERIVATIVE = np.array([2.0, 6.0, 12.0, 20.0])


class HoldController:
    """Controller that holds a configuration: the given one, else the set-point at the start."""

    name: ClassVar[str] = "Hold"
    done = False

    def __init__(self, position: Array | None = None) -> None:
        self._position = position

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        position = setpoint.position if self._position is None else self._position
        self.command = JointCommand(position.copy(), np.zeros_like(position))

    def update(self, now: float, state: JointState) -> JointCommand:
        return self.command

    def brake(self) -> Controller:
        return self


class BrakeController:
    """Controller that brakes all joints at their acceleration limits, as far as their torques suffice."""

    name: ClassVar[str] = "Brake"

    def __init__(self, model: RobotModel, period: float) -> None:
        self._model = model
        self._step: Array = model.acceleration_limit * period
        self._period = period
        self.done = False

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        self._position = setpoint.position.copy()
        self._velocity = setpoint.velocity.copy()

    def update(self, now: float, state: JointState) -> JointCommand:
        change = self._change()
        slower = self._velocity + change
        self._position = self._position + (0.5 * self._period) * (self._velocity + slower)
        self._velocity = slower
        self.done = not slower.any()
        return JointCommand(self._position, slower)

    def brake(self) -> Controller:
        return self

    def _change(self) -> Array:
        """Return the change (n,) of the joint speeds in this period, rad/s. No joint accelerates or exceeds
        its torque."""
        model, speed = self._model, np.abs(self._velocity)
        most = -np.sign(self._velocity) * np.minimum(self._step, speed)
        mass = model.mass_matrix(self._position) / self._period
        coasting = model.bias(self._position, self._velocity)
        limit = BRAKING_TORQUE_SHARE * model.torque_limit
        change = most.copy()
        for _ in range(TORQUE_RELAXATIONS):
            torque = mass @ change + coasting
            excess = torque - np.clip(torque, -limit, limit)
            if not excess.any():
                return change
            change = change - excess / np.diagonal(mass)
            change = np.clip(change, np.minimum(most, 0.0), np.maximum(most, 0.0))
        room = np.maximum(limit - np.sign(mass @ change) * coasting, 0.0)
        share = float((room / np.maximum(np.abs(mass @ change), 1e-9)).min())
        return change * min(max(share, MIN_BRAKING_SHARE), 1.0)


class TrajectoryController:
    """Controller that follows a trajectory in time. It brakes *on the path*, which was checked for
    collisions.

    Progress s runs with rate r = 1. While braking, r falls by u a second: the joints accelerate by
    q″r² − q′·u, within their limits, and M(q″r² − q′·u) + bias(q, q′r) stays within their torques.
    """

    name: ClassVar[str] = "Track"

    def __init__(self, trajectory: Trajectory, model: RobotModel, period: float) -> None:
        self.trajectory = trajectory
        self.progress = 0.0
        """Commanded part of the trajectory, s."""
        self.done = False
        self._period = period
        self._model = model
        self._limit = PATH_BRAKING_SHARE * model.acceleration_limit
        self._times: list[float] = trajectory.times.tolist()
        self._coefficients = trajectory.polynomials()
        self._segment = 0
        self._rate = 1.0
        self._braking = False
        self._unattended: int | None = None

    @property
    def braking(self) -> bool:
        return self._braking

    @property
    def completed(self) -> bool:
        """Whether the end of the trajectory was commanded."""
        return self.progress >= self._times[-1]

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        offset = setpoint.position - self.trajectory.start
        self._offset: Array | None = offset if np.abs(offset).max() > 1e-9 else None

    def update(self, now: float, state: JointState) -> JointCommand:
        if self._unattended is not None:
            self._unattended -= 1
            self._braking = self._braking or self._unattended < 0
        if self._braking:
            self._slow_down()
        end = self._times[-1]
        self.progress = min(self.progress + self._rate * self._period, end)
        position, velocity = self._sample(self.progress)
        if self._rate != 1.0:
            velocity = velocity * self._rate
        if self._offset is not None:
            position = position + self._fade(self.progress) * self._offset
        self.done = self._rate == 0.0 or self.progress >= end
        if self.done:
            velocity = np.zeros_like(velocity)
        return JointCommand(position, velocity)

    def ahead(self, times: tuple[float, ...]) -> tuple[Array, ...]:
        """Return the configurations (n,) that follow the last command by these times, s; none while
        braking."""
        if self._braking:
            return ()
        segment = self._segment
        found: list[Array] = []
        for time in times:
            s = min(self.progress + self._rate * time, self._times[-1])
            position = self._sample(s)[0]
            found.append(position if self._offset is None else position + self._fade(s) * self._offset)
        self._segment = segment
        return tuple(found)

    def brake(self) -> Controller:
        self._braking = True
        return self

    def hand_over(self, seconds: float = MAX_UNATTENDED_TIME) -> None:
        """Brake after `seconds`, unless another skill continues this motion before."""
        self._unattended = round(seconds / self._period)

    def go_on(self) -> None:
        """Cancel the braking that `hand_over` has scheduled."""
        self._unattended = None

    def _fade(self, s: float) -> float:
        """Return the share of the offset that is left at `s` s of the trajectory."""
        end = self._times[-1]
        left = max(0.0, 1.0 - s / min(OFFSET_FADE_TIME, end)) if end > 0.0 else 0.0
        return left * left * (3.0 - 2.0 * left)

    def _sample(self, s: float) -> tuple[Array, Array]:
        times, k = self._times, self._segment
        last = len(self._coefficients) - 1
        while k < last and times[k + 1] <= s:
            k += 1
        self._segment = k
        t = s - times[k]
        t2 = t * t
        t3 = t2 * t
        t4 = t3 * t
        powers = (1.0, t, t2, t3, t4, t4 * t)
        derivatives = (0.0, 1.0, 2.0 * t, 3.0 * t2, 4.0 * t3, 5.0 * t4)
        # For so few numbers `dot` takes half the time of `@`.
        both = np.array(powers + derivatives).reshape(2, 6).dot(self._coefficients[k])
        return both[0], both[1]

    def _slow_down(self) -> None:
        c = self._coefficients[self._segment]
        t = self.progress - self._times[self._segment]
        powers = t ** np.arange(6.0)
        position = powers @ c
        along = (_FIRST_DERIVATIVE * powers[:5]) @ c[1:]
        bend = (_SECOND_DERIVATIVE * powers[:4]) @ c[2:] * (self._rate * self._rate)
        mass = self._model.mass_matrix(position)
        torque = mass @ bend + self._model.bias(position, along * self._rate)
        most = BRAKING_TORQUE_SHARE * self._model.torque_limit
        room = min(_room(bend, -along, self._limit), _room(torque, mass @ -along, most))
        deceleration = min(max(room, MIN_PATH_DECELERATION), MAX_PATH_DECELERATION)
        self._rate = max(0.0, self._rate - deceleration * self._period)


def _room(base: Array, change: Array, limit: Array) -> float:
    """Return the greatest u with |base + u·change| within the limits (n,); infinite where nothing changes."""
    size = np.abs(change)
    moving = size > 1e-6
    return float(((limit - np.sign(change) * base)[moving] / size[moving]).min(initial=math.inf))


def reversed_trajectory(trajectory: Trajectory, done: float, rate: float = 0.3) -> Trajectory | None:
    """Return the same path from `done` s back to its start, from rest to rest, at about `rate` of its speed.

    None: the path is too short.
    """
    if done <= 1e-3:
        return None
    duration = 1.5 * done / rate
    times = np.linspace(0.0, duration, max(8, math.ceil(duration / 0.02) + 1))
    x = times / duration
    s = done * (1.0 - x * x * (3.0 - 2.0 * x))
    ds = -done * 6.0 * x * (1.0 - x) / duration
    samples = [trajectory.sample(float(value)) for value in s]
    position = np.array([p for p, _ in samples])
    velocity = np.array([v for _, v in samples]) * ds[:, None]
    return Trajectory(times, position, velocity, np.gradient(velocity, times, axis=0))
