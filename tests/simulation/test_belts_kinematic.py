"""Belts without physics: what stands on one moves with it exactly, and falls off its end."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

from picktree.simulation.checkpoints import KinematicState
from picktree.simulation.kinematic import KinematicHardware
from picktree.world import Pose
from picktree.world.scene import SceneDescription

from .belt_cell import AT, TOP, belt_of, belt_scene, lying, positions, ride, wait
from .simulated_cell import panda


def on_belt(scene: SceneDescription, *along: float) -> KinematicHardware:
    """The scene with its items there."""
    hardware = KinematicHardware(scene, panda(), 0)
    for body, pose in zip(hardware.bodies.items, lying(scene, along), strict=True):
        hardware.bodies.put(replace(body, pose=pose))
    hardware.bodies.settle()
    return hardware


def test_items_ride_exactly_as_far_as_the_belt() -> None:
    hardware = on_belt(belt_scene("block", "can", "ball"), -0.3, 0.0, 0.2)
    ride(hardware, 0.25)
    way = belt_of(hardware).travelled
    assert way == pytest.approx(0.25, abs=1e-3)
    assert positions(hardware) == [
        pytest.approx((AT[0], along + way, TOP + up), abs=1e-9)
        for along, up in ((-0.3, 0.02), (0.0, 0.0375), (0.2, 0.02))
    ]


def test_what_stands_on_an_item_rides_with_it_and_what_is_beside_the_belt_stays() -> None:
    hardware = on_belt(belt_scene("block", "plate", "ball"), -0.3, 0.0, 0.2)
    block, plate, ball = hardware.bodies.items
    on_top = Pose((AT[0], -0.29, TOP + 0.044))
    hardware.bodies.put(replace(plate, pose=on_top))
    hardware.bodies.put(replace(ball, pose=Pose((0.9, 0.2, TOP + 0.02))))
    ride(hardware, 0.2)
    way = belt_of(hardware).travelled
    assert positions(hardware) == [
        pytest.approx(block.pose.shifted((0.0, way, 0.0)).position, abs=1e-9),
        pytest.approx(on_top.shifted((0.0, way, 0.0)).position, abs=1e-9),
        (0.9, 0.2, TOP + 0.02),
    ]


def test_what_comes_to_the_end_falls_to_the_floor() -> None:
    hardware = on_belt(belt_scene("block", "ball", length=0.8), 0.30, 0.0)
    ride(hardware, 0.11)
    block, ball = positions(hardware)
    assert block == pytest.approx((AT[0], 0.4 + math.hypot(0.02, 0.02) + 1e-3, -0.75 + 0.02), abs=1e-3)
    assert ball[2] == pytest.approx(TOP + 0.02)
    ride(hardware, 0.1)
    assert positions(hardware)[0] == block


def test_the_light_barrier_sees_the_item_as_it_is() -> None:
    hardware = on_belt(belt_scene("ball", eye=0.3), 0.2)
    belt = belt_of(hardware)
    belt.go()
    while not belt.interrupted():
        assert belt.travelled < 0.2
        hardware.step()
    # The chord of a ball 4 mm over the ground.
    half = math.sqrt(0.02**2 - 0.016**2)
    assert positions(hardware)[0][1] == pytest.approx(0.3 - half, abs=1e-3)


def test_a_checkpoint_of_a_running_belt_goes_on_the_same() -> None:
    scene = belt_scene("block", "can")
    hardware = on_belt(scene, -0.3, 0.0)
    belt_of(hardware).go()
    wait(hardware, 0.3)
    saved = KinematicState.from_plain(json.loads(json.dumps(hardware.checkpoint().to_plain())))
    resumed = KinematicHardware.resume(scene, panda(), 0, saved)
    for _ in range(240):
        hardware.step()
        resumed.step()
        assert resumed.truth() == hardware.truth()
    assert belt_of(resumed).state == belt_of(hardware).state
    assert belt_of(resumed).moving
