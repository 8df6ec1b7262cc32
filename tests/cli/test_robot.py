"""picktree robot: files proposed for URDFs, explanations where there is nothing to propose."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from picktree.analysis import resim
from picktree.analysis import resim as child
from picktree.apps.cli import answer
from picktree.apps.cli.file_schemas import CHECKS
from picktree.apps.commissioning import ProposalRequest, propose
from picktree.files.file_checks import check_files
from picktree.world.robot_model import RobotModel, load_robot
from picktree.world.robot_model.urdf_parser import UrdfMesh, link_geometry

PANDA = "pybullet_data:franka_panda/panda.urdf"
URDF = "an XML file <robot> with <link> and <joint> elements that form one tree"
LIMIT = '<limit lower="-2" upper="2" effort="20" velocity="2"/>'


def chain(*joints: str, more: str = "") -> str:
    """A URDF of links a0, a1, …, each hung on the one before by a joint of that type."""
    links = "".join(f'<link name="a{k}"/>' for k in range(len(joints) + 1))
    held = "".join(
        f'<joint name="j{k}" type="{kind}"><parent link="a{k - 1}"/><child link="a{k}"/><axis xyz="0 0 1"/>'
        f"{'' if kind in ('fixed', 'continuous') else LIMIT}</joint>"
        for k, kind in enumerate(joints, 1)
    )
    return f'<robot name="chain">{links}{held}{more}</robot>'


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What `picktree robot new` says of something it cannot use."""
    assert answer(["robot", "new", *arguments]) == 2
    return capsys.readouterr().err


def test_the_proposal_for_the_panda_agrees_with_the_shipped_file(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    assert answer(["robot", "new", PANDA, "-o", str(file), "--samples", "3000", "--json"]) == 0
    assert check_files([file], CHECKS).faults == ()
    made, shipped = load_robot(str(file)), load_robot("panda")
    assert (made.joints, made.flange_joint, made.tcp_link) == (
        shipped.joints,
        shipped.flange_joint,
        shipped.tcp_link,
    )
    assert [(j.lower, j.upper, j.velocity, j.torque) for j in made.limits] == [
        (j.lower, j.upper, j.velocity, j.torque) for j in shipped.limits
    ]
    assert made.tcp_in_link.position == pytest.approx(shipped.tcp_in_link.position, abs=1e-4)
    ours, theirs = made.gripper, shipped.gripper
    assert (ours.joints, ours.fingers, ours.gear) == (theirs.joints, theirs.fingers, theirs.gear)
    assert (ours.tip, ours.palm, ours.max_width) == pytest.approx(
        (theirs.tip, theirs.palm, theirs.max_width), abs=3e-4
    )
    for (box, pose), (other, other_pose) in zip(ours.pads, theirs.pads, strict=True):
        assert box.size == pytest.approx(other.size, abs=5e-4)
        assert pose.position == pytest.approx(other_pose.position, abs=5e-4)
    pairs = {frozenset(pair) for pair in made.disabled_pairs}
    known = {frozenset(pair) for pair in shipped.disabled_pairs}
    within = {frozenset(p) for p in shipped.disabled_pairs if set(p) <= {"panda_hand", *theirs.fingers}}
    # Pairs that are near each other as neighbours are: one joint further, always checked by the proposal.
    assert known - within - pairs <= {
        frozenset(("panda_link5", "panda_link7")),
        frozenset(("panda_link7", "panda_hand")),
        frozenset(("panda_link2", "panda_link6")),  # 7 of 10,000
    }
    # What sampling found never to collide is what the shipped file says, too.
    assert pairs <= known
    for pose in ("home", "observe", "rest"):
        assert np.all(np.array(made.named[pose]) > [j.lower for j in made.limits])


def test_a_proposal_is_the_same_each_time_and_says_where_things_come_from(tmp_path: Path) -> None:
    wish = ProposalRequest(
        "pybullet_data:xarm/xarm6_with_gripper.urdf", tmp_path / "arm.yaml", samples=300, seed=4
    )
    first, second = propose(wish), propose(wish)
    assert first.text == second.text
    found = [(f.link, f.kind) for f in first.draft.findings]
    assert found == [("link2", "impossible"), ("link3", "impossible")]
    assert "# Angles: the URDF's limits, each moved inwards by 2.0 deg." in first.text
    assert "# Never in collision in any sample." in first.text
    gripper, shipped = first.robot.gripper, load_robot("xarm6").gripper
    assert gripper.linkage is not None
    assert shipped.linkage is not None
    assert gripper.joints == shipped.joints
    # The shipped pads stand for the rubber that the meshes lack, 0.8 mm each.
    assert gripper.max_width - shipped.max_width == pytest.approx(0.0016, abs=3e-4)
    assert first.robot.tcp_in_link.position[2] == pytest.approx(0.155, abs=2e-3)
    assert gripper.tip == pytest.approx(shipped.tip, abs=2e-3)
    # Between the fingers the knuckles stand out from the palm, by the links' own meshes.
    model = RobotModel(first.robot)
    ahead = -np.inf
    for opening in np.linspace(0.02, gripper.max_width, 6).tolist():
        tcp, poses = model.tcp(model.named("home")), model.link_poses(model.named("home"), opening)
        for mesh in link_geometry(first.robot.urdf, "collision"):
            if isinstance(mesh, UrdfMesh) and "knuckle" in mesh.link:
                vertices = np.asarray(trimesh.load(mesh.path, force="mesh").vertices)
                points = (tcp.inverse() @ poses[mesh.link] @ mesh.pose_in_link).apply(vertices)
                inside = points[(np.abs(points[:, 1]) < opening / 2) & (np.abs(points[:, 0]) < 0.01)]
                ahead = max(ahead, inside[:, 2].max(initial=-np.inf))
    assert -0.05 < ahead < -gripper.palm


def test_a_hand_is_mounted_on_an_arm_without(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm, file, picture = "pybullet_data:kuka_iiwa/model.urdf", tmp_path / "kuka.yaml", tmp_path / "kuka.png"
    said = refused(capsys, arm, "-o", str(file))
    assert said == (
        f"{arm}: no robot file can be made of it\n"
        "  found    an arm of 7 joints, lbr_iiwa_joint_1 to lbr_iiwa_joint_7, "
        "with 'lbr_iiwa_link_7' at its end\n"
        "  missing  a gripper with two fingers that move against each other\n"
        "  helps    --gripper URDF:LINK --mount lbr_iiwa_link_7 mounts one, as the Franka hand: --gripper "
        "pybullet_data:franka_panda/panda.urdf:panda_hand\n"
    )
    assert not file.exists()
    hand = ["--gripper", f"{PANDA}:panda_hand", "--mount", "lbr_iiwa_link_7", "--samples", "200"]
    assert answer(["robot", "new", arm, "-o", str(file), *hand, "--picture", str(picture)]) == 0
    assert "kuka: an arm of 7 joints" in capsys.readouterr().out
    made, shipped = load_robot(str(file)), load_robot("iiwa")
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert made.tcp_in_link.position == pytest.approx(shipped.tcp_in_link.position)
    assert 'joint name="mount"' in Path(made.urdf).read_text(encoding="utf-8")
    assert refused(capsys, arm, "-o", str(file)) == f"{file} is there already; --force writes over it\n"


def test_what_xacro_left_in_a_urdf_is_no_matter(tmp_path: Path) -> None:
    text = Path(load_robot("panda").urdf).read_text(encoding="utf-8")
    left = '<xacro:property name="width" value="0.2"/><gazebo><file>$(find my_arm)/a.yaml</file></gazebo>'
    text = text.replace("</robot>", f"<!-- ${{width}} -->{left}</robot>")
    meshes = Path(load_robot("panda").urdf).parent / "meshes"
    (tmp_path / "arm.urdf").write_text(text.replace("package://meshes", str(meshes)), encoding="utf-8")
    arguments = ["robot", "new", str(tmp_path / "arm.urdf"), "-o", str(tmp_path / "arm.yaml")]
    assert answer([*arguments, "--samples", "200", "--no-test"]) == 0


@pytest.mark.parametrize(
    ("urdf", "found", "missing"),
    [
        (chain("fixed"), "2 links and no joint that moves", "an arm"),
        (
            chain(*["revolute"] * 3, "prismatic"),
            "a chain of 3 joints that turn and 1 that slide: j1, j2, j3, j4",
            "an arm that puts its tool anywhere, upright and turned: 5 joints at least, better 6",
        ),
        (
            chain(*["continuous"] * 6),
            "6 joints that all turn without end: j1, j2, j3, j4, j5, j6",
            "joints with limits: this looks like wheels or a toy",
        ),
        (
            chain("prismatic", *["revolute"] * 6),
            "an arm of 6 hinges behind the sliding joint j1",
            "an arm whose joints all turn",
        ),
        (
            chain("floating", *["revolute"] * 6),
            "the joint 'j1' is floating: the robot drives, flies or walks",
            "an arm on a base that does not move",
        ),
        (
            chain(*["revolute"] * 6).replace(LIMIT, "", 1),
            "a file that cannot be used as a URDF: joint 'j1' is revolute and has no <limit>; write it, as "
            '<limit lower="-3" upper="3" effort="50" velocity="2"/>',
            URDF,
        ),
        (
            "<robot",
            "a file that cannot be used as a URDF: not readable as XML: unclosed token: line 1, column 0",
            URDF,
        ),
        (
            '<robot xmlns:xacro="x"><xacro:arm/></robot>',
            "a xacro template, from which a URDF is made",
            "the URDF itself",
        ),
        (
            chain(*["revolute"] * 6, more='<link name="b"/>').replace(
                '<link name="a6"/>',
                '<link name="a6"><collision><geometry><mesh filename="package://my_arm/a.stl"/></geometry>'
                "</collision></link>",
            ).replace('<link name="b"/>', ""),
            "1 meshes that are not there: package://my_arm/a.stl",
            "their files",
        ),
    ],
    ids=["a rock", "a SCARA", "wheels", "a lift", "a drone", "no limits", "no XML", "xacro", "no meshes"],
)  # fmt: skip
def test_what_is_no_arm_gets_an_explanation(
    urdf: str, found: str, missing: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "thing.urdf").write_text(urdf, encoding="utf-8")
    said = refused(capsys, str(tmp_path / "thing.urdf"), "-o", str(tmp_path / "robot.yaml"))
    lines = said.splitlines()
    assert lines[0] == f"{tmp_path}/thing.urdf: no robot file can be made of it"
    assert lines[1] == f"  found    {found}"
    assert lines[2] == f"  missing  {missing}"
    assert lines[3].startswith("  helps    ")
    assert not (tmp_path / "robot.yaml").exists()


@pytest.mark.parametrize(
    ("urdf", "found"),
    [
        ("laikago/laikago.urdf", "4 limbs of about the same length (legs, or arms without grippers): "),
        ("pr2_gripper.urdf", "chains of 1 joint at most: "),
        ("husky/husky.urdf", "a xacro template, from which a URDF is made"),
    ],
)
def test_robots_of_other_kinds_get_an_explanation(
    urdf: str, found: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(capsys, f"pybullet_data:{urdf}", "-o", str(tmp_path / "robot.yaml"))
    assert said.splitlines()[1].startswith(f"  found    {found}")


def test_show_tells_what_a_robot_file_says(capfd: pytest.CaptureFixture[str]) -> None:
    assert answer(["robot", "show", "xarm6"]) == 0
    shown = capfd.readouterr().out
    assert "xarm6: an arm of 6 joints" in shown
    assert "gripper     xarm_gripper_base_link: opens 87 mm, presses 30 N, weighs 0.75 kg" in shown
    assert answer(["robot", "show", "xarm6", "--json"]) == 0
    said = json.loads(capfd.readouterr().out)
    assert (said["name"], len(said["joints"]), said["poses"]) == ("xarm6", 6, ["home", "observe", "rest"])
    assert answer(["robot", "show", "xarm66"]) == 2
    assert capfd.readouterr().err == "unknown robot 'xarm66' (did you mean 'xarm6'?)\n"


@pytest.mark.parametrize("robot", ["xarm6", "iiwa", "gen3", "ur10e"])
def test_one_pick_on_each_arm(
    robot: str, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    mission = Path(__file__).parents[2] / "examples" / "one_pick.yaml"
    arguments = [
        "run",
        str(mission),
        "--robot",
        robot,
        "--backend",
        "kinematic",
        "--out",
        str(tmp_path),
        "--json",
    ]
    assert answer(arguments) == 0
    said = json.loads(capfd.readouterr().out)
    assert (said["status"], said["items"]["sorted"], said["picks"]["held"]) == ("success", 1, 1)
    # What a run of an arm is made from is in its log; that it runs in another process is not the matter here.
    monkeypatch.setattr(
        resim, "_run_in_process", lambda order, _: child.run_order(order, lambda answer: None)
    )
    assert answer(["resim", said["folder"]]) == 0
    assert f"digest {said['digest'][:16]}" in capfd.readouterr().out
