"""<dynamics> of a URDF: neither simulation nor controller has the damping and friction of joints."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pybullet as pb
import pytest

from picktree.simulation.physics import Client, RobotBody
from picktree.simulation.physics.engine import reset
from picktree.world import Array, GripperCommand
from picktree.world.robot_model import RobotDescription, RobotModel, load_robot

PERIOD = 1 / 240


@cache
def iiwa() -> RobotDescription:
    return load_robot("iiwa")


def with_dynamics(folder: Path, damping: str, friction: str) -> RobotDescription:
    """The iiwa with that damping and friction at each joint, fingers included."""
    root = ElementTree.parse(iiwa().urdf).getroot()
    for joint in root.findall("joint"):
        for old in joint.findall("dynamics"):
            joint.remove(old)
        ElementTree.SubElement(joint, "dynamics", damping=damping, friction=friction)
    path = folder / "iiwa.urdf"
    path.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
    return replace(iiwa(), urdf=str(path))


def loaded(robot: RobotDescription) -> tuple[RobotBody, Client]:
    client = Client()
    reset(client.id)
    body = RobotBody(robot, client, PERIOD)
    body.load()
    return body, client


def step(body: RobotBody, client: Client, count: int = 1) -> None:
    for _ in range(count):
        body.before_step()
        pb.stepSimulation(client.id)


def unexplained(robot: RobotDescription, joint: int, speed: float) -> Array:
    """Effort of each joint beyond the model's while one joint turns at a constant speed, Nm."""
    body, client = loaded(robot)
    model = RobotModel(robot)
    q, v = model.named("home"), np.zeros(model.n)
    for k in range(60):
        v[joint] = speed * min(1.0, k / 30)
        q = q + v * PERIOD
        body.follow(tuple(q.tolist()), tuple(v.tolist()))
        step(body, client)
    reading = body.read()
    at, rate, effort = (
        np.array(row[: model.n]) for row in (reading.position, reading.velocity, reading.effort)
    )
    assert rate[joint] == pytest.approx(speed, abs=1e-3)
    return effort - model.inverse_dynamics(at, rate, np.zeros(model.n))


@pytest.mark.parametrize(("damping", "friction"), [("0.5", "0"), ("10", "1"), ("1000", "100")])
@pytest.mark.parametrize("joint", [0, 3, 6])
def test_a_joint_that_turns_exerts_what_the_model_says(
    tmp_path: Path, damping: str, friction: str, joint: int
) -> None:
    left = unexplained(with_dynamics(tmp_path, damping, friction), joint, 1.0)
    assert np.abs(left).max() < 0.2


def test_the_xarm6_exerts_what_the_model_says() -> None:
    """Its URDF has a damping of 1 Nms/rad and a friction of 1 Nm."""
    assert np.abs(unexplained(load_robot("xarm6"), 5, 1.0)).max() < 0.1


@pytest.mark.parametrize("damping", ["10", "1000"])
def test_a_light_joint_without_drive_keeps_its_speed(tmp_path: Path, damping: str) -> None:
    robot = with_dynamics(tmp_path, damping, "1")
    body, client = loaded(robot)
    model = RobotModel(robot)
    fingers = body.fingers.positions(0.04)
    step(body, client)
    q, v = model.named("home"), np.zeros(model.n)
    v[6] = 1.0
    body.place((*q.tolist(), *fingers), (*v.tolist(), *(0.0 for _ in fingers)))
    for _ in range(24):
        reading = body.read()
        at, rate = np.array(reading.position[: model.n]), np.array(reading.velocity[: model.n])
        body.apply_torque(tuple(model.bias(at, rate).tolist()))
        step(body, client)
    assert body.read().velocity[6] == pytest.approx(1.0, abs=0.02)


def test_fingers_close_as_fast_and_press_as_hard(tmp_path: Path) -> None:
    widths: list[list[float]] = []
    for robot in (iiwa(), with_dynamics(tmp_path, "5000", "50")):
        body, client = loaded(robot)
        step(body, client, 60)
        body.drive_fingers(GripperCommand(0.0, 20.0))
        course: list[float] = []
        n = len(robot.joints)
        for _ in range(12):
            step(body, client, 10)
            course.append(body.fingers.width(body.read().position[n:]))
        widths.append(course)
    assert widths[0] == pytest.approx(widths[1], abs=1e-4)
    assert widths[0][-1] < 0.5 * widths[0][0]
