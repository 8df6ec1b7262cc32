"""Why a pose cannot be reached, and how near the arm comes to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from picktree.robot.planning import InverseKinematics
from picktree.world import Array
from picktree.world.robot_model import RobotModel, load_robot

from .motion_cell import HOME, MODEL, down

LIMITS = MODEL.description.limits
SHOULDER = np.array([0.0, 0.0, 0.333])


def inside(q: Array) -> bool:
    return bool(np.all(q >= MODEL.planned_lower) and np.all(q <= MODEL.planned_upper))


def test_a_pose_that_can_be_reached_has_no_obstacle() -> None:
    found = InverseKinematics(MODEL).nearest(down(0.5, 0.1, 0.2), HOME)
    assert (found.obstacle, found.beyond) == ("", ())
    assert found.distance < 1e-4 and found.angle < 1e-3 and inside(found.q)


@pytest.mark.parametrize("x", [1.2, 2.0])
def test_a_point_out_of_reach_is_told_with_the_way_that_is_missing(x: float) -> None:
    """The arm stretches towards it: what it misses is what the point is further away than the farthest."""
    wanted = down(x, 0.0, 0.333)
    found = InverseKinematics(MODEL).nearest(wanted, HOME)
    assert found.obstacle == "position" and inside(found.q)
    assert found.distance == pytest.approx(found.tcp_in_world.distance(wanted))
    farthest = max(
        float(np.linalg.norm(np.array(MODEL.tcp(q).position) - SHOULDER))
        for q in np.random.default_rng(0).uniform(MODEL.planned_lower, MODEL.planned_upper, (3000, 7))
    )
    missing = float(np.linalg.norm(np.array(wanted.position) - SHOULDER)) - farthest
    assert missing - 0.05 < found.distance < missing + 0.001


def test_a_point_that_is_reached_in_another_orientation_only() -> None:
    found = InverseKinematics(MODEL).nearest(down(0.9, 0.0, 0.2), HOME)
    assert found.obstacle == "orientation" and inside(found.q)
    assert found.distance < 1e-4
    assert np.degrees(found.angle) == pytest.approx(29.8, abs=1.0)


def test_joints_whose_limits_are_in_the_way_are_named() -> None:
    """A tool pulled in to the base asks more of shoulder and elbow than they can do."""
    found = InverseKinematics(MODEL).nearest(down(0.05, 0.0, 0.3), HOME)
    assert found.obstacle == "limits"
    assert {b.joint for b in found.beyond} == {"panda_joint2", "panda_joint4"}
    for joint in found.beyond:
        index = MODEL.description.joints.index(joint.joint)
        assert joint.limit == MODEL.planned_lower[index] > joint.wanted


def test_a_narrower_limit_is_the_one_that_is_named() -> None:
    """The last joint alone turns the tool about its own axis."""
    q = HOME.copy()
    q[6] = 2.5
    wanted = MODEL.tcp(q)
    fixed = [replace(limit, lower=at - 0.04, upper=at + 0.04) for limit, at in zip(LIMITS, HOME, strict=True)]
    arm = RobotModel(replace(load_robot("panda"), limits=(*fixed[:6], replace(fixed[6], upper=1.5))))
    assert InverseKinematics(MODEL).nearest(wanted, HOME).obstacle == ""
    found = InverseKinematics(arm).nearest(wanted, HOME)
    assert found.obstacle == "limits"
    assert "panda_joint7" in {beyond.joint for beyond in found.beyond}


def test_answers_do_not_depend_on_earlier_ones() -> None:
    fresh, used = InverseKinematics(MODEL), InverseKinematics(MODEL)
    rng = np.random.default_rng(4)
    for _ in range(5):
        x, y, z = rng.uniform([-0.9, -0.9, -0.2], [0.9, 0.9, 1.1])
        used.solutions(down(float(x), float(y), float(z)), rng, HOME)
    wanted = down(0.05, 0.0, 0.3)
    first, second = fresh.nearest(wanted, HOME), used.nearest(wanted, HOME)
    np.testing.assert_array_equal(first.q, second.q)
    assert first.beyond == second.beyond
    ours, theirs = (ik.solutions(down(0.5, 0.2, 0.3), np.random.default_rng(1), HOME) for ik in (fresh, used))
    np.testing.assert_array_equal(ours, theirs)


def test_a_joint_that_turns_more_than_once_round_stands_near() -> None:
    wide = list(MODEL.description.limits)
    wide[6] = replace(wide[6], lower=-6.5, upper=6.5)
    arm = RobotModel(replace(load_robot("panda"), limits=tuple(wide)))
    ik = InverseKinematics(arm)
    near = HOME.copy()
    near[6] = 4.5
    found = ik.solutions(down(0.5, 0.1, 0.2), np.random.default_rng(0), near, want=6)
    assert len(found) == 6
    for q in found:
        assert arm.planned_lower[6] <= q[6] <= arm.planned_upper[6]
        for turns in (-1, 1):
            other = q[6] + turns * 2 * np.pi
            assert not arm.planned_lower[6] <= other <= arm.planned_upper[6] or abs(other - 4.5) >= abs(
                q[6] - 4.5
            )
        assert arm.tcp(q).distance(down(0.5, 0.1, 0.2)) < 1e-4
    np.testing.assert_allclose(ik.unwound(near - [0, 0, 0, 0, 0, 0, 2 * np.pi], near), near)
