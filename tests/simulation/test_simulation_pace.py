"""A change of the simulation's step changes nothing of what the motors do."""

from __future__ import annotations

import math

import numpy as np
import pytest

from picktree.simulation.physics import PhysicsHardware
from picktree.world.robot_model import load_robot
from picktree.world.scene import load_scene

SCENE, ROBOT = load_scene("sort_small"), load_robot("panda")


@pytest.mark.parametrize("rates", [(1000, None), (None, 1000)])
def test_an_arm_that_is_held_stays_where_it_is(rates: tuple[int | None, int | None]) -> None:
    hardware = PhysicsHardware(SCENE, ROBOT, 1)
    before, after = rates
    hardware.pace(before)
    # Stretched out, where gravity pulls most.
    out = np.array([0.0, 0.4, 0.0, -1.6, 0.0, 2.0, 0.785])
    now = hardware.arm.read().position
    for share in (*np.linspace(0.0, 1.0, 600), *np.ones(240)):
        hardware.arm.follow(now + share * (out - now), np.zeros(7))
        hardware.step()
    hardware.pace(after)
    for _ in range(120):
        hardware.arm.follow(out, np.zeros(7))
        hardware.step()
    assert np.abs(hardware.arm.read().position - out).max() < math.radians(0.1)
