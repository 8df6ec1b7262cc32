"""Time parameterisation: from a path to a trajectory within the joints' limits of velocity, acceleration,
jerk and torque.

The fastest profile of the path's speed comes from TOPP-RA. Its acceleration jumps. Therefore the time law
s(t), not the joints, is averaged over a short window. The path stays the checked one, and the acceleration
becomes continuous.

Pham and Pham, "A new approach to time-optimal path parameterization based on reachability analysis", IEEE
Transactions on Robotics 34 (2018).
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from picktree.files import library_parts
from picktree.world import Array, Trajectory
from picktree.world.robot_model import RobotModel

from .path_curves import JointCurve, distinct, rounded_polyline, spline_through
from .requests import Scaling

if TYPE_CHECKING:
    from toppra.constraint import LinearConstraint
    from toppra.solverwrapper.cy_seidel_solverwrapper import seidelWrapper
else:
    # Its solver alone: the package also interpolates and draws, with scipy and matplotlib.
    with library_parts.bare_packages(
        *("toppra", "toppra.constraint", "toppra.solverwrapper", "toppra.interpolator"),
        toppra_interpolator={"AbstractGeometricPath": object},
    ):
        from toppra.constraint.constraint import ConstraintType

        sys.modules["toppra.constraint"].ConstraintType = ConstraintType
        from toppra.constraint.linear_constraint import LinearConstraint
        from toppra.solverwrapper.cy_seidel_solverwrapper import seidelWrapper

TORQUE_LIMIT_SHARE = 0.7
"""Share of the torque limits in the plan: the servo and a held object need the rest."""
ACCELERATION_RISE_TIME = 0.025
"""Time in which a joint may reach its acceleration limit, s; it defines the jerk limit."""
COSTLY_SAMPLE_STRIDE = 4
"""Step between the samples whose torques and tool acceleration are checked: they cost more than the rest."""


@dataclass(frozen=True, slots=True)
class ScaledStretch:
    """Scaling of the path up to parameter `end`, rad."""

    end: float
    scaling: Scaling


class PathLimits:
    """Limits of one robot along one path. A stretch scales velocity and acceleration, not jerk and torque.

    It may limit the tool's acceleration, too.
    """

    def __init__(self, model: RobotModel, stretches: Sequence[ScaledStretch]) -> None:
        self.jerk: Array = model.acceleration_limit / ACCELERATION_RISE_TIME
        self._model = model
        self._pool = pin.ModelPool(model.arm, 1)
        self._ends = np.array([stretch.end for stretch in stretches[:-1]])
        self._velocity = np.array([stretch.scaling.velocity for stretch in stretches])
        self._acceleration = np.array([stretch.scaling.acceleration for stretch in stretches])
        self._tool = np.array([stretch.scaling.tool for stretch in stretches])

    def speed(self, s: Array, first: Array, window: float) -> Array:
        """Return the greatest speed (m,) of the parameter at s (m,) with which no joint is too fast.

        The limits of every stretch that is reached within `window` s apply; `first` (m, n) is the path's
        derivative.
        """
        here = least_ratio(self.kinematic(s)[0], first)
        around = self.around(s, first, window)
        return here if around is None else least_ratio(self.kinematic(s, around)[0], first)

    def around(self, s: Array, first: Array, window: float) -> Array | None:
        """Return how far the slower of two stretches reaches into the faster one, rad, at each s (m,).

        That is the travel in `window` s. None where there is only one stretch.
        """
        if not len(self._ends):
            return None
        slowest = 2.0 * float(self._velocity.min()) * least_ratio(self._model.velocity_limit, first)
        return window * np.minimum(least_ratio(self.kinematic(s)[0], first), slowest)

    def kinematic(self, s: Array, around: Array | None = None) -> tuple[Array, Array]:
        """Return the limits of velocity and acceleration (m, n) at parameters (m,).

        Less than `around` rad (m,) from where two stretches meet, the lower limits apply.
        """
        reach = np.full(len(s), 1e-9) if around is None else around
        first = np.searchsorted(self._ends, s - reach, side="left")
        last = np.searchsorted(self._ends, s + reach, side="right")
        velocity, acceleration = self._velocity[first], self._acceleration[first]
        for k in range(1, int((last - first).max(initial=0)) + 1):
            other = np.minimum(first + k, last)
            velocity = np.minimum(velocity, self._velocity[other])
            acceleration = np.minimum(acceleration, self._acceleration[other])
        model = self._model
        return velocity[:, None] * model.velocity_limit, acceleration[:, None] * model.acceleration_limit

    def torques(self, q: Array, first: Array, second: Array) -> tuple[Array, Array]:
        """Return the torques of the parameter's acceleration and of its squared speed, as shares (m, n).

        They are shares of the torques that gravity leaves; q, first, second (m, n) are the path and its
        derivatives.
        """
        weight, along = self._weight(q), self._rnea(q, np.zeros_like(q), first)
        left = self._remaining_torque(weight)
        return (along - weight) / left, (self._rnea(q, first, second) - weight) / left

    def excess(self, times: Array, s: Array, q: Array, v: Array, a: Array) -> Array:
        """Return the factor (m,) by which each sample of a motion must be stretched in time to keep all
        limits.

        Stretched by k, the torques of inertia, Coriolis and centrifugal forces fall by k²; gravity stays.
        """
        velocity, acceleration = self.kinematic(s)
        dt = np.diff(times)[:, None]
        factor = (np.abs(v) / velocity).max(axis=1)
        squared = (np.abs(a) / acceleration).max(axis=1)
        # The servo sees these differences between samples.
        steps = (np.abs(np.diff(v, axis=0)) / (dt * acceleration[1:])).max(axis=1)
        squared[1:] = np.maximum(squared[1:], steps)
        some = slice(None, None, COSTLY_SAMPLE_STRIDE)
        weight = self._weight(q[some])
        moving = np.abs(self._rnea(q[some], v[some], a[some]) - weight) / self._remaining_torque(weight)
        squared[some] = np.maximum(squared[some], moving.max(axis=1))
        if np.isfinite(self._tool).any():
            most = self._tool[np.searchsorted(self._ends, s[some], side="left")]
            pull = self._tool_acceleration(q[some], v[some], a[some]) / most
            squared[some] = np.maximum(squared[some], pull)
        factor = np.maximum(factor, np.sqrt(squared))
        jerk = (np.abs(np.diff(a, axis=0)) / (dt * self.jerk)).max(axis=1)
        factor[1:] = np.maximum(factor[1:], np.cbrt(jerk))
        return factor

    def _tool_acceleration(self, q: Array, v: Array, a: Array) -> Array:
        """Return the TCP's acceleration (m,) at each sample (m, n), m/s²."""
        arm, frame = self._model.arm, self._model.tcp_frame
        data = arm.createData()
        found = np.zeros(len(q))
        for k in range(len(q)):
            pin.forwardKinematics(arm, data, q[k], v[k], a[k])
            motion = pin.getFrameClassicalAcceleration(arm, data, frame, pin.LOCAL)
            found[k] = np.linalg.norm(motion.linear)
        return found

    def _weight(self, q: Array) -> Array:
        still = np.zeros_like(q)
        return self._rnea(q, still, still)

    def _rnea(self, q: Array, v: Array, a: Array) -> Array:
        return pin.rneaInParallel(1, self._pool, q.T, v.T, a.T).T

    def _remaining_torque(self, weight: Array) -> Array:
        limit = self._model.torque_limit
        return np.maximum(TORQUE_LIMIT_SHARE * limit - np.abs(weight), 0.1 * limit)


def least_ratio(limit: Array, each: Array) -> Array:
    """Return the greatest factor (m,) with which all joints of each row (m, n) stay within their limits."""
    return (limit / np.maximum(np.abs(each), 1e-9)).min(axis=1)


SPEED_ROUNDING = 0.9999
"""Share of the squared speed that a step keeps, so that rounding leaves it controllable."""


@dataclass(frozen=True, slots=True, eq=False)
class TimeLaw:
    """Time law: the path's parameter over the time, with a constant acceleration between two marks.

    times, parameter, speed (k + 1,) in s, rad, rad/s; from rest to rest.
    """

    times: Array
    parameter: Array
    speed: Array

    def averaged(self, times: Array, window: float) -> tuple[Array, Array, Array]:
        """Return parameter, speed and acceleration (m,) at `times`, of the law averaged over `window` s.

        The averaged law ends `window` s later. Its acceleration is continuous and changes by at most the
        greatest jump of the law's own in `window` s. The average is known in closed form: the mean of the
        parameter over the window is the difference of its integral at both ends.
        """
        now, before = self._integrals(times), self._integrals(times - window)
        s, ds, dds = ((a - b) / window for a, b in zip(now, before, strict=True))
        return s, ds, dds

    def _integrals(self, times: Array) -> tuple[Array, Array, Array]:
        """Return the parameter's integral over the time, the parameter and the speed (m,), also before and
        after the law."""
        steps = np.diff(self.times)
        acceleration = np.diff(self.speed) / steps
        areas = self.parameter[:-1] * steps + self.speed[:-1] * steps**2 / 2 + acceleration * steps**3 / 6
        area: Array = np.concatenate([[0.0], np.cumsum(areas)])
        t = np.clip(times, 0.0, self.times[-1])
        k = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(steps) - 1)
        u = t - self.times[k]
        p, v, a = self.parameter[k], self.speed[k], acceleration[k]
        after = np.maximum(times - self.times[-1], 0.0) * self.parameter[-1]
        return (
            area[k] + p * u + v * u**2 / 2 + a * u**3 / 6 + after,
            p + v * u + a * u**2 / 2,
            v + a * u,
        )


def time_optimal_law(
    grid: Array,
    first: Array,
    second: Array,
    speed: Array,
    acceleration: Array,
    torques: tuple[Array, Array],
) -> TimeLaw | None:
    """Compute the time-optimal law from rest to rest along a path with these derivatives (m, n) at grid
    points (m,).

    `speed` (m,): greatest speed of the parameter at each. `acceleration` (m, n): the joints' limits.
    `torques` (m, n) each: joint torques of the parameter's acceleration and of its squared speed, as shares.
    None when rounding makes it unsolvable. Without lower limits of the speed, speed 0 is possible everywhere.
    Of the sets of controllable speeds only the upper ends are therefore needed.
    """
    rows = _Rows(grid, first / acceleration, second / acceleration, torques, speed**2)
    solver = seidelWrapper([rows], rows, grid, solve_lp1d=True)
    steps = np.diff(grid)
    count = len(steps)
    reach = np.zeros(count + 1)
    upward = np.array([1e-9, -1.0])
    solver.setup_solver()
    for k in range(count - 1, -1, -1):
        reach[k] = solver.solve_stagewise_optim(k, None, upward, np.nan, np.nan, 0.0, reach[k + 1])[1]
        if not reach[k] >= 0.0:
            return None
    squared = np.zeros(count + 1)
    forward = np.array([0.0, -1.0])
    for k in range(count):
        x = min(squared[k], reach[k])
        forward[0] = -2.0 * steps[k]
        u = np.nan
        for _ in range(20):
            u = solver.solve_stagewise_optim(k, None, forward, x, x, 0.0, reach[k + 1])[0]
            if not np.isnan(u):
                break
            x *= 0.999
        if np.isnan(u):
            return None
        squared[k] = x
        # Rounding must leave the step controllable.
        squared[k + 1] = min(max(SPEED_ROUNDING * (x + 2.0 * steps[k] * u), 0.0), reach[k + 1])
    solver.close_solver()
    v: Array = np.sqrt(squared)
    mean = v[:-1] + v[1:]
    if not bool((mean > 0.0).all()):
        return None
    return TimeLaw(np.concatenate([[0.0], np.cumsum(2.0 * steps / mean)]), grid, v)


class _Rows(LinearConstraint):
    """Limits of acceleration, torque and speed as the solver's rows.

    Acceleration and torque count at both ends of each grid step (TOPP-RA's interpolation scheme).
    """

    def __init__(
        self, grid: Array, first: Array, second: Array, torques: tuple[Array, Array], squared_speed: Array
    ) -> None:
        super().__init__()
        self.identical = True
        self.dof = first.shape[1]
        a = np.concatenate([first, torques[0]], axis=1)
        b = np.concatenate([second, torques[1]], axis=1)
        # The limits at a step's end count, too; at the last point there is no step.
        ahead = 2.0 * np.diff(grid, append=grid[-1])[:, None]
        b_next = np.concatenate([b[1:], b[-1:]])
        a = np.concatenate([a, np.concatenate([a[1:], a[-1:]]) + ahead * b_next], axis=1)
        b = np.concatenate([b, b_next], axis=1)
        count = a.shape[1]
        both: Array = np.concatenate([np.eye(count), -np.eye(count)])
        bounds = np.column_stack([np.zeros(len(grid)), squared_speed])
        self._params = (a, b, np.zeros_like(a), both, np.ones(2 * count), None, bounds)

    def compute_constraint_params(self, path: object, gridpoints: Array) -> tuple[Array | None, ...]:
        return self._params


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
