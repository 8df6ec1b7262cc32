"""`marker:`, `tool_error:` and `calibration:` in scene files, and what robot and simulation make of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from picktree.files import FileError
from picktree.session import assemble_world
from picktree.simulation import build_hardware
from picktree.simulation.kinematic import KinematicHardware
from picktree.world import Pose
from picktree.world.robot_model import RobotModel, load_robot
from picktree.world.scene import SceneDescription, parse_scene

HEAD = """\
picktree: 1
kind: scene
robot: panda
fixtures:
  table: {box: [1.2, 1.6, 0.04], at: [0.5, 0, -0.02], colour: light_grey}
  target: {marker: [180 mm, 160 mm, 50 mm], at: [0.5, 0, 0.025], uncertainty: {position: 5 mm}}
cameras:
  overhead: {at: [0.5, 0, 0.8], look_at: [0.5, 0, 0], error: [8 mm, 0, 0]}
  wrist: {on: hand, at: [70 mm, 0, -60 mm], look_at: [0, 0, 70 mm], error: [0, 5 mm, 0]}
"""
CALIBRATED = """\
tool_error: [1 mm, 2 mm, 3 mm]
calibration:
  cameras:
    overhead: {at: [0.5, -0.008, 0.8], rpy: [180 deg, 0, -90 deg]}
    wrist: {at: [70 mm, 0, -60 mm], rpy: [0, 0, 90 deg]}
  tcp: {offset: [1 mm, 2 mm, 2.5 mm]}
  date: 2026-01-02 10:00
  by: somebody
"""


def read(text: str) -> SceneDescription:
    return parse_scene(text, Path("scene.yaml"))


def test_a_target_is_a_block_with_six_squares_on_its_top() -> None:
    target = read(HEAD).fixture("target")
    assert [tile.colour for tile in target.tiles] == ["red", "yellow", "blue", "purple", "green", "cyan"]
    assert target.uncertainty.position == 0.005
    edges = np.concatenate([tile.corners() for tile in target.tiles])
    assert (np.abs(edges[:, :2]) < (0.085, 0.075)).all()
    assert np.allclose(edges[:, 2], 0.025, atol=1e-4)


def test_a_calibration_moves_what_is_believed_and_not_what_is_true() -> None:
    stated, found = read(HEAD), read(HEAD + CALIBRATED)
    for before, after in zip(stated.cameras, found.cameras, strict=True):
        truly, still = before.pose @ before.error, after.pose @ after.error
        assert truly.distance(still) < 1e-12
        assert truly.angle(still) < 1e-7
    assert found.cameras[0].pose.position == (0.5, -0.008, 0.8)
    assert stated.tool == Pose()
    assert found.tool.position == (0.001, 0.002, 0.0025)
    assert found.calibration is not None
    assert (found.calibration.by, found.calibration.date) == ("somebody", "2026-01-02 10:00")


@pytest.mark.parametrize("name", ["panda", "xarm6", "iiwa"])
def test_a_tool_that_is_off_moves_the_whole_hand(name: str) -> None:
    robot = load_robot(name)
    off = Pose.from_rpy((0.003, -0.002, 0.004), (0.02, -0.01, 0.03))
    stated, moved = RobotModel(robot), RobotModel(replace(robot, tool=off))
    q = stated.named("home") + 0.1
    found = stated.tcp(q).inverse() @ moved.tcp(q)
    assert found.distance(off) < 1e-9
    assert found.angle(off) < 1e-7
    for link in (robot.tcp_link, *robot.gripper.fingers):
        one = stated.tcp(q).inverse() @ stated.link_poses(q, 0.02)[link]
        other = moved.tcp(q).inverse() @ moved.link_poses(q, 0.02)[link]
        assert one.distance(other) < 1e-9
    upstream = stated.link_poses(q, 0.02)
    assert upstream[next(iter(upstream))] == moved.link_poses(q, 0.02)[next(iter(upstream))]


def test_belief_has_the_calibrated_tool_and_the_simulation_the_true_one() -> None:
    scene, robot = read(HEAD + CALIBRATED), load_robot("panda")
    hardware = build_hardware("kinematic", scene, robot, 0)
    assert isinstance(hardware, KinematicHardware)
    world = assemble_world(hardware, scene, robot, 0)
    off = world.control.tcp.inverse() @ hardware.true_tcp()
    assert np.allclose(off.position, (0.0, 0.0, 0.0005), atol=1e-9)
    image = hardware.cameras["wrist"].capture()
    assert image.camera_in_world.distance(world.control.tcp @ scene.cameras[1].pose) < 1e-9


def test_physics_mounts_the_hand_where_it_truly_is() -> None:
    scene, robot = read(HEAD + CALIBRATED), load_robot("panda")
    hardware = build_hardware("physics", scene, robot, 0)
    stated = RobotModel(robot).tcp(hardware.arm.read().position)
    off = stated.inverse() @ hardware.true_tcp()  # pyright: ignore[reportAttributeAccessIssue] - physics has it
    assert np.allclose(off.position, (0.001, 0.002, 0.003), atol=2e-5)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (
            HEAD.replace("180 mm, 160 mm, 50 mm", "40 mm, 30 mm, 10 mm"),
            "scene.yaml:6:20: fixtures.target.marker: a target this small cannot be seen and touched well "
            "enough (at least [60 mm, 40 mm, 20 mm])",
        ),
        (
            HEAD + CALIBRATED.replace("    wrist:", "    wirst:"),
            "scene.yaml:14:5: calibration.cameras.wirst: there is no camera 'wirst' (did you mean 'wrist'?)",
        ),
    ],
)
def test_faults(text: str, fault: str) -> None:
    with pytest.raises(FileError) as caught:
        read(text)
    assert str(caught.value) == fault
