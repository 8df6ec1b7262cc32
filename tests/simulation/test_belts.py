"""Belts in physics: items ride by friction, lie still when the belt does, go on alike from a checkpoint."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pybullet as pb
import pytest

from picktree.files import PicktreeError
from picktree.simulation.belt_feed import BELT_ACCELERATION
from picktree.simulation.checkpoints import Checkpoint
from picktree.simulation.physics import PhysicsHardware, belts
from picktree.world import Array, Box, ObjectId, Pose
from picktree.world.scene import Fixture

from .belt_cell import (
    BELT,
    ROLLING,
    TOP,
    UPRIGHT,
    belt_of,
    belt_scene,
    on_belt,
    positions,
    ride,
    wait,
)
from .simulated_cell import panda
from .test_simulation_sleeping import asleep

ALL = ("block", "can", "ball", "plate", "wedge", "can")
TURNS = (*[UPRIGHT] * 5, ROLLING)
ALONG = [-0.65 + 0.12 * k for k in range(6)]


def carried(speed: float, way: float = 0.25) -> Array:
    """How far each item has slipped on the belt, mm (6, 3)."""
    hardware = on_belt(belt_scene(*ALL, speed=speed), ALONG, TURNS)
    before = np.array(positions(hardware))
    ride(hardware, way)
    travelled = belt_of(hardware).travelled
    assert travelled == pytest.approx(way, abs=1e-3)
    return 1e3 * (np.array(positions(hardware)) - before - [0.0, travelled, 0.0])


def test_items_of_every_shape_ride_without_slipping() -> None:
    assert np.abs(carried(0.15)).max() < 0.2


def test_what_is_round_rolls_when_the_belt_starts_faster_than_rolling_friction_can(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("picktree.simulation.belt_feed.BELT_ACCELERATION", 3.0)
    slip = np.abs(carried(0.15)).max(axis=1)
    assert slip[[0, 1, 3]].max() < 0.3
    assert slip[5] > 1.0


def test_no_item_is_set_anywhere_nor_pushed_while_it_rides(monkeypatch: pytest.MonkeyPatch) -> None:
    hardware = on_belt(belt_scene("block", "can"), [-0.2, 0.0])
    set_back: list[int] = []
    setting: Callable[..., None] = pb.resetJointState

    def spy(body: int, *args: object, **options: object) -> None:
        set_back.append(body)
        setting(body, *args, **options)

    for name in ("resetBasePositionAndOrientation", "resetBaseVelocity", "applyExternalForce"):
        monkeypatch.setattr(pb, name, None)
    monkeypatch.setattr(pb, "resetJointState", spy)
    before = np.array(positions(hardware))
    ride(hardware, 0.1)
    assert np.array(positions(hardware)) - before == pytest.approx(np.array([[0.0, 0.1, 0.0]] * 2), abs=2e-3)
    # Each centimetre, and when it stands.
    assert len(set_back) == 11
    assert len(set(set_back)) == 1


def test_setting_the_slab_back_changes_nothing_for_the_items(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = carried(0.1)
    monkeypatch.setattr(belts, "SLAB_SET_BACK", 2.0)
    assert np.abs(carried(0.1) - usual).max() < 0.1


def test_a_belt_starts_and_stops_by_a_ramp_and_then_stands() -> None:
    hardware = on_belt(belt_scene("block", speed=0.1), [0.0])
    belt = belt_of(hardware)
    assert not belt.moving
    belt.go()
    speeds: list[float] = []
    for _ in range(240):
        hardware.step()
        speeds.append(hardware.truth()[0].velocity[1])
    # It slept in the first step.
    assert max(np.diff(speeds)[2:]) == pytest.approx(BELT_ACCELERATION / 240, rel=0.2)
    assert speeds[-1] == pytest.approx(0.1, abs=1e-4)
    start = belt.travelled
    belt.halt()
    wait(hardware, 0.5)
    assert not belt.moving
    assert belt.travelled - start == pytest.approx(0.1**2 / 2 / BELT_ACCELERATION, abs=3e-4)
    wait(hardware, 0.5)
    before = positions(hardware)
    wait(hardware, 1.0)
    assert positions(hardware) == before
    assert asleep(hardware) == [True]


def test_a_belt_that_starts_wakes_what_lies_on_it_and_nothing_on_it_sleeps() -> None:
    hardware = on_belt(belt_scene("block", "can"), [0.0, 0.2])
    wait(hardware, 1.0)
    assert asleep(hardware) == [True, True]
    before = np.array(positions(hardware))
    belt_of(hardware).go()
    for _ in range(12):
        hardware.step()
        # Nothing falls while the slab takes over.
        assert np.abs(np.array(positions(hardware)) - before)[:, 2].max() < 5e-5
    wait(hardware, 1.0)
    assert asleep(hardware) == [False, False]
    way = belt_of(hardware).travelled
    assert np.abs(np.array(positions(hardware)) - before - [0.0, way, 0.0]).max() < 2e-4


def test_what_stands_against_a_wall_does_not_sleep_while_the_belt_runs_below_it() -> None:
    scene = belt_scene("block")
    wall = Fixture(ObjectId("wall"), Box((0.2, 0.02, 0.1)), Pose((0.55, 0.3, TOP + 0.051)))
    hardware = on_belt(replace(scene, fixtures=(*scene.fixtures, wall)), [0.2])
    belt_of(hardware).go()
    for _ in range(12):
        wait(hardware, 0.25)
        assert asleep(hardware) == [False]
    assert positions(hardware)[0] == pytest.approx((0.55, 0.27, TOP + 0.02), abs=1e-3)


def test_what_comes_to_the_end_falls_to_the_floor() -> None:
    hardware = on_belt(belt_scene("block", "ball", length=0.8), [0.30, -0.20])
    ride(hardware, 0.25)
    wait(hardware, 0.6)
    block, ball = positions(hardware)
    assert block[2] < -0.7
    assert ball == pytest.approx((0.55, 0.05, TOP + 0.02), abs=1e-3)


def test_the_light_barrier_sees_even_a_plate() -> None:
    hardware = on_belt(belt_scene("plate", eye=0.3, speed=0.1), [0.2])
    belt = belt_of(hardware)
    assert not belt.interrupted()
    belt.go()
    while not belt.interrupted():
        assert belt.travelled < 0.2
        hardware.step()
    assert positions(hardware)[0][1] == pytest.approx(0.3 - 0.02, abs=2e-3)
    while belt.interrupted():
        assert belt.travelled < 0.3
        hardware.step()
    assert positions(hardware)[0][1] == pytest.approx(0.3 + 0.02, abs=2e-3)


def test_contacts_with_the_belt_bear_its_name_whether_it_runs_or_not() -> None:
    hardware = on_belt(belt_scene("block"), [0.0])
    touched = [{c.one, c.other} for c in hardware.true_contacts()]
    belt_of(hardware).go()
    wait(hardware, 0.5)
    touched += [{c.one, c.other} for c in hardware.true_contacts()]
    assert len(touched) == 8
    assert all(pair == {"item_00", BELT} for pair in touched)


def trace(hardware: PhysicsHardware, seconds: float) -> list[object]:
    found: list[object] = []
    for _ in range(round(seconds * 240)):
        hardware.step()
        found.append((hardware.truth(), belt_of(hardware).travelled))
    return found


def test_a_checkpoint_of_a_running_belt_goes_on_bit_for_bit() -> None:
    scene = belt_scene(*ALL)
    hardware = on_belt(scene, ALONG, TURNS)
    belt_of(hardware).go()
    wait(hardware, 0.7)
    saved = Checkpoint.from_plain(json.loads(json.dumps(hardware.checkpoint().to_plain())))
    resumed = PhysicsHardware.resume(scene, panda(), 0, saved)
    assert belt_of(resumed).moving
    assert trace(resumed, 0.7) == trace(hardware, 0.7)
    belt_of(hardware).halt()
    belt_of(resumed).halt()
    assert trace(resumed, 0.7) == trace(hardware, 0.7)
    assert not belt_of(resumed).moving


def test_a_checkpoint_of_other_belts_is_refused() -> None:
    hardware = on_belt(belt_scene("block"), [0.0])
    saved = replace(hardware.checkpoint(), belts=())
    with pytest.raises(PicktreeError) as error:
        hardware.restore(saved)
    assert str(error.value) == "the checkpoint's belts are [], but the scene has ['belt']"


def test_a_belt_that_is_turned_runs_along_its_own_x() -> None:
    hardware = on_belt(belt_scene("block"), [0.0])
    track = belt_of(hardware).track
    assert track.place((0.5, 0.3, 0.0)) == pytest.approx((0.3, 0.05), abs=1e-9)
    assert track.at(0.3, 0.05) == pytest.approx((0.5, 0.3, TOP), abs=1e-9)
    assert math.dist(*track.beam(0.0)) == pytest.approx(0.2)
    assert track.carries((0.5, 0.79, 1.0))
    assert not track.carries((0.5, 0.81, 1.0))
    assert not track.carries((0.44, 0.0, 1.0))
