"""Controllers on the stiff joint servo: hold, brake, follow a trajectory."""

from __future__ import annotations

import math

import numpy as np

from ..robot.model import RobotModel
from ..trajectory import Trajectory
from ..values import Array, JointState
from .commands import Controller, JointCommand

BLEND = 0.25
"""Time in which a small offset to the start of a trajectory is faded out, s."""
LEAST_DECELERATION = 1.0
"""Of the progress along a path, 1/s²: braking on the path ends within a second in any case."""
BRAKING = 0.6
"""Share of the acceleration limits for braking on a path: all at once the joints' torques would not do."""
MOST_DECELERATION = 60.0
UNATTENDED = 0.1
"""How long a motion that was handed over goes on before it brakes by itself, s."""


class Hold:
    """Stay at a configuration: the given one, else the set-point at the start."""

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


class Brake:
    """Slow each joint down at its own acceleration limit."""

    def __init__(self, model: RobotModel, period: float) -> None:
        self._step: Array = model.acceleration_limit * period
        self._period = period
        self.done = False

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        self._position = setpoint.position.copy()
        self._velocity = setpoint.velocity.copy()

    def update(self, now: float, state: JointState) -> JointCommand:
        slower = np.sign(self._velocity) * np.maximum(np.abs(self._velocity) - self._step, 0.0)
        self._position = self._position + (0.5 * self._period) * (self._velocity + slower)
        self._velocity = slower
        self.done = not slower.any()
        return JointCommand(self._position, slower)

    def brake(self) -> Controller:
        return self


class Track:
    """Follow a trajectory in time. It brakes *on the path*, which was checked for collisions.

    Progress s runs with rate r = 1; while braking, r falls such that |q″r² − q′·u| stays within the
    joints' acceleration limits, with u the deceleration of the progress.
    """

    def __init__(self, trajectory: Trajectory, model: RobotModel, period: float) -> None:
        self.trajectory = trajectory
        self.progress = 0.0
        """Seconds of the trajectory that were commanded."""
        self.done = False
        self._period = period
        self._limit = BRAKING * model.acceleration_limit
        self._times: list[float] = trajectory.times.tolist()
        self._coefficients = _cubics(trajectory)
        self._powers = np.zeros((2, 4))
        self._powers[0, 0] = 1.0
        self._powers[1, 1] = 1.0
        self._segment = 0
        self._rate = 1.0
        self._braking = False
        self._unattended: int | None = None

    @property
    def braking(self) -> bool:
        return self._braking

    @property
    def completed(self) -> bool:
        """The end of the trajectory was commanded."""
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
            left = max(0.0, 1.0 - self.progress / min(BLEND, end)) if end > 0.0 else 0.0
            fade = left * left * (3.0 - 2.0 * left)
            position = position + fade * self._offset
        self.done = self._rate == 0.0 or self.progress >= end
        if self.done:
            velocity = np.zeros_like(velocity)
        return JointCommand(position, velocity)

    def brake(self) -> Controller:
        self._braking = True
        return self

    def hand_over(self, seconds: float = UNATTENDED) -> None:
        """Brake after `seconds`, unless somebody goes on with this motion by then."""
        self._unattended = round(seconds / self._period)

    def go_on(self) -> None:
        """Somebody attends to this motion again."""
        self._unattended = None

    def _sample(self, s: float) -> tuple[Array, Array]:
        times, k = self._times, self._segment
        last = len(self._coefficients) - 1
        while k < last and times[k + 1] <= s:
            k += 1
        self._segment = k
        t = s - times[k]
        p = self._powers
        p[0, 1] = t
        p[0, 2] = t * t
        p[0, 3] = t * t * t
        p[1, 2] = 2.0 * t
        p[1, 3] = 3.0 * t * t
        both = p @ self._coefficients[k]
        return both[0], both[1]

    def _slow_down(self) -> None:
        c = self._coefficients[self._segment]
        t = self.progress - self._times[self._segment]
        along = c[1] + 2.0 * t * c[2] + 3.0 * t * t * c[3]
        bend = (2.0 * c[2] + 6.0 * t * c[3]) * (self._rate * self._rate)
        speed = np.abs(along)
        moving = speed > 1e-6
        deceleration = MOST_DECELERATION
        if moving.any():
            room = (self._limit + np.sign(along) * bend)[moving] / speed[moving]
            deceleration = min(max(float(room.min()), LEAST_DECELERATION), MOST_DECELERATION)
        self._rate = max(0.0, self._rate - deceleration * self._period)


def _cubics(trajectory: Trajectory) -> Array:
    """Coefficients (m - 1, 4, n) of the cubic Hermite pieces in the time since their beginning."""
    h = np.diff(trajectory.times)[:, None]
    p, v = trajectory.position, trajectory.velocity
    if len(h) == 0:
        return np.stack([p, np.zeros_like(p), np.zeros_like(p), np.zeros_like(p)], axis=1)
    step = (p[1:] - p[:-1]) / h
    return np.stack(
        [p[:-1], v[:-1], (3 * step - 2 * v[:-1] - v[1:]) / h, (v[:-1] + v[1:] - 2 * step) / h**2], axis=1
    )


def way_back(trajectory: Trajectory, done: float, rate: float = 0.3) -> Trajectory | None:
    """The same path from `done` s back to its start, from rest to rest, at about `rate` of its speed."""
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
