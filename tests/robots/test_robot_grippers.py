"""Grippers on knuckles and grippers of another URDF: what the robot file says, and what becomes of it."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio as pin
import pybullet as pb
import pytest
import trimesh

from picktree.apps.commissioning import ProposalRequest, propose
from picktree.files import FileError
from picktree.simulation.physics import Client, RobotBody
from picktree.simulation.physics.engine import reset
from picktree.world import Array, GripperCommand, corners
from picktree.world.robot_model import (
    LinkageFingers,
    RobotDescription,
    RobotModel,
    fingers_of,
    load_robot,
    parse_robot,
)
from picktree.world.robot_model.finger_linkage import SliderPair
from picktree.world.robot_model.urdf_parser import link_geometry

from .arms import HINGED_HAND, mini

SHIPPED = ("xarm6", "iiwa", "panda", "gen3", "ur10e")
PERIOD = 1 / 240


@cache
def shipped(name: str) -> RobotDescription:
    return load_robot(name)


def pads_apart(model: RobotModel, width: float) -> float:
    """The gap between the inner faces of the pads along the TCP's y, by the whole robot's kinematics."""
    description = model.description
    home = model.named("home")
    poses, tcp = model.link_poses(home, width), model.tcp(home)
    faces: list[Array] = []
    for link, (box, pad) in zip(description.gripper.fingers, description.gripper.pads, strict=True):
        faces.append((tcp.inverse() @ poses[link] @ pad).apply(corners(box))[:, 1])
    return float(faces[0].min() - faces[1].max())


@pytest.mark.parametrize("name", SHIPPED)
def test_the_opening_is_the_gap_between_the_pads(name: str) -> None:
    model = RobotModel(shipped(name))
    for width in np.linspace(0.002, shipped(name).gripper.max_width, 7).tolist():
        assert pads_apart(model, width) == pytest.approx(width, abs=2e-5)


def test_joints_of_a_linkage_follow_its_drive_and_give_the_opening_back() -> None:
    fingers = fingers_of(shipped("xarm6").gripper)
    assert isinstance(fingers, LinkageFingers)
    assert shipped("xarm6").gripper.joints[0] == "drive_joint"
    assert shipped("xarm6").gripper.max_width == pytest.approx(0.0873, abs=2e-4)
    for width in (0.0, 0.02, 0.05, 0.0873):
        positions = fingers.positions(width)
        assert positions == pytest.approx([positions[0]] * 6)
        assert fingers.width(positions) == pytest.approx(
            min(width, shipped("xarm6").gripper.max_width), abs=1e-6
        )
    # By virtual work, as a finite difference.
    low, high = fingers.positions(0.041)[0], fingers.positions(0.039)[0]
    per_rad = (0.039 - 0.041) / (high - low)
    assert fingers.opening_per_rad((low + high) / 2) == pytest.approx(per_rad, rel=2e-3)
    assert fingers.force(fingers.positions(0.04), (0.01, 0.02, 0.03, 0.0, 0.0, 0.0)) == pytest.approx(
        0.06 / abs(per_rad), rel=2e-3
    )


def test_tips_on_knuckles_reach_further_out_the_more_they_close() -> None:
    fingers, tip = fingers_of(shipped("xarm6").gripper), shipped("xarm6").gripper.tip
    reaches = [fingers.reach(width) for width in (0.08, 0.06, 0.04, 0.02)]
    assert all(near < far for near, far in pairwise(reaches))
    assert reaches[-1] <= tip + 1e-4
    assert tip - reaches[0] > 0.008
    assert isinstance(sliders := fingers_of(shipped("panda").gripper), SliderPair)
    assert sliders.reach(0.08) == sliders.reach(0.0) == shipped("panda").gripper.tip


def test_the_shipped_linkage_fits_its_meshes() -> None:
    folder = Path(load_robot("panda").urdf).parents[1] / "xarm" / "xarm_gripper" / "meshes"
    model = RobotModel(shipped("xarm6"))
    for width in (0.0, 0.03, 0.08):
        poses, tcp = model.link_poses(model.named("home"), width), model.tcp(model.named("home"))
        (box, near), _ = model.finger_boxes(width)
        finger: Array = np.asarray(trimesh.load(folder / "left_finger.STL", force="mesh").vertices)
        points = (near.inverse() @ tcp.inverse() @ poses["left_finger"]).apply(finger)
        assert (np.abs(points).max(axis=0) <= np.array(box.size) / 2 + 1.1e-3).all()
    base: Array = np.asarray(trimesh.load(folder / "base_link.STL", force="mesh").vertices)
    in_tcp = (tcp.inverse() @ poses["xarm_gripper_base_link"]).apply(base)
    assert in_tcp[:, 2].max() == pytest.approx(-shipped("xarm6").gripper.palm, abs=1e-4)


@pytest.mark.parametrize("name", [*SHIPPED, "without an inertia"])
def test_simulation_and_model_have_the_same_mass_matrix(name: str, tmp_path: Path) -> None:
    if name == "without an inertia":
        # The engine's own idea of such a link is 1 kg.
        root = ElementTree.parse(shipped("iiwa").urdf).getroot()
        hand = next(link for link in root.findall("link") if link.get("name") == "panda_hand")
        hand.remove(hand.findall("inertial")[0])
        ElementTree.ElementTree(root).write(tmp_path / "arm.urdf")
        robot = replace(shipped("iiwa"), urdf=str(tmp_path / "arm.urdf"))
    else:
        robot = shipped(name)
    model, client = RobotModel(robot), Client()
    body = RobotBody(robot, client, PERIOD)
    body.load()
    joints = [pb.getJointInfo(body.body, k, client.id) for k in range(pb.getNumJoints(body.body, client.id))]
    moving = [info[1].decode() for info in joints if info[2] != pb.JOINT_FIXED]
    order = [model.full.joints[model.full.getJointId(joint)].idx_q for joint in moving]
    generator = np.random.default_rng(1)
    data = model.full.createData()
    for _ in range(5):
        q = generator.uniform(model.lower, model.upper)
        whole = model.full_q(q, float(generator.uniform(0.0, robot.gripper.max_width)))
        theirs = np.array(pb.calculateMassMatrix(body.body, whole[order].tolist(), physicsClientId=client.id))
        upper = np.triu(pin.crba(model.full, data, whole))
        ours = (upper + np.triu(upper, 1).T)[np.ix_(order, order)]
        assert np.abs(theirs - ours).max() < 1e-9


@pytest.mark.parametrize("limits", ['lower="-0.8" upper="0"', 'lower="0" upper="0.8"'])
def test_a_joint_follows_the_grippers_motor_beyond_its_own_limits(limits: str, tmp_path: Path) -> None:
    # The prefix of an element that other tools read is not declared.
    foreign = ('<robot name="mini">', '<robot name="mini"><drake:material name="grey"/>')
    edits = (*HINGED_HAND, ('lower="-0.8" upper="0"', limits), foreign)
    (tmp_path / "mini.urdf").write_text(mini(*edits), encoding="utf-8")
    robot = propose(ProposalRequest(str(tmp_path / "mini.urdf"), tmp_path / "mini.yaml", samples=100)).robot
    client = Client()
    body = RobotBody(robot, client, PERIOD)
    body.load()
    body.drive_fingers(GripperCommand(0.03, 10.0))
    for _ in range(240):
        body.before_step()
        pb.stepSimulation(client.id)
    positions = body.read().position[len(robot.joints) :]
    assert positions == pytest.approx(body.fingers.positions(0.03), abs=2e-3)
    assert min(positions) < -0.2


def held_box(force: float) -> tuple[float, float, float, float]:
    """Squeeze a 40 mm box in the air: opening, what the gripper feels, what presses on the box, its slip."""
    client = Client()
    pb.setGravity(0, 0, -9.81, physicsClientId=client.id)
    pb.setTimeStep(PERIOD, physicsClientId=client.id)
    body = RobotBody(shipped("xarm6"), client, PERIOD)
    body.load()
    tcp = body.tcp()
    shape = pb.createCollisionShape(pb.GEOM_BOX, halfExtents=[0.02] * 3, physicsClientId=client.id)
    x, y, z = tcp.position
    box = pb.createMultiBody(0.1, shape, -1, (x, y, z), physicsClientId=client.id)
    below = pb.createMultiBody(0.0, shape, -1, (x, y, z - 0.04), physicsClientId=client.id)
    pb.changeDynamics(box, -1, lateralFriction=0.6, physicsClientId=client.id)
    body.drive_fingers(GripperCommand(0.0, force))
    for step in range(360):
        if step == 240:
            pb.removeBody(below, client.id)
        body.before_step()
        pb.stepSimulation(client.id)
    reading, n = body.read(), len(shipped("xarm6").joints)
    at, efforts = reading.position[n:], reading.effort[n:]
    pressed = sum(point[9] for point in pb.getContactPoints(body.body, box, physicsClientId=client.id))
    sunk = z - pb.getBasePositionAndOrientation(box, client.id)[0][2]
    return body.fingers.width(at), body.fingers.force(at, efforts), pressed, sunk


def test_fingers_on_knuckles_press_as_hard_as_they_are_told_and_hold_by_friction() -> None:
    width, felt, pressed, sunk = held_box(20.0)
    assert width == pytest.approx(0.04, abs=1e-3)
    assert felt == pytest.approx(20.0, rel=0.03)
    assert pressed == pytest.approx(2 * 20.0, rel=0.05)
    assert abs(sunk) < 1e-3


@pytest.mark.parametrize("name", ["xarm6", "gen3", "ur10e"])
def test_the_wrist_feels_the_weight_of_a_free_hand_on_knuckles_in_any_pose(name: str) -> None:
    robot, client = shipped(name), Client()
    reset(client.id)
    body, model, rng = RobotBody(robot, client, PERIOD), RobotModel(robot), np.random.default_rng(1)
    body.load()
    for width in (0.08, 0.02, 0.05):
        q = np.clip(model.named("home") + rng.uniform(-0.6, 0.6, model.n), model.lower, model.upper)
        body.place(
            (*q.tolist(), *body.fingers.positions(width)), (0.0,) * (model.n + len(robot.gripper.joints))
        )
        body.follow(tuple(q.tolist()), (0.0,) * model.n)
        body.drive_fingers(GripperCommand(width, 10.0))
        for _ in range(240):
            body.before_step()
            pb.stepSimulation(client.id)
        # Without the reaction of the knuckles' gear it is up to 0.9 N off.
        x, y, z = body.read().wrench[:3]
        assert max(abs(x), abs(y), abs(z + model.hand_mass * 9.81)) < 0.2


def test_a_weak_grip_on_knuckles_lets_go() -> None:
    """2 μ F = 0.6 N carries less than the 0.98 N that the box weighs: nothing glues it to the fingers."""
    _, _, _, sunk = held_box(0.5)
    assert sunk > 0.01


def test_a_mounted_gripper_is_one_robot_with_the_arm() -> None:
    text = Path(shipped("iiwa").urdf).read_text(encoding="utf-8")
    assert 'filename="package://pybullet_data/kuka_iiwa/meshes/link_7.stl"' in text
    assert "/site-packages/" not in text
    assert load_robot("iiwa").urdf == shipped("iiwa").urdf
    links = {element.link for element in link_geometry(shipped("iiwa").urdf, "collision")}
    assert {"lbr_iiwa_link_0", "panda_hand", "panda_leftfinger"} <= links
    model = RobotModel(shipped("iiwa"))
    poses = model.link_poses(model.named("home"), 0.04)
    hand = poses["lbr_iiwa_link_7"].inverse() @ poses["panda_hand"]
    assert hand.position == pytest.approx((0.0, 0.0, 0.045))
    assert model.hand_mass == pytest.approx(RobotModel(shipped("panda")).hand_mass)


def test_home_points_the_tool_down_in_front_of_each_arm() -> None:
    for robot in map(shipped, SHIPPED):
        model = RobotModel(robot)
        tcp = model.tcp(model.named("home"))
        assert tcp.rotation()[2, 2] < -0.999
        assert tcp.position[0] > 0.25
        assert {"home", "observe", "rest"} <= set(robot.named)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "to: lbr_iiwa_link_7",
            "to: lbr_iiwa_link_8",
            "8:1: mount: the gripper cannot be mounted: the arm has no link 'lbr_iiwa_link_8' "
            "(did you mean 'lbr_iiwa_link_7'?)",
        ),
        (
            "  link: panda_hand\n",
            "  link: panda_head\n",
            "8:1: mount: the gripper cannot be mounted: the gripper has no link 'panda_head' "
            "(did you mean 'panda_hand'?)",
        ),
        (
            "  joint: hand_mount\n",
            "  joint: lbr_iiwa_joint_1\n",
            "8:1: mount: the gripper cannot be mounted: arm and gripper both have 'lbr_iiwa_joint_1': "
            "give the gripper's names a prefix",
        ),
        (
            "  urdf: pybullet_data:franka",
            "  urdf: pybullet_data:frank",
            "9:9: mount.urdf: there is no file {data}/frank_panda/panda.urdf",
        ),
    ],
)
def test_grippers_that_cannot_be_mounted_are_refused(old: str, new: str, told: str) -> None:
    path = Path(shipped("iiwa").source)
    assert shipped("iiwa").text.count(old) == 1
    with pytest.raises(FileError) as caught:
        parse_robot(shipped("iiwa").text.replace(old, new), path)
    data = Path(shipped("panda").urdf).parents[1]
    assert str(caught.value).splitlines()[0] == f"{path}:{told}".format(data=data)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "opened: 0\n    closed: 0.85",
            "opened: 0.85\n    closed: 0",
            "gripper.linkage: the pads do not open all the way as 'drive_joint' turns from 0 rad (closed) to "
            "0.85 rad (opened): 87.3 mm, halfway 46.3 mm, at the end 0.0 mm apart",
        ),
        (
            "drive: drive_joint",
            "drive: drive_joynt",
            "gripper.linkage.drive: the URDF has no joint 'drive_joynt'",
        ),
        (
            "  linkage:",
            "  joints: [joint1, joint2]\n  linkage:",
            "gripper: 'joints' and 'linkage' exclude each other",
        ),
    ],
)
def test_linkages_that_do_not_open_are_refused(old: str, new: str, told: str) -> None:
    assert shipped("xarm6").text.count(old) == 1
    with pytest.raises(FileError) as caught:
        parse_robot(shipped("xarm6").text.replace(old, new), Path(shipped("xarm6").source))
    assert told in str(caught.value)


def test_a_linkage_closes_in_the_time_that_its_speed_says() -> None:
    client = Client()
    pb.setTimeStep(PERIOD, physicsClientId=client.id)
    robot = replace(shipped("xarm6"), gripper=replace(shipped("xarm6").gripper, speed=0.05))
    body = RobotBody(robot, client, PERIOD)
    body.load()
    body.drive_fingers(GripperCommand(0.02, 20.0))
    n = len(robot.joints)
    for _ in range(120):
        body.before_step()
        pb.stepSimulation(client.id)
    closed = robot.gripper.max_width - body.fingers.width(body.read().position[n:])
    assert closed == pytest.approx(2 * 0.05 * 0.5, rel=0.15)


def test_a_tip_that_tapers_beyond_the_pad_is_a_body_and_counts_for_the_reach(tmp_path: Path) -> None:
    def tip(name: str, y: float) -> tuple[str, str]:
        box = f'<origin xyz="0 {y} 0.056"/><geometry><box size="0.02 0.008 0.012"/></geometry>'
        return f'<link name="{name}">', f'<link name="{name}"><collision>{box}</collision>'

    # Its face is 4 mm behind the pad's.
    edits = (*HINGED_HAND, tip("left", -0.012), tip("right", 0.012))
    (tmp_path / "mini.urdf").write_text(mini(*edits), encoding="utf-8")
    robot = propose(ProposalRequest(str(tmp_path / "mini.urdf"), tmp_path / "mini.yaml", samples=100)).robot
    first, second = robot.gripper.finger_bodies
    assert first[0].size[2] == pytest.approx(0.012, abs=1e-4) == second[0].size[2]
    model = RobotModel(robot)
    reaches = [fingers_of(robot.gripper).reach(width) for width in (0.0, robot.gripper.max_width)]
    assert max(reaches) == pytest.approx(robot.gripper.tip, abs=1e-3)
    assert pads_apart(model, 0.03) == pytest.approx(0.03, abs=2e-5)


def test_pads_of_fingers_that_turn_are_measured_where_they_look_at_each_other(tmp_path: Path) -> None:
    turning = [(f'joint="{k}" multiplier="-1"', f'joint="{k}" multiplier="-0.6"') for k in ("k1", "k2")]
    (tmp_path / "mini.urdf").write_text(mini(*HINGED_HAND, *turning), encoding="utf-8")
    robot = propose(ProposalRequest(str(tmp_path / "mini.urdf"), tmp_path / "mini.yaml", samples=100)).robot
    # Open, the fingers lean by 18 deg, and no more than their edges are level.
    assert [box.size[2] for box, _ in robot.gripper.pads] == pytest.approx([0.05, 0.05], abs=4e-3)
