"""Robot files: the shipped Panda against its URDF and meshes, and what is refused."""

from __future__ import annotations

import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import trimesh

from picktree.files import FileError, PicktreeError
from picktree.simulation.physics import Client, RobotBody
from picktree.simulation.physics.engine_urdf import patched_urdf
from picktree.world import Box
from picktree.world.robot_model import RobotModel, load_robot, parse_robot
from picktree.world.robot_model.robot_file import robot_names
from picktree.world.robot_model.urdf_parser import UrdfPrimitive, link_geometry

URDF = """\
<robot name="arm">
  <link name="base"/><link name="upper"/><link name="hand"/><link name="left"/><link name="right"/>
  <joint name="turn" type="revolute">{L}<parent link="base"/><child link="upper"/></joint>
  <joint name="wrist" type="fixed"><parent link="upper"/><child link="hand"/></joint>
  <joint name="finger1" type="prismatic">{L}<parent link="hand"/><child link="left"/></joint>
  <joint name="finger2" type="prismatic">{L}<parent link="hand"/><child link="right"/></joint>
</robot>
""".replace("{L}", '<limit lower="-2" upper="2" effort="50" velocity="2"/>')
ROBOT = """\
picktree: 1
kind: robot
urdf: arm.urdf
base: {at: [0, 0, 10 cm], rpy: [0, 0, 90 deg]}
joints:
  turn: {lower: -90 deg, upper: 1.5, velocity: 2, acceleration: 10, torque: 50}
poses: {home: [0.5]}
tcp: {link: hand, at: [0, 0, 0.1]}
flange_joint: wrist
gripper:
  joints: [finger1, finger2]
  links: [left, right]
  max_width: 80 mm
  max_force: 70 N
  speed: 100 mm/s
  tip: 7 mm
  palm: 39 mm
  pads: [{box: [0.02, 0.01, 0.02]}, {box: [0.02, 0.01, 0.02], at: [0, 1 mm, 0]}]
  hand: [{box: [0.05, 0.2, 0.1]}]
  finger: {box: [0.02, 0.02, 0.05]}
disabled_pairs: [[base, upper]]
"""


@pytest.fixture
def robot_file(tmp_path: Path) -> Path:
    (tmp_path / "arm.urdf").write_text(URDF)
    (tmp_path / "arm.yaml").write_text(ROBOT)
    return tmp_path / "arm.yaml"


def test_a_robot_is_read(robot_file: Path) -> None:
    robot = load_robot("arm.yaml", robot_file)
    assert robot.name == "arm"
    assert robot.urdf == str(robot_file.parent / "arm.urdf")
    assert robot.base_in_world.position == (0, 0, 0.1)
    assert (robot.joints, robot.limits[0].lower) == (("turn",), pytest.approx(-np.pi / 2))
    assert (robot.tcp_link, robot.tcp_in_link.position) == ("hand", (0, 0, 0.1))
    assert (robot.gripper.fingers, robot.gripper.gear) == (("left", "right"), -1.0)
    assert robot.gripper.pads[1][1].position == (0, 0.001, 0)
    assert (robot.gripper.pad_contact.friction, robot.disabled_pairs) == (1.0, (("base", "upper"),))
    assert parse_robot(robot.text, robot_file) == robot


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("arm.urdf", "leg.urdf", "3:7: urdf: there is no file {here}/leg.urdf"),
        ("arm.urdf", "no_such:arm.urdf", "3:7: urdf: there is no installed package 'no_such'"),
        ("arm.urdf", "__main__:arm.urdf", None),
        ("  turn:", "  tourn:", "6:3: joints.tourn: the URDF has no joint 'tourn' (did you mean 'turn'?)"),
        (
            "  turn:",
            "  wrist:",
            "6:3: joints.wrist: 'wrist' is fixed; revolute or continuous or prismatic is wanted",
        ),
        (
            "upper: 1.5",
            "upper: -2",
            "6:33: joints.turn.upper: the upper limit, -2 rad, is not above the lower, -90 deg",
        ),
        (
            "velocity: 2",
            "velocity: 0",
            "6:48: joints.turn.velocity: 0 rad/s is not positive",
        ),
        ("velocity: 2, ", "", "6:3: joints.turn: 'velocity' is missing"),
        ("home: [0.5]", "away: [0.5]", "7:1: poses: 'home' is missing (the pose to which the arm returns)"),
        ("home: [0.5]", "home: [0, 0]", "7:15: poses.home: 1 value is wanted, one for each joint, not 2"),
        (
            "home: [0.5]",
            "home: [2]",
            "7:16: poses.home[0]: 2 rad is outside the limits of turn (-90 deg … 1.5 rad)",
        ),
        (
            "home: [0.5]",
            "home: [45]",
            "7:16: poses.home[0]: 45 rad is outside the limits of turn (-90 deg … 1.5 rad; degrees? Numbers "
            "without a unit are in rad, of a slider in m)",
        ),
        ("link: hand", "link: hnad", "8:13: tcp.link: the URDF has no link 'hnad' (did you mean 'hand'?)"),
        (
            "flange_joint: wrist",
            "flange_joint: turn",
            "9:15: flange_joint: 'turn' is revolute; fixed is wanted",
        ),
        (
            "joints: [finger1, finger2]",
            "joints: [finger1]",
            "11:11: gripper.joints: 2 values are wanted, not 1",
        ),
        (
            "[left, right]",
            "[left, middle]",
            "12:17: gripper.links[1]: the URDF has no link 'middle' (known: base, upper, hand, left, right)",
        ),
        ("max_force: 70 N", "max_force: 70 kg", None),
        ("[base, upper]", "[base]", "21:18: disabled_pairs[0]: 2 values are wanted, not 1"),
        ("[base, upper]", "[base, uper]", None),
        ("tip: 7 mm", "tips: 7 mm", None),
    ],
)
def test_faulty_robots_are_refused(robot_file: Path, old: str, new: str, message: str | None) -> None:
    assert ROBOT.count(old) == 1
    with pytest.raises(FileError) as caught:
        parse_robot(ROBOT.replace(old, new), robot_file)
    if message is not None:
        lines = message.format(here=robot_file.parent).split("\n")
        assert str(caught.value) == "\n".join(f"{robot_file}:{line}" for line in lines)


def test_a_urdf_that_is_no_xml(robot_file: Path) -> None:
    (robot_file.parent / "arm.urdf").write_text("<robot")
    with pytest.raises(FileError, match=r"arm.yaml:3:7: urdf: .*arm.urdf: not readable as XML: "):
        load_robot(str(robot_file))


def test_unknown_robots() -> None:
    assert robot_names() == ("gen3", "iiwa", "panda", "panda_long_fingers", "ur10e", "xarm6")
    with pytest.raises(PicktreeError) as caught:
        load_robot("pnada")
    assert str(caught.value) == "unknown robot 'pnada' (did you mean 'panda'?)"


def test_the_panda_has_the_soft_limits_of_its_urdf() -> None:
    robot = load_robot("panda")
    root = ElementTree.parse(robot.urdf).getroot()
    for name, limits in zip(robot.joints, robot.limits, strict=True):
        joint = root.find(f"joint[@name='{name}']")
        assert joint is not None
        soft, hard = joint.find("safety_controller"), joint.find("limit")
        assert soft is not None
        assert hard is not None
        assert limits.lower == float(soft.get("soft_lower_limit", ""))
        assert limits.upper == float(soft.get("soft_upper_limit", ""))
        assert limits.velocity == float(hard.get("velocity", ""))
        assert limits.torque == float(hard.get("effort", ""))
    target = root.find("joint[@name='panda_grasptarget_hand']/origin")
    assert target is not None
    assert [float(v) for v in target.get("xyz", "").split()] == list(robot.tcp_in_link.position)


def mesh(name: str) -> np.ndarray:
    folder = Path(load_robot("panda").urdf).parent / "meshes" / "collision"
    return np.asarray(trimesh.load(folder / f"{name}.obj", force="mesh").vertices)


def test_the_gripper_numbers_are_those_of_the_meshes() -> None:
    gripper = load_robot("panda").gripper
    finger_in_tcp = np.array([0, 0, 0.0584 - 0.105])
    hand = mesh("hand") - [0, 0, 0.105]
    finger = mesh("finger") + finger_in_tcp
    assert finger[:, 2].max() == pytest.approx(gripper.tip, abs=1e-4)
    assert hand[:, 2].max() == pytest.approx(-gripper.palm, abs=1e-4)
    assert np.ptp(hand[:, 1]) == pytest.approx(0.204, abs=5e-4)

    ((box, pose),) = gripper.finger_boxes
    half = np.array(box.size) / 2 + 2e-4
    assert (np.abs(finger - pose.position) <= half).all()
    boxes = [(np.array(b.size) / 2, np.array(p.position)) for b, p in gripper.hand]
    for vertex in hand:
        assert any((np.abs(vertex - centre) <= half + 1e-6).all() for half, centre in boxes), vertex


def test_the_pads_meet_at_width_zero_and_lie_on_the_flat_of_the_fingers() -> None:
    gripper = load_robot("panda").gripper
    (left, left_pose), (right, right_pose) = gripper.pads
    assert left_pose.position[1] - left.size[1] / 2 == pytest.approx(0, abs=1e-12)
    assert right_pose.position[1] + right.size[1] / 2 == pytest.approx(0, abs=1e-12)
    flat = [v for v in mesh("finger") if abs(v[1]) < 3e-4]
    low, high = left_pose.position[2] - left.size[2] / 2, left_pose.position[2] + left.size[2] / 2
    assert min(v[2] for v in flat) == pytest.approx(low, abs=2e-3)
    assert max(v[2] for v in flat) == pytest.approx(high, abs=3e-3)


def test_attachments_collide_are_seen_and_reach_as_far_as_the_fingers_that_the_planner_knows(
    tmp_path: Path,
) -> None:
    robot = load_robot("panda_long_fingers")
    model = RobotModel(robot)
    tips = {
        shape.link: shape.pose_in_link.position[2] + shape.shape.size[2] / 2 - 0.0538
        for shape in link_geometry(robot.urdf, "visual")
        if isinstance(shape, UrdfPrimitive) and isinstance(shape.shape, Box)
    }
    assert tips == pytest.approx({"panda_leftfinger": 0.08, "panda_rightfinger": 0.08}, abs=1e-6)
    assert {shape.link for shape in model.collision_shapes()} >= set(tips)
    reach = [pose.position[2] + box.size[2] / 2 for box, pose in model.finger_boxes(0.02)]
    assert max(reach) == pytest.approx(robot.gripper.tip, abs=1e-6)
    inner = [abs(pose.position[1]) - box.size[1] / 2 for box, pose in model.finger_boxes(0.02)]
    assert min(inner) == pytest.approx(0.01)
    text = patched_urdf(robot, tmp_path)
    assert text.count("0.0176 0.0104 0.08") == 4  # each bar seen and touched
    assert text.count("0.019 0.013 0.0362") == 2  # and the Franka fingers behind the bars


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("tip: 7 mm", "tip: 7 mm\n  finger_bodies: [{box: [1, 1, 1]}]", "one box of each finger in turn"),
        ("base: {at", "attachments: {lefd: []}\nbase: {at", "no link 'lefd' (did you mean 'left'?)"),
    ],
)  # fmt: skip
def test_faulty_parts_of_fingers_are_refused(robot_file: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(FileError) as caught:
        parse_robot(ROBOT.replace(old, new), robot_file)
    assert message in str(caught.value)


def test_reading_a_known_robot_imports_no_simulator() -> None:
    load_robot("panda")  # its meshes are in the disk cache from here on
    code = (
        "import sys; from picktree.world.robot_model import load_robot; load_robot('panda');"
        "print([m for m in ('pybullet', 'pybullet_data', 'pinocchio', 'trimesh') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_finger_collides_along_its_whole_length(tmp_path: Path) -> None:
    urdf = ElementTree.fromstring(patched_urdf(load_robot("panda"), tmp_path))
    for name in ("panda_leftfinger", "panda_rightfinger"):
        finger = next(link for link in urdf.findall("link") if link.get("name") == name)
        spans = list[tuple[float, float]]()
        for collision in finger.findall("collision"):
            size, origin = collision.find("geometry/box"), collision.find("origin")
            assert size is not None and origin is not None
            height, middle = float(size.get("size", "").split()[2]), float(origin.get("xyz", "").split()[2])
            spans.append((middle - height / 2, middle + height / 2))
        pad, body = spans
        assert body[0] == pytest.approx(0.0) and body[1] == pytest.approx(pad[0]) and pad[1] > 0.053


def test_positions_of_an_arm_that_slides_are_those_of_its_tcp(robot_file: Path) -> None:
    slide = '<joint name="slide" type="prismatic"><axis xyz="0.6 0 0.8"/><parent link="upper"/>'
    limits = '<child link="rod"/><limit lower="-1" upper="1" effort="50" velocity="2"/></joint>'
    fixed = '<joint name="wrist" type="fixed"><parent link="'
    urdf = URDF.replace(f"{fixed}upper", f'<link name="rod"/>{slide}{limits}{fixed}rod')
    (robot_file.parent / "arm.urdf").write_text(urdf)
    joint = "  slide: {lower: -0.5, upper: 0.5, velocity: 2, acceleration: 10, torque: 50}"
    robot_file.write_text(ROBOT.replace("poses: {home: [0.5]}", f"{joint}\nposes: {{home: [0.5, 0.1]}}"))
    model = RobotModel(load_robot(str(robot_file)))
    path = np.random.default_rng(0).uniform(model.lower, model.upper, (20, 2))
    positions = [model.tcp(q).position for q in path]
    np.testing.assert_allclose(model.tcp_positions(path), positions, rtol=0, atol=1e-12)
    assert np.ptp(np.array(positions), axis=0).min() > 0.1


def test_models_of_an_extra_that_is_not_installed_name_it(tmp_path: Path) -> None:
    text = load_robot("panda").text.replace("pybullet_data:franka_panda", "compas_fabs:franka_panda")
    (tmp_path / "arm.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(FileError, match="there is no installed package 'compas_fabs'"):
        load_robot(str(tmp_path / "arm.yaml"))
    sys_path = [folder for folder in sys.path if not (Path(folder) / "compas_fab").is_dir()]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", sys_path)
        with pytest.raises(FileError, match=r"'compas_fab' \(pip install 'picktree\[robots\]' has it\)"):
            load_robot("ur10e")


def test_a_hand_without_a_flange_gets_one_behind_the_last_joint(robot_file: Path) -> None:
    # The fingers hang on what the last joint moves; nothing of the hand may move by what is put in.
    fixed = '<joint name="wrist" type="fixed"><parent link="upper"/><child link="hand"/></joint>'
    plain = URDF.replace('<link name="hand"/>', "").replace(fixed, "").replace('"hand"', '"upper"')
    (robot_file.parent / "arm.urdf").write_text(plain)
    text = ROBOT.replace("flange_joint: wrist", "flange_joint: wrist\nflange_behind: turn")
    robot_file.write_text(text.replace("link: hand", "link: upper"))
    robot = load_robot(str(robot_file))
    model = RobotModel(robot)
    poses = model.link_poses(np.array([0.5]), 0.04)
    assert poses["wrist_link"] == poses["upper"]
    assert model.hand_mass == 0.0
    body = RobotBody(robot, Client(), 1 / 240)
    body.load()
    assert set(body.links.values()) == {"base", "wrist_link", "upper", "left", "right"}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("behind: turn", "behind: trun", "there is no joint 'trun' (did you mean 'turn'?)"),
        (
            "flange_joint: wrist",
            "flange_joint: turn",
            "the URDF has 'turn' or 'turn_link' already: give 'flange_joint' another name",
        ),
    ],
)
def test_a_flange_that_cannot_be_put_in_is_refused(
    robot_file: Path, old: str, new: str, message: str
) -> None:
    text = ROBOT.replace("flange_joint: wrist", "flange_joint: wrist\nflange_behind: turn")
    with pytest.raises(FileError) as caught:
        parse_robot(text.replace("wrist", "flange").replace(old.replace("wrist", "flange"), new), robot_file)
    assert f"flange_behind: no flange can be put in: {message}" in str(caught.value)
