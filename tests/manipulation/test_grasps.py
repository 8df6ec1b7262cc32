"""Grasp candidates are judged by geometry: closing across the object, clear of table and palm."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from picktree.robot.manipulation import grasp_candidates
from picktree.robot.manipulation.grasps import ROOMY_EXCESS, TIGHT_EXCESS, TIP_CLEARANCE, leaning_grasps
from picktree.world import (
    BeliefObject,
    Box,
    ConvexMesh,
    Cylinder,
    ObjectId,
    Pose,
    Shape,
    Sphere,
    bottom,
    corners,
    top,
)
from picktree.world.robot_model import GripperDescription
from picktree.world.robot_model.description import PadContact

PAD = (Box((0.018, 0.01, 0.018)), Pose())
GRIPPER = GripperDescription(
    joints=("left", "right"),
    fingers=("left", "right"),
    max_width=0.08,
    max_force=70.0,
    speed=0.1,
    pads=(PAD, PAD),
    pad_contact=PadContact(),
    gear=-1.0,
    tip=0.0072,
    palm=0.039,
    hand=(),
    finger_boxes=PAD,
)


def belief(shape: Shape, pose: Pose) -> BeliefObject:
    return BeliefObject("thing", "box", shape, "red", pose, 0.001, 0.01, 1.0, 0.0, id=ObjectId("it"))


def standing(shape: Shape, yaw: float = 0.0, x: float = 0.5, y: float = 0.1) -> BeliefObject:
    pose = Pose.from_rpy((x, y, 0.0), (0.0, 0.0, yaw))
    return belief(shape, pose.shifted((0.0, 0.0, -bottom(shape, pose))))


@settings(max_examples=20)
@given(st.floats(-math.pi, math.pi), st.floats(0.02, 0.06), st.floats(0.02, 0.075))
def test_a_box_is_closed_on_across_its_faces(yaw: float, a: float, b: float) -> None:
    item = standing(Box((a, b, 0.04)), yaw)
    for candidate in grasp_candidates(item, GRIPPER):
        closing = item.pose.rotation().T @ candidate.tcp_in_world.rotation()[:, 1]
        assert max(abs(closing)) == pytest.approx(1.0, abs=1e-6)
        across = (a, b, 0.04)[int(np.argmax(np.abs(closing)))]
        assert candidate.expected_width == pytest.approx(across)
        assert TIGHT_EXCESS * 0.6 <= candidate.opening - across <= ROOMY_EXCESS + 1e-9


@settings(max_examples=8)
@given(st.floats(-math.pi, math.pi), st.sampled_from([Box((0.04, 0.05, 0.06)), Cylinder(0.02, 0.08)]))
def test_a_hand_that_leans_keeps_its_pads_flat_and_comes_between_neither_support_nor_palm(
    yaw: float, shape: Shape
) -> None:
    item = standing(shape, yaw)
    leaning = leaning_grasps(item, GRIPPER)
    assert {round(math.degrees(math.asin(c.tcp_in_world.rotation()[2, 0]))) for c in leaning} == {
        *(-45, -30, -15, 15, 30, 45)
    }
    points = corners(shape) @ item.pose.rotation().T + item.pose.position
    for grasp in leaning:
        tcp, turned = np.array(grasp.tcp_in_world.position), grasp.tcp_in_world.rotation()
        assert abs(turned[2, 1]) < 1e-9
        tips = [tcp + turned @ (x, 0.0, GRIPPER.tip) for x in (-0.009, 0.009)]
        assert min(tip[2] for tip in tips) >= bottom(shape, item.pose) + TIP_CLEARANCE - 1e-9
        assert ((points - tcp) @ turned[:, 2]).min() > -GRIPPER.palm
        assert tcp[2] < top(shape, item.pose)


def test_a_flat_object_is_not_grasped_by_a_leaning_hand() -> None:
    assert leaning_grasps(standing(Box((0.06, 0.06, 0.006))), GRIPPER) == []


@pytest.mark.parametrize(
    "shape",
    [Box((0.04, 0.04, 0.12)), Box((0.06, 0.06, 0.006)), Cylinder(0.02, 0.08), Sphere(0.02)],
    ids=["tall", "plate", "can", "ball"],
)
def test_tips_stay_above_the_table_and_the_palm_above_the_object(shape: Shape) -> None:
    item = standing(shape)
    candidates = grasp_candidates(item, GRIPPER)
    assert candidates
    for candidate in candidates:
        z = candidate.tcp_in_world.position[2]
        assert z - GRIPPER.tip >= TIP_CLEARANCE - 1e-9
        assert z + GRIPPER.palm > top(shape, item.pose)
        assert candidate.tcp_in_world.rotation()[2, 2] == pytest.approx(-1.0)


def test_only_a_plate_is_felt_for() -> None:
    assert all(c.flat for c in grasp_candidates(standing(Box((0.06, 0.06, 0.006))), GRIPPER))
    assert not any(c.flat for c in grasp_candidates(standing(Box((0.06, 0.06, 0.02))), GRIPPER))


def test_what_is_wider_than_the_opening_has_no_candidate() -> None:
    assert grasp_candidates(standing(Box((0.09, 0.1, 0.05))), GRIPPER) == []
    assert grasp_candidates(standing(Sphere(0.045)), GRIPPER) == []


def test_a_box_too_wide_one_way_is_taken_the_other_way() -> None:
    for candidate in grasp_candidates(standing(Box((0.1, 0.03, 0.03))), GRIPPER):
        assert abs(candidate.tcp_in_world.rotation()[1, 1]) == pytest.approx(1.0)


def test_a_lying_cylinder_is_closed_on_across_its_axis() -> None:
    pose = Pose.from_rpy((0.5, 0.0, 0.02), (0.0, math.pi / 2, 0.7))
    item = belief(Cylinder(0.02, 0.08), pose)
    axis = pose.rotation()[:, 2]
    candidates = grasp_candidates(item, GRIPPER)
    assert candidates
    assert all(abs(float(c.tcp_in_world.rotation()[:, 1] @ axis)) < 1e-6 for c in candidates)


def test_a_hull_is_closed_on_across_a_flat_side() -> None:
    ring = [(0.025 * math.cos(k * math.pi / 3), 0.025 * math.sin(k * math.pi / 3)) for k in range(6)]
    prism = ConvexMesh(tuple((x, y, z) for x, y in ring for z in (-0.02, 0.02)), "hexagon.obj")
    for candidate in grasp_candidates(standing(prism, 0.3), GRIPPER):
        assert candidate.expected_width == pytest.approx(0.025 * math.sqrt(3), abs=1e-4)


def test_candidates_have_unique_names_and_come_best_first() -> None:
    candidates = grasp_candidates(standing(Box((0.05, 0.03, 0.04))), GRIPPER)
    assert len({c.name for c in candidates}) == len(candidates)
    assert [c.score for c in candidates] == sorted(c.score for c in candidates)
    assert candidates[0].expected_width == pytest.approx(0.03)


def test_corners_enclose_a_cylinder() -> None:
    ring = corners(Cylinder(0.02, 0.08))[:, :2]
    assert np.linalg.norm(ring, axis=1).min() * math.cos(math.pi / 8) >= 0.02 - 1e-12
