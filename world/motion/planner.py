"""From a configuration to any of several others: the direct edge first, RRT-Connect when none is free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..robot.model import RobotModel
from ..trajectory import Trajectory
from ..values import Array
from .collision import Collision
from .edges import RESOLUTION, edge_free
from .posture import discomfort
from .requests import Scaling
from .rrt import connect
from .timing import time_corners
from .way import Way

RADII = (0.1, 0.05, 0.02, 0.005)
"""How far corners are cut, tried in this order until the timed path is free, rad."""
RECHECK = 0.02
"""Distance of the configurations at which a timed path is checked again, rad."""


class Budget:
    """Collision checks that a request may still spend."""

    def __init__(self, collision: Collision, checks: int) -> None:
        self._collision = collision
        self._end = collision.checks + checks

    @property
    def spent(self) -> bool:
        return self._collision.checks >= self._end


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """A timed answer: its corners (m, n) rad, how it was found, and which goal it reached."""

    trajectory: Trajectory
    path: Array
    planner: str
    goal: int


class Planner:
    """One request's search from the start of `way` (n,) to goals; edges and budget are shared."""

    def __init__(self, model: RobotModel, way: Way, start: Array, scaling: Scaling, budget: Budget) -> None:
        self._model = model
        self._way = way
        self._start = start
        self._scaling = scaling
        self._budget = budget

    def direct(self, goals: Sequence[Array]) -> Found | None:
        """Straight in joint space to one of the goals: the nearest first, uncomfortable ones as detours."""

        def effort(k: int) -> float:
            return float(np.linalg.norm(goals[k] - self._start)) + discomfort(self._model, goals[k])

        for k in sorted(range(len(goals)), key=effort):
            if self._edge(self._start, goals[k], RESOLUTION):
                path = np.array([self._start, goals[k]])
                trajectory = self._timed(path)
                if trajectory is not None:
                    return Found(trajectory, path, "direct", k)
        return None

    def around(self, goals: Sequence[Array], seed: int) -> Found | None:
        """By RRT-Connect to any of the goals. None: the budget is spent, or no timing keeps the margins."""
        # What is given may lie closer to the limits than what is planned: OMPL refuses states out of bounds.
        lower: Array = np.min([self._model.planned_lower, self._start, *goals], axis=0)
        upper: Array = np.max([self._model.planned_upper, self._start, *goals], axis=0)
        # A path that grazes between its steps is searched again with smaller ones.
        for attempt, resolution in enumerate((RESOLUTION, RESOLUTION / 2)):
            path = connect(
                lower,
                upper,
                self._start,
                goals,
                self._free,
                lambda a, b, step=resolution: self._edge(a, b, step),
                lambda: self._budget.spent,
                seed + attempt,
            )
            if path is None:
                return None
            trajectory = self._timed(path)
            if trajectory is not None:
                nearest = [float(np.abs(goal - path[-1]).max()) for goal in goals]
                return Found(trajectory, path, "RRTConnect", int(np.argmin(nearest)))
        return None

    def _free(self, q: Array) -> bool:
        return not self._budget.spent and self._way.free(q)

    def _edge(self, a: Array, b: Array, resolution: float) -> bool:
        return edge_free(self._free, a, b, resolution)

    def _timed(self, path: Array) -> Trajectory | None:
        for radius in RADII if len(path) > 2 else RADII[:1]:
            trajectory = time_corners(self._model, path, self._scaling, radius)
            if trajectory is not None and stays_free(self._way, trajectory):
                return trajectory
        return None


def stays_free(way: Way, trajectory: Trajectory) -> bool:
    """Whether a timed path is free: corners were cut, and steps fall elsewhere than when it was planned."""
    q = trajectory.position
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])
    marks = np.arange(0.0, float(along[-1]) + RECHECK, RECHECK)
    picked = np.unique(np.minimum(np.searchsorted(along, marks), len(q) - 1))
    return all(way.nearly_free(q[int(k)]) for k in picked)
