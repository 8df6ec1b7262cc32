"""The fast checker against the naive test, against python-fcl, and against its own margins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from picktree.robot.planning import CollisionChecker, InverseKinematics
from picktree.robot.planning.collision_model import CollisionMargins, is_board
from picktree.robot.planning.trajectory_check import StartTolerance
from picktree.robot.planning.trajectory_verifier import TrajectoryVerifier
from picktree.world import Array, Box, PlanningScene, Pose, Trajectory

from .motion_cell import HOME, MODEL, down, item, littered, table_scene


def at(pose: Pose) -> Array:
    q = InverseKinematics(MODEL).descend(pose, HOME)
    assert q is not None
    return q


def looking_at(
    scene: PlanningScene, width: float = 0.04, margins: CollisionMargins | None = None
) -> CollisionChecker:
    collision = CollisionChecker(MODEL, margins)
    collision.update(scene, width)
    return collision


def names(collision: CollisionChecker, q: Array) -> set[tuple[str, str]]:
    return {(c.a, c.b) for c in collision.contacts(q)}


@pytest.mark.parametrize("seed", range(2))
def test_the_broad_phase_misses_nothing(seed: int) -> None:
    scene = littered(seed, high=0.6)
    if seed % 2:
        scene.put(item("held", Box((0.05, 0.05, 0.15)), Pose()), "test")
        scene.attach("held", Pose((0.0, 0.0, 0.05)))
    collision = looking_at(scene)
    rng = np.random.default_rng(seed)
    answers: list[bool] = []
    for _ in range(150):
        q = rng.uniform(MODEL.lower, MODEL.upper)
        answers.append(collision.free(q))
        one_by_one = collision.contacts(q)
        assert answers[-1] == (not one_by_one), one_by_one
    assert 0.1 < np.mean(answers) < 0.95


def test_boxes_reach_as_far_as_the_margins() -> None:
    """Fingers above a level board, nearer and nearer: their boxes part exactly where the margin ends."""
    collision = looking_at(table_scene(), 0.04, CollisionMargins(0.02, 0.02, 0.02, 0.02))
    answers: list[bool] = []
    for height in np.linspace(0.0, 0.05, 60):
        q = at(down(0.5, 0.0, float(height)))
        answers.append(collision.free(q))
        assert answers[-1] == (not collision.contacts(q)), height
    assert {True, False} == set(answers)


def test_bodies_that_were_moved_are_found_by_checkers_that_exist() -> None:
    scene = littered(0)
    scene.put(item("board", Box((0.2, 0.2, 0.02)), Pose((0.5, 0.0, 1.2))), "test")
    collision = looking_at(scene)
    q = at(down(0.5, 0.0, 0.5))
    excusing = collision.excusing((), 0.0)
    assert collision.free(q) and collision.nearly_free(q) and collision.check_with(excusing, q)
    scene.put(item("board", Box((0.2, 0.2, 0.02)), Pose((0.5, 0.0, 0.5))), "test")
    collision.update(scene, 0.04)
    assert not (collision.free(q) or collision.nearly_free(q) or collision.check_with(excusing, q))


def test_requests_depend_on_no_earlier_query() -> None:
    """A cached guess would make answers depend on history; contact points would cost time."""
    collision = looking_at(littered(0))
    checker = collision.excusing((), 0.0)
    for request in checker._geometry_data.collisionRequests:  # pyright: ignore[reportPrivateUsage]
        assert not request.enable_contact
        assert str(request.gjk_initial_guess).endswith("DefaultGuess")


def test_agrees_with_fcl() -> None:
    """Without margins, contacts 0.1 mm deep by the judge are not free, and ours are the judge's, too."""
    scene = littered(5, high=0.6)
    scene.put(item("held", Box((0.05, 0.05, 0.15)), Pose()), "test")
    scene.attach("held", Pose((0.0, 0.0, 0.05)))
    collision = looking_at(scene, 0.06, CollisionMargins(0.0, 0.0, 0.0, -0.002))
    judge = TrajectoryVerifier(MODEL)
    rng = np.random.default_rng(2)
    hits = 0
    for _ in range(120):
        q = rng.uniform(MODEL.lower, MODEL.upper)
        still = np.zeros((2, 7))
        standing = Trajectory(np.array([0.0, 0.01]), np.array([q, q]), still, still)
        judged = {(c.a, c.b) for c in judge.judge(standing, scene, 0.06, excuse_start=False)}
        seen = {(c.a, c.b): c.distance for c in collision.contacts(q)}
        assert judged <= set(seen)
        assert {pair for pair, depth in seen.items() if depth < -0.0025} <= judged
        assert collision.free(q) == (not seen)
        hits += bool(judged)
    assert 10 < hits < 110


def test_without_a_margin_what_lies_deep_in_each_other_is_seen() -> None:
    """These two links are 9 mm deep in each other; coal takes them for apart when the margin is nought."""
    q = np.array([1.0462881, 0.72710322, 1.04743667, -0.76741345, -2.43633052, 0.38170118, 2.05911783])
    scene = table_scene(item("held", Box((0.05, 0.05, 0.15)), Pose()))
    scene.attach("held", Pose((0.0, 0.0, 0.05)))
    collision = looking_at(scene, 0.06, CollisionMargins(0.0, 0.0, 0.0, -0.002))
    assert names(collision, q) == {("panda_link5", "panda_hand")}
    assert not collision.free(q)


def test_fingers_come_nearer_to_a_board_than_to_anything_else() -> None:
    tip = MODEL.description.gripper.tip
    collision = looking_at(table_scene())
    assert collision.free(at(down(0.5, 0.0, tip + 0.001)))
    assert not collision.free(at(down(0.5, 0.0, tip + 0.0003)))
    block = item("block", Box((0.1, 0.1, 0.1)), Pose((0.5, 0.0, 0.05)))
    collision.update(table_scene(block), 0.04)
    assert collision.free(at(down(0.5, 0.0, 0.1 + tip + 0.0035)))
    touching = names(collision, at(down(0.5, 0.0, 0.1 + tip + 0.0025)))
    assert touching == {("panda_leftfinger", "block"), ("panda_rightfinger", "block")}


def test_clearance_widens_what_is_kept_and_not_what_is_tolerated() -> None:
    block = item("block", Box((0.1, 0.1, 0.1)), Pose((0.5, 0.0, 0.05)))
    collision, scene = CollisionChecker(MODEL), table_scene(block)
    above = at(down(0.5, 0.0, 0.1 + MODEL.description.gripper.tip + 0.010))
    for clearance, free in ((0.0, True), (0.006, True), (0.008, False), (0.0, True)):
        collision.update(scene, 0.04, clearance=clearance)
        assert collision.free(above) == free
        assert (collision.contacts(above) == ()) == free
    scene = table_scene(item("cube", Box((0.04, 0.04, 0.04)), Pose((0.5, 0.0, 0.02))))
    scene.attach("cube", Pose())
    collision.update(scene, 0.04, clearance=0.002)
    assert collision.free(at(down(0.5, 0.0, 0.0185)))


def test_a_held_object_may_stand_on_the_table_but_not_lie_in_a_neighbour() -> None:
    scene = table_scene(item("cube", Box((0.04, 0.04, 0.04)), Pose((0.5, 0.0, 0.02))))
    scene.attach("cube", Pose())
    collision = looking_at(scene)
    assert collision.free(at(down(0.5, 0.0, 0.0185)))
    assert names(collision, at(down(0.5, 0.0, 0.0175))) == {("cube", "table")}
    neighbour = item("other", Box((0.04, 0.04, 0.04)), Pose((0.542, 0.0, 0.02)))
    scene.put(neighbour, "test")
    collision.update(scene, 0.04)
    assert ("cube", "other") in names(collision, at(down(0.5, 0.0, 0.02)))
    scene.put(replace(neighbour, pose=Pose((0.55, 0.0, 0.02))), "test")
    collision.update(scene, 0.04)
    assert ("cube", "other") not in names(collision, at(down(0.5, 0.0, 0.02)))


def test_follows_what_the_scene_allows_moves_and_removes() -> None:
    scene = table_scene(item("block", Box((0.05, 0.05, 0.05)), Pose((0.5, 0.0, 0.025))))
    collision = looking_at(scene)
    inside = at(down(0.5, 0.0, 0.02))
    assert not collision.free(inside)
    with scene.allow(("gripper", "block")):
        collision.update(scene, 0.04)
        assert collision.free(inside)
    collision.update(scene, 0.04)
    assert not collision.free(inside)
    scene.put(replace(scene.get("block"), pose=Pose((0.4, 0.15, 0.025))), "moved")
    collision.update(scene, 0.04)
    assert collision.free(inside)
    assert not collision.free(at(down(0.4, 0.15, 0.02)))
    scene.remove("block", "gone")
    collision.update(scene, 0.04)
    assert collision.free(at(down(0.4, 0.15, 0.02)))


def test_scenes_that_take_turns_are_each_seen_as_they_are_now() -> None:
    """A block goes to and fro while the checker looks at the belief and at a supposition in turn."""
    q, scene = at(down(0.5, 0.0, 0.03)), table_scene()
    collision = looking_at(scene)
    for k, x in enumerate((0.5, 0.7, 0.5, 0.5, 0.7, 0.7, 0.5)):
        scene.put(item("block", Box((0.04, 0.1, 0.06)), Pose((x, 0.0, 0.03))), "test")
        for each, free in ((scene, x > 0.6), (scene.supposing(allowed=[("gripper", "block")]), True)):
            if k != 3 or each is scene:
                collision.update(each, 0.04)
                assert collision.free(q) == free, (k, x)


def test_fingers_follow_the_opening() -> None:
    scene = table_scene(item("post", Box((0.03, 0.03, 0.06)), Pose((0.5, 0.0, 0.03))))
    collision = looking_at(scene, 0.08)
    around = at(down(0.5, 0.0, 0.03))
    assert collision.free(around)
    collision.update(scene, 0.03)
    assert names(collision, around) == {("panda_leftfinger", "post"), ("panda_rightfinger", "post")}


def test_the_named_poses_are_free() -> None:
    collision = looking_at(table_scene())
    for name in MODEL.description.named:
        assert collision.contacts(MODEL.named(name)) == (), name


def test_a_start_within_the_margin_is_excused_near_it_only() -> None:
    scene = table_scene(item("block", Box((0.1, 0.1, 0.1)), Pose((0.5, 0.0, 0.05))))
    collision = looking_at(scene)
    tip = MODEL.description.gripper.tip
    start = at(down(0.5, 0.0, 0.1 + tip + 0.001))
    way = StartTolerance(collision, start)
    assert not collision.free(start)
    assert {(c.a, c.b) for c in way.excused} == {
        ("panda_leftfinger", "block"),
        ("panda_rightfinger", "block"),
    }
    assert way.stuck == ()
    assert way.free(start) and way.nearly_free(start)
    assert not way.free(at(down(0.5, 0.0, 0.1 + tip - 0.002)))
    assert way.free(at(down(0.5, 0.0, 0.2)))
    deep = StartTolerance(collision, at(down(0.5, 0.0, 0.1 + tip - 0.005)))
    assert {(c.a, c.b) for c in deep.stuck} == {("panda_leftfinger", "block"), ("panda_rightfinger", "block")}


def test_boards_are_told_by_their_least_extent() -> None:
    assert is_board(Box((1.0, 1.0, 0.04)), Pose())
    assert not is_board(Box((1.0, 0.02, 0.5)), Pose())
    assert is_board(Box((1.0, 0.02, 0.5)), Pose.from_rpy((0, 0, 0), (np.pi / 2, 0, 0)))
