"""picktree robot new: home, torques, hands and paths of proposals for a small arm."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pytest
import trimesh

from picktree.apps.cli import answer
from picktree.apps.commissioning import ProposalRequest, propose
from picktree.apps.commissioning.base_pose import TargetPlace, propose_base
from picktree.apps.commissioning.joints import is_placeholder
from picktree.apps.commissioning.model_checks import RobotUnderTest, check_model
from picktree.apps.commissioning.proposal import Proposal
from picktree.apps.commissioning.robot_test import advice, opening_advice, reach_advice
from picktree.files import PicktreeError
from picktree.robot.planning import CollisionChecker, standing_pairs
from picktree.world import BeliefObject, Box, ObjectId, PlanningScene, Pose
from picktree.world.robot_model import RobotModel, load_robot
from picktree.world.robot_model.urdf_parser import mesh_file
from picktree.world.scene import Fixture

from ..robots.arms import BAR_HAND, HINGED_HAND, JOINTS, link, mini

WITHOUT_BASE = ((link("base"), '<link name="base"/>'), ('<origin xyz="0 0 0.12"/>', '<origin xyz="0 0 0"/>'))
"""The first link stands where the base stood, and turns there."""


Proposed: TypeAlias = Callable[..., Proposal]


@pytest.fixture(scope="module")
def proposed(tmp_path_factory: pytest.TempPathFactory) -> Proposed:
    """Proposal for an arm with these edits of its URDF, made once for each."""

    @cache
    def made(*edits: tuple[str, str]) -> Proposal:
        folder = tmp_path_factory.mktemp("mini")
        (folder / "mini.urdf").write_text(mini(*edits), encoding="utf-8")
        return propose(ProposalRequest(str(folder / "mini.urdf"), folder / "mini.yaml", samples=100))

    return made


def test_a_robot_file_is_written_to_a_relative_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "urdf"
    folder.mkdir()
    trimesh.creation.box((0.08, 0.06, 0.36)).export(folder / "l3.stl")
    (folder / "mini.urdf").write_text(
        mini(('<box size="0.08 0.06 0.36"/>', '<mesh filename="l3.stl"/>')), encoding="utf-8"
    )
    monkeypatch.chdir(tmp_path)
    asked = ["robot", "new", "urdf/mini.urdf", "--samples", "100", "--no-test", "-o"]
    assert answer([*asked, "mini.yaml"]) == 0
    assert "\nurdf: urdf/mini.urdf\n" in (tmp_path / "mini.yaml").read_text(encoding="utf-8")
    assert answer([*asked, "urdf/../other.yaml"]) == 0
    assert answer(["robot", "show", "other.yaml"]) == 0
    capsys.readouterr()
    assert answer([*asked, "gone/mini.yaml"]) == 2
    assert capsys.readouterr().err == "there is no folder gone for mini.yaml; make it first\n"
    assert answer([*asked, "urdf"]) == 2
    assert capsys.readouterr().err == "urdf is a folder; name the robot file in it, as urdf/arm.yaml\n"


def test_home_is_in_front_of_a_shoulder_beside_the_base(proposed: Proposed) -> None:
    torso = '<link name="torso"/><joint name="mount" type="fixed"><parent link="torso"/><child link="base"/>'
    moved = ('<robot name="mini">', f'<robot name="mini">{torso}<origin xyz="-0.1 0.6 0.3"/></joint>')
    beside = proposed(moved)
    tool = RobotModel(beside.robot).tcp(np.array(beside.draft.poses[0].joints))
    assert tool.position[1] == pytest.approx(0.6, abs=0.02)
    assert 0.1 < tool.position[0] < 0.5
    # Turned aside, the tool is nearer to the middle of the table than at home.
    aside = RobotModel(beside.robot).tcp(np.array(beside.draft.poses[1].joints))
    assert aside.position[1] < 0.4


def test_each_pose_is_above_the_table(proposed: Proposed) -> None:
    # The upper arm goes on behind the shoulder, beside the base.
    made = proposed(('"0.08 0.06 0.46"', '"0.08 0.06 1.2"'), ('"0 0.09 0.2"', '"0 0.14 0.2"'))
    model = RobotModel(made.robot)
    box = np.array(list(product((-0.04, 0.04), (0.11, 0.17), (0.2 - 0.6, 0.2 + 0.6))))
    for pose in made.draft.poses:
        upper_arm = model.link_poses(np.array(pose.joints), 0.0)["l2"]
        assert upper_arm.apply(box)[:, 2].min() >= 0.009


BURIED = (('<origin xyz="0 0 0.12"/>', '<origin xyz="0 0 -2"/>'),)
BULKY = (('"0.08 0.06 0.36"', '"0.08 0.06 1.2"'), ('"0.07 0.07 0.12"', '"1.2 1.2 0.12"'))


@pytest.mark.parametrize(
    ("edits", "told"),
    [
        (
            BURIED,
            "l2 and the table touch in 63 % of the random poses; in the best of these they are "
            "1850 mm in each other",
        ),
        (BULKY, "l3 and l6 touch in "),
    ],
    ids=["under the table", "in itself"],
)
def test_without_a_free_pose_no_file_is_made(
    edits: tuple[tuple[str, str], ...], told: str, proposed: Proposed
) -> None:
    with pytest.raises(PicktreeError) as caught:
        proposed(*edits)
    lines = str(caught.value).splitlines()
    assert lines[1].startswith("  found    an arm of 6 joints and a gripper; ")
    assert told in lines[1]
    assert lines[2] == "  missing  " + (
        "a free pose: above the table at z = 0, in front of the first joint, no links in each other"
    )


@pytest.mark.parametrize("effort", ["1", "1000000"])
def test_torques_that_no_motor_has_are_guessed(effort: str, proposed: Proposed) -> None:
    efforts = [(f'effort="{most}" velocity="2"', f'effort="{effort}" velocity="2"') for most in (150, 80, 30)]
    made = proposed(*efforts)
    model = RobotModel(made.robot)
    for k, limit in enumerate(made.draft.limits):
        assert limit.guess == (
            f"{limit.torque:g} Nm are a guess from gravity and inertia, because the URDF's effort of "
            f"{float(effort):g} Nm is implausible: see the data sheet"
        )
        assert f"# the URDF's limits, each moved inwards by 2.0 deg; torque: {limit.guess}" in made.text
        # It carries the arm and takes each joint to its speed in 0.3 s.
        assert limit.acceleration == pytest.approx(limit.velocity / 0.3, rel=0.02)
        q = np.array([0.0, 1.5, 0.0, 0.0, 0.0, 0.0])
        needed = np.abs(model.inverse_dynamics(q, np.zeros(6), np.eye(6)[k] * limit.acceleration))[k]
        assert needed < limit.torque < 20 * needed + 5
    assert [v for v in check_model(RobotUnderTest.of(made.robot)) if not v.good] == []


def test_torques_of_the_urdf_are_kept(proposed: Proposed) -> None:
    made = proposed()
    assert [limit.torque for limit in made.draft.limits] == [effort for *_, effort in JOINTS.values()]
    assert [limit.guess for limit in made.draft.limits] == [""] * 6
    assert not is_placeholder(0.5, gravity=0.2, guess=1.2)
    assert is_placeholder(0.5, gravity=0.7, guess=2.2)
    assert is_placeholder(0.0, gravity=0.0, guess=2.2) and is_placeholder(-1.0, gravity=0.0, guess=2.2)


@pytest.mark.parametrize("moments", [0, 1])
def test_inertias_that_a_urdf_lacks_are_those_of_hulls(moments: int, proposed: Proposed) -> None:
    box = '<geometry><box size="0.1 0.1 0.1"/></geometry>'
    more = (
        f'<link name="pad"><collision>{box}</collision></link><link name="mark"/>'
        '<joint name="on_l4" type="fixed"><parent link="l4"/><child link="pad"/></joint>'
        '<joint name="on_pad" type="fixed"><parent link="pad"/><child link="mark"/></joint>'
    )
    l3 = link("l3")
    given = l3[l3.index("<inertia ") : l3.index("</inertial>")]
    lone = given if moments else ""
    made = proposed((given, lone), ("</robot>", f"{more}</robot>"))
    told = {f.link: f.sentence for f in made.draft.findings}
    assert told["pad"] == "has no <inertial>, but a shape: it gets 1 kg, of its hull at 1000 kg/m³, a guess"
    assert made.draft.inertias["pad"].moments == pytest.approx((1 / 600,) * 3)
    assert "mark" not in told
    if not moments:
        assert (
            told["l3"]
            == "has a mass, but no <inertia>: the robot file gives it the inertia of its hull, a guess"
        )
        assert f"# l3: {told['l3']}." in made.text
        assert made.draft.inertias["l3"].mass == 3
        assert made.draft.inertias["l3"].moments[2] == pytest.approx(3 * (0.08**2 + 0.06**2) / 12)
    assert [v for v in check_model(RobotUnderTest.of(made.robot)) if not v.good] == []


def test_the_tcp_stays_between_fingers_on_hinges(proposed: Proposed) -> None:
    gripper = proposed(*HINGED_HAND).draft.gripper
    # Closed tips are at 160 mm, open ones at 60 + 50 · cos 0.8 + 50 mm.
    assert gripper.tcp_in_palm.position == pytest.approx((0, 0, 0.1388), abs=1e-3)
    assert gripper.tcp_comment == (
        "Between the pads, measured on the meshes; the URDF's frame 'tool' lies 16 mm further out, "
        "at the tips"
    )
    assert gripper.max_width == pytest.approx(2 * 0.05 * np.sin(0.8), abs=1e-3)


def test_a_tool_frame_between_the_pads_is_kept(proposed: Proposed) -> None:
    at = ('<origin xyz="0 0 0.155"/>', '<origin xyz="0 0 0.135"/>')
    gripper = proposed(*HINGED_HAND, at).draft.gripper
    assert gripper.tcp_in_palm.position == pytest.approx((0, 0, 0.135))
    assert gripper.tcp_comment == "At the URDF's frame 'tool', which lies between the pads"


def test_a_hand_whose_bar_carries_the_fingers_is_measured(proposed: Proposed) -> None:
    made = proposed(*BAR_HAND)
    gripper = made.draft.gripper
    assert made.draft.flange_joint == "flange"
    assert (gripper.min_width, gripper.max_width) == pytest.approx((0.012, 0.056), abs=1e-6)
    assert gripper.tcp_in_palm.rotation()[:, 2] == pytest.approx([0, 0, 1])
    assert gripper.tcp_in_palm.position == pytest.approx((0, 0, 0.04))
    # The bar ends 10 mm before the fingers' frame.
    assert (gripper.palm, gripper.tip) == pytest.approx((0.05, 0.01), abs=1e-6)
    for box, _ in gripper.pads:
        assert box.size == pytest.approx((0.02, 0.012, 0.05), abs=1e-6)
    assert "  # It opens from 12 to 56 mm: computed from the pads." in made.text
    assert (
        gripper.force_comment == "The URDF's effort means only 1 N; this force is a guess: see the data sheet"
    )
    # No joint of the arm moves the wheel against the fingers.
    assert {"prop", "left"} in [{*pair} for pair in made.robot.disabled_pairs]
    assert [v.name for v in check_model(RobotUnderTest.of(made.robot)) if not v.good] == ["tool frame"]


def test_a_turret_may_touch_the_table_on_which_it_stands(proposed: Proposed) -> None:
    made = proposed(*WITHOUT_BASE)
    model = RobotModel(made.robot)
    assert model.standing_links == ("l1",)
    ground = Fixture(ObjectId("ground"), Box((1.0, 1.0, 0.04)), Pose((0.5, 0.0, -0.02)))
    wall = Fixture(ObjectId("wall"), Box((0.02, 1.0, 0.6)), Pose((-0.07, 0.0, 0.3)))
    scene = PlanningScene((ground, wall), ())
    assert standing_pairs(model, scene) == (("l1", "ground"),)
    checker = CollisionChecker(model)
    checker.update(scene, 0.0)
    touching = {(c.a, c.b) for c in checker.contacts(model.named("home"))}
    assert {("l1", "ground"), ("l1", "wall")} <= touching
    scene.allow_mounting(standing_pairs(model, scene))
    for belief in (scene, scene.supposing()):
        with belief.allow(("arm", "something")):
            pass
        checker.update(belief, 0.0)
        assert {(c.a, c.b) for c in checker.contacts(model.named("home"))} == touching - {("l1", "ground")}
    scene.restore(*scene.state())
    assert scene.allowed("ground", "l1")
    # A link that swings is checked against what is under it.
    assert standing_pairs(RobotModel(proposed().robot), scene) == ()


def test_the_advice_for_a_place_out_of_reach_leads_to_a_base_within_it(proposed: Proposed) -> None:
    robot = proposed().robot
    red_bin = TargetPlace("red_bin", np.array([0.42, 0.48, 0.2]))
    assert reach_advice(RobotUnderTest.of(robot), (red_bin,), "arm.yaml") is None
    away = RobotUnderTest.of(replace(robot, base_in_world=Pose((-0.5, 0.0, 0.0))))
    found = reach_advice(away, (red_bin,), "arm.yaml")
    assert found is not None
    assert found[0].startswith("with the tool down the arm reaches from 0.")
    assert found[0].endswith("; red_bin is at 1.04 m")
    told = re.match(r"write 'at: \[(.*), 0, 0\]' under 'base:' in arm.yaml: from there the tool, ", found[1])
    assert told is not None
    moved = RobotUnderTest.of(replace(robot, base_in_world=Pose((float(told[1]), 0.0, 0.0))))
    assert reach_advice(moved, (red_bin,), "arm.yaml") is None
    high = reach_advice(moved, (TargetPlace("lamp", np.array([0.4, 0.0, 2.5])),), "arm.yaml")
    assert high is not None
    assert high[0] == "with the tool down the arm reaches nothing 2500 mm above the table"


SHORT = (
    ('<origin xyz="0 0 0.4"/>', '<origin xyz="0 0 0.26"/>'),
    ('<origin xyz="0 0 0.3"/>', '<origin xyz="0 0 0.2"/>'),
    ('"0.08 0.06 0.46"', '"0.08 0.06 0.3"'), ('"0 0.09 0.2"', '"0 0.09 0.13"'),
    ('"0.08 0.06 0.36"', '"0.08 0.06 0.24"'), ('"0 0 0.15"', '"0 0 0.1"'),
)  # fmt: skip


def test_a_short_arm_stands_where_it_reaches_most(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mini.urdf").write_text(mini(*SHORT), encoding="utf-8")
    file = tmp_path / "mini.yaml"
    asked = ["robot", "new", str(tmp_path / "mini.urdf"), "-o", str(file), "--samples", "100", "--no-test"]
    assert answer(asked) == 0
    shown, text = capsys.readouterr().out, file.read_text(encoding="utf-8")
    robot = load_robot(str(file))
    x, y, z = robot.base_in_world.position
    assert (0.05 <= x <= 0.25, y) == (True, 0.0)
    told = "from there the tool, pointing down, reaches "
    assert f"base: at [{x:g}, {y:g}, {z:g}] m, a proposal: {told}" in shown
    assert f"# This position is a proposal: {told}" in text
    tested = RobotUnderTest.of(robot)
    there = propose_base(tested.model, tested.skeleton, tested.solids)
    assert there is None
    # Neither the foot nor its outline is among the items.
    assert x + 0.07 < 0.38


def test_guessed_masses_are_light_enough_for_the_torques_of_the_urdf(proposed: Proposed) -> None:
    def without(name: str) -> tuple[str, str]:
        whole = link(name)
        inertial = whole[whole.index("<inertial>") : whole.index("</inertial>") + len("</inertial>")]
        return whole, whole.replace(inertial, "")

    edits = [without(name) for name in ("l2", "l3", "l4", "l5", "l6")]
    heavy = proposed(*edits)
    weak = proposed(*edits, ('effort="150"', 'effort="40"'))
    assert {f.density for f in heavy.draft.findings} == {1000.0}
    (density,) = {f.density for f in weak.draft.findings}
    assert 300.0 <= density < 1000.0
    assert weak.draft.inertias["l2"].mass == pytest.approx(density * 0.08 * 0.06 * 0.46, rel=1e-6)
    told = {f.link: f.sentence for f in weak.draft.findings}["l2"]
    assert told.endswith(
        f"of its hull at {density:.4g} kg/m³, a guess, light enough for the torques of the URDF"
    )
    model = RobotModel(weak.robot)
    stretched = np.abs(model.gravity(np.array([0.0, 1.57, 0.0, 0.0, 0.0, 0.0])))
    assert 20.0 < stretched[1] < 40.0 / 1.4
    assert [limit.torque for limit in weak.draft.limits][:2] == [40.0, 40.0]


def test_poses_of_a_large_arm_are_inside_of_the_workspace(proposed: Proposed) -> None:
    made = proposed(('<origin xyz="0 0 0.4"/>', '<origin xyz="0 0 1.0"/>'),
                    ('<origin xyz="0 0 0.3"/>', '<origin xyz="0 0 0.9"/>'))  # fmt: skip
    model = RobotModel(made.robot)
    for pose in made.draft.poses:
        x, y, z = model.tcp(np.array(pose.joints)).position
        assert -0.2 < x < 0.9 and -0.9 < y < 0.9 and 0.0 < z < 1.2, pose.name


def test_a_gripper_that_opens_too_little_is_told_so(proposed: Proposed) -> None:
    gripper = proposed().robot.gripper
    block = BeliefObject(
        "block",
        "box",
        Box((0.04, 0.04, 0.04)),
        "red",
        Pose((0.5, 0.0, 0.02)),
        0.001,
        0.01,
        1.0,
        0.0,
        id=ObjectId("red_block_1"),
        place="table",
    )
    assert opening_advice(replace(gripper, max_width=0.047), block, "arm.yaml") is None
    assert opening_advice(replace(gripper, max_width=0.021), block, "arm.yaml") == (
        "the gripper opens 21 mm; the block is 40 mm wide, and needs 46 mm",
        "look at 'max_width' in arm.yaml; if it is right, mount another gripper, or write a scene "
        "with smaller items",
    )


@pytest.mark.parametrize(
    ("cause", "message", "change"),
    [
        (
            "planning.goal_in_collision",
            "at the goal l3 is 6.6 mm deep in red_bin",
            "choose other 'poses:' in arm.yaml, or move its 'base:', so that l3 keeps away from red_bin",
        ),
        (
            "planning.goal_in_collision",
            "at the goal l3 is 6.6 mm deep in l1",
            "look at the collision geometry of l1 and l3 in the URDF, and at 'disabled_pairs:' in arm.yaml",
        ),
        (
            "grasp.no_candidate",
            "none of 16 grasps is free: 16 at the grasp l3 would be only 2.0 mm from table",
            "look at the collision geometry of l3 in the URDF, and at 'tip', 'palm' and 'hand' under "
            "'gripper:' in arm.yaml: it touches table",
        ),
        (
            "safety.stop",
            "a safety stop is not acknowledged: the tool is 3 mm outside the workspace",
            "choose 'poses:' in arm.yaml with the tool inside of the scene's workspace, or move 'base:'",
        ),
        (
            "safety.torque_limit",
            "j1 has exerted 1.0 Nm for 0.5 s, of 1 Nm that it bears",
            "compare 'torque' under 'joints:' in arm.yaml with the data sheet, and masses under 'inertias:'",
        ),
        ("world.disturbed", "touched something", "look at 'joints:' in arm.yaml"),
    ],
)
def test_the_advice_fits_the_cause(cause: str, message: str, change: str) -> None:
    assert advice(cause, message, "arm.yaml", ("base", "l1", "l3"), ("table", "red_bin")) == change


def test_meshes_are_found_in_ros_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def placed(file: Path, text: str = "") -> Path:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
        return file

    urdf = tmp_path / "here" / "mini.urdf"
    named = "<package><name>arm_description</name></package>"
    placed(tmp_path / "ws" / "src" / "folder" / "package.xml", named)
    mesh = placed(tmp_path / "ws" / "src" / "folder" / "meshes" / "a.stl")
    placed(tmp_path / "ws" / "off" / "COLCON_IGNORE")
    placed(tmp_path / "ws" / "off" / "lost" / "package.xml", "<package><name>lost</name></package>")
    placed(tmp_path / "ws" / "off" / "lost" / "a.stl")
    shared = placed(tmp_path / "jazzy" / "share" / "hand_description" / "meshes" / "b.stl")
    assert mesh_file(urdf, "package://arm_description/meshes/a.stl") is None
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path}/gone:{tmp_path}/ws")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path}/jazzy")
    assert mesh_file(urdf, "package://arm_description/meshes/a.stl") == mesh
    assert mesh_file(urdf, "package://hand_description/meshes/b.stl") == shared
    assert mesh_file(urdf, "package://folder/meshes/a.stl") is None
    assert mesh_file(urdf, "package://lost/a.stl") is None
    # What is beside the URDF comes first: the environment changes no robot that works without it.
    own = placed(tmp_path / "arm_description" / "meshes" / "a.stl")
    assert mesh_file(urdf, "package://arm_description/meshes/a.stl") == own
