"""Joint planner: from a configuration to any of several others, by the direct edge first, else by
RRT-Connect or a chosen planner.

A retreat path leads out of a narrow place: back along the tool for as long as that is free.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from picktree.files import PicktreeError
from picktree.world import Array, Trajectory, planner_names
from picktree.world.robot_model import RobotModel

from .collision_checker import CollisionChecker
from .limits import configuration_cost
from .path_search import EdgeFree, PathPlanner, PathSearch, SearchProblem
from .requests import Scaling
from .rrt_connect import Rooted, SearchChecks, improve_path, rrt_connect, shorten_path
from .time_parameterization import time_corners
from .trajectory_check import EdgeSteps, StartTolerance, first_collision

PLANNER_NAME = "RRTConnect"
CORNER_RADII = (0.1, 0.05, 0.02, 0.005)
"""Distances at which corners are cut, tried in this order until the timed path is free, rad."""
STEP_SHARES = (1.0, 0.5, 0.25)
"""Shares of the greatest step of an edge, tried in this order while paths graze."""
ON_PATH_DISTANCE = 1e-4
"""Distance from a path below which a configuration is on a straight part of it, rad."""
MAX_PLAIN_CHECKS = 200
"""Number of checks of a first search without retreat paths. Where it suffices, paths are shorter."""
MAX_IMPROVING_CHECKS = 600
"""Number of checks of each of the searches that improve a path."""
MAX_RETREATING_GOALS = 4
"""Number of goals, the nearest first, for which a retreat path is planned."""
IMPROVING_SHARE = 0.7
"""Share of the budget that is left after which an optimising planner ends with its path."""


class CheckBudget:
    """Collision checks that a request may still spend."""

    def __init__(self, collision: CollisionChecker, checks: int) -> None:
        self._collision = collision
        self._end = collision.checks + checks

    @property
    def left(self) -> int:
        """Number of checks that are left."""
        return max(0, self._end - self._collision.checks)

    def share(self, checks: int) -> CheckBudget:
        """Return a budget of a number of checks within this one."""
        return CheckBudget(self._collision, min(checks, self.left))

    def is_spent(self) -> bool:
        return self._collision.checks >= self._end

    def enough(self) -> Callable[[], bool]:
        """Return the condition that ends the improvement of a path."""
        end = self._collision.checks + IMPROVING_SHARE * self.left
        return lambda: self._collision.checks >= end


@dataclass(frozen=True, slots=True, eq=False)
class FoundPath:
    """Path of a search: its corners (m, n) rad, its planner, and the index of the reached goal."""

    path: Array
    planner: str
    goal: int
    trajectory: Trajectory | None
    """Trajectory on the path with its corners cut; None: the path was not to be timed."""


def order_goals(model: RobotModel, start: Array, goals: Sequence[Array]) -> list[int]:
    """Return the indices of goals (n,), the nearest to the start first; discomfort counts as a detour."""
    efforts = [float(np.linalg.norm(goal - start)) + configuration_cost(model, goal) for goal in goals]
    return sorted(range(len(goals)), key=efforts.__getitem__)


class JointPlanner:
    """Search of one request from the start of `way` (n,) to goals; edges and budget are shared.

    A path counts when its trajectory is free. Without a scaling it is not timed, and free edges are enough.
    """

    def __init__(
        self,
        model: RobotModel,
        way: StartTolerance,
        start: Array,
        scaling: Scaling | None,
        budget: CheckBudget,
        planner: PathPlanner | None = None,
    ) -> None:
        """Set the planner of `around`; None: RRT-Connect with retreat paths."""
        self._model = model
        self._way = way
        self._start = start
        self._scaling = scaling
        self._budget = budget
        self._strides = EdgeSteps(model)
        self._planner = planner or PathPlanner(PLANNER_NAME, self._rrt_connect)

    def direct(self, goals: Sequence[Array]) -> FoundPath | None:
        """Plan a straight edge in joint space to one of the goals; None: no edge is free."""
        for k in order_goals(self._model, self._start, goals):
            if self._edge(self._start, goals[k]):
                found = self._timed(np.array([self._start, goals[k]]), "direct", k)
                if found is not None:
                    return found
        return None

    def around(self, goals: Sequence[Array], seed: int) -> FoundPath | None:
        """Plan by the planner to any of the goals. None: the budget is spent, or no timing keeps the
        margins."""
        # A path that grazes between its steps is searched again with smaller ones.
        for attempt, share in enumerate(STEP_SHARES):
            problem = self._problem(goals, share, np.random.default_rng([seed, attempt]))
            path = self._planner.solve(problem)
            if path is None:
                return None
            corners = shorten_path(path, problem.edge, problem.between)
            missed = [float(np.abs(goal - corners[-1]).max()) for goal in goals]
            found = self._timed(np.array(corners), self._planner.name, int(np.argmin(missed)))
            if found is not None:
                return found
        return None

    def within(self, budget: CheckBudget) -> JointPlanner:
        """Return the planner of the same request with another budget."""
        return JointPlanner(self._model, self._way, self._start, self._scaling, budget)

    def improved(self, found: FoundPath, seed: int) -> FoundPath:
        """Spend the budget on further searches to the same goal. Returns the shortest path whose trajectory
        is free: at worst the given one."""
        problem = self._problem([found.path[-1]], 1.0, np.random.default_rng([seed, len(STEP_SHARES)]))
        before = list(found.path)
        path = improve_path(
            before,
            lambda: self._plain(problem, MAX_IMPROVING_CHECKS),
            problem.edge,
            problem.between,
            problem.spent,
        )
        if path is before:
            return found
        # Timing and its check are not part of the budget.
        return self._timed(np.array(path), found.planner, found.goal) or found

    def _problem(self, goals: Sequence[Array], share: float, rng: np.random.Generator) -> SearchProblem:
        """Return the search problem with a share of the greatest steps."""
        strides = self._strides.scaled(share)

        def edge(a: Array, b: Array) -> bool:
            return strides.free(self._count_free, a, b)

        return SearchProblem(
            np.min([self._model.planned_lower, self._start, *goals], axis=0),
            np.max([self._model.planned_upper, self._start, *goals], axis=0),
            self._start,
            goals,
            self._free,
            edge,
            lambda a, b: strides.free(self._count_free, a, b, ends_free=True),
            self._budget.is_spent,
            self._budget.enough(),
            self._budget.left,
            rng,
            lambda q: retreat_path(self._model, edge, q),
        )

    def _rrt_connect(self, problem: SearchProblem) -> Sequence[Array] | None:
        return self._plain(problem, MAX_PLAIN_CHECKS) or self._retreating(problem)

    def _plain(self, problem: SearchProblem, checks: int) -> list[Array] | None:
        """Search without retreat paths, with a number of checks at most."""
        ends = [(q, ()) for q in problem.goals]
        return self._connected(problem, (problem.start, ()), ends, self._budget.share(checks))

    def _retreating(self, problem: SearchProblem) -> list[Array] | None:
        nearest = sorted(problem.goals, key=lambda q: float(np.linalg.norm(q - self._start)))
        ends: list[Rooted] = [
            (q, problem.retreat(q) if k < MAX_RETREATING_GOALS else ()) for k, q in enumerate(nearest)
        ]
        return self._connected(problem, (problem.start, problem.retreat(problem.start)), ends, self._budget)

    def _connected(
        self, problem: SearchProblem, start: Rooted, goals: Sequence[Rooted], budget: CheckBudget
    ) -> list[Array] | None:
        # Start and goals may be nearer to the limits than the planned configurations between them.
        limits = self._model.planned_lower, self._model.planned_upper
        checks = SearchChecks(problem.edge, problem.between, self._way.count_blocked, lambda: budget.left)
        return rrt_connect(*limits, start, goals, checks, problem.rng)

    def _free(self, q: Array) -> bool:
        return self._count_free(q[None]) == 1

    def _count_free(self, configurations: Array) -> int:
        """Return the number of free configurations before the first that is not, or that the budget leaves
        out."""
        return self._way.count_free(configurations[: self._budget.left])

    def _edge(self, a: Array, b: Array) -> bool:
        return self._strides.free(self._count_free, a, b)

    def timed(self, path: Array) -> Trajectory | None:
        """Return the trajectory on a path (m, n) with its corners cut as far as that is free. None: none is
        free, or the request has no scaling."""
        if self._scaling is None:
            return None
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

    def _timed(self, path: Array, planner: str, goal: int) -> FoundPath | None:
        """Time a path where the request has a scaling. None: no trajectory on it is free."""
        if self._scaling is None:
            return FoundPath(path, planner, goal, None)
        trajectory = self.timed(path)
        return None if trajectory is None else FoundPath(path, planner, goal, trajectory)


def _distance_to_path(path: Array, q: Array) -> float:
    """Return the distance of q (n,) to a polyline (m, n), rad."""
    along = np.diff(path, axis=0)
    squared = np.maximum(np.einsum("ij,ij->i", along, along), 1e-12)
    share = np.clip(np.einsum("ij,ij->i", q - path[:-1], along) / squared, 0.0, 1.0)
    apart: Array = np.linalg.norm(path[:-1] + share[:, None] * along - q, axis=1)
    return float(apart.min())


def load_planner(name: str) -> PathPlanner:
    """Return the planner of a name other than `auto`.

    Raises PicktreeError for an unknown name, and for a plug-in that cannot be imported.
    """
    if name in planner_names.BUILT_IN:
        from .ompl_planners import ompl_search  # imports OMPL

        return PathPlanner(name, ompl_search(name))
    entry = planner_names.installed_planners().get(name)
    if entry is None:
        raise PicktreeError(f"{planner_names.unknown_planner(name)}: {planner_names.suggest_planner(name)}")
    try:
        search = entry.load()
    except (Exception, SystemExit) as error:
        reason = re.sub(r"\s+", " ", str(error)) or type(error).__name__
        raise PicktreeError(f"the planner {name!r} ({entry.value}) cannot be imported: {reason}") from error
    if not callable(search):
        message = f"the planner {name!r} ({entry.value}) must be a function that takes a SearchProblem"
        raise PicktreeError(message)
    return PathPlanner(name, cast("PathSearch", search))


RETREAT_STEP = 0.03
"""Travel of the TCP in a step, m."""
MAX_RETREAT_LENGTH = 0.45
"""Greatest travel in one direction, m."""
ENOUGH_STEPS = 3
"""Number of steps from which on no other directions are tried."""
MAX_JOINT_SWING = 0.5
"""Greatest change of a joint in a step, rad: more means a singularity."""
RETREAT_DAMPING = 1e-4


def retreat_path(model: RobotModel, edge: EdgeFree, q: Array) -> list[Array]:
    """Return configurations (n,) behind q, one after the other with free edges.

    They are no nearer to the limits than planned ones, or than q. The TCP goes back against the direction in
    which the tool points, its orientation kept. Where that ends soon, it goes up and then towards the axis of
    the base, turning on the way.
    """
    lower, upper = np.minimum(model.planned_lower, q), np.maximum(model.planned_upper, q)
    walk = _Walk(model, edge, lower, upper)
    chain = walk.along(q, -model.tcp(q).rotation()[:, 2], upright=True)
    if len(chain) < ENOUGH_STEPS:
        chain += walk.along(chain[-1] if chain else q, np.array([0.0, 0.0, 1.0]), upright=False)
    if len(chain) < ENOUGH_STEPS:
        at = chain[-1] if chain else q
        chain += walk.along(at, _towards_base(model, at), upright=False)
    return chain


class _Walk:
    def __init__(self, model: RobotModel, edge: EdgeFree, lower: Array, upper: Array) -> None:
        self._model = model
        self._edge = edge
        self._lower = lower
        self._upper = upper

    def along(self, q: Array, direction: Array, *, upright: bool) -> list[Array]:
        """Return free configurations for steps in that direction (3,) of the world; `upright`: without
        turning the tool.

        Damped least squares of first order: the line is roughly straight, which is enough for a retreat.
        """
        rows = 6 if upright else 3
        wanted: Array = np.zeros(rows)
        wanted[:3] = direction * RETREAT_STEP
        chain, at = list[Array](), q
        for _ in range(round(MAX_RETREAT_LENGTH / RETREAT_STEP)):
            jacobian = self._model.jacobian(at)[:rows]
            damped: Array = jacobian @ jacobian.T
            damped[np.diag_indices(rows)] += RETREAT_DAMPING
            step: Array = jacobian.T @ np.asarray(np.linalg.solve(damped, wanted), np.float64)
            behind: Array = np.minimum(np.maximum(at + step, self._lower), self._upper)
            swing = float(np.abs(behind - at).max())
            if not 1e-3 < swing < MAX_JOINT_SWING or not self._edge(at, behind):
                break
            chain.append(behind)
            at = behind
        return chain


def _towards_base(model: RobotModel, q: Array) -> Array:
    x, y, _ = model.tcp(q).position
    base_x, base_y, _ = model.description.base_in_world.position
    away = float(np.hypot(x - base_x, y - base_y))
    return np.array([base_x - x, base_y - y, 0.0]) / max(away, 1e-9)
