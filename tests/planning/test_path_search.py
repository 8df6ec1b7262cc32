"""Search and shortening of paths among obstacles whose shortest paths are known."""

from __future__ import annotations

import itertools

import numpy as np

from picktree.robot.planning import PoseGoal, Request, Scaling
from picktree.robot.planning.joint_planner import CheckBudget, FoundPath, JointPlanner
from picktree.robot.planning.rrt_connect import (
    SearchChecks,
    improve_path,
    path_length,
    rrt_connect,
    shorten_path,
)
from picktree.robot.planning.trajectory_check import StartTolerance, is_trajectory_free
from picktree.world import Array, Pose

from .motion_cell import MODEL, Cell, shelf_scene

LOWER, UPPER = np.array([-4.0, -4.0]), np.array([4.0, 4.0])
START, GOAL = np.array([-2.0, 0.0]), np.array([2.0, 0.0])
IN_LEFT = Pose.from_rpy((0.6, 0.17, 0.4), (0.0, np.pi / 2, 0.0))


def outside(q: Array) -> bool:
    """Whether a point is outside a square of 2 rad around the origin."""
    return float(np.abs(q).max()) > 1.0


def edge(a: Array, b: Array) -> bool:
    return all(outside(a + (b - a) * share) for share in np.linspace(0.0, 1.0, 200))


SHORTEST = 2.0 + 2.0 * float(np.hypot(1.0, 1.0))
"""Length of the shortest way round the square, over two of its corners, rad."""


def detour() -> list[Array]:
    return [START, *(np.array(p) for p in [(-3.0, 3.0), (0.0, 3.5), (3.0, 3.0)]), GOAL]


def test_a_shortened_path_is_free_and_near_the_shortest() -> None:
    path = shorten_path(detour(), edge, edge)
    assert path[0] is START
    assert path[-1] is GOAL
    assert all(edge(a, b) for a, b in itertools.pairwise(path))
    assert SHORTEST <= path_length(path) < 1.02 * SHORTEST


def test_a_path_that_cannot_be_shortened_stays() -> None:
    straight = [START, np.array([-2.0, 3.0])]
    assert shorten_path(straight, edge, edge) == straight


def test_samples_are_drawn_near_start_and_goal_but_not_there_alone() -> None:
    drawn = vain_samples(1000, np.random.default_rng(0))
    flat = np.mean(np.abs(drawn[:, 1]) < 0.5)
    assert len(drawn) == 1000 and 0.7 < flat < 0.98


def test_a_search_takes_no_more_random_numbers_than_its_samples_need() -> None:
    rng = np.random.default_rng(0)
    parts = np.concatenate([vain_samples(count, rng) for count in (5, 40, 64, 11)])
    np.testing.assert_array_equal(parts, vain_samples(120, np.random.default_rng(0)))


def vain_samples(count: int, rng: np.random.Generator) -> Array:
    """Return the ends (m, n) of the extensions of a search that finds none free in that number of checks."""
    drawn: list[Array] = []

    def recorded(ends: Array) -> int:
        drawn.extend(ends)
        return len(ends)

    def no(a: Array, b: Array) -> bool:
        return False

    checks = SearchChecks(no, no, recorded, lambda: count - len(drawn))
    assert rrt_connect(LOWER, UPPER, (START, ()), [(GOAL, ())], checks, rng) is None
    return np.array(drawn)


def test_further_searches_replace_a_path_by_shorter_ones_only() -> None:
    long_way = [START, np.array([-2.0, -3.9]), np.array([2.0, -3.9]), GOAL]
    others = iter([[START, np.array([-3.9, 3.9]), np.array([3.9, 3.9]), GOAL], None, detour()])
    left = iter([False, False, False, True])
    path = improve_path(long_way, lambda: next(others), edge, edge, lambda: next(left))
    assert path_length(path) < 1.02 * SHORTEST
    assert improve_path(path, detour, edge, edge, lambda: True) is path


def _found(cell: Cell) -> FoundPath:
    plan = cell.plan.solver.solve(Request(PoseGoal((IN_LEFT,))), 1)
    return FoundPath(plan.path, plan.planner, 0, plan.trajectory)


def test_a_path_is_improved_within_its_checks_and_always_alike() -> None:
    told: list[bytes] = []
    for _ in range(2):
        cell = Cell(shelf_scene(), verify=False)
        found, collision = _found(cell), cell.plan.solver.collision
        way = StartTolerance(collision, found.path[0])
        planner = JointPlanner(MODEL, way, found.path[0], Scaling(), CheckBudget(collision, 3000))
        before = collision.checks
        better = planner.improved(found, 1)
        trajectory = better.trajectory
        assert trajectory is not None
        checked = len(trajectory.times)
        assert collision.checks - before < 3000 + 10 * checked
        assert path_length(list(better.path)) < 0.98 * path_length(list(found.path))
        assert is_trajectory_free(way, trajectory)
        assert (better.path[0].tobytes(), better.path[-1].tobytes()) == (
            found.path[0].tobytes(),
            found.path[-1].tobytes(),
        )
        told.append(better.path.tobytes())
    assert told[0] == told[1]


def test_a_path_without_checks_to_spend_stays() -> None:
    cell = Cell(shelf_scene(), verify=False)
    found, collision = _found(cell), cell.plan.solver.collision
    way = StartTolerance(collision, found.path[0])
    planner = JointPlanner(MODEL, way, found.path[0], Scaling(), CheckBudget(collision, 0))
    assert planner.improved(found, 1) is found
