"""Grasps of bodies that are not convex, and of round ones with fine facets."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from picktree.robot.manipulation.object_grasps import leaning_object_grasps, object_grasps
from picktree.world import BeliefObject, CompoundMesh, ConvexMesh, ObjectId, Pose, bottom
from picktree.world.robot_model import load_robot

GRIPPER = load_robot("panda").gripper


def belief(shape: ConvexMesh, yaw: float = 0.3) -> BeliefObject:
    pose = Pose.from_rpy((0.5, 0.1, 0.0), (0.0, 0.0, yaw))
    pose = pose.shifted((0.0, 0.0, -bottom(shape, pose)))
    return BeliefObject("thing", "mesh", shape, "red", pose, 0.001, 0.01, 1.0, 0.0, id=ObjectId("it"))


def prism(radius: float, height: float, sides: int) -> tuple[tuple[float, float, float], ...]:
    angles = [2 * math.pi * k / sides for k in range(sides)]
    return tuple(
        (radius * math.cos(a), radius * math.sin(a), z) for a in angles for z in (-height / 2, height / 2)
    )


@cache
def tube(inner: float, outer: float, height: float, sides: int = 16) -> CompoundMesh:
    """Return a tube that stands upright, in wedges."""
    parts: list[tuple[tuple[float, float, float], ...]] = []
    for k in range(sides):
        ends = [2 * math.pi * n / sides for n in (k, k + 1)]
        parts.append(
            tuple(
                (r * math.cos(a), r * math.sin(a), z)
                for r in (inner, outer)
                for a in ends
                for z in (-height / 2, height / 2)
            )
        )
    return CompoundMesh(prism(outer, height, sides), "tube.stl", tuple(parts))


def test_a_ring_that_is_wider_than_the_opening_is_taken_by_its_wall() -> None:
    found = object_grasps(belief(tube(0.032, 0.044, 0.02)), GRIPPER)
    assert found
    for grasp in found:
        x, y, _ = grasp.tcp_in_world.position
        radial = np.array([x - 0.5, y - 0.1])
        assert float(np.linalg.norm(radial)) == pytest.approx(0.038, abs=0.003)
        assert 0.011 < grasp.expected_width < 0.018
        # The fingers close along the radius, one of them in the hole.
        closing = grasp.tcp_in_world.rotation()[:2, 1]
        assert abs(float(closing @ radial)) / float(np.linalg.norm(radial)) > math.cos(math.radians(25.0))


def test_a_ring_that_fits_between_the_fingers_is_taken_across() -> None:
    best = object_grasps(belief(tube(0.014, 0.022, 0.018)), GRIPPER)[0]
    assert best.expected_width == pytest.approx(0.044, abs=1e-3)
    assert best.tcp_in_world.position[:2] == pytest.approx((0.5, 0.1), abs=1e-3)


def test_a_bracket_is_taken_by_the_leg_that_stands() -> None:
    plate = tuple((x, y, z) for x in (-0.05, 0.05) for y in (-0.05, 0.05) for z in (-0.02, -0.012))
    leg = tuple((x, y, z) for x in (-0.004, 0.004) for y in (-0.02, 0.02) for z in (-0.012, 0.03))
    body = CompoundMesh(tuple({*plate, *leg}), "bracket.stl", (plate, leg))
    item = belief(body)
    found = object_grasps(item, GRIPPER)
    assert found
    for grasp in found:
        closing = item.pose.rotation().T @ grasp.tcp_in_world.rotation()[:, 1]
        assert (abs(float(closing[0])) > 0.9 and grasp.expected_width < 0.02) or (
            abs(float(closing[1])) > 0.9 and grasp.expected_width == pytest.approx(0.04, abs=5e-3)
        )


def test_a_cup_is_also_taken_by_a_hand_that_leans() -> None:
    assert all(grasp.tilted for grasp in leaning_object_grasps(belief(tube(0.025, 0.03, 0.07)), GRIPPER))


@pytest.mark.parametrize("sides", [61, 128])
def test_a_disc_of_fine_facets_is_taken_from_all_around(sides: int) -> None:
    found = object_grasps(belief(ConvexMesh(prism(0.019, 0.02, sides), "disc.stl")), GRIPPER)
    assert len(found) >= 16
    assert all(grasp.expected_width == pytest.approx(0.038, abs=1e-3) for grasp in found)


def test_a_chamfer_of_a_block_is_no_place_for_a_pad() -> None:
    half, cut = 0.02, 0.003
    outline = [
        (sx * x, sy * y)
        for sx in (-1, 1)
        for sy in (-1, 1)
        for x, y in ((half, half - cut), (half - cut, half))
    ]
    block = ConvexMesh(tuple((x, y, z) for x, y in outline for z in (-0.02, 0.02)), "block.stl")
    for grasp in object_grasps(belief(block, yaw=0.0), GRIPPER):
        assert grasp.expected_width == pytest.approx(0.04)
