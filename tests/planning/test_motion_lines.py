"""Straight lines of the TCP: straight, reversible, and clear about what ended them."""

from __future__ import annotations

import numpy as np
import pytest

from picktree.robot.planning import CollisionChecker, InverseKinematics
from picktree.robot.planning.cartesian_lines import (
    MAX_JOINT_JUMP,
    MAX_LINE_STEP,
    plan_line,
)
from picktree.robot.planning.trajectory_check import StartTolerance
from picktree.world import Array, Box, PlanningScene, Pose

from .motion_cell import HOME, MODEL, down, item, table_scene

IK = InverseKinematics(MODEL)


def at(pose: Pose) -> Array:
    q = IK.descend(pose, HOME)
    assert q is not None
    return q


def way(start: Array, scene: PlanningScene | None = None) -> StartTolerance:
    collision = CollisionChecker(MODEL)
    collision.update(scene or table_scene(), 0.04)
    return StartTolerance(collision, start)


def test_a_line_is_straight_in_even_steps_and_turns_evenly() -> None:
    begin, end = down(0.45, -0.1, 0.3), down(0.5, 0.1, 0.25, 0.8)
    start = at(begin)
    found = plan_line(MODEL, IK, way(start), start, end)
    assert (found.fraction, found.ended_by, found.ended_at) == (1.0, "", None)
    poses = [MODEL.tcp(q) for q in found.path]
    points = np.array([pose.position for pose in poses])
    share = np.linspace(0.0, 1.0, len(points))[:, None]
    np.testing.assert_allclose(points, points[0] + share * (points[-1] - points[0]), atol=3e-5)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() <= MAX_LINE_STEP + 3e-5
    turned = [begin.angle(pose) for pose in poses]
    np.testing.assert_allclose(turned, share[:, 0] * begin.angle(end), atol=5e-4)
    assert np.abs(np.diff(found.path, axis=0)).max() < MAX_JOINT_JUMP


def test_the_same_line_backwards_leads_back() -> None:
    begin, end = down(0.45, -0.1, 0.3), down(0.5, 0.08, 0.22)
    start = at(begin)
    there = plan_line(MODEL, IK, way(start), start, end)
    back = plan_line(MODEL, IK, way(start), there.path[-1], begin)
    assert (there.ended_by, back.ended_by) == ("", "")
    assert MODEL.tcp(back.path[-1]).distance(begin) < 2e-5
    np.testing.assert_allclose(back.path[-1], start, atol=0.05)


def test_a_line_out_of_reach_says_where_it_ended() -> None:
    begin = down(0.6, 0.0, 0.3)
    start = at(begin)
    end = begin.shifted((0.5, 0.0, 0.0))
    found = plan_line(MODEL, IK, way(start), start, end)
    assert found.ended_by in ("reach", "jump")
    assert 0.2 < found.fraction < 0.8
    assert found.ended_at is not None
    reached = MODEL.tcp(found.path[-1]).position[0]
    assert found.ended_at.position[0] == pytest.approx(reached + MAX_LINE_STEP, abs=1e-4)


def test_a_line_that_meets_something_says_with_which_configuration() -> None:
    block = item("block", Box((0.1, 0.1, 0.1)), Pose((0.5, 0.0, 0.05)))
    scene = table_scene(block)
    start = at(down(0.5, 0.0, 0.3))
    found = plan_line(MODEL, IK, way(start, scene), start, down(0.5, 0.0, 0.05))
    assert found.ended_by == "collision" and found.blocked is not None and found.ended_at is not None
    assert MODEL.tcp(found.blocked).distance(found.ended_at) < 2e-5
    assert way(start, scene).free(found.path[-1]) and not way(start, scene).free(found.blocked)
