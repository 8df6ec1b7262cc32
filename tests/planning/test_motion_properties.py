"""What holds for every scene and path: no history, even steps, limits, re-checks that find what is hit."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from picktree.robot.planning import (
    CollisionChecker,
    JointGoal,
    PoseGoal,
    Scaling,
    time_corners,
    trajectory_check,
)
from picktree.robot.planning.collision_model import CollisionMargins
from picktree.robot.planning.joint_planner import retreat_path
from picktree.robot.planning.trajectory_check import (
    MAX_JOINT_STEP,
    MAX_TCP_STEP,
    EdgeSteps,
    StartTolerance,
    bisection_order,
    first_collision,
    is_trajectory_free,
    sampled_configurations,
)
from picktree.world import (
    Array,
    Bounds,
    Box,
    Cylinder,
    ObjectId,
    PlanningScene,
    Pose,
    Shape,
    Sphere,
    Trajectory,
)
from picktree.world.robot_model import RobotModel, load_robot

from .motion_cell import HOME, MODEL, Cell, item, littered, run, shelf_scene, table_scene

WITHIN = Bounds((-0.3, -0.7, 0.05), (0.8, 0.7, 0.9))


@cache
def collision() -> CollisionChecker:
    """One for all examples: what was asked of it before must not matter."""
    return CollisionChecker(MODEL, workspace=WITHIN)


def a_shape(rng: np.random.Generator) -> Shape:
    a, b, c = (float(x) for x in rng.uniform(0.02, 0.15, 3))
    return (Box((a, b, c)), Cylinder(a / 2, b), Sphere(c / 2))[int(rng.integers(3))]


def a_scene(rng: np.random.Generator) -> PlanningScene:
    """Up to twelve things in the air, one of them held or not, some that may touch."""
    scene = table_scene()
    for k in range(int(rng.integers(1, 12))):
        x, y, z = (float(c) for c in rng.uniform([0.1, -0.6, 0.05], [0.8, 0.6, 0.9]))
        turned = Pose.from_rpy((x, y, z), (float(rng.uniform(-3, 3)), float(rng.uniform(-3, 3)), 0.0))
        scene.put(item(f"thing_{k}", a_shape(rng), turned), "test")
    if rng.random() < 0.5:
        scene.attach("thing_0", Pose.from_rpy((0.0, 0.0, 0.04), (float(rng.uniform(-3, 3)), 0.0, 0.0)))
    return scene


def naive(collision: CollisionChecker, width: float, q: Array) -> bool:
    """Every pair by itself, with new scratch memory, and the workspace by the model's own kinematics."""
    built = collision._now  # pyright: ignore[reportPrivateUsage]
    data, geometry_data = MODEL.full.createData(), pin.GeometryData(built.geometry)
    geometry_data.setSecurityMargins(built.geometry, built.least, True, False)
    pin.updateGeometryPlacements(MODEL.full, data, built.geometry, geometry_data, MODEL.full_q(q, width))
    pairs = range(len(built.geometry.collisionPairs))
    hit = any(pin.computeCollision(built.geometry, geometry_data, index) for index in pairs)
    return not hit and WITHIN.contains(MODEL.tcp(q).position, 0.002)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.01]), st.booleans())
def test_free_is_what_the_naive_check_says(seed: int, clearance: float, touching: bool) -> None:
    rng = np.random.default_rng(seed)
    scene, width = a_scene(rng), float(rng.uniform(0.0, 0.08))
    allowed = [("gripper", "thing_1"), ("panda_link5", "thing_2")] if touching else []
    with scene.allow(*allowed):
        collision().update(scene, width, clearance=clearance)
        for _ in range(5):
            q = HOME + rng.normal(0.0, 0.6, 7)
            assert collision().free(q) == naive(collision(), width, q)


def test_a_remembered_geometry_answers_as_a_new_one() -> None:
    """Switched to and fro between what is supposed and what is believed, while things move."""
    rng = np.random.default_rng(3)
    scene, kept = littered(3, high=0.6), CollisionChecker(MODEL)
    answers: set[bool] = set()
    for turn in range(9):
        supposed = scene.supposing(ObjectId("thing_0"), Pose((0.0, 0.0, 0.05))) if turn % 3 == 1 else scene
        if turn % 3 == 2:
            supposed = scene.supposing(allowed=[("gripper", "thing_1"), ("arm", "table")])
        kept.update(supposed, 0.05, clearance=0.01 * (turn % 2))
        new = CollisionChecker(MODEL)
        new.update(supposed, 0.05, clearance=0.01 * (turn % 2))
        for _ in range(6):
            q = HOME + rng.normal(0.0, 0.5, 7)
            assert kept.free(q) == new.free(q)
            assert kept.contacts(q) == new.contacts(q)
            answers.add(kept.free(q))
        x, y, z = (float(c) for c in rng.uniform([0.2, -0.5, 0.03], [0.8, 0.5, 0.6]))
        moved = scene.get(f"thing_{turn % 15}")
        scene.put(replace(moved, pose=Pose((x, y, z), moved.pose.orientation)), "moved")
    assert answers == {True, False}


@pytest.mark.parametrize("robot", ["panda", "xarm6"])
def test_no_point_of_the_arm_moves_further_in_a_step_than_said(robot: str) -> None:
    model = MODEL if robot == "panda" else RobotModel(load_robot(robot))
    strides, rng = EdgeSteps(model), np.random.default_rng(0)
    data = model.arm.createData()

    def points(q: Array) -> Array:
        pin.forwardKinematics(model.arm, data, q)
        tool = pin.updateFramePlacement(model.arm, data, model.tcp_frame).act(
            np.array([0.0, 0.0, trajectory_check.REACH_BEYOND_TCP])
        )
        return np.array([*(data.oMi[k].translation.copy() for k in range(1, model.n + 1)), tool])

    furthest = 0.0
    for _ in range(300):
        a, b = rng.uniform(model.lower, model.upper, (2, model.n))
        if rng.random() < 0.5:
            joint = int(rng.integers(model.n))
            b = np.concatenate([a[:joint], b[joint : joint + 1], a[joint + 1 :]])
        count = strides.count(b - a)
        k = int(rng.integers(count))
        step = points(a + (b - a) * ((k + 1) / count)) - points(a + (b - a) * (k / count))
        furthest = max(furthest, float(np.linalg.norm(step, axis=1).max()))
    assert 0.3 * trajectory_check.MAX_EDGE_SWEEP < furthest <= trajectory_check.MAX_EDGE_SWEEP


@given(st.integers(1, 500))
def test_an_edge_is_asked_about_at_every_step_once_and_first_at_its_end(count: int) -> None:
    order = bisection_order(count)
    assert order[0] == count and sorted(order) == list(range(1, count + 1))


def a_motion(*corners: Array) -> Trajectory:
    trajectory = time_corners(MODEL, np.array(corners), Scaling(), 0.1)
    assert trajectory is not None
    return trajectory


def test_a_timed_path_is_checked_at_steps_of_five_millimetres() -> None:
    rng = np.random.default_rng(5)
    trajectory = a_motion(*rng.uniform(MODEL.planned_lower, MODEL.planned_upper, (4, 7)))
    checked = sampled_configurations(MODEL, trajectory)
    np.testing.assert_array_equal(checked[0], trajectory.start)
    np.testing.assert_allclose(checked[-1], trajectory.end, atol=1e-12)
    tool = np.array([MODEL.tcp(q).position for q in checked])
    assert np.linalg.norm(np.diff(tool, axis=0), axis=1).max() <= MAX_TCP_STEP * 1.02
    assert np.linalg.norm(np.diff(checked, axis=0), axis=1).max() <= MAX_JOINT_STEP * 1.001
    standing = a_motion(HOME, HOME)
    np.testing.assert_array_equal(sampled_configurations(MODEL, standing), [HOME, HOME])


def test_a_wall_as_thin_as_a_step_is_found_wherever_it_stands() -> None:
    a = HOME + np.array([-0.8, 0.4, 0, 0, 0, 0, 0])
    b = HOME + np.array([0.8, 0.4, 0, 0, 0, 0, 0])
    trajectory, collision = a_motion(a, b), CollisionChecker(MODEL, CollisionMargins(0.0, 0.0, 0.0, 0.0))
    hits = 0
    for k in range(20):
        q = trajectory.position[int(len(trajectory.position) * (0.2 + 0.03 * k))]
        x, y, z = MODEL.tcp(q).position
        needle = item("needle", Sphere(0.003), Pose((x, y, z + 0.001)))
        collision.update(table_scene(needle), 0.0)
        hit = first_collision(collision, trajectory)
        assert hit is not None and not collision.free(hit)
        assert not is_trajectory_free(StartTolerance(collision, trajectory.start), trajectory)
        hits += 1
    collision.update(table_scene(), 0.0)
    assert is_trajectory_free(collision, trajectory) and hits == 20


def test_a_timed_path_beyond_a_limit_is_no_plan() -> None:
    collision = CollisionChecker(MODEL)
    collision.update(table_scene(), 0.04)
    trajectory = a_motion(HOME, HOME + 0.2)
    assert is_trajectory_free(collision, trajectory)
    beyond = trajectory.position.copy()
    beyond[len(beyond) // 2, 0] = MODEL.upper[0] + 1e-4
    found = first_collision(collision, replace(trajectory, position=beyond))
    assert found is not None and found[0] > MODEL.upper[0]


def test_plans_keep_the_limits_and_come_back_from_beyond_them() -> None:
    rng, cell = np.random.default_rng(2), Cell(shelf_scene(), verify=False)
    near = np.where(rng.random((6, 7)) < 0.5, MODEL.lower, MODEL.upper)
    beyond = near + 0.004 * np.sign(near - HOME) * (np.arange(7) < 3)
    searched = 0
    for corner, outside in zip(near, beyond, strict=True):
        goal = HOME + 0.98 * (corner - HOME)
        begin = HOME + 0.3 * (corner - HOME)
        begin[:3] = outside[:3] if cell.plan.contacts(outside) == () else begin[:3]
        cell.at = begin
        if cell.plan.contacts(goal) or cell.plan.contacts(begin):
            continue
        plan, _ = run(cell.plan.to(JointGoal(goal)))
        searched += 1
        lower, upper = np.minimum(MODEL.lower, begin), np.maximum(MODEL.upper, begin)
        position = plan.trajectory.position
        assert np.all(position >= lower - 1e-9) and np.all(position <= upper + 1e-9)
    assert searched >= 1


def test_backing_out_of_a_shelf_is_free_and_straight() -> None:
    cell = Cell(shelf_scene())
    inside = Pose.from_rpy((0.6, 0.17, 0.4), (0.0, np.pi / 2, 0.0))
    q = run(cell.plan.to(PoseGoal((inside,))))[0].trajectory.end
    collision = CollisionChecker(MODEL)
    collision.update(cell.scene, cell.width)
    strides = EdgeSteps(MODEL)
    chain = retreat_path(MODEL, lambda a, b: strides.free(StartTolerance(collision, q).count_free, a, b), q)
    assert len(chain) > 3 and all(collision.free(at) for at in chain)
    # As far as the boards reach it is nearly a straight line; behind them it may turn.
    way = np.array([MODEL.tcp(at).position for at in chain]) - np.array(inside.position)
    in_there = way[:, 0] > -0.2
    assert np.all(np.diff(way[:, 0]) < 0.0) and in_there.sum() >= 6
    assert np.abs(way[in_there, 1:]).max() < 0.02
    blocked = retreat_path(MODEL, lambda _, __: False, q)
    assert blocked == []
