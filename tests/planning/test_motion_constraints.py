"""Constraints hold on the whole way, regions are reached near first, and all of it is the same again."""

from __future__ import annotations

from math import degrees, pi, radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.robot.planning import (
    BoxConstraint,
    Constraint,
    JointGoal,
    MotionPlan,
    NamedGoal,
    OffsetGoal,
    PoseGoal,
    RegionGoal,
    Request,
    RequestSolver,
    UprightConstraint,
)
from picktree.robot.planning.goal_configurations import region_poses
from picktree.robot.planning.path_constraints import PathConstraints
from picktree.robot.planning.trajectory_verifier import TrajectoryVerifier
from picktree.world import Array, Bounds, Box, Failure, PlanningScene, Pose, Trajectory

from ..other_process import OtherProcess
from .motion_cell import HOME, MODEL, down, item, shelf_scene, table_scene

LEVEL = (-1.0, 0.0, 0.0)
"""The axis of a hand that points forward which then points up."""


def solver(scene: PlanningScene, at: Array = HOME) -> RequestSolver:
    return RequestSolver(MODEL, scene, configuration=lambda: at, width=lambda: 0.08)


def tilt(trajectory: Trajectory, axis: tuple[float, float, float]) -> float:
    """The greatest angle between the tool's axis and the vertical, by definition, rad."""
    ups = [float((MODEL.tcp(q).rotation() @ np.array(axis))[2]) for q in trajectory.position]
    return float(np.arccos(np.clip(min(ups), -1.0, 1.0)))


def in_shelf(x: float, y: float, z: float, yaw: float = 0.0) -> Pose:
    """The hand level, reaching into the shelf."""
    return Pose.from_rpy((x, y, z), (0.0, pi / 2, 0.0)) @ Pose.from_rpy((0.0, 0.0, 0.0), (yaw, 0.0, 0.0))


def configuration(scene: PlanningScene, pose: Pose) -> Array:
    asked = solver(scene)
    asked.look()
    found = asked.ik.solutions(pose, np.random.default_rng(0), HOME, 8)
    return next(q for q in found if asked.collision.free(q))


def test_a_glass_is_carried_from_one_compartment_of_a_shelf_to_the_other() -> None:
    scene = shelf_scene()
    start = configuration(scene, in_shelf(0.55, 0.17, 0.4))
    goal = PoseGoal((in_shelf(0.55, -0.17, 0.4),))
    plan = solver(scene).solve(Request(goal, start, constraints=(UprightConstraint(radians(10), LEVEL),)), 1)
    assert plan.planner == "CBiRRT"
    assert degrees(tilt(plan.trajectory, LEVEL)) <= 10.0 + 1e-6
    assert TrajectoryVerifier(MODEL).judge(plan.trajectory, scene, 0.08) == ()
    np.testing.assert_allclose(plan.trajectory.start, start, atol=1e-9)
    assert MODEL.tcp(plan.trajectory.end).distance(goal.tcp_in_world[0]) < 1e-4
    free = solver(scene).solve(Request(goal, start), 1)
    assert degrees(tilt(free.trajectory, LEVEL)) > 10.0


PILLAR = item("pillar", Box((0.08, 0.08, 0.4)), Pose((0.5, 0.0, 0.2)))


@pytest.mark.parametrize("degree", [1.0, 10.0])
def test_upright_around_a_pillar(degree: float) -> None:
    scene = table_scene(PILLAR)
    start = configuration(scene, down(0.45, 0.3, 0.15))
    goal = PoseGoal((down(0.45, -0.3, 0.15),))
    upright = UprightConstraint(radians(degree))
    plan = solver(scene).solve(Request(goal, start, constraints=(upright,)), 1)
    assert degrees(tilt(plan.trajectory, upright.axis)) <= degree + 1e-6
    assert TrajectoryVerifier(MODEL).judge(plan.trajectory, scene, 0.08) == ()


def test_within_a_box() -> None:
    box = Bounds((0.35, -0.35, 0.1), (0.45, 0.35, 0.3))
    scene = table_scene()
    start = configuration(scene, down(0.4, 0.32, 0.15))
    goal = PoseGoal((down(0.4, -0.32, 0.15),))
    plan = solver(scene).solve(Request(goal, start, constraints=(BoxConstraint(box),)), 1)
    assert all(box.contains(MODEL.tcp(q).position, -1e-6) for q in plan.trajectory.position)
    free = solver(scene).solve(Request(goal, start), 1)
    assert not all(box.contains(MODEL.tcp(q).position) for q in free.trajectory.position)


def test_a_clearance_is_kept() -> None:
    block = item("block", Box((0.1, 0.1, 0.25)), Pose((0.45, 0.0, 0.125)))
    scene = table_scene(block)
    start = configuration(scene, down(0.45, 0.3, 0.2))
    goal = PoseGoal((down(0.45, -0.3, 0.2),))
    asked = solver(scene)
    plan = asked.solve(Request(goal, start, clearance=0.03), 1)
    asked.look()
    contacts = [asked.collision.nearest(q) for q in plan.trajectory.position]
    assert min(c.distance for c in contacts if c is not None and c.b == "block") > 0.015


@given(st.lists(st.floats(-1.0, 1.0), min_size=7, max_size=7), st.floats(0.01, 1.0))
def test_a_projection_ends_where_the_constraints_hold(shares: list[float], limit: float) -> None:
    middle, half = (MODEL.upper + MODEL.lower) / 2, (MODEL.upper - MODEL.lower) / 2
    q = middle + np.array(shares) * half
    wanted: tuple[Constraint, ...] = (
        UprightConstraint(limit),
        BoxConstraint(Bounds((-0.6, -0.6, 0.0), (0.6, 0.6, 0.9))),
    )
    constraints = PathConstraints(MODEL, wanted)
    found = constraints.project(q, MODEL.lower, MODEL.upper)
    if found is not None:
        assert constraints.hold(found) and not constraints.broken(found)
        assert np.all(found >= MODEL.lower) and np.all(found <= MODEL.upper)


def test_broken_is_told_by_how_much() -> None:
    leant = Pose.from_rpy((0.5, 0.0, 0.3), (pi + 0.3, 0.0, 0.0))
    constraints = PathConstraints(
        MODEL, (UprightConstraint(0.1), BoxConstraint(Bounds((0.0, 0.0, 0.0), (0.4, 0.2, 1.0))))
    )
    tilted, outside = constraints.broken_by(leant)
    assert (tilted.is_at, tilted.by) == (pytest.approx(0.3), pytest.approx(0.2))
    assert outside.by == pytest.approx(0.1)


REGION = RegionGoal(down(0.5, 0.1, 0.2, 0.4), yaw=0.5, tilt=0.2, reach=(0.01, 0.03, 0.05))


def test_a_region_is_sampled_within_its_limits_near_ones_first() -> None:
    found = region_poses(REGION)
    assert found[0] == REGION.tcp_in_world
    assert len(set(found)) == len(found) == 65
    inverse = REGION.tcp_in_world.inverse()
    local = [inverse @ pose for pose in found]
    for pose in local:
        assert all(abs(p) <= r + 1e-9 for p, r in zip(pose.position, REGION.reach, strict=True))
        assert np.arccos(np.clip(pose.rotation()[2, 2], -1, 1)) <= REGION.tilt + 1e-9
    shifts = [max(abs(p) / r for p, r in zip(pose.position, REGION.reach, strict=True)) for pose in local]
    assert np.mean(shifts[1:22]) < np.mean(shifts[44:])
    # Every part of the region is tried: each axis to both sides, beyond the half of it.
    away = np.array([np.array(pose.position) / np.array(REGION.reach) for pose in local])
    assert np.all(away.min(axis=0) < -0.5) and np.all(away.max(axis=0) > 0.5)
    turned = region_poses(RegionGoal(down(0.5, 0.1, 0.2), yaw=pi), 8)
    assert all(pose.position == (0.5, 0.1, 0.2) for pose in turned)
    assert region_poses(RegionGoal(down(0.5, 0.1, 0.2))) == (down(0.5, 0.1, 0.2),)


def test_a_region_is_reached_where_its_middle_is_not_free() -> None:
    # Walls on either side leave room for the hand, which is 208 mm wide, only when it is turned.
    walls = [
        item(f"wall_{k}", Box((0.3, 0.02, 0.3)), Pose((0.5, y, 0.15))) for k, y in enumerate((-0.06, 0.06))
    ]
    scene = table_scene(*walls)
    across = down(0.5, 0.0, 0.15)
    with pytest.raises(Failure):
        solver(scene).solve(Request(PoseGoal((across,))), 1)
    plan = solver(scene).solve(Request(RegionGoal(across, yaw=pi)), 1)
    assert plan.goal_index > 0
    reached = MODEL.tcp(plan.trajectory.end)
    assert reached.distance(across) < 1e-4
    assert abs(degrees(reached.angle(across)) - 90.0) < 30.0
    near = solver(table_scene()).solve(Request(RegionGoal(across, yaw=pi)), 1)
    assert near.goal_index == 0


def test_constraints_are_kept_by_lines_and_joint_goals() -> None:
    upright = (UprightConstraint(radians(10)),)
    plan = solver(table_scene()).solve(Request(OffsetGoal((0.1, 0.1, -0.1)), constraints=upright), 1)
    assert tilt(plan.trajectory, (0.0, 0.0, -1.0)) <= radians(10)
    leant = HOME.copy()
    leant[5] += 0.5
    with pytest.raises(Failure, match=r"planning\.constraint: at the goal the tool tilts by"):
        solver(table_scene()).solve(Request(JointGoal(leant), constraints=upright), 1)
    plan = solver(table_scene()).solve(Request(NamedGoal("observe"), constraints=upright), 1)
    assert tilt(plan.trajectory, (0.0, 0.0, -1.0)) <= radians(10)


def fingerprint() -> str:
    """Of a plan under a constraint and one into a region, for comparison across processes."""
    scene = table_scene(PILLAR)
    start = configuration(scene, down(0.45, 0.3, 0.15))
    goal = PoseGoal((down(0.45, -0.3, 0.15),))
    plans: list[MotionPlan] = [
        solver(scene).solve(Request(goal, start, constraints=(UprightConstraint(radians(10)),)), 5),
        solver(scene).solve(Request(RegionGoal(goal.tcp_in_world[0], 0.3, 0.2), start), 5),
    ]
    return " ".join(f"{p.planner} {p.checks} {p.trajectory.position.tobytes().hex()[-64:]}" for p in plans)


def test_the_same_bits_in_another_process(elsewhere: OtherProcess) -> None:
    here = fingerprint()
    assert here.startswith("CBiRRT ")
    assert elsewhere.call(fingerprint) == here
