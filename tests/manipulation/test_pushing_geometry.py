"""Poses, outlines and arcs in the plane, and what slides where when it is pushed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.robot.manipulation.stroke_planning import arc_to, biarc, push_sides, straight, truncated
from picktree.world import (
    BeliefObject,
    Box,
    Cylinder,
    ObjectId,
    PlanarPushModel,
    Pose,
    Shape,
    Sphere,
    outline,
)
from picktree.world.planar_geometry import (
    PlanarOutline,
    PlanarPose,
    heading,
    moved,
    outline_distance,
    planar,
    wrap_angle,
)
from picktree.world.robot_model import load_robot, tool_outline

GRIPPER = load_robot("panda").gripper
BLOCK = outline(Box((0.04, 0.04, 0.04)), Pose())
CAN = outline(Cylinder(0.022, 0.075), Pose())
LYING = Pose.from_rpy((0.0, 0.0, 0.022), (0.0, math.pi / 2, 0.4))
places = st.builds(PlanarPose, st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-math.pi, math.pi))


def believed(shape: Shape, pose: Pose) -> BeliefObject:
    return BeliefObject("it", "box", shape, "red", pose, 0.0005, 0.01, 1.0, 0.0, id=ObjectId("it"))


@given(places, places)
def test_a_frame_and_its_inverse_cancel(one: PlanarPose, other: PlanarPose) -> None:
    back = one.inverse() @ (one @ other)
    assert back.distance(other) < 1e-12
    assert wrap_angle(back.yaw - other.yaw) == pytest.approx(0.0, abs=1e-12)


@given(places, st.floats(0.05, 0.2), st.floats(-0.04, 0.04), st.floats(-1.0, 1.0))
def test_two_arcs_lead_to_a_pose_ahead(start: PlanarPose, x: float, y: float, turn: float) -> None:
    end = start @ PlanarPose(x, y, turn)
    way = biarc(start, end)
    assert way is not None
    last = way.at(way.length)
    assert last.distance(end) < 1e-8
    assert wrap_angle(last.yaw - end.yaw) == pytest.approx(0.0, abs=1e-7)
    assert truncated(way, 0.02).at(0.02).distance(way.at(0.02)) < 1e-12


def test_one_arc_leads_to_a_point_ahead_and_none_to_one_behind() -> None:
    way = arc_to(PlanarPose(0.0, 0.0), 0.1, 0.05)
    assert way is not None
    assert way.at(way.length).distance(PlanarPose(0.1, 0.05)) < 1e-12
    assert way.length > math.hypot(0.1, 0.05)
    assert arc_to(PlanarPose(0.0, 0.0), -0.1, 0.05) is None
    assert straight(PlanarPose(0.0, 0.0, math.pi / 2), 0.1).at(0.1).y == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("shape", "pose", "turn"),
    [
        (Box((0.04, 0.04, 0.06)), Pose(), math.pi / 2),
        (Box((0.05, 0.03, 0.04)), Pose.from_rpy((0.1, 0.2, 0.0), (0.0, 0.0, 0.7)), math.pi),
        (Cylinder(0.02, 0.07), Pose(), 0.0),
        (Cylinder(0.02, 0.07), LYING, math.pi),
        (Sphere(0.02), Pose(), 0.0),
    ],
)
def test_what_looks_the_same_when_it_is_turned(shape: Shape, pose: Pose, turn: float) -> None:
    assert outline(shape, pose).turn == pytest.approx(turn)


def test_how_an_outline_resists_turning_is_that_of_its_area() -> None:
    wide, deep = 0.05, 0.03
    assert outline(Box((wide, deep, 0.1)), Pose()).inertia() == pytest.approx(
        (wide**2 + deep**2) / 12, rel=1e-5
    )
    assert CAN.inertia() == pytest.approx(0.022**2 / 2)


@given(places)
def test_a_body_that_is_moved_is_where_it_was_moved_to(to: PlanarPose) -> None:
    for shape, pose in ((Box((0.05, 0.03, 0.04)), Pose()), (Cylinder(0.022, 0.075), LYING)):
        there = moved(shape, pose, to)
        assert planar(shape, there).distance(to) < 1e-12
        assert wrap_angle(heading(shape, there) - to.yaw) == pytest.approx(0.0, abs=1e-9)
        assert there.position[2] == pose.position[2]


def test_gaps_between_outlines() -> None:
    near = pytest.approx
    assert outline_distance(BLOCK, PlanarPose(0, 0), BLOCK, PlanarPose(0.05, 0.05)) == near(
        math.hypot(0.01, 0.01), abs=1e-6
    )
    assert outline_distance(BLOCK, PlanarPose(0, 0), CAN, PlanarPose(0.05, 0.0)) == near(0.008, abs=1e-6)
    assert outline_distance(CAN, PlanarPose(0, 0), CAN, PlanarPose(0.03, 0.0)) == near(-0.014)
    assert outline_distance(BLOCK, PlanarPose(0, 0), BLOCK, PlanarPose(0.03, 0.01)) == near(-0.01, abs=1e-6)


def test_the_fingers_touch_a_side_flat_and_what_is_round_with_both() -> None:
    block = believed(Box((0.05, 0.03, 0.04)), Pose((0.5, 0.0, 0.02)))
    by_heading = {round(math.degrees(side.heading)): side for side in push_sides(block, GRIPPER, 0.0)}
    assert sorted(by_heading) == [-90, 0, 90, 180]
    assert by_heading[0].opening == 0.0
    assert by_heading[0].tool.x == pytest.approx(-0.025 - 0.0095)
    assert by_heading[90].opening == pytest.approx(0.0152)
    can = believed(Cylinder(0.022, 0.075), Pose((0.5, 0.0, 0.0375)))
    first = push_sides(can, GRIPPER, 1.0)[0]
    assert first.heading == 1.0
    assert 0.0 < first.opening < 0.044
    lying = believed(Cylinder(0.022, 0.075), LYING)
    rolling = {round(math.degrees(side.heading)): side.rolls for side in push_sides(lying, GRIPPER, 0.0)}
    assert rolling == {-90: True, 0: False, 90: True, 180: False}


def drive(sliding: PlanarPushModel, opening: float, start: float, way: float, y: float = 0.0) -> None:
    """The fingers along x."""
    fingers = tool_outline(GRIPPER, opening)
    for k in range(int(way / 0.0005) + 1):
        sliding.press([(finger, PlanarPose(start + 0.0005 * k, y)) for finger in fingers])


def test_a_block_turns_until_it_lies_at_the_flat_of_the_fingers() -> None:
    sliding = PlanarPushModel({"block": (BLOCK, PlanarPose(0.0, 0.0, 0.12))})
    drive(sliding, 0.01, -0.04, 0.05)
    at = sliding.where("block")
    assert at.x == pytest.approx(0.01 + 0.0095 + 0.02, abs=2e-4)
    assert abs(at.yaw) < 0.01


def test_what_is_round_stays_between_the_fingers() -> None:
    sliding = PlanarPushModel({"can": (CAN, PlanarPose(0.0, 0.004))})
    drive(sliding, 0.0264, -0.04, 0.06)
    assert sliding.where("can").y == pytest.approx(0.0, abs=3e-4)


def test_what_is_pushed_pushes_the_next_and_stops_at_a_wall() -> None:
    row = {f"block {k}": (BLOCK, PlanarPose(0.0401 * k, 0.0)) for k in range(3)}
    sliding = PlanarPushModel(row)
    drive(sliding, 0.01, -0.035, 0.03)
    first, last = sliding.where("block 0"), sliding.where("block 2")
    assert last.x - first.x == pytest.approx(0.08, abs=3e-4)
    assert last.x > 0.09
    wall = (PlanarOutline(BLOCK.corners), PlanarPose(0.06, 0.0))
    blocked = PlanarPushModel({"block": (BLOCK, PlanarPose(0.0, 0.0))}, [wall])
    blocked.press([(finger, PlanarPose(-0.026, 0.0)) for finger in tool_outline(GRIPPER, 0.0)])
    assert outline_distance(BLOCK, blocked.where("block"), *wall) > -1e-3


def test_fingers_that_come_down_into_something_do_not_push_it() -> None:
    sliding = PlanarPushModel({"block": (BLOCK, PlanarPose(0.0, 0.0))})
    assert not sliding.press([(finger, PlanarPose(0.0, 0.0)) for finger in tool_outline(GRIPPER, 0.0)])
    assert np.allclose((sliding.where("block").x, sliding.where("block").y), 0.0)


def test_the_order_of_contacts_does_not_depend_on_the_hashes_of_names() -> None:
    found: set[tuple[PlanarPose, ...]] = set()
    for run in range(5):
        names = [f"{run}-{k}" for k in range(6)]
        heap = {
            name: (BLOCK, PlanarPose(0.034 * (k % 3), 0.035 * (k // 3) + 0.002 * k, 0.1 * k))
            for k, name in enumerate(names)
        }
        sliding = PlanarPushModel(heap)
        drive(sliding, 0.0, -0.06, 0.05, y=0.01)
        found.add(tuple(sliding.where(name) for name in names))
    assert len(found) == 1
