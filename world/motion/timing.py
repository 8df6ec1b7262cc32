"""From a path to a timed trajectory within the joints' limits of velocity, acceleration, jerk and torque.

The fastest profile of the path's speed comes from TOPP-RA (Pham and Pham, "A new approach to time-optimal
path parameterization based on reachability analysis", IEEE Transactions on Robotics 34, 2018). Its
acceleration jumps; so the time law s(t), not the joints, is averaged over a short window. The path stays what
was checked, and the acceleration becomes continuous.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..robot.model import RobotModel
from ..trajectory import Trajectory
from ..values import Array
from .curves import Curve, cornered, distinct, splined
from .profile import TimeLaw, fastest
from .requests import Scaling

PERIOD = 0.01
"""Between two samples of a trajectory, at most, s."""
RESERVE = 0.9
"""Share of the acceleration limits that is planned with: between grid points it overshoots."""
TORQUE = 0.7
"""Share of the torque limits that is planned with: the servo and a held object need the rest."""
HEAVY = 0.95
"""Share of what is left of the torques that the profile is planned with, for the same reason."""
RISE = 0.025
"""The jerk limit of a joint is its acceleration limit over this time, s."""
WINDOW = 0.045
"""Over which the time law is averaged, s: from full acceleration to full braking at the jerk limit."""
BEND = 0.5
"""Share of the jerk limit that the path's own bends may take at a constant speed."""
GRID = 0.1
"""Distance of TOPP-RA's grid points along the path, rad."""
LEAST = 6
"""Steps of the grid on each piece of a path that has few."""
MANY = 12
"""Breaks of a path that is so finely cut already, as one along a Cartesian line."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """How fast the path may be followed up to parameter `end`, rad."""

    end: float
    scaling: Scaling


@dataclass(frozen=True, slots=True, eq=False)
class Timed:
    """A trajectory, and the path's parameter (m,) at each of its samples."""

    trajectory: Trajectory
    parameter: Array

    def when(self, s: float) -> float:
        """The time at which the parameter is reached, s."""
        return float(np.interp(s, self.parameter, self.trajectory.times))


def time_corners(model: RobotModel, path: Array, scaling: Scaling, radius: float) -> Trajectory | None:
    """Along a polyline (m, n) with its corners cut by at most `radius` rad. None when no timing is found."""
    points = distinct(path)
    if len(points) < 2:
        return standing(path[-1])
    return _trajectory(model, cornered(points, radius), scaling)


def time_smooth(model: RobotModel, path: Array, scaling: Scaling) -> Trajectory | None:
    """Along a cubic spline through dense waypoints (m, n), as those of a Cartesian line."""
    points = distinct(path)
    if len(points) < 2:
        return standing(path[-1])
    return _trajectory(model, splined(points) if len(points) > 2 else cornered(points, 0.0), scaling)


def standing(q: Array) -> Trajectory:
    """No motion at all, for one period."""
    still = np.zeros((2, len(q)))
    return Trajectory(np.array([0.0, PERIOD]), np.array([q, q]), still, still)


def time_curve(model: RobotModel, curve: Curve, stretches: Sequence[Stretch]) -> Timed | None:
    """Along a curve from rest to rest, each stretch of it with its own scaling; the last one ends where the
    curve does. None when no timing is found, or when the curve leaves the joints' limits."""
    if not _within(model, curve):
        return None
    law = _law(model, curve, stretches)
    if law is None:
        return None
    duration = float(law.times[-1]) + WINDOW
    times: Array = np.linspace(0.0, duration, max(2, int(np.ceil(duration / PERIOD)) + 1))
    s, ds, dds = law.averaged(times, WINDOW)
    s = np.clip(s, 0.0, curve.length)
    along, bend = curve.at(s, 1), curve.at(s, 2)
    q, v = curve.at(s), along * ds[:, None]
    a = along * dds[:, None] + bend * (ds**2)[:, None]
    v[0] = v[-1] = a[0] = a[-1] = 0.0
    velocity, acceleration = _limits(model, s, stretches)
    between = np.diff(times)[:, None]
    steps: Array = np.diff(v, axis=0) / between
    jerk: Array = np.diff(a, axis=0) / between
    stretch = max(
        1.0,
        float((np.abs(v) / velocity).max()),
        float(np.sqrt((np.abs(a) / acceleration).max())),
        float(np.sqrt((np.abs(steps) / acceleration[1:]).max())),
        float(np.cbrt((np.abs(jerk) * RISE / acceleration[1:]).max())),
        _heavy(model, q, v, a),
    )
    return Timed(Trajectory(times * stretch, q, v / stretch, a / stretch**2), s)


def _trajectory(model: RobotModel, curve: Curve, scaling: Scaling) -> Trajectory | None:
    timed = time_curve(model, curve, (Stretch(curve.length, scaling),))
    return None if timed is None else timed.trajectory


def _law(model: RobotModel, curve: Curve, stretches: Sequence[Stretch]) -> TimeLaw | None:
    grid = _grid(curve, stretches)
    velocity, acceleration = _limits(model, grid, stretches)
    first, second, third = (curve.at(grid, order) for order in (1, 2, 3))
    # At a constant speed the joints still jerk, where the path's bend changes.
    jerk = BEND * acceleration / RISE
    speed = np.minimum(
        (velocity / np.maximum(np.abs(first), 1e-9)).min(axis=1),
        np.cbrt((jerk / np.maximum(np.abs(third), 1e-9)).min(axis=1)),
    )
    torques = _torques(model, curve.at(grid), first, second)
    return fastest(grid, first, second, speed, RESERVE * acceleration, torques)


def _torques(model: RobotModel, q: Array, first: Array, second: Array) -> tuple[Array, Array]:
    """What the path's acceleration and its squared speed take of the joints' torques that gravity leaves,
    as shares (m, n) of those."""
    arm, data, still = model.arm, model.arm.createData(), np.zeros(model.n)
    weight = np.array([pin.rnea(arm, data, p, still, still) for p in q])
    along = np.array([pin.rnea(arm, data, p, still, v) for p, v in zip(q, first, strict=True)]) - weight
    bending = np.array([pin.rnea(arm, data, *each) for each in zip(q, first, second, strict=True)]) - weight
    left = HEAVY * _left(model, weight)
    return along / left, bending / left


def _left(model: RobotModel, weight: Array) -> Array:
    """Torques (m, n) that may go into motion where gravity takes `weight` (m, n), Nm."""
    return np.maximum(TORQUE * model.torque_limit - np.abs(weight), 0.1 * model.torque_limit)


def _grid(curve: Curve, stretches: Sequence[Stretch]) -> Array:
    """Every break and end of a stretch, and between them at most GRID apart."""
    marks = np.unique(np.concatenate([curve.breaks, [stretch.end for stretch in stretches[:-1]]]))
    marks = marks[np.concatenate([[True], np.diff(marks) > 1e-9])]
    least = LEAST if len(marks) < MANY else 1
    counts = np.maximum(least, np.ceil(np.diff(marks) / GRID).astype(int))
    steps = np.repeat(np.diff(marks) / counts, counts)
    grid: Array = np.concatenate([[0.0], np.cumsum(steps)])
    grid[-1] = curve.length
    return grid


def _limits(model: RobotModel, s: Array, stretches: Sequence[Stretch]) -> tuple[Array, Array]:
    """Limits of velocity and acceleration (m, n) at parameters (m,); where two stretches meet, the lower."""
    ends = np.array([stretch.end for stretch in stretches[:-1]])
    before = np.searchsorted(ends, s - 1e-9, side="left")
    after = np.searchsorted(ends, s + 1e-9, side="right")
    velocity = np.array([stretch.scaling.velocity for stretch in stretches])
    acceleration = np.array([stretch.scaling.acceleration for stretch in stretches])
    return (
        np.minimum(velocity[before], velocity[after])[:, None] * model.velocity_limit,
        np.minimum(acceleration[before], acceleration[after])[:, None] * model.acceleration_limit,
    )


def _within(model: RobotModel, curve: Curve) -> bool:
    """Whether the curve stays within the limits, and where its own corners lie beyond them, within those."""
    corners = np.concatenate([curve.coefficients[:, 0], curve.at(np.array([curve.length]))])
    lower = np.minimum(model.lower, corners.min(axis=0))
    upper = np.maximum(model.upper, corners.max(axis=0))
    q = curve.at(np.linspace(0.0, curve.length, max(2, int(curve.length / 0.02) + 1)))
    return bool((q >= lower - 1e-9).all() and (q <= upper + 1e-9).all())


def _heavy(model: RobotModel, q: Array, v: Array, a: Array) -> float:
    """By how much the time must be stretched so that the joints' torques suffice.

    Stretched by k, the torques of inertia, Coriolis and centrifugal forces fall by k²; gravity stays.
    """
    arm, data, still = model.arm, model.arm.createData(), np.zeros(model.n)
    picked = range(0, len(q), 2)
    weight = np.array([pin.rnea(arm, data, q[k], still, still) for k in picked])
    moving = np.array([pin.rnea(arm, data, q[k], v[k], a[k]) for k in picked]) - weight
    return float(np.sqrt((np.abs(moving) / _left(model, weight)).max()))
