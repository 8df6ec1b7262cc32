"""From a path to a timed trajectory within the joints' limits: TOPP-RA over corners rounded by Bézier arcs.

Pham and Pham, "A new approach to time-optimal path parameterization based on reachability analysis",
IEEE Transactions on Robotics 34 (2018).
"""

from __future__ import annotations

import itertools
from functools import lru_cache

import numpy as np
from toppra.algorithm import TOPPRA
from toppra.constraint import (
    Constraint,
    DiscretizationType,
    JointAccelerationConstraint,
    JointVelocityConstraint,
)
from toppra.interpolator import AbstractGeometricPath, SplineInterpolator

from ..robot.model import RobotModel
from ..trajectory import Trajectory
from ..values import Array
from .requests import Scaling

PERIOD = 0.01
"""Between two samples of a trajectory, at most, s."""
RESERVE = 0.8
"""Share of the acceleration limits that is planned with: between grid points it overshoots."""
TORQUE = 0.7
"""Share of the torque limits that is planned with: the servo and a held object need the rest."""
GRID = 0.05
"""Distance of TOPP-RA's grid points along the path, rad."""
SAME = 1e-6
"""Waypoints closer than this are one, rad."""


class BlendedPath(AbstractGeometricPath):
    """A polyline (m, n) whose corners are quadratic Bézier arcs; its parameter is about the arc length.

    Each arc begins and ends at most `radius` rad from its corner. The first derivative is continuous.
    """

    def __init__(self, points: Array, radius: float) -> None:
        along = np.diff(points, axis=0)
        lengths = np.linalg.norm(along, axis=1)
        units: Array = along / lengths[:, None]
        # Two arcs share a segment; the ends of the path have none.
        cuts = np.zeros(len(points))
        for k in range(1, len(points) - 1):
            cuts[k] = min(radius, 0.5 * lengths[k - 1], 0.5 * lengths[k])
        breaks = [0.0]
        first: list[Array] = []
        second: list[Array] = []
        third: list[Array] = []
        zero = np.zeros(points.shape[1])
        for k in range(len(along)):
            straight = float(lengths[k] - cuts[k] - cuts[k + 1])
            if straight > 1e-9:
                first.append(points[k] + units[k] * cuts[k])
                second.append(units[k])
                third.append(zero)
                breaks.append(breaks[-1] + straight)
            if cuts[k + 1] > 0.0:
                # p(u) = p0 + a u + (b - a) u² / (4 r), u in [0, 2 r]: unit speed at both ends.
                first.append(points[k + 1] - units[k] * cuts[k + 1])
                second.append(units[k])
                third.append((units[k + 1] - units[k]) / (4 * cuts[k + 1]))
                breaks.append(breaks[-1] + 2 * float(cuts[k + 1]))
        self._breaks: Array = np.array(breaks)
        self._first: Array = np.array(first)
        self._second: Array = np.array(second)
        self._third: Array = np.array(third)

    def __call__(self, path_positions: Array | float, order: int = 0) -> Array:
        s: Array = np.atleast_1d(np.asarray(path_positions, dtype=np.float64))
        piece = np.clip(np.searchsorted(self._breaks, s, side="right") - 1, 0, len(self._first) - 1)
        u = (s - self._breaks[piece])[:, None]
        a, b, c = self._first[piece], self._second[piece], self._third[piece]
        value = (a + b * u + c * u**2, b + 2 * c * u, 2 * c)[order]
        return value if np.ndim(path_positions) else value[0]

    @property
    def dof(self) -> int:
        return int(self._first.shape[1])

    @property
    def path_interval(self) -> Array:
        return np.array([0.0, self._breaks[-1]])

    @property
    def waypoints(self) -> tuple[Array, Array] | None:
        return None

    def grid(self) -> Array:
        """Grid points: every break, and between them at most GRID apart, at least three a piece."""
        points: list[Array] = [np.zeros(1)]
        for low, high in itertools.pairwise(float(b) for b in self._breaks):
            count = max(3, int(np.ceil((high - low) / GRID)))
            piece: Array = np.linspace(low, high, count + 1)
            points.append(piece[1:])
        return np.concatenate(points)


def time_corners(model: RobotModel, path: Array, scaling: Scaling, radius: float) -> Trajectory | None:
    """Along a polyline (m, n) with its corners cut by at most `radius` rad. None when no timing is found."""
    points = _distinct(path)
    if len(points) < 2:
        return _standing(path[-1])
    blended = BlendedPath(points, radius)
    return _time(model, blended, blended.grid(), scaling)


def time_smooth(model: RobotModel, path: Array, scaling: Scaling) -> Trajectory | None:
    """Along a cubic spline through dense waypoints (m, n), as those of a Cartesian line."""
    points = _distinct(path)
    if len(points) < 2:
        return _standing(path[-1])
    if len(points) == 2:
        return time_corners(model, points, scaling, 0.0)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    knots: Array = np.concatenate([[0.0], np.cumsum(lengths)])
    spline = SplineInterpolator(knots, points, bc_type="natural")
    per_piece = max(1, int(np.ceil(20 / len(lengths))))
    shares = np.linspace(0.0, 1.0, per_piece + 1)[1:]
    inner = (knots[:-1, None] + np.diff(knots)[:, None] * shares).ravel()
    return _time(model, spline, np.concatenate([[0.0], inner]), scaling)


def _time(model: RobotModel, path: AbstractGeometricPath, grid: Array, scaling: Scaling) -> Trajectory | None:
    velocity = model.velocity_limit * scaling.velocity
    acceleration = model.acceleration_limit * scaling.acceleration
    constraints = _constraints(tuple(velocity), tuple(acceleration * RESERVE))
    solver = TOPPRA(list(constraints), path, grid, "seidel", "ParametrizeConstAccel")
    found = solver.compute_trajectory(0.0, 0.0)
    if found is None:
        return None
    duration = float(found.path_interval[1])
    times: Array = np.linspace(0.0, duration, max(2, int(np.ceil(duration / PERIOD)) + 1))
    q, v, a = found(times, 0), found(times, 1), found(times, 2)
    v[0] = v[-1] = 0.0
    # What the servo will see between samples are these differences.
    jumps = np.diff(v, axis=0) / np.diff(times)[:, None]
    stretch = max(
        1.0,
        float((np.abs(v) / velocity).max()),
        float(np.sqrt((np.abs(jumps) / acceleration).max())),
        float(np.sqrt((np.abs(a) / acceleration).max())),
        _heavy(model, q, v, a),
    )
    return Trajectory(times * stretch, q, v / stretch, a / stretch**2)


def _heavy(model: RobotModel, q: Array, v: Array, a: Array) -> float:
    """By how much the time must be stretched so that the joints' torques suffice.

    Stretched by k, the torques of inertia, Coriolis and centrifugal forces fall by k²; gravity stays.
    """
    still = np.zeros(model.n)
    worst = 0.0
    for k in range(0, len(q), 2):
        weight = model.inverse_dynamics(q[k], still, still)
        moving = np.abs(model.inverse_dynamics(q[k], v[k], a[k]) - weight)
        left = np.maximum(TORQUE * model.torque_limit - np.abs(weight), 0.1 * model.torque_limit)
        worst = max(worst, float((moving / left).max()))
    return float(np.sqrt(worst))


@lru_cache(maxsize=32)
def _constraints(velocity: tuple[float, ...], acceleration: tuple[float, ...]) -> tuple[Constraint, ...]:
    """Kept, because making them formats their own descriptions: a third of the time of a timing."""
    v, a = np.array(velocity), np.array(acceleration)
    return (
        JointVelocityConstraint(np.column_stack([-v, v])),
        JointAccelerationConstraint(np.column_stack([-a, a]), DiscretizationType.Interpolation),
    )


def _distinct(path: Array) -> Array:
    kept = [path[0]]
    for point in path[1:]:
        if float(np.abs(point - kept[-1]).max()) > SAME:
            kept.append(point)
    return np.array(kept)


def _standing(q: Array) -> Trajectory:
    still = np.zeros((2, len(q)))
    return Trajectory(np.array([0.0, PERIOD]), np.array([q, q]), still, still)
