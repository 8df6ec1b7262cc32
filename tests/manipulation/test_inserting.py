"""How a held object comes over its hole, and what of it goes first when it leans."""

from __future__ import annotations

import math

import numpy as np
import pytest

from picktree.robot.manipulation.insertion import (
    SEARCH_HEIGHT,
    InsertionTask,
    fit,
    inserted_pose,
    mouth,
    peg,
    poses_over,
)
from picktree.world import Box, Cylinder, Pose, Shape
from picktree.world.hole_geometry import tightest_hole
from picktree.world.scene import Fixture, load_scene

BOARD: Fixture = load_scene("pegs").fixture("board")
DOWEL, POST, KEY = Cylinder(0.015, 0.065), Box((0.030, 0.030, 0.065)), Box((0.014, 0.036, 0.060))
TIP = 0.0072


def held(shape: Shape, in_tcp: Pose) -> InsertionTask:
    hole = tightest_hole(BOARD.holes, shape)
    assert hole is not None
    return fit(BOARD, hole, shape, in_tcp)


def upright(yaw: float = 0.3, x: float = 0.001, z: float = 0.004, roll: float = math.pi) -> Pose:
    """In a TCP that points down, a little beside and below its middle."""
    return Pose.from_rpy((x, 0.0, z), (roll, 0.0, yaw))


@pytest.mark.parametrize(("shape", "turns"), [(DOWEL, 8), (POST, 4), (KEY, 2)])
@pytest.mark.parametrize("roll", [0.0, math.pi])
def test_the_object_stands_upright_over_the_mouth_at_each_turn_that_fits(
    shape: Shape, turns: int, roll: float
) -> None:
    plan = held(shape, upright(roll=roll))
    poses = poses_over(plan, SEARCH_HEIGHT)
    assert len({round(math.atan2(*p.rotation()[:2, 0]), 3) for p in poses}) == len(poses) == turns
    for tcp in poses:
        thing = plan.hole_in_world.inverse() @ tcp @ plan.object_in_tcp
        assert thing.position == pytest.approx((0.0, 0.0, SEARCH_HEIGHT + plan.height / 2), abs=1e-9)
        assert abs(thing.rotation()[2, 2]) == pytest.approx(1.0)
        if isinstance(shape, Box):
            size = np.abs(thing.rotation()) @ np.array(shape.size)
            assert (size[:2] < plan.hole.size).all()


def test_what_is_held_lying_does_not_stand_over_a_hole() -> None:
    lying = Pose.from_rpy((0.0, 0.0, 0.0), (math.pi / 2, 0.0, 0.0))
    assert poses_over(held(DOWEL, lying), SEARCH_HEIGHT) == ()


@pytest.mark.parametrize(
    ("shape", "reach"), [(DOWEL, 0.015), (POST, math.hypot(0.015, 0.015)), (KEY, math.hypot(0.007, 0.018))]
)
@pytest.mark.parametrize("roll", [0.0, math.pi])
def test_the_point_that_goes_first_is_on_the_rim_towards_a_finger(
    shape: Shape, reach: float, roll: float
) -> None:
    plan = held(shape, upright(roll=roll))
    tcp = poses_over(plan, SEARCH_HEIGHT)[0]
    thing = peg(plan, tcp)
    foot = plan.hole_in_world.inverse() @ tcp
    assert foot.apply(thing.foot) == pytest.approx((0.0, 0.0, SEARCH_HEIGHT), abs=1e-9)
    assert np.linalg.norm(thing.tip) == pytest.approx(reach)
    assert float(thing.tip @ thing.lean) > 0.7 * reach
    assert thing.lean[1] > 0.7 - 1e-9
    assert abs(float(thing.lean[2])) < 1e-9
    assert thing.round == isinstance(shape, Cylinder)


def test_what_is_known_of_the_hole() -> None:
    plan = held(DOWEL, upright())
    known = mouth(plan, 0.020, TIP)
    assert (plan.hole.id, known.depth, known.across) == ("board/round_31", 0.020, 0.031)
    # A corner of the square in which it may stand, what turning adds, and how it sits in the hand.
    arm = math.hypot(0.088, 0.045) * math.radians(2.0)
    assert known.slack == pytest.approx(math.sqrt(2.0) * 0.005 + arm + 0.0015)


def test_the_fingers_stay_above_the_board() -> None:
    low = held(DOWEL, upright(z=-0.010))
    tips_over_foot = -0.010 + 0.0325 - TIP
    assert mouth(low, 1.0, TIP).depth == pytest.approx(tips_over_foot - 0.0015)
    assert mouth(held(DOWEL, upright(z=0.010)), 1.0, TIP).depth == 0.030


def test_a_tight_hole_is_felt_for_with_a_finer_step() -> None:
    assert held(DOWEL, upright()).rate == 500
    hole = tightest_hole(BOARD.holes, DOWEL)
    assert hole is not None
    assert fit(BOARD, hole, Cylinder(0.01526, 0.065), upright()).rate == 1000


def test_what_was_let_go_stands_upright_on_the_bottom_where_it_was() -> None:
    plan = held(POST, upright())
    tcp = poses_over(plan, -0.025)[1].shifted((0.003, -0.002, 0.0))
    there = plan.hole_in_world.inverse() @ inserted_pose(plan, tcp)
    assert there.position == pytest.approx((0.003, -0.002, -0.030 + 0.0325), abs=1e-9)
    assert abs(there.rotation()[2, 2]) == pytest.approx(1.0)
