"""What the robot is not told of: in the scene from the beginning, or put into its way by a fault."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.simulation import FaultInjector, parse_faults, score
from picktree.simulation.checkpoints import Checkpoint, KinematicState
from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.physics import PhysicsHardware
from picktree.world import Box, Cylinder, ObjectId, Pose
from picktree.world.scene import Fixture, parse_scene

from .simulated_cell import cell, panda

POST = Fixture(ObjectId("post"), Box((0.06, 0.06, 0.3)), Pose((0.5, 0.35, 0.15)), "red")
FAULTS = """
picktree: 1
kind: faults
faults:
  - {fault: obstacle, when: {at: 100 ms}, name: post, stays: 0.2,
     body: {box: [6 cm, 6 cm, 30 cm], at: [0.5, 0.35, 0.15], yaw: 30 deg, colour: red}}
  - {fault: obstacle, when: {node: Grasp}, body: {sphere: {radius: 3 cm}, at: [0.306, 0, 0.55]}}
"""
Hardware = PhysicsHardware | KinematicHardware


def wait(hardware: Hardware, seconds: float) -> None:
    for _ in range(round(seconds * 240)):
        hardware.step()


@pytest.mark.parametrize("backend", [PhysicsHardware, KinematicHardware])
def test_it_stands_in_the_scene_is_seen_and_is_no_item(backend: type[Hardware]) -> None:
    scene = cell(unknown=(POST,))
    hardware = backend(scene, panda(), 1)
    assert [(str(o.id), o.role) for o in hardware.obstacles()] == [("post", "obstacle")]
    with_it = hardware.cameras["overhead"].capture().depth
    without = backend(cell(), panda(), 1).cameras["overhead"].capture().depth
    nearer = (without - with_it > 0.1) & (with_it > 0)
    assert nearer.sum() > 200
    assert all(body.role == "item" for body in hardware.truth())
    assert score(hardware.truth(), scene).count.total == len(hardware.truth())


def test_items_are_spawned_beside_it() -> None:
    wide = replace(POST, shape=Box((0.2, 0.2, 0.1)), pose=Pose((0.5, 0.0, 0.05)))
    hardware = KinematicHardware(cell(unknown=(wide,)), panda(), 1)
    away = [np.abs(np.array(body.pose.position[:2]) - (0.5, 0.0)).max() for body in hardware.truth()]
    assert min(away) > 0.1


def test_it_bears_what_comes_down_on_it() -> None:
    low = replace(POST, shape=Cylinder(0.05, 0.1), pose=Pose((0.5, 0.38, 0.05)))
    hardware = KinematicHardware(cell(), panda(), 1)
    name = hardware.put_obstacle(low)
    body = hardware.bodies.items[0]
    hardware.bodies.put(replace(body, pose=Pose((0.5, 0.38, 0.3))))
    hardware.bodies.drop(body.id)
    assert hardware.truth()[0].pose.position[2] == pytest.approx(0.12)
    hardware.take_obstacle(name)
    assert hardware.truth()[0].pose.position[2] == pytest.approx(0.02)


def test_the_arm_meets_it_in_the_physical_backend() -> None:
    hardware = PhysicsHardware(cell(), panda(), 1)
    tcp = np.array(hardware.true_tcp().position)
    ahead = Fixture(ObjectId("wall"), Box((0.02, 0.4, 0.4)), Pose((float(tcp[0]) + 0.1, 0.0, float(tcp[2]))))
    hardware.put_obstacle(ahead)
    target = hardware.arm.read().position + np.array([0.0, 0.5, 0.0, 0.3, 0.0, 0.0, 0.0])
    for _ in range(240):
        hardware.arm.follow(target, np.zeros(7))
        hardware.step()
    touched = {name for c in hardware.true_contacts() if c.force > 1.0 for name in (c.one, c.other)}
    assert "wall" in touched
    assert hardware.obstacles()[0].pose == ahead.pose


@pytest.mark.parametrize("backend", [PhysicsHardware, KinematicHardware])
def test_a_fault_puts_it_there_and_takes_it_away(backend: type[Hardware]) -> None:
    hardware = backend(cell(), panda(), 1)
    faults = FaultInjector(parse_faults(FAULTS, Path("faults.yaml")), hardware)
    assert faults.tick() == ()
    wait(hardware, 0.1)
    (happened,) = faults.tick()
    assert (happened.kind, happened.message) == ("fault", "post is put into the way")
    assert [str(o.id) for o in hardware.obstacles()] == ["post"]
    wait(hardware, 0.1)
    assert faults.tick() == ()
    wait(hardware, 0.1)
    assert [h.message for h in faults.tick()] == ["post is taken away"]
    assert hardware.obstacles() == ()
    wait(hardware, 0.3)
    assert faults.tick() == ()


def test_it_waits_until_the_arm_has_left_its_place() -> None:
    hardware = KinematicHardware(cell(), panda(), 1)
    faults = FaultInjector(parse_faults(FAULTS, Path("faults.yaml")), hardware)
    faults.node_started("Main/Grasp")
    assert [h.message for h in faults.tick()] == ["obstacle waits until nothing is in its place"]
    assert faults.tick() == ()
    aside = hardware.arm.read().position + np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    hardware.arm.set(aside, np.zeros(7))
    assert [h.message for h in faults.tick()] == ["obstacle is put into the way"]


def test_two_of_one_name_are_told_apart() -> None:
    hardware = KinematicHardware(cell(unknown=(POST,)), panda(), 1)
    other = replace(POST, pose=Pose((0.5, -0.35, 0.15)))
    assert str(hardware.put_obstacle(other)) == "post_2"
    hardware.take_obstacle(ObjectId("post"))
    assert [str(o.id) for o in hardware.obstacles()] == ["post_2"]


@pytest.mark.parametrize("backend", [PhysicsHardware, KinematicHardware])
def test_a_checkpoint_has_it_bit_for_bit(backend: type[Hardware]) -> None:
    scene = cell(unknown=(replace(POST, pose=Pose((0.5, -0.35, 0.15))),))
    hardware = backend(scene, panda(), 1)
    hardware.put_obstacle(POST)
    hardware.take_obstacle(ObjectId("post"))
    wait(hardware, 0.1)
    plain = hardware.checkpoint().to_plain()
    saved = Checkpoint if backend is PhysicsHardware else KinematicState
    resumed = backend.resume(scene, panda(), 1, saved.from_plain(plain))  # pyright: ignore[reportArgumentType]
    wait(hardware, 0.2)
    wait(resumed, 0.2)
    assert hardware.obstacles() == resumed.obstacles() and len(hardware.obstacles()) == 1
    assert hardware.truth() == resumed.truth()
    one, other = (h.cameras["overhead"].capture() for h in (hardware, resumed))
    assert np.array_equal(one.depth, other.depth) and np.array_equal(one.colour, other.colour)


def test_a_checkpoint_of_an_older_log_has_what_the_scene_has() -> None:
    hardware = KinematicHardware(cell(unknown=(POST,)), panda(), 1)
    plain = hardware.checkpoint().to_plain()
    del plain["obstacles"]
    resumed = KinematicHardware.resume(cell(unknown=(POST,)), panda(), 1, KinematicState.from_plain(plain))
    assert [str(o.id) for o in resumed.obstacles()] == ["post"]


def test_a_scene_file_names_it() -> None:
    text = """
picktree: 1
kind: scene
base: sort_small
unknown:
  post: {cylinder: {radius: 3 cm, height: 30 cm}, at: [0.5, 0.3, 0.15], colour: red}
"""
    (post,) = parse_scene(text, Path("scene.yaml")).unknown
    assert post == Fixture(ObjectId("post"), Cylinder(0.03, 0.3), Pose((0.5, 0.3, 0.15)), "red")


def test_what_is_wrong_with_it_is_said() -> None:
    scene = """
picktree: 1
kind: scene
base: sort_small
unknown:
  table: {box: [1, 1, 1], sphere: {radius: 1 cm}, at: [0, 0, 0]}
"""
    with pytest.raises(PicktreeError) as wrong:
        parse_scene(scene, Path("scene.yaml"))
    assert str(wrong.value) == (
        "scene.yaml:6:3: unknown.table: the name 'table' is taken by a fixture (give one of them "
        "another name)\n"
        "scene.yaml:6:3: unknown.table: 'box' and 'sphere' exclude each other (give one of them)"
    )
    faults = """
picktree: 1
kind: faults
faults:
  - {fault: obstacle, when: {at: 2 s}, target: {index: 2}}
  - {fault: remove, when: {at: 2 s}, stays: 2 s, target: {index: 1}}
"""
    with pytest.raises(PicktreeError) as wrong:
        parse_faults(faults, Path("faults.yaml"))
    assert str(wrong.value) == (
        "faults.yaml:5:5: faults[0]: 'obstacle' needs 'body'\n"
        "faults.yaml:5:40: faults[0].target: 'obstacle' takes no 'target'\n"
        "faults.yaml:6:38: faults[1].stays: 'remove' takes no 'stays'"
    )
