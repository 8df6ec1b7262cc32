"""Checking a mission as a whole: scene, robot, and the names that they give."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent

from picktree.trees.check import MissionCheck, check_mission
from picktree.world.files.document import parse_document


def check(text: str, folder: Path = Path()) -> MissionCheck:
    whole = "picktree: 1\nkind: mission\n" + dedent(text).lstrip("\n")
    return check_mission(parse_document(whole, folder / "mission.yaml", "mission"))


def faults(text: str, folder: Path = Path()) -> list[str]:
    prefix = f"{folder / 'mission.yaml'}:"
    return [f"{fault.code} {str(fault).removeprefix(prefix)}" for fault in check(text, folder).faults]


def test_a_mission_without_a_fault_is_given_back() -> None:
    checked = check("scene: three_bins\ntrees: {Main: {GoTo: {pose: home}}}")
    assert checked.mission is not None
    assert checked.faults == ()
    assert checked.mission.scene == "three_bins"


def test_a_camera_that_the_scene_does_not_have() -> None:
    text = """
    scene: three_bins
    trees:
      Main:
        Sequence:
          - Observe: {camera: overhed, objects: "{a}"}
          - GoTo: {pose: hme}
          - Place: {object: x, into: red}
    """
    assert faults(text) == [
        "P240 7:27: Main/Sequence/Observe: port 'camera': the scene 'three_bins' has no camera 'overhed' "
        "(did you mean 'overhead'?)",
        "P240 8:22: Main/Sequence/GoTo: port 'pose': the robot 'panda' has no pose 'hme' "
        "(did you mean 'home'?)",
        "P240 9:34: Main/Sequence/Place: port 'into': the scene 'three_bins' has no bin 'red' "
        "(did you mean 'red_bin'?)",
    ]


def test_a_scene_that_is_not_there() -> None:
    assert faults("scene: three_bin\ntrees: {Main: AlwaysSuccess}") == [
        "P241 3:8: scene: unknown scene 'three_bin' (did you mean 'three_bins'?)"
    ]


def test_faults_of_the_scene_come_with_those_of_the_mission(tmp_path: Path) -> None:
    (tmp_path / "cell.yaml").write_text("picktree: 1\nkind: scene\nrobot: pandaa\n")
    checked = check("scene: cell.yaml\ntrees: {Main: GoT}", tmp_path)
    assert checked.mission is None
    assert [str(fault).removeprefix(f"{tmp_path}/") for fault in checked.faults] == [
        "cell.yaml:3:8: robot: unknown robot 'pandaa' (did you mean 'panda'?)",
        "mission.yaml:4:15: Main: unknown node 'GoT' (did you mean 'GoTo'?)",
    ]


def test_names_are_checked_in_a_mission_that_has_other_faults() -> None:
    text = "scene: three_bins\ntrees: {Main: {Sequence: [{GoTo: {pose: hme}}, Gto]}}"
    assert faults(text) == [
        "P240 4:41: Main/Sequence/GoTo: port 'pose': the robot 'panda' has no pose 'hme' "
        "(did you mean 'home'?)",
        "P207 4:48: Main/Sequence: unknown node 'Gto' (did you mean 'GoTo'?)",
    ]
