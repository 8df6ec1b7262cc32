"""Joint planner: from a configuration to any of several others, by the direct edge first, else by
RRT-Connect."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...robots.model import RobotModel
from ...world.trajectory import Trajectory
from ...world.values import Array
from ..collision.collision_checker import CollisionChecker
from ..collision.edges import EdgeSteps
from ..collision.start_tolerance import StartTolerance
from ..collision.trajectory_check import first_collision
from ..kinematics.configuration_cost import configuration_cost
from ..requests import Scaling
from ..timing.time_parameterization import time_corners
from .rrt_connect import EdgeFree, Rooted, rrt_connect, shortcut_path
from .start_retreat import retreat_path

CORNER_RADII = (0.1, 0.05, 0.02, 0.005)
"""Distances at which corners are cut, tried in this order until the timed path is free, rad."""
STEP_SHARES = (1.0, 0.5, 0.25)
"""Shares of the greatest step of an edge, tried in this order while paths graze."""
ON_PATH_DISTANCE = 1e-4
"""Distance from a path below which a configuration is on a straight part of it, rad."""
MAX_RETREATING_GOALS = 4
"""Number of goals, the nearest first, for which a retreat path is planned."""


class CheckBudget:
    """Collision checks that a request may still spend."""

    def __init__(self, collision: CollisionChecker, checks: int) -> None:
        self._collision = collision
        self._end = collision.checks + checks

    def is_spent(self) -> bool:
        return self._collision.checks >= self._end


@dataclass(frozen=True, slots=True, eq=False)
class TimedPath:
    """Timed answer: its corners (m, n) rad, its planner, and the index of the reached goal."""

    trajectory: Trajectory
    path: Array
    planner: str
    goal: int


class JointPlanner:
    """Search of one request from the start of `way` (n,) to goals; edges and budget are shared."""

    def __init__(
        self, model: RobotModel, way: StartTolerance, start: Array, scaling: Scaling, budget: CheckBudget
    ) -> None:
        self._model = model
        self._way = way
        self._start = start
        self._scaling = scaling
        self._budget = budget
        self._strides = EdgeSteps(model)

    def direct(self, goals: Sequence[Array]) -> TimedPath | None:
        """Plan a straight edge in joint space to one of the goals: the nearest first, with discomfort as a
        detour.

        None: no edge is free.
        """

        def effort(k: int) -> float:
            return float(np.linalg.norm(goals[k] - self._start)) + configuration_cost(self._model, goals[k])

        for k in sorted(range(len(goals)), key=effort):
            if self._edge(self._start, goals[k]):
                path = np.array([self._start, goals[k]])
                trajectory = self._timed(path)
                if trajectory is not None:
                    return TimedPath(trajectory, path, "direct", k)
        return None

    def around(self, goals: Sequence[Array], seed: int) -> TimedPath | None:
        """Plan by RRT-Connect to any of the goals. None: the budget is spent, or no timing keeps the
        margins."""
        # Start and goals may be nearer to the limits than the planned configurations between them.
        lower, upper = self._model.planned_lower, self._model.planned_upper
        # A path that grazes between its steps is searched again with smaller ones.
        for attempt, share in enumerate(STEP_SHARES):
            strides = EdgeSteps(self._model, share)
            rng = np.random.default_rng([seed, attempt])

            def edge(a: Array, b: Array, strides: EdgeSteps = strides) -> bool:
                return strides.free(self._free, a, b)

            def between(a: Array, b: Array, strides: EdgeSteps = strides) -> bool:
                return strides.free(self._free, a, b, ends_free=True)

            def rooted(q: Array, edge: EdgeFree = edge) -> Rooted:
                return q, retreat_path(self._model, edge, q)

            ends = self._near_first(goals, rooted)
            spent = self._budget.is_spent
            path = rrt_connect(lower, upper, rooted(self._start), ends, edge, between, spent, rng)
            if path is None:
                return None
            corners = np.array(shortcut_path(path, between, rng))
            trajectory = self._timed(corners)
            if trajectory is not None:
                missed = [float(np.abs(goal - corners[-1]).max()) for goal in goals]
                return TimedPath(trajectory, corners, "RRTConnect", int(np.argmin(missed)))
        return None

    def _near_first(self, goals: Sequence[Array], rooted: Callable[[Array], Rooted]) -> list[Rooted]:
        nearest = sorted(goals, key=lambda q: float(np.linalg.norm(q - self._start)))
        return [rooted(q) for q in nearest[:MAX_RETREATING_GOALS]] + [
            (q, ()) for q in nearest[MAX_RETREATING_GOALS:]
        ]

    def _free(self, q: Array) -> bool:
        return not self._budget.is_spent() and self._way.free(q)

    def _edge(self, a: Array, b: Array) -> bool:
        return self._strides.free(self._free, a, b)

    def _timed(self, path: Array) -> Trajectory | None:
        for radius in CORNER_RADII if len(path) > 2 else CORNER_RADII[:1]:
            trajectory = time_corners(self._model, path, self._scaling, radius)
            if trajectory is None:
                continue
            hit = first_collision(self._way, trajectory)
            if hit is None:
                return trajectory
            if _distance_to_path(path, hit) < ON_PATH_DISTANCE:
                # On a straight part, cutting less of the corners helps nothing.
                return None
        return None


def _distance_to_path(path: Array, q: Array) -> float:
    """Return the distance of q (n,) to a polyline (m, n), rad."""
    along = np.diff(path, axis=0)
    squared = np.maximum(np.einsum("ij,ij->i", along, along), 1e-12)
    share = np.clip(np.einsum("ij,ij->i", q - path[:-1], along) / squared, 0.0, 1.0)
    apart: Array = np.linalg.norm(path[:-1] + share[:, None] * along - q, axis=1)
    return float(apart.min())
