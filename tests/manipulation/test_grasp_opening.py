"""Fingers open wide beside an object where there is room; elsewhere the hand comes down slowly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from picktree.robot import World
from picktree.robot.manipulation import grasp_candidates
from picktree.robot.manipulation.candidate_search import CandidateSearch
from picktree.robot.manipulation.grasps import OUTER_ROOM, WIDE_EXCESSES, widened
from picktree.robot.manipulation.pick_candidates import PickPlaceCandidate
from picktree.robot.manipulation.pick_place_motions import MAX_TOP_ERROR
from picktree.world import Array, BeliefObject, Trajectory
from picktree.world.robot_model.description import Linkage

from .test_candidates import BLOCK, answer, believed, world_with

HEIGHT = 0.04


def block(name: str, y: float, width: float) -> BeliefObject:
    return believed(name, (0.5, y, HEIGHT / 2), size=width)


def approached(width: float, *, gently: bool = False) -> tuple[World, PickPlaceCandidate, Array, Array]:
    """How a block of that width is approached: heights of the finger tips, m, and speeds of the TCP, m/s."""
    world = world_with(block(BLOCK, 0.0, width))
    belief = world.scene.get(BLOCK)
    ranked = grasp_candidates(belief, world.robot.description.gripper)
    pick = answer(CandidateSearch(world, belief, ranked, "Grasp").find(gently=gently))
    assert pick is not None
    return world, pick, *tool_motion(world, pick.approach.trajectory)


def tool_motion(world: World, trajectory: Trajectory) -> tuple[Array, Array]:
    """Heights of the finger tips (m,), m, and speeds of the TCP (m,), m/s."""
    tip = world.robot.description.gripper.tip
    tips = [world.robot.tcp(q).position[2] - tip for q in trajectory.position]
    pairs = zip(trajectory.position, trajectory.velocity, strict=True)
    speeds = [float(np.linalg.norm((world.robot.jacobian(q) @ v)[:3])) for q, v in pairs]
    return np.array(tips), np.array(speeds)


@pytest.mark.parametrize(("gap", "excess"), [(0.060, 0.036), (0.052, 0.028), (0.042, 0.020)])
def test_fingers_open_as_wide_as_their_neighbours_leave_room(gap: float, excess: float) -> None:
    width = 0.04
    world = world_with(block(BLOCK, 0.0, width), block("beside", width + gap, width))
    gripper = world.robot.description.gripper
    grasp = next(
        candidate
        for candidate in grasp_candidates(world.scene.get(BLOCK), gripper)
        if abs(candidate.tcp_in_world.rotation()[1, 1]) > 0.99
    )
    opened = widened(world.queries, world.scene.get(BLOCK), grasp, gripper)
    assert opened.opening - width == pytest.approx(excess)
    assert opened.narrow is (excess < min(WIDE_EXCESSES))
    near = world.queries.hand_contacts(opened.tcp_in_world, opened.opening, (BLOCK,), grasp.margin)
    assert not near
    if not opened.narrow:
        outside = opened.opening + 2 * OUTER_ROOM
        assert not world.queries.hand_contacts(opened.tcp_in_world, outside, (BLOCK,), grasp.margin)


@pytest.mark.parametrize(("reach", "excess"), [(0.010, 0.036), (0.003, 0.020)])
def test_tips_of_hinged_fingers_stay_ahead_of_the_tcp_beside_a_flat_object(
    reach: float, excess: float
) -> None:
    world, width = world_with(block(BLOCK, 0.0, 0.03)), 0.03
    plain = world.robot.description.gripper
    linkage = Linkage("k1", (), ("k1", "k2"), (0.0, 0.8), (0.0, 0.058), (0.02, reach))
    hinged = replace(plain, linkage=linkage)
    grasp = replace(grasp_candidates(world.scene.get(BLOCK), plain)[0], flat=True)
    opened = widened(world.queries, world.scene.get(BLOCK), grasp, hinged)
    assert opened.opening - width == pytest.approx(excess)
    tall = widened(world.queries, world.scene.get(BLOCK), replace(grasp, flat=False), hinged)
    assert tall.opening - width == pytest.approx(0.036)


@pytest.mark.parametrize(("width", "narrow"), [(0.04, False), (0.058, True)])
def test_the_hand_slows_down_above_an_object_that_its_fingers_might_meet(
    width: float, *, narrow: bool
) -> None:
    world, pick, tips, speeds = approached(width)
    assert pick.grasp.narrow is narrow
    near = speeds[tips < HEIGHT + MAX_TOP_ERROR - 1e-4]
    if narrow:
        assert near.max() < 1.05 * world.handling.touch_speed
    else:
        assert near.max() > 0.15
    assert speeds[tips > HEIGHT + 0.03].max() > 0.15


def test_after_a_slip_all_of_the_way_down_is_slow() -> None:
    world, _, tips, speeds = approached(0.04, gently=True)
    assert speeds[tips < HEIGHT + 0.02].max() < 1.05 * world.handling.touch_speed
