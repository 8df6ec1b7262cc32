"""picktree robot test: a verdict a line, and what spoils a robot is found and named."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.apps.cli import answer
from picktree.apps.cli.file_schemas import CHECKS
from picktree.apps.commissioning.model_checks import RobotUnderTest, Verdict, check_model
from picktree.files.file_checks import check_files
from picktree.robot.perception import hidden_shares
from picktree.world.robot_model import RobotModel, load_robot
from picktree.world.robot_model.robot_file import SHIPPED, robot_names
from picktree.world.robot_model.urdf_parser import mesh_file, parsed_urdf
from picktree.world.scene import MAX_HIDDEN_SHARE, load_scene
from picktree.world.scene.scene_loading import scene_names

EXAMPLES = Path(__file__).parents[2] / "examples"
HIDING = "  home: [0, 0.05, 0, -1.75, 0, 1.8, 0.785]"
"""Line of a Panda's file: a home before the overhead camera."""
MASSES, LIMITS, HOME, FINGERS, TOOL = "masses", "limits", "home", "fingers", "tool frame"


def panda_urdf() -> ElementTree.Element:
    """Return the Panda's URDF with full paths of its meshes."""
    urdf = Path(load_robot("panda").urdf)
    root = parsed_urdf(urdf)
    for mesh in root.iter("mesh"):
        mesh.set("filename", str(mesh_file(urdf, mesh.get("filename", ""))))
    return root


def panda(
    folder: Path, urdf: Callable[[ElementTree.Element], None] = lambda root: None, **lines: str
) -> Path:
    """Write a Panda whose URDF was changed, and whose file has other lines that begin with these words."""
    root = panda_urdf()
    urdf(root)
    ElementTree.ElementTree(root).write(folder / "arm.urdf")
    text = (SHIPPED / "panda.yaml").read_text(encoding="utf-8")
    for word, line in {"urdf": "urdf: arm.urdf", **lines}.items():
        old = next(each for each in text.splitlines() if each.strip().startswith(f"{word}:"))
        text = text.replace(old, line, 1)
    (folder / "arm.yaml").write_text(text, encoding="utf-8")
    return folder / "arm.yaml"


def failed(file: Path) -> list[Verdict]:
    return [v for v in check_model(RobotUnderTest.of(load_robot(str(file)))) if not v.good]


def one(root: ElementTree.Element, kind: str, name: str) -> ElementTree.Element:
    return next(each for each in root.findall(kind) if each.get("name") == name)


def child(element: ElementTree.Element, tag: str) -> ElementTree.Element:
    found = element.find(tag)
    assert found is not None
    return found


def test_a_good_robot_passes(tmp_path: Path) -> None:
    assert failed(panda(tmp_path)) == []


@pytest.mark.parametrize("name", ["xarm6", "iiwa", "gen3", "ur10e"])
def test_the_models_of_shipped_robots_pass(name: str) -> None:
    assert [v for v in check_model(RobotUnderTest.of(load_robot(name))) if not v.good] == []


def without_inertia(root: ElementTree.Element) -> None:
    link = one(root, "link", "panda_link4")
    link.remove(child(link, "inertial"))


def tight_limits(root: ElementTree.Element) -> None:
    child(one(root, "joint", "panda_joint2"), "limit").set("effort", "8.7")
    child(one(root, "joint", "panda_joint4"), "limit").set("lower", "-1")


def swapped_fingers(root: ElementTree.Element) -> None:
    for name, axis in (("panda_finger_joint1", "0 -1 0"), ("panda_finger_joint2", "0 1 0")):
        child(one(root, "joint", name), "axis").set("xyz", axis)


def turned_hand(root: ElementTree.Element) -> None:
    child(one(root, "joint", "panda_hand_joint"), "origin").set("rpy", "3.14159265 0 -0.785398")


def as_it_is(root: ElementTree.Element) -> None: ...


@pytest.mark.parametrize(
    ("spoil", "lines", "name", "measured", "change"),
    [
        (without_inertia, {}, MASSES, "panda_link4 has no <inertial>, but a joint moves it",
         "give panda_link4 a correct <inertial> in the URDF, or an entry under 'inertias:'"),
        (tight_limits, {}, LIMITS, "panda_joint2 exerts 87 Nm, beyond the URDF's 8.7 Nm", "'joints:'"),
        (tight_limits, {}, LIMITS,
         "panda_joint4 turns from -3.0718 to -0.0698 rad, beyond the URDF's -1 … ", "'joints:'"),
        (as_it_is, {"panda_joint2": "  panda_joint2: {lower: -1.7, upper: 1.7, velocity: 2.175, "
                    "acceleration: 7.5, torque: 20}"},
         LIMITS, "panda_joint2 exerts 20 Nm, and gravity alone needs ", ""),
        (as_it_is, {"home": "  home: [0, -1.7, 0, -3.05, 0, 0.4, 0.785]"}, HOME, " mm in each other",
         "'home' under 'poses:'"),
        (swapped_fingers, {}, FINGERS, "panda_leftfinger is on the TCP's -y side", "under 'gripper:'"),
        (as_it_is, {"tcp": "tcp: {link: panda_hand, at: [0, 0, 0.16]}"}, TOOL,
         "between the pads is at 0.0, 0.0, -5", "'at:'"),
        (as_it_is, {"tcp": "tcp: {link: panda_hand, at: [0.03, 0, 0.105]}"}, TOOL,
         "between the pads is at -30.0,", "'at:'"),
        (as_it_is, {"tcp": "tcp: {link: panda_hand, at: [0, 0, 0.105], rpy: [0, 180 deg, 0]}"}, TOOL,
         "points back", "'rpy:'"),
        (turned_hand, {}, TOOL, "the hand points back at the arm", ""),
    ],
)  # fmt: skip
def test_what_spoils_a_robot_is_named(
    spoil: Callable[[ElementTree.Element], None],
    lines: dict[str, str],
    name: str,
    measured: str,
    change: str,
    tmp_path: Path,
) -> None:
    found = {verdict.name: verdict for verdict in failed(panda(tmp_path, spoil, **lines))}
    if name in (MASSES, LIMITS, HOME):
        assert list(found) == [name]
    assert measured in found[name].measured
    assert change in found[name].change and "arm.yaml" in found[name].change


def test_the_trials_in_physics_give_a_table_and_a_page(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    # The hand hangs before the camera.
    file = panda(tmp_path, home=HIDING)
    assert answer(["robot", "test", str(file), "--page", str(tmp_path / "arm.html")]) == 1
    shown = capfd.readouterr().out
    for name in ("effort at rest", "track", "brake", "soft retreat", "open and close"):
        assert f"  ok      {name:<14}  " in shown
    assert "  FAILED  camera's view   overhead: the arm hides " in shown
    assert "to change: choose another 'home' under 'poses:' in arm.yaml" in shown
    page = (tmp_path / "arm.html").read_text(encoding="utf-8")
    assert "<h1>Self-test of arm</h1>" in page
    assert page.count("<td class=good>ok</td>") == shown.count("  ok      ")
    assert "data:image/png;base64," in page


def test_a_new_robot_is_tested(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    made = ["robot", "new", "pybullet_data:franka_panda/panda.urdf", "-o", str(tmp_path / "arm.yaml")]
    assert answer([*made, "--samples", "500", "--json"]) == 0
    said = json.loads(capfd.readouterr().out)
    assert [v["name"] for v in said["test"]["verdicts"] if not v["good"]] == []


def test_a_urdf_with_four_faults_is_made_a_robot_whose_test_names_each(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    root = panda_urdf()
    for spoil in (without_inertia, swapped_fingers, turned_hand):
        spoil(root)
    child(one(root, "joint", "panda_joint2"), "limit").set("effort", "8.7")
    ElementTree.ElementTree(root).write(tmp_path / "spoilt.urdf")
    arguments = ["robot", "new", str(tmp_path / "spoilt.urdf"), "-o", str(tmp_path / "arm.yaml")]
    assert answer([*arguments, "--samples", "500"]) == 0
    shown = capfd.readouterr().out
    for told in (
        "panda_link4: has no <inertial>, but a joint moves it",
        "FAILED  limits          panda_joint2 exerts 8.7 Nm, and gravity alone needs 51",
        "FAILED  fingers         the fingers pass 51 mm through each other at the end of their joints' range",
        "to change: mend <axis> of the fingers' joints in the URDF, which look swapped",
        "FAILED  tool frame      the hand points back at the arm",
    ):
        assert told in shown
    # The hand is turned into the arm: open fingers would touch a link at a home where shut ones do not.
    assert "start_in_collision" not in shown


def test_a_run_that_sees_nothing_says_that_the_arm_is_in_the_way(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = panda(tmp_path, home=HIDING)
    mission = EXAMPLES / "sort_by_colour.yaml"
    scene = tmp_path / "hidden.yaml"
    scene.write_text(
        "picktree: 1\nkind: scene\nbase: three_bins\nspawn:\n  - of: {block: 1}\n    colours: [red]\n"
        "    area: {min: [0.48, -0.04], max: [0.56, 0.04]}\n",
        encoding="utf-8",
    )
    arguments = ["run", str(mission), "--scene", str(scene), "--robot", str(file), "--out", str(tmp_path)]
    assert answer([*arguments, "--backend", "kinematic"]) == 1
    shown = capfd.readouterr().out
    assert (
        "incomplete: the tree ended in SUCCESS, but the goal is missed: the arm hides the place of the items"
        in shown
    )
    assert "'home' under 'poses:' in arm.yaml" in shown
    (folder,) = tmp_path.glob("sort_by_colour-*")
    assert answer(["explain", str(folder), "--json"]) == 0
    (cause,) = json.loads(capfd.readouterr().out)["root_causes"]
    assert (cause["cause"], cause["ended_run"]) == ("arm.hides_items", True)
    assert cause["title"] == "the arm hides items on the table from the camera overhead"
    assert "the image of 0.15 s shows the arm there" in cause["reasons"][0]
    assert "'home' under 'poses:' in the robot file of arm" in cause["reasons"][2]


def test_a_run_that_fails_and_has_seen_nothing_says_so_too(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = panda(tmp_path, home=HIDING)
    mission = tmp_path / "look.yaml"
    mission.write_text(
        "picktree: 1\nkind: mission\nscene: sort_small\ntrees:\n  Main:\n    Sequence:\n"
        '      - Observe: {objects: "{items}"}\n      - AlwaysFailure\n',
        encoding="utf-8",
    )
    for robot, told in ((str(file), True), ("panda", False)):
        arguments = ["run", str(mission), "--robot", robot, "--out", str(tmp_path), "--backend", "kinematic"]
        answer(arguments)
        assert ("the arm hides the place of the items, 100 % from overhead" in capfd.readouterr().out) is told


def test_of_two_items_the_one_behind_the_arm_is_explained_by_the_arm(tmp_path: Path) -> None:
    file = panda(tmp_path, home="  home: [0.2, 0, 0, -2, 0, 2, 0.785]")
    (tmp_path / "partly.yaml").write_text(
        "picktree: 1\nkind: scene\nbase: three_bins\nspawn:\n"
        "  - {of: {block: 1}, colours: [red], area: {min: [0.42, -0.12], max: [0.44, -0.1]}}\n"
        "  - {of: {ball: 1}, colours: [red], area: {min: [0.44, 0.18], max: [0.46, 0.2]}}\n",
        encoding="utf-8",
    )
    mission = EXAMPLES / "sort_by_colour.yaml"
    arguments = ["run", str(mission), "--scene", str(tmp_path / "partly.yaml"), "--robot", str(file)]
    answer([*arguments, "--backend", "kinematic", "--out", str(tmp_path)])
    with Run(next(tmp_path.glob("sort_by_colour-*"))) as run:
        (cause,) = run.explanation.root_causes
    assert (cause.cause, cause.items) == ("arm.hides_items", ("the red ball (item_01)",))


def test_the_arm_is_not_blamed_for_what_a_fixture_hides(tmp_path: Path) -> None:
    (tmp_path / "roof.yaml").write_text(
        "picktree: 1\nkind: scene\nbase: three_bins\nfixtures:\n"
        "  roof: {box: [0.24, 0.12, 0.02], at: [0.5, -0.18, 0.3]}\nspawn:\n"
        "  - {of: {ball: 1}, colours: [red], area: {min: [0.5, -0.29], max: [0.51, -0.28]}}\n",
        encoding="utf-8",
    )
    mission = EXAMPLES / "sort_by_colour.yaml"
    arguments = ["run", str(mission), "--scene", str(tmp_path / "roof.yaml"), "--backend", "kinematic"]
    answer([*arguments, "--out", str(tmp_path)])
    with Run(next(tmp_path.glob("sort_by_colour-*"))) as run:
        (cause,) = run.explanation.root_causes
    assert cause.cause == "item.never_seen"


def check(*files: Path) -> list[tuple[str, int, str]]:
    """File, line and sentence of each finding of `picktree check`."""
    faults = check_files(files, CHECKS).faults
    assert {(fault.code, fault.severity) for fault in faults} <= {("P514", "warning")}
    return [
        (Path(fault.mark.file).name, fault.mark.line, f"{fault.message} ({fault.hint})") for fault in faults
    ]


def test_a_home_that_hides_the_items_is_found_in_robot_scene_and_mission(tmp_path: Path) -> None:
    robot, scene, mission = panda(tmp_path, home=HIDING), tmp_path / "cell.yaml", tmp_path / "look.yaml"
    scene.write_text("picktree: 1\nkind: scene\nbase: three_bins\nrobot: arm.yaml\n", encoding="utf-8")
    mission.write_text(
        "picktree: 1\nkind: mission\nscene: cell.yaml\ntrees:\n  Main:\n    Observe\n", encoding="utf-8"
    )
    line = robot.read_text(encoding="utf-8").splitlines().index(HIDING) + 1
    hint = "choose another 'home' under 'poses:' in arm.yaml, or move the camera; at most 25 % may be hidden"
    told = "the arm of 'arm' at 'home' hides where the items {}are: 100 % from overhead ({})"
    in_robot = ("arm.yaml", line, told.format("of the scene 'self_test' ", hint))
    in_scene = ("cell.yaml", 4, told.format("", hint))
    assert check(robot) == [in_robot]
    assert check(scene) == [in_scene]
    assert check(mission) == [in_scene]
    assert check(robot, scene, mission) == [in_robot, in_scene]


def test_a_second_camera_that_sees_the_items_or_another_home_is_enough(tmp_path: Path) -> None:
    scene = tmp_path / "cell.yaml"
    scene.write_text(
        "picktree: 1\nkind: scene\nbase: three_bins\nrobot: arm.yaml\ncameras:\n"
        "  front: {at: [1.4, 0, 0.6], look_at: [0.5, 0, 0], size: [320, 240], fov: 60 deg}\n",
        encoding="utf-8",
    )
    assert check(panda(tmp_path)) == []
    assert len(check(panda(tmp_path, home=HIDING))) == 1  # whatever the cache holds of the other home
    assert check(scene) == []
    assert check(panda(tmp_path)) == []


@pytest.mark.parametrize("name", robot_names())
def test_no_shipped_arm_hides_the_items_of_a_shipped_scene(name: str) -> None:
    model = RobotModel(load_robot(name))
    for scene in scene_names():
        shares = hidden_shares(model, load_scene(scene), model.named("home"))
        assert min(shares.values(), default=0.0) <= MAX_HIDDEN_SHARE, scene
