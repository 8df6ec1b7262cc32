"""Constrained RRT: paths on which constraints hold, by a bidirectional RRT whose steps are projected onto
them.

Berenson, Srinivasa, Ferguson and Kuffner, "Manipulation planning on constraint manifolds", ICRA 2009
(CBiRRT); Berenson, Srinivasa and Kuffner, "Task Space Regions", IJRR 30 (2011).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from picktree.world import Array, Trajectory
from picktree.world.robot_model import RobotModel

from .collision_checker import CollisionChecker
from .joint_planner import CORNER_RADII, IMPROVING_SHARE, FoundPath, order_goals
from .path_constraints import PROJECTION_RESERVE, PathConstraints
from .path_curves import polyline_length
from .path_search import ConstraintProjection, PathPlanner, SearchProblem
from .requests import Scaling
from .rrt_connect import SearchTree
from .time_parameterization import time_corners, time_smooth
from .trajectory_check import EDGE_RESOLUTION, StartTolerance, edge_free, is_trajectory_free

PLANNER_NAME = "CBiRRT"
MAX_TREE_STEP = 0.3
"""Greatest step of a tree between two projections, rad."""
SAMPLE_STEPS = 1
"""Number of steps of the tree that grows towards a sample. The other tree then extends towards it as far as
it gets."""
SAMPLE_RESERVES = (0.1, 0.9)
"""Range of the share of their room that samples keep from the constraints' borders. Without it all samples
would be on the borders."""
CURVATURE_DIVISOR = 8.0
"""Divisor in the estimate s² / CURVATURE_DIVISOR, rad: how far a step of s rad leaves a constraint."""
SHORTENING_ATTEMPTS = 60
"""Number of attempts to shorten a path."""
MIN_SPLINE_CORNERS = 8
"""Number of corners above which a path is also tried as a spline through all of them."""
SEARCH_ATTEMPTS = 3
"""Number of searches, each with finer steps, when the found path cannot be timed."""


class ConstrainedPlanner:
    """Constrained search of one request, with the interface of `JointPlanner`. Paths are always timed.

    The trees' projections count against the budget together with the collision checks.
    """

    def __init__(
        self,
        model: RobotModel,
        way: StartTolerance,
        start: Array,
        scaling: Scaling,
        collision: CollisionChecker,
        checks: int,
        constraints: PathConstraints,
        planner: PathPlanner | None = None,
    ) -> None:
        """Set the budget: `checks` of `collision`, and projections, that the search may spend.

        `planner` is that of `around`; None: projected trees.
        """
        self._model = model
        self._way = way
        self._start = start
        self._scaling = scaling
        self._collision = collision
        self._constraints = constraints
        self._end = collision.checks + constraints.projections + checks
        self._planner = planner

    def direct(self, goals: Sequence[Array]) -> FoundPath | None:
        """Plan a straight edge in joint space to one of the goals, where the constraints hold on it; None: no
        edge is free."""
        for k in order_goals(self._model, self._start, goals):
            if self.edge(self._start, goals[k], EDGE_RESOLUTION):
                path = np.array([self._start, goals[k]])
                trajectory = self.timed(path)
                if trajectory is not None:
                    return FoundPath(path, "direct", k, trajectory)
        return None

    def around(self, goals: Sequence[Array], seed: int) -> FoundPath | None:
        """Plan by the planner to any of the goals. None: the budget is spent, or no timing keeps margins and
        constraints."""
        lower: Array = np.min([self._model.planned_lower, self._start, *goals], axis=0)
        upper: Array = np.max([self._model.planned_upper, self._start, *goals], axis=0)
        stride = min(MAX_TREE_STEP, float(np.sqrt(CURVATURE_DIVISOR * self._constraints.room / 2)))
        rng = np.random.default_rng(seed)
        for attempt in range(SEARCH_ATTEMPTS):
            search = _Search(self, lower, upper, stride / 2**attempt, EDGE_RESOLUTION / 2**attempt, rng)
            path = (
                search.connect(self._start, goals)
                if self._planner is None
                else search.by(self._planner, self._start, goals)
            )
            if path is None:
                return None
            path = search.shortened(path)
            trajectory = self.timed(path)
            if trajectory is not None:
                nearest = [float(np.abs(goal - path[-1]).max()) for goal in goals]
                return FoundPath(
                    path,
                    self._planner.name if self._planner else PLANNER_NAME,
                    int(np.argmin(nearest)),
                    trajectory,
                )
        return None

    def project(
        self, q: Array, lower: Array, upper: Array, reserve: float = PROJECTION_RESERVE
    ) -> Array | None:
        """Return a configuration near q where the constraints hold with a reserve, or None."""
        return self._constraints.project(q, lower, upper, reserve)

    def hold(self, q: Array) -> bool:
        """Whether the constraints hold."""
        return self._constraints.hold(q)

    @property
    def left(self) -> int:
        """Number of checks and projections that are left."""
        return max(0, self._end - self._collision.checks - self._constraints.projections)

    @property
    def spent(self) -> bool:
        """Whether the budget is used up."""
        return not self.left

    def free(self, q: Array) -> bool:
        """Whether a configuration keeps margins and constraints, and the budget is not used up."""
        return not self.spent and self._constraints.hold(q) and self._way.free(q)

    def edge(self, a: Array, b: Array, resolution: float) -> bool:
        """Whether the straight segment from a (exclusive) to b is free and keeps the constraints."""
        return edge_free(self.free, a, b, resolution)

    def timed(self, path: Array) -> Trajectory | None:
        """Return the fastest of the timings that stay free and keep the constraints; None without one."""
        found: list[Trajectory] = []
        for radius in CORNER_RADII if len(path) > 2 else CORNER_RADII[:1]:
            trajectory = time_corners(self._model, path, self._scaling, radius)
            if trajectory is not None and self._stays(trajectory):
                found.append(trajectory)
                break
        if len(path) > MIN_SPLINE_CORNERS:
            trajectory = time_smooth(self._model, path, self._scaling)
            if trajectory is not None and self._stays(trajectory):
                found.append(trajectory)
        return min(found, key=lambda trajectory: trajectory.duration, default=None)

    def _stays(self, trajectory: Trajectory) -> bool:
        return all(self._constraints.hold(q) for q in trajectory.position) and is_trajectory_free(
            self._way, trajectory
        )


class _Search:
    """Pair of trees with their step sizes."""

    def __init__(
        self,
        planner: ConstrainedPlanner,
        lower: Array,
        upper: Array,
        stride: float,
        resolution: float,
        rng: np.random.Generator,
    ) -> None:
        self._planner = planner
        self._lower, self._upper = lower, upper
        self._stride = stride
        self._resolution = resolution
        self._rng = rng

    def connect(self, start: Array, goals: Sequence[Array]) -> Array | None:
        """Return a path (m, n) from start to one of the goals, or None when the budget is spent."""
        trees = [SearchTree([(start, ())]), SearchTree([(goal, ()) for goal in goals])]
        target: Array = goals[0]
        turn = 0
        while not self._planner.spent:
            one, other = trees[turn], trees[1 - turn]
            reached = self._extend(one, one.nearest(target)[0], target, SAMPLE_STEPS)
            tip = one.points[reached].copy()
            met = self._extend(other, other.nearest(tip)[0], tip)
            if float(np.abs(other.points[met] - tip).max()) < 1e-9:
                halves = [one.back(reached), other.back(met)]
                ours, theirs = halves if turn == 0 else halves[::-1]
                return np.array([*ours[::-1], *theirs[1:]])
            turn = 1 - turn
            target = self._sample()
        return None

    def by(self, planner: PathPlanner, start: Array, goals: Sequence[Array]) -> Array | None:
        """Return a path (m, n) by a chosen planner, or None when the budget is spent."""
        lower, upper = self._lower, self._upper
        constraint = ConstraintProjection(
            self._planner.hold, lambda q: self._planner.project(q, lower, upper), self._stride
        )

        def edge(a: Array, b: Array) -> bool:
            return self._planner.edge(a, b, self._resolution)

        left = self._planner.left
        path = planner.solve(
            SearchProblem(
                lower,
                upper,
                start,
                goals,
                self._planner.free,
                edge,
                edge,
                lambda: self._planner.spent,
                lambda: self._planner.left <= (1.0 - IMPROVING_SHARE) * left,
                left,
                self._rng,
                constraint=constraint,
            )
        )
        return None if path is None else np.array(path)

    def _sample(self) -> Array:
        q = self._rng.uniform(self._lower, self._upper)
        reserve = float(self._rng.uniform(*SAMPLE_RESERVES))
        projected = self._planner.project(q, self._lower, self._upper, reserve)
        return q if projected is None else projected

    def _extend(self, tree: SearchTree, index: int, target: Array, most: int | None = None) -> int:
        """Extend a tree from a configuration towards the target, by at most `most` steps. Returns the last
        index."""
        for q in self._walk(tree.points[index].copy(), target, most):
            index = tree.add(q, index)
        return index

    def _walk(self, q: Array, target: Array, most: int | None = None) -> list[Array]:
        """Return projected steps from q (exclusive) towards the target, which is the last where it is
        reached."""
        steps: list[Array] = []
        left = float(np.linalg.norm(target - q))
        while left > 1e-9 and not self._planner.spent and (most is None or len(steps) < most):
            towards = target if left <= self._stride else q + (target - q) * (self._stride / left)
            step = towards if towards is target else self._planner.project(towards, self._lower, self._upper)
            if step is None or float(np.linalg.norm(step - q)) > 2 * self._stride:
                break
            still = float(np.linalg.norm(target - step))
            if still > left - 0.05 * self._stride and towards is not target:
                break
            if not self._planner.edge(q, step, self._resolution):
                break
            steps.append(step)
            q, left = step, still
        return steps

    def shortened(self, path: Array) -> Array:
        """Cut detours off a path: straight where the constraints allow it, else by projected steps."""
        points = list(path)
        for _ in range(SHORTENING_ATTEMPTS):
            if len(points) < 3 or self._planner.spent:
                break
            a, b = sorted(int(k) for k in self._rng.choice(len(points), 2, replace=False))
            if b - a < 2:
                continue
            between = self._between(points[a], points[b])
            if between is None:
                continue
            before = polyline_length(np.array(points[a : b + 1]))
            if polyline_length(np.array([points[a], *between, points[b]])) < 0.999 * before:
                points[a + 1 : b] = between
        return np.array(self._fewer(points))

    def _between(self, a: Array, b: Array) -> list[Array] | None:
        """Return the inner points of a shorter connection; None: none was found."""
        if self._planner.edge(a, b, self._resolution):
            return []
        steps = self._walk(a, b)
        return steps[:-1] if steps and steps[-1] is b else None

    def _fewer(self, points: list[Array]) -> list[Array]:
        """Remove corners that can be left out."""
        k = 1
        while k < len(points) - 1 and not self._planner.spent:
            if self._planner.edge(points[k - 1], points[k + 1], self._resolution):
                del points[k]
            else:
                k += 1
        return points
