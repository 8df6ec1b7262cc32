"""Items at rest sleep, and nothing that would move them is missed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from picktree.simulation.physics import PhysicsHardware
from picktree.world import Box, Cylinder, GripperCommand, Pose, Quaternion, Shape, Sphere, Vector3, vector3
from picktree.world.robot_model import RobotModel
from picktree.world.scene import CatalogueEntry, Form, SceneDescription, Spawn

from .simulated_cell import cell, panda
from .test_simulation_physics import SILENT, down_at, go, held_block, lifted

CUBE = Box((0.04, 0.04, 0.04))


def scene_of(*shapes: Shape, friction: float = 0.6) -> SceneDescription:
    forms: dict[type[Shape], Form] = {Box: "box", Cylinder: "cylinder", Sphere: "sphere"}
    catalogue = tuple(
        CatalogueEntry(f"kind{n}", forms[type(shape)], shape, 0.1, friction) for n, shape in enumerate(shapes)
    )
    spawn = Spawn({entry.kind: 1 for entry in catalogue}, ("red",), ((0.35, -0.25), (0.65, 0.25)))
    return cell(catalogue=catalogue, spawn=(spawn,), noise=SILENT)


def standing(
    scene: SceneDescription, *poses: Pose, velocities: dict[int, Vector3] | None = None
) -> PhysicsHardware:
    """The scene with its items, all awake, at these poses."""
    hardware = PhysicsHardware(scene, panda(), 0)
    saved, still = hardware.checkpoint(), (0.0, 0.0, 0.0)
    items = tuple(
        replace(
            item,
            position=pose.position,
            orientation=pose.orientation,
            velocity=speed,
            spin=still,
            asleep=False,
        )
        for item, pose, speed in zip(
            saved.items, poses, ((velocities or {}).get(n, still) for n in range(len(poses))), strict=True
        )
    )
    hardware.restore(replace(saved, items=items))
    return hardware


def wait(hardware: PhysicsHardware, seconds: float) -> None:
    for _ in range(round(seconds * 240)):
        hardware.step()


def asleep(hardware: PhysicsHardware) -> list[bool]:
    return [item.asleep for item in hardware.checkpoint().items]


def height(hardware: PhysicsHardware, number: int) -> float:
    return hardware.truth()[number].pose.position[2]


def tower() -> PhysicsHardware:
    """A cube on a cube, both asleep."""
    hardware = standing(scene_of(CUBE, CUBE), Pose((0.5, 0.0, 0.02)), Pose((0.5, 0.0, 0.06)))
    wait(hardware, 1.0)
    assert asleep(hardware) == [True, True]
    return hardware


@pytest.mark.parametrize("seed", range(2))
def test_everything_sleeps_at_time_zero_and_sleeps_on(seed: int):
    hardware = PhysicsHardware(cell(), panda(), seed)
    before = hardware.truth()
    assert all(asleep(hardware))
    wait(hardware, 2.0)
    assert all(asleep(hardware))
    for one, other in zip(before, hardware.truth(), strict=True):
        assert one.pose.distance(other.pose) < 1e-4


def test_what_stands_on_something_that_is_taken_away_falls():
    hardware = tower()
    hardware.remove("item_00")
    wait(hardware, 0.5)
    assert height(hardware, 1) == pytest.approx(0.02, abs=1e-3)


def test_what_stands_on_something_that_is_knocked_away_falls():
    hardware = tower()
    hardware.bump("item_00", (1.5, 0.0, 0.0))
    wait(hardware, 1.0)
    assert height(hardware, 1) < 0.03
    assert asleep(hardware) == [True, True]


def test_what_stands_on_something_that_the_gripper_pushes_away_falls():
    scene = scene_of(CUBE, Box((0.04, 0.04, 0.01)))
    hardware = standing(scene, Pose((0.5, 0.0, 0.02)), Pose((0.515, 0.0, 0.045)))
    model = RobotModel(hardware.robot)
    hardware.gripper.command(GripperCommand(0.0, 20.0))
    go(hardware, down_at(model, (0.42, 0.0, 0.3), 0.0), 1.0)
    assert asleep(hardware) == [True, True]
    go(hardware, down_at(model, (0.42, 0.0, 0.015), 0.0), 1.0)
    assert height(hardware, 1) == pytest.approx(0.045, abs=1e-3)
    go(hardware, down_at(model, (0.55, 0.0, 0.015), 0.0), 0.15)
    go(hardware, down_at(model, (0.40, 0.0, 0.3), 0.0), 1.0)
    wait(hardware, 1.0)
    lower, upper = (body.pose.position for body in hardware.truth())
    assert lower[0] > 0.56
    assert upper[2] == pytest.approx(0.005, abs=1e-3)


def test_a_sleeping_item_is_pushed_as_slowly_as_the_gripper_moves():
    hardware = standing(scene_of(CUBE), Pose((0.5, 0.0, 0.02)))
    model = RobotModel(hardware.robot)
    hardware.gripper.command(GripperCommand(0.0, 20.0))
    go(hardware, down_at(model, (0.44, 0.0, 0.2), 0.0), 1.0)
    go(hardware, down_at(model, (0.44, 0.0, 0.015), 0.0), 1.0)
    wait(hardware, 0.5)
    assert hardware.truth()[0].pose.position[0] == pytest.approx(0.5, abs=1e-4)
    go(hardware, down_at(model, (0.475, 0.0, 0.015), 0.0), 1.0)
    start = hardware.truth()[0].pose.position[0]
    go(hardware, down_at(model, (0.485, 0.0, 0.015), 0.0), 3.0)
    assert hardware.truth()[0].pose.position[0] - start == pytest.approx(0.01, abs=5e-4)


def test_a_falling_item_wakes_the_one_that_it_hits():
    hardware = standing(scene_of(Sphere(0.02), CUBE), Pose((0.5, 0.0, 0.02)), Pose((0.7, 0.0, 0.02)))
    wait(hardware, 1.0)
    saved = hardware.checkpoint()
    assert saved.items[0].asleep
    above = replace(saved.items[1], position=(0.513, 0.0, 0.2), asleep=False)
    hardware.restore(replace(saved, items=(saved.items[0], above)))
    wait(hardware, 1.0)
    assert abs(hardware.truth()[0].pose.position[0] - 0.5) > 0.005
    assert height(hardware, 1) == pytest.approx(0.02, abs=1e-3)


def test_a_bump_sets_a_sleeping_item_in_motion():
    hardware = standing(scene_of(Sphere(0.02)), Pose((0.5, 0.0, 0.02)))
    wait(hardware, 1.0)
    assert asleep(hardware) == [True]
    hardware.bump("item_00", (0.2, 0.0, 0.0), (0.0, 10.0, 0.0))
    assert hardware.truth()[0].velocity == (0.2, 0.0, 0.0)
    wait(hardware, 0.5)
    assert hardware.truth()[0].pose.position[0] > 0.54


def test_a_bump_that_no_step_has_followed_yet_is_in_the_checkpoint():
    hardware = standing(scene_of(Sphere(0.02)), Pose((0.5, 0.0, 0.02)))
    wait(hardware, 1.0)
    hardware.bump("item_00", (0.2, 0.0, 0.0), (0.0, 10.0, 0.0))
    again = PhysicsHardware.resume(hardware.scene, panda(), 0, hardware.checkpoint())
    for each in (hardware, again):
        wait(each, 0.5)
    assert hardware.truth() == again.truth()
    assert hardware.truth()[0].pose.position[0] > 0.54


@pytest.mark.parametrize("speed", [0.001, 0.1])
def test_what_slides_slowly_is_not_frozen(speed: float):
    ice = scene_of(CUBE, friction=0.0)
    hardware = standing(ice, Pose((0.5, 0.0, 0.02)), velocities={0: (speed, 0.0, 0.0)})
    wait(hardware, 3.0)
    assert hardware.truth()[0].pose.position[0] - 0.5 == pytest.approx(3.0 * speed, rel=0.1)


def test_a_heap_in_a_bin_comes_to_sleep_though_its_items_tremble():
    random = np.random.default_rng(0)
    heap = [
        Pose.from_rpy(
            (0.35 + random.uniform(-0.02, 0.02), 0.55 + random.uniform(-0.02, 0.02), 0.05 + 0.06 * k),
            vector3(random.uniform(-3.0, 3.0, 3)),
        )
        for k in range(16)
    ]
    hardware = standing(scene_of(*[CUBE] * 16), *heap)
    wait(hardware, 6.0)
    assert all(state.asleep for state in hardware.snapshot().items)


@pytest.mark.parametrize("off", [1e-5, 1e-2])
def test_what_stands_off_balance_falls(off: float):
    wide, tall = 0.03, 0.06
    tilt = math.atan2(wide, tall) + off
    lean: Quaternion = (0.0, math.sin(tilt / 2), 0.0, math.cos(tilt / 2))
    z = math.cos(tilt) * tall / 2 + math.sin(tilt) * wide / 2
    hardware = standing(scene_of(Box((wide, wide, tall))), Pose((0.5, 0.0, z), lean))
    wait(hardware, 3.0)
    assert height(hardware, 0) == pytest.approx(wide / 2, abs=1e-3)


def test_a_lying_cylinder_stays_and_sleeps():
    side: Quaternion = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    hardware = standing(scene_of(Cylinder(0.02, 0.08)), Pose((0.5, 0.0, 0.02), side))
    wait(hardware, 10.0)
    assert hardware.truth()[0].pose.distance(Pose((0.5, 0.0, 0.02), side)) < 1e-3
    assert asleep(hardware) == [True]


def test_what_is_held_for_long_does_not_sleep_and_weighs_what_it_weighs():
    hardware = PhysicsHardware(held_block(0.2, 0.6), panda(), 0)
    empty = hardware.wrench.read().force[2]
    assert lifted(hardware, 30.0) > 0.1
    loads: list[float] = []
    for _ in range(1200):
        hardware.step()
        loads.append(empty - hardware.wrench.read().force[2])
    assert asleep(hardware) == [False]
    assert np.mean(loads[240:]) == pytest.approx(0.2 * 9.81, abs=0.01)
    assert np.abs(np.array(loads[240:]) - 0.2 * 9.81).max() < 0.1
    hardware.gripper.command(GripperCommand(0.08, 30.0))
    wait(hardware, 0.5)
    assert hardware.truth()[0].pose.position[2] == pytest.approx(0.02, abs=1e-3)


def test_what_is_held_falls_when_it_becomes_slippery():
    hardware = PhysicsHardware(held_block(0.2, 0.6), panda(), 0)
    assert lifted(hardware, 20.0) > 0.1
    wait(hardware, 3.0)
    hardware.change_dynamics("item_00", friction=0.02)
    wait(hardware, 0.5)
    assert height(hardware, 0) < 0.03


def test_sleep_is_part_of_the_checkpoint():
    hardware = PhysicsHardware(cell(), panda(), 4)
    hardware.bump("item_06", (0.3, 0.1, 0.0))
    wait(hardware, 0.5)
    saved = hardware.checkpoint()
    assert 0 < sum(item.asleep for item in saved.items) < len(saved.items)
    again = PhysicsHardware.resume(cell(), panda(), 4, saved)
    for _ in range(480):
        hardware.step()
        again.step()
    assert hardware.truth() == again.truth()
    assert hardware.checkpoint() == again.checkpoint()
