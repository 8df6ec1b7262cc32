"""Grip force: it follows from mass, friction and the greatest force that the item can withstand."""

from __future__ import annotations

from dataclasses import replace

import pytest

from picktree.robot.manipulation import opening_force
from picktree.robot.manipulation.grip_force import grip_force, required_force
from picktree.robot.planning import CARRYING_ACCELERATION
from picktree.world import Box
from picktree.world.robot_model import load_robot
from picktree.world.scene import CatalogueEntry

GRIPPER = load_robot("panda").gripper
BLOCK = CatalogueEntry("block", "box", Box((0.04, 0.04, 0.04)), 0.1, 0.6)
CUP = replace(BLOCK, kind="cup", mass=0.06, friction=0.5, force_limit=8.0)
INGOT = replace(BLOCK, kind="ingot", mass=1.2, friction=0.5)


def test_the_grip_grows_with_the_mass_and_falls_with_friction() -> None:
    assert required_force(0.5, 0.5) == pytest.approx(2.0 * 0.5 * (9.81 + CARRYING_ACCELERATION) / (2 * 0.5))
    assert required_force(1.0, 0.5) == pytest.approx(2 * required_force(0.5, 0.5))
    assert required_force(0.5, 0.25) == pytest.approx(2 * required_force(0.5, 0.5))
    assert grip_force(INGOT, 70.0, GRIPPER).grip == pytest.approx(required_force(1.2, 0.5))


def test_what_the_wrist_does_not_feel_is_gripped_gently() -> None:
    feather = replace(BLOCK, mass=0.003)
    assert grip_force(feather, 70.0, GRIPPER).grip == 3.0
    assert grip_force(replace(feather, mass=0.03), 70.0, GRIPPER).grip == 8.0
    assert grip_force(replace(feather, force_limit=5.0), 70.0, GRIPPER).grip == 2.0


def test_the_bound_is_kept() -> None:
    weak = grip_force(BLOCK, 1.5, GRIPPER)
    assert (weak.closing, weak.grip, weak.most) == (1.5, 1.5, 1.5)
    assert grip_force(INGOT, 500.0, GRIPPER).most == GRIPPER.max_force


def test_it_turns_out_to_weigh_more() -> None:
    press = grip_force(BLOCK, 70.0, GRIPPER)
    assert press.carrying(0.05) == press.grip
    assert press.carrying(1.0) == pytest.approx(required_force(1.0, 0.6))
    assert press.carrying(50.0) == press.most


@pytest.mark.parametrize("limit", [3.0, 5.0, 8.0, 20.0])
def test_a_finger_that_touches_alone_or_carries_sideways_stays_below_the_limit(limit: float) -> None:
    press = grip_force(replace(CUP, force_limit=limit), 70.0, GRIPPER)
    speed = GRIPPER.speed if press.speed is None else press.speed
    assert 2 * press.closing + 47 * speed < limit
    assert press.most < limit
    assert press.grip <= press.most


def test_what_rests_heavily_is_not_pushed_along() -> None:
    press = grip_force(INGOT, 70.0, GRIPPER)
    on_table = 0.5 * 1.2 * 9.81
    assert 2 * press.closing < on_table
    light = grip_force(BLOCK, 70.0, GRIPPER)
    assert light.closing == light.grip


def test_fingers_open_gently_beside_what_is_fragile() -> None:
    assert opening_force([BLOCK, INGOT]) == 20.0
    assert 2 * opening_force([BLOCK, CUP]) < 8.0


def test_what_is_unknown_is_gripped_firmly() -> None:
    press = grip_force(None, 70.0, GRIPPER)
    assert (press.closing, press.grip, press.most, press.speed) == (30.0, 30.0, 70.0, None)
