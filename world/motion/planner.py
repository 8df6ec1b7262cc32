"""From a configuration to any of several others: the direct edge first, RRT-Connect when none is free."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..robot.model import RobotModel
from ..trajectory import Trajectory
from ..values import Array
from .collision import Collision
from .edges import Strides
from .posture import discomfort
from .recheck import stays_free
from .requests import Scaling
from .retreat import retreat
from .rrt import EdgeFree, Rooted, connect, shortened
from .timing import time_corners
from .way import Way

RADII = (0.1, 0.05, 0.02, 0.005)
"""How far corners are cut, tried in this order until the timed path is free, rad."""
ROOTS = 4
"""Goals, the nearest first, of which a way out is looked for."""


class Budget:
    """Collision checks that a request may still spend."""

    def __init__(self, collision: Collision, checks: int) -> None:
        self._collision = collision
        self._end = collision.checks + checks

    def is_spent(self) -> bool:
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
        self._strides = Strides(model)

    def direct(self, goals: Sequence[Array]) -> Found | None:
        """Straight in joint space to one of the goals: the nearest first, uncomfortable ones as detours."""

        def effort(k: int) -> float:
            return float(np.linalg.norm(goals[k] - self._start)) + discomfort(self._model, goals[k])

        for k in sorted(range(len(goals)), key=effort):
            if self._edge(self._start, goals[k]):
                path = np.array([self._start, goals[k]])
                trajectory = self._timed(path)
                if trajectory is not None:
                    return Found(trajectory, path, "direct", k)
        return None

    def around(self, goals: Sequence[Array], seed: int) -> Found | None:
        """By RRT-Connect to any of the goals. None: the budget is spent, or no timing keeps the margins."""
        # What is given may lie closer to the limits than what is planned.
        lower: Array = np.min([self._model.planned_lower, self._start, *goals], axis=0)
        upper: Array = np.max([self._model.planned_upper, self._start, *goals], axis=0)
        # A path that grazes between its steps is searched again with smaller ones.
        for attempt, strides in enumerate((self._strides, Strides(self._model, 0.5))):
            rng = np.random.default_rng([seed, attempt])

            def edge(a: Array, b: Array, strides: Strides = strides) -> bool:
                return strides.free(self._free, a, b)

            def between(a: Array, b: Array, strides: Strides = strides) -> bool:
                return strides.free(self._free, a, b, ends_free=True)

            def rooted(q: Array, edge: EdgeFree = edge) -> Rooted:
                return q, retreat(self._model, edge, q, lower, upper)

            ends = self._near_first(goals, rooted)
            spent = self._budget.is_spent
            path = connect(lower, upper, rooted(self._start), ends, edge, between, spent, rng)
            if path is None:
                return None
            corners = np.array(shortened(path, between, rng))
            trajectory = self._timed(corners)
            if trajectory is not None:
                missed = [float(np.abs(goal - corners[-1]).max()) for goal in goals]
                return Found(trajectory, corners, "RRTConnect", int(np.argmin(missed)))
        return None

    def _near_first(self, goals: Sequence[Array], rooted: Callable[[Array], Rooted]) -> list[Rooted]:
        nearest = sorted(goals, key=lambda q: float(np.linalg.norm(q - self._start)))
        return [rooted(q) for q in nearest[:ROOTS]] + [(q, ()) for q in nearest[ROOTS:]]

    def _free(self, q: Array) -> bool:
        return not self._budget.is_spent() and self._way.free(q)

    def _edge(self, a: Array, b: Array) -> bool:
        return self._strides.free(self._free, a, b)

    def _timed(self, path: Array) -> Trajectory | None:
        for radius in RADII if len(path) > 2 else RADII[:1]:
            trajectory = time_corners(self._model, path, self._scaling, radius)
            if trajectory is not None and stays_free(self._way, trajectory):
                return trajectory
        return None
