"""Time parameterisation: from a path to a trajectory within the joints' limits of velocity, acceleration,
jerk and torque.

The fastest profile of the path's speed comes from TOPP-RA. Its acceleration jumps. Therefore the time law
s(t), not the joints, is averaged over a short window. The path stays what was checked, and the acceleration
becomes continuous.

Pham and Pham, "A new approach to time-optimal path parameterization based on reachability analysis", IEEE
Transactions on Robotics 34 (2018).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...world.robot_model.model import RobotModel
from ...world.trajectory import Trajectory
from ...world.values import Array
from .path_curves import JointCurve, distinct, rounded_polyline, spline_through
from .requests import Scaling
from .toppra_profile import PathLimits, ScaledStretch, TimeLaw, least_ratio, time_optimal_law

SAMPLE_PERIOD = 0.01
"""Greatest time between two samples of a trajectory, s."""
ACCELERATION_SHARE = 0.9
"""Share of the acceleration limits in the plan: between grid points the profile overshoots."""
TORQUE_SHARE = 0.95
"""Share of the remaining torques in the plan of the profile, for the same reason."""
AVERAGING_WINDOW = 0.045
"""Window over which the time law is averaged, s: from full acceleration to full braking at the jerk limit."""
BEND_JERK_SHARE = 0.5
"""Share of the jerk limit that the path's own bends may take at a constant speed."""
MAX_PROFILE_PASSES = 3
"""Greatest number of plans of a profile, each slower where the averaged one exceeded a limit."""
ACCEPTED_EXCESS = 1.01
"""Excess over a limit, as a factor, up to which a profile is not planned again: all of it goes slower."""
GRID_DISTANCE = 0.1
"""Distance of TOPP-RA's grid points along the path, rad."""
MIN_GRID_STEPS = 12
"""Least number of grid steps, rounded up on each piece of the path."""
MAX_GRID_TURN = 0.25
"""Greatest turn of the path's direction between two grid points, rad."""


@dataclass(frozen=True, slots=True, eq=False)
class TimedTrajectory:
    """Trajectory with the path's parameter (m,) at each of its samples."""

    trajectory: Trajectory
    parameter: Array

    def when(self, s: float) -> float:
        """Return the time at which the parameter is reached, s."""
        return float(np.interp(s, self.parameter, self.trajectory.times))


def time_corners(model: RobotModel, path: Array, scaling: Scaling, radius: float) -> Trajectory | None:
    """Time a polyline (m, n) with its corners cut by at most `radius` rad. None when no timing is found."""
    points = distinct(path)
    if len(points) < 2:
        return stationary_trajectory(path[-1])
    return _trajectory(model, rounded_polyline(points, radius), scaling)


def time_smooth(model: RobotModel, path: Array, scaling: Scaling) -> Trajectory | None:
    """Time a cubic spline through dense waypoints (m, n), as those of a Cartesian line. None when no timing
    is found."""
    points = distinct(path)
    if len(points) < 2:
        return stationary_trajectory(path[-1])
    return _trajectory(
        model, spline_through(points) if len(points) > 2 else rounded_polyline(points, 0.0), scaling
    )


def stationary_trajectory(q: Array) -> Trajectory:
    """Return a trajectory without motion, for one period."""
    still = np.zeros((2, len(q)))
    return Trajectory(np.array([0.0, SAMPLE_PERIOD]), np.array([q, q]), still, still)


def time_curve(
    model: RobotModel, curve: JointCurve, stretches: Sequence[ScaledStretch]
) -> TimedTrajectory | None:
    """Time a curve from rest to rest, each stretch with its own scaling; the last one ends where the curve
    does.

    None when no timing is found, or when the curve leaves the joints' limits.
    """
    limits = PathLimits(model, stretches)
    grid = _grid(curve, stretches)
    at, first, second, third = curve.derivatives(grid, 3)
    # The averaged law lags behind the profile.
    speed = limits.speed(grid, first, AVERAGING_WINDOW)
    acceleration = (
        ACCELERATION_SHARE * limits.kinematic(grid, limits.around(grid, first, AVERAGING_WINDOW))[1]
    )
    # At a constant speed the joints still jerk, where the path's bend changes.
    speed = np.minimum(speed, np.cbrt(least_ratio(BEND_JERK_SHARE * limits.jerk, third)))
    inertia, bending = (share / TORQUE_SHARE for share in limits.torques(at, first, second))
    best: TimedTrajectory | None = None
    for _ in range(MAX_PROFILE_PASSES):
        law = time_optimal_law(grid, first, second, speed, acceleration, (inertia, bending))
        if law is None:
            break
        timed, excess, times = _stretched_motion(limits, curve, law)
        if best is None or timed.trajectory.duration < best.trajectory.duration:
            best = timed
        if excess.max() <= ACCEPTED_EXCESS:
            break
        slower = _slowdown(law, grid, times, excess)
        speed = np.minimum(speed, np.where(slower > 1.0, law.speed / slower, speed))
        acceleration = acceleration / slower[:, None] ** 2
        inertia, bending = inertia * slower[:, None] ** 2, bending * slower[:, None] ** 2
    return best if best is not None and _within(model, curve, best.trajectory.position) else None


def _trajectory(model: RobotModel, curve: JointCurve, scaling: Scaling) -> Trajectory | None:
    timed = time_curve(model, curve, (ScaledStretch(curve.length, scaling),))
    return None if timed is None else timed.trajectory


def _stretched_motion(
    limits: PathLimits, curve: JointCurve, law: TimeLaw
) -> tuple[TimedTrajectory, Array, Array]:
    """Stretch the averaged law's motion as a whole until it keeps all limits.

    Returns it with the excess (m,) of each sample before, as a factor, and the samples' times (m,), s.
    """
    duration = float(law.times[-1]) + AVERAGING_WINDOW
    # Limits are checked between the samples, too.
    times: Array = np.linspace(0.0, duration, 2 * max(1, int(np.ceil(duration / SAMPLE_PERIOD))) + 1)
    s, ds, dds = law.averaged(times, AVERAGING_WINDOW)
    s = np.clip(s, 0.0, curve.length)
    q, along, bend = curve.derivatives(s, 2)
    v = along * ds[:, None]
    a = along * dds[:, None] + bend * (ds**2)[:, None]
    v[0] = v[-1] = a[0] = a[-1] = 0.0
    excess = limits.excess(times, s, q, v, a)
    stretch = max(1.0, float(excess.max()))
    t, q, v, a = (rows[::2] for rows in (times * stretch, q, v / stretch, a / stretch**2))
    return TimedTrajectory(Trajectory(t, q, v, a), s[::2]), excess, times


def _slowdown(law: TimeLaw, grid: Array, times: Array, excess: Array) -> Array:
    """Return the factor (k,) of slowing at each grid point: the greatest of the samples that it contributes
    to."""
    slower = np.ones(len(grid))
    for k in np.flatnonzero(excess > 1.0):
        low, high = np.interp([times[k] - AVERAGING_WINDOW, times[k]], law.times, law.parameter)
        first = max(int(np.searchsorted(grid, low, side="right")) - 1, 0)
        last = int(np.searchsorted(grid, high, side="left")) + 1
        slower[first:last] = np.maximum(slower[first:last], excess[k])
    return slower


def _grid(curve: JointCurve, stretches: Sequence[ScaledStretch]) -> Array:
    """Return every break and end of a stretch, and more between them: see GRID, STEPS and TURN."""
    marks = np.unique(np.concatenate([curve.breaks, [stretch.end for stretch in stretches[:-1]]]))
    marks = marks[np.concatenate([[True], np.diff(marks) > 1e-9])]
    spans = np.diff(marks)
    bends = np.linalg.norm(curve.at(np.concatenate([marks, marks[:-1] + spans / 2]), 2), axis=1)
    bend = np.maximum(np.maximum(bends[: len(spans)], bends[1 : len(marks)]), bends[len(marks) :])
    counts = np.ceil(
        np.maximum(spans / min(GRID_DISTANCE, curve.length / MIN_GRID_STEPS), spans * bend / MAX_GRID_TURN)
    ).astype(int)
    steps = np.repeat(spans / counts, counts)
    grid: Array = np.concatenate([[0.0], np.cumsum(steps)])
    grid[-1] = curve.length
    return grid


def _within(model: RobotModel, curve: JointCurve, q: Array) -> bool:
    """Whether configurations (m, n) on the curve keep the joints' limits.

    Where the curve's own corners are beyond the limits, the corners are the limits.
    """
    corners = curve.coefficients[:, 0]
    lower = np.minimum(model.lower, np.minimum(corners.min(axis=0), q[-1]))
    upper = np.maximum(model.upper, np.maximum(corners.max(axis=0), q[-1]))
    return bool((q >= lower - 1e-9).all() and (q <= upper + 1e-9).all())
