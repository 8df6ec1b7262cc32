"""The judge against every pair at every moment."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from picktree.robot.planning import CollisionChecker, Scaling, time_corners
from picktree.robot.planning.collision_model import fixed_bodies, movable_bodies
from picktree.robot.planning.scene_queries import FclSolid, distance_between, hull, place, solid
from picktree.robot.planning.swept_volumes import MAX_JOINT_STEP, MAX_TCP_STEP, moments_of
from picktree.robot.planning.trajectory_verifier import PENETRATION_ROUNDING, TrajectoryVerifier
from picktree.world import Array, Box, ConvexMesh, PlanningScene, Pose, Sphere, Trajectory
from picktree.world.robot_model import RobotModel, load_robot

from .motion_cell import HOME, MODEL, item, littered, table_scene

WIDTH = 0.06
HAND = {"panda_hand", "panda_leftfinger", "panda_rightfinger"}


@cache
def judge() -> TrajectoryVerifier:
    return TrajectoryVerifier(MODEL)


@cache
def links() -> list[tuple[str, Pose, FclSolid]]:
    return [(part.link, part.pose_in_link, solid(part.shape)) for part in MODEL.collision_shapes()]


def motion(*corners: Array) -> Trajectory:
    found = time_corners(MODEL, np.array(corners), Scaling(), 0.1)
    assert found is not None
    return found


def some_motion(seed: int, reach: float = 0.8) -> Trajectory:
    rng = np.random.default_rng(seed)
    a = rng.uniform(MODEL.planned_lower, MODEL.planned_upper)
    b = np.clip(a + rng.uniform(-reach, reach, 7), MODEL.planned_lower, MODEL.planned_upper)
    return motion(a, b)


def scene_of(seed: int) -> PlanningScene:
    scene = littered(seed, high=0.6)
    if seed % 2:
        scene.put(item("held", Box((0.05, 0.05, 0.15)), Pose()), "test")
        scene.attach("held", Pose((0.0, 0.0, 0.05)))
    return scene


def one_by_one(trajectory: Trajectory, scene: PlanningScene) -> dict[tuple[str, str], float]:
    """Least distance of each pair that may not touch, found without any bound."""
    disabled = {frozenset(pair) for pair in MODEL.description.disabled_pairs}
    around = (*fixed_bodies(scene), *movable_bodies(scene.objects))
    bodies = [(body.name, place(solid(body.shape), body.pose)) for body in around]
    least: dict[tuple[str, str], float] = {}

    def note(a: str, b: str, distance: float) -> None:
        least[a, b] = min(distance, least.get((a, b), np.inf))

    for q in moments_of(MODEL, trajectory).configurations:
        poses = MODEL.link_poses(q, WIDTH)
        robot = [(link, place(shape, poses[link] @ pose)) for link, pose, shape in links()]
        held = scene.held
        if held is not None and held.object_in_tcp is not None:
            robot.append((held.id, place(solid(held.shape), MODEL.tcp(q) @ held.object_in_tcp)))
        for i, (a, one) in enumerate(robot):
            for b, other in robot[i + 1 :]:
                carried = b == "held" and a in {*HAND, "panda_link7"}
                if frozenset((a, b)) not in disabled and not {a, b} <= HAND and not carried:
                    note(a, b, distance_between(one, other).distance)
            if a != "panda_link0":
                for b, other in bodies:
                    note(a, b, distance_between(one, other).distance)
    return least


@pytest.mark.parametrize("seed", range(2))
def test_bounds_hide_no_contact(seed: int) -> None:
    scene, trajectory = scene_of(seed), some_motion(seed)
    least = one_by_one(trajectory, scene)
    judged = {(c.a, c.b): c.distance for c in judge().judge(trajectory, scene, WIDTH, excuse_start=False)}
    # What is held may sink 2 mm into a board.
    deep = {
        pair: d
        for pair, d in least.items()
        if d < (-0.002 if pair[1] == "table" else 0.0) - PENETRATION_ROUNDING
    }
    assert judged == pytest.approx(deep, abs=1e-9)


def test_moments_are_close_together_and_begin_and_end_with_the_motion() -> None:
    trajectory = some_motion(3)
    moments = moments_of(MODEL, trajectory)
    points = np.array([MODEL.tcp(q).position for q in moments.configurations])
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() <= MAX_TCP_STEP * 1.001
    assert np.linalg.norm(np.diff(moments.configurations, axis=0), axis=1).max() <= MAX_JOINT_STEP * 1.001
    np.testing.assert_array_equal(moments.configurations[[0, -1]], trajectory.position[[0, -1]])
    assert (moments.times[0], moments.times[-1]) == (0.0, trajectory.duration)
    assert np.all(np.diff(moments.times) > 0)
    for time, q in zip(moments.times, moments.configurations, strict=True):
        np.testing.assert_allclose(q, trajectory.sample(float(time))[0], atol=1e-12)


def test_a_motion_that_stands_still_is_judged() -> None:
    still = np.zeros((2, 7))
    standing = Trajectory(np.array([0.0, 0.01]), np.array([HOME, HOME]), still, still)
    assert judge().judge(standing, table_scene(), WIDTH) == ()


def test_what_one_joint_carries_is_not_judged_against_itself() -> None:
    """The xArm's gripper is screwed to its last link: their hulls overlap."""
    arm = RobotModel(load_robot("xarm6"))
    home = arm.named("home")
    still = np.zeros((2, arm.n))
    standing = Trajectory(np.array([0.0, 0.01]), np.array([home, home]), still, still)
    judge = TrajectoryVerifier(arm)
    assert judge.judge(standing, table_scene(), WIDTH) == ()
    (tightest,) = judge.tightest(home[None], table_scene(), WIDTH, reach=1.0)
    assert tightest is not None and tightest.distance > tightest.margin > 0.0


def test_where_the_fast_checker_changes_its_answer_the_judge_measures_the_margin() -> None:
    """Halved down between a free and a colliding configuration, among hulls and with one in the hand."""
    rng = np.random.default_rng(5)
    scene = littered(1, high=0.6)
    hulls = [
        ConvexMesh(tuple((float(x), float(y), float(z)) for x, y, z in points), "made up")
        for points in rng.normal(size=(9, 12, 3)) * 0.04
    ]
    for k, shape in enumerate(hulls[1:]):
        x, y, z = (float(c) for c in rng.uniform([0.2, -0.5, 0.1], [0.8, 0.5, 0.8]))
        scene.put(item(f"hull_{k}", shape, Pose((x, y, z))), "test")
    scene.put(item("held", hulls[0], Pose()), "test")
    scene.attach("held", Pose((0.0, 0.0, 0.05)))
    collision = CollisionChecker(MODEL)
    collision.update(scene, WIDTH)
    drawn = rng.uniform(MODEL.lower, MODEL.upper, (120, 7))
    free = [q for q in drawn if collision.free(q)]
    hit = [q for q in drawn if not collision.free(q)]
    edges: list[Array] = []
    for low, high in zip(free, hit, strict=False):
        for _ in range(30):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if collision.free(middle) else (low, middle)
        edges.append(low)
    assert len(edges) > 20
    for tightest in judge().tightest(np.array(edges), scene, WIDTH):
        assert tightest is not None
        assert tightest.distance == pytest.approx(tightest.margin, abs=1e-4)


def test_flat_points_have_a_hull_to_keep_away_from() -> None:
    """Meshes of robots may be flat."""
    square = [(x, y, 0.0) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    flat = place(hull(np.array(square), keep=False), Pose())
    ball = place(solid(Sphere(0.02)), Pose((0.0, 0.0, 0.12)))
    assert distance_between(flat, ball).distance == pytest.approx(0.1, abs=1e-4)
