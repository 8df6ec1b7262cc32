"""Ways out of what the arm is believed to be in: gradients, steps, and when there is none."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from picktree.robot.planning import DIRECTIONS, CollisionChecker
from picktree.robot.planning.penetration_escape import (
    EscapeSearch,
    StepConstraints,
    least_distance,
)
from picktree.world import Array, Box, PlanningScene, Pose, Sphere

from .motion_cell import HOME, MODEL, item, littered, table_scene

WIDTH = 0.08


def believing(scene: PlanningScene) -> CollisionChecker:
    collision = CollisionChecker(MODEL)
    collision.update(scene, WIDTH)
    return collision


def depth(collision: CollisionChecker, q: Array) -> float:
    return max((s.margin - s.distance for s in collision.separations(q, 0.0)), default=0.0)


def at_the_hand(name: str = "ghost", size: float = 0.08, *, up: float = 0.05) -> PlanningScene:
    """A box of that size beside the hand at home, that much above the TCP."""
    x, y, z = MODEL.tcp(HOME).position
    return table_scene(item(name, Box((size, size, size)), Pose((x + 0.03, y + 0.05, z + up))))


def test_gradients_of_distances_are_what_finite_differences_say() -> None:
    compared = 0
    rng = np.random.default_rng(3)
    for seed in range(12):
        collision = believing(littered(seed, 15, 0.5))
        q = np.clip(HOME + rng.uniform(-0.9, 0.9, MODEL.n), MODEL.planned_lower, MODEL.planned_upper)
        near = collision.separations(q, 0.03)
        alone = [s for s in near if [o.key for o in collision.separations(q, 0.06)].count(s.key) == 1]
        for separation in alone[:3]:
            for joint in range(MODEL.n):
                step = np.zeros(MODEL.n)
                step[joint] = 1e-5

                def distance(
                    q: Array, known: CollisionChecker = collision, key: object = separation.key
                ) -> float:
                    return next(s.distance for s in known.separations(q, 0.06) if s.key == key)

                slope = (distance(q + step) - distance(q - step)) / 2e-5
                assert abs(slope - separation.gradient[joint]) < 2e-3
                compared += 1
    assert compared >= 20


def test_the_depth_only_shrinks_on_the_way_out() -> None:
    collision = believing(at_the_hand())
    assert depth(collision, HOME) > 0.02
    way = EscapeSearch(MODEL, collision, HOME).way("out", 0.4)
    depths = [depth(collision, q) for q in way.path]
    assert (way.free, way.ended_by) == (True, "")
    assert all(after < before + 5e-4 for before, after in pairwise(depths))
    assert depths[-1] == 0.0
    assert collision.free(way.path[-1])


def test_every_way_keeps_clear_of_what_was_not_touched_and_the_least_is_out() -> None:
    x, y, z = MODEL.tcp(HOME).position
    ghost = item("ghost", Sphere(0.05), Pose((x, y + 0.06, z + 0.06)))
    wall = item("wall", Box((0.3, 0.02, 0.4)), Pose((x, y - 0.17, z)))
    collision = believing(table_scene(ghost, wall))
    outward = EscapeSearch(MODEL, collision, HOME)
    ways = {direction: outward.way(direction, 0.4) for direction in DIRECTIONS}
    assert ways["out"].free
    assert sum(way.free for way in ways.values()) >= 4
    for way in ways.values():
        for q in way.path:
            assert all(s.b != "wall" or s.distance > s.margin - 1e-3 for s in collision.separations(q, 0.0))


def test_from_within_what_closes_in_on_all_sides_there_is_no_way() -> None:
    x, y, z = MODEL.tcp(HOME).position
    blocks = [
        item(f"wall_{k}", Box((0.05, 0.05, 0.3)), Pose((x + dx, y + dy, z + 0.02)))
        for k, (dx, dy) in enumerate([(0.06, 0.12), (-0.06, 0.12), (0.06, -0.12), (-0.06, -0.12)])
    ]
    lid = item("ghost", Box((0.9, 0.9, 0.9)), Pose((x, y, z + 0.1)))
    collision = believing(table_scene(*blocks, lid))
    outward = EscapeSearch(MODEL, collision, HOME)
    for direction in DIRECTIONS:
        way = outward.way(direction, 0.1)
        assert not way.free
        assert way.ended_by
        assert way.depth > 0.1


def test_a_known_path_is_followed_as_far_as_nothing_comes_closer() -> None:
    x, y, z = MODEL.tcp(HOME).position
    collision = believing(table_scene(item("ghost", Box((0.08, 0.08, 0.08)), Pose((x, y, z - 0.2)))))
    outward = EscapeSearch(MODEL, collision, HOME)
    free = believing(table_scene())
    unhindered = EscapeSearch(MODEL, free, HOME).way("down", 0.2, until_free=False).path
    again = outward.along("the way it came", unhindered)
    assert again.ended_by.endswith("would come closer to ghost")
    assert len(again.path) < len(unhindered)


def test_the_least_change_that_keeps_inequalities() -> None:
    rng = np.random.default_rng(5)
    for _ in range(40):
        g, inside = rng.normal(size=(6, 4)), rng.normal(size=4)
        h = g @ inside - rng.uniform(0.0, 1.0, 6)
        wanted = rng.normal(size=4)
        x = least_distance(StepConstraints(g, h), wanted)
        assert x is not None
        assert (g @ x >= h - 1e-8).all()
        assert np.linalg.norm(x - wanted) <= np.linalg.norm(inside - wanted) + 1e-9
    nowhere = StepConstraints(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([1.0, 1.0]))
    assert least_distance(nowhere, np.zeros(2)) is None
