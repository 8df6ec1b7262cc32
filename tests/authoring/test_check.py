"""Checking a mission as a whole: scene, robot, and the names that they give."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent

from picktree.authoring import MissionCheck, check_mission
from picktree.files.yaml import read_document
from picktree.trees import LIBRARY


def check(text: str, folder: Path = Path()) -> MissionCheck:
    whole = "picktree: 1\nkind: mission\n" + dedent(text).lstrip("\n")
    return check_mission(read_document(folder / "mission.yaml", "mission", whole))


def faults(text: str, folder: Path = Path()) -> list[str]:
    prefix = f"{folder / 'mission.yaml'}:"
    found = [fault for fault in check(text, folder).faults if fault.severity == "error"]
    return [f"{fault.code} {str(fault).removeprefix(prefix)}" for fault in found]


def test_a_mission_without_a_fault_is_given_back() -> None:
    checked = check("scene: three_bins\ntrees: {Main: AlwaysSuccess}")
    assert checked.mission is not None
    assert checked.faults == ()
    assert checked.mission.scene == "three_bins"


def test_names_that_the_scene_does_not_have_are_said_beside_other_faults() -> None:
    text = """
    scene: three_bins
    trees:
      Main:
        Sequence:
          - Observe: {camera: overhed, objects: "{a}"}
          - GoTo: {pose: hme}
          - Place: {object: x, into: red}
          - Gto
    """
    assert faults(text) == [
        "P240 7:27: Main/Sequence/Observe: port 'camera': the scene 'three_bins' has no camera 'overhed' "
        "(did you mean 'overhead'?)",
        "P240 8:22: Main/Sequence/GoTo: port 'pose': the robot 'panda' has no pose 'hme' "
        "(did you mean 'home'?)",
        "P240 9:34: Main/Sequence/Place: port 'into': the scene 'three_bins' has no bin 'red' "
        "(did you mean 'red_bin'?)",
        "P207 10:9: Main/Sequence: unknown node 'Gto' (did you mean 'GoTo'?)",
    ]


def test_faults_of_the_scene_come_with_those_of_the_mission(tmp_path: Path) -> None:
    (tmp_path / "cell.yaml").write_text("picktree: 1\nkind: scene\nrobot: pandaa\n")
    checked = check("scene: cell.yaml\ntrees: {Main: GoT}", tmp_path)
    assert checked.mission is None
    assert [str(fault).removeprefix(f"{tmp_path}/") for fault in checked.faults] == [
        "cell.yaml:3:8: robot: unknown robot 'pandaa' (did you mean 'panda'?)",
        "mission.yaml:4:15: Main: unknown node 'GoT' (did you mean 'GoTo'?)",
    ]


def test_names_are_followed_over_keys_and_the_ports_of_sub_trees() -> None:
    text = """
    scene: three_bins
    trees:
      Main:
        ports: {rest: {type: string, default: hom}}
        Sequence:
          - {SetBlackboard: {value: overhed, output_key: "{eye}"}}
          - Observe: {camera: "{eye}", objects: "{items}"}
          - Look: {camera: side}
          - Look
          - GoTo: {pose: "{rest}"}
          - ForEach: {in: [red_bin, bleu_bin], out: "{bin}", do: {Place: {object: a, into: "{bin}"}}}
      Look:
        ports: {camera: {type: string, default: front}}
        Observe: {camera: "{camera}"}
    """
    assert faults(text) == [
        "P240 6:19: Main: port 'rest': the robot 'panda' has no pose 'hom', which is the default "
        "(did you mean 'home'?; the value goes to the port 'pose' of GoTo, line 12)",
        "P240 9:27: Main/Sequence/Observe: port 'camera': the scene 'three_bins' has no camera 'overhed' "
        "(did you mean 'overhead'?; Main/Sequence/SetBlackboard writes it, line 8)",
        "P240 10:24: Main/Sequence/Look: port 'camera': the scene 'three_bins' has no camera 'side' "
        "(known: overhead; the value goes to the port 'camera' of Observe, line 16)",
        "P240 11:9: Main/Sequence/Look#2: port 'camera': the scene 'three_bins' has no camera 'front', "
        "which is the default (known: overhead; the value goes to the port 'camera' of Observe, line 16)",
        "P240 13:88: Main/Sequence/ForEach/Place: port 'into': the scene 'three_bins' has no bin 'bleu_bin' "
        "(did you mean 'blue_bin'?; Main/Sequence/ForEach writes it, line 13)",
    ]


def test_what_an_attribute_can_be_is_known_from_the_scene() -> None:
    text = """
    scene: three_bins
    trees:
      Main:
        ports: {item: {type: object, doc: which}}
        Sequence:
          - Condition: {if: "item.kind == 'blok' or item.destination in ['red_bin']"}
          - Condition: {if: "item.destination in ['red_bin', 'black_bin']"}
          - Condition: {if: "item.destination == null or item.place == 'aside'"}
          - Switch:
              variable: "{item.destination}"
              cases: {red_bin: AlwaysSuccess, pink_bin: AlwaysSuccess, "null": AlwaysSuccess}
    """
    assert faults(text) == [
        "P240 8:39: Main/Sequence/Condition: port 'if': this is never 'blok'; did you mean 'block'?",
        "P240 9:58: Main/Sequence/Condition#2: port 'if': this is never 'black_bin'; did you mean "
        "'blue_bin'?",
        "P240 13:43: Main/Sequence/Switch: in the scene 'three_bins' {item.destination} is never 'pink_bin' "
        "(known: red_bin, green_bin, blue_bin, null)",
    ]


def test_a_tree_of_the_library_is_held_to_the_scene_where_it_is_used(tmp_path: Path) -> None:
    scene = "picktree: 1\nkind: scene\nbase: three_bins\ncameras: {overhead: null, eye: {at: [0.5, 0, 0.75], "
    (tmp_path / "cell.yaml").write_text(scene + "look_at: [0.5, 0, 0], size: [320, 240], fov: 60 deg}}\n")
    recovery = LIBRARY / "recovery.yaml"
    line = recovery.read_text().split("Observe:")[0].count("\n") + 1
    text = "scene: cell.yaml\ninclude: [library/recovery]\ntrees: {Main: {Sequence: [%s]}}"
    assert [fault for fault in faults(text % "AlwaysSuccess", tmp_path) if "P343" not in fault] == []
    assert faults(text % "LookAgain, {LookAgain: {camera: eye}}", tmp_path) == [
        "P240 5:27: Main/Sequence/LookAgain: port 'camera': the scene 'cell' has no camera 'overhead', which "
        f"is the default (known: eye; the value goes to the port 'camera' of Observe, line {line} "
        f"of {recovery})"
    ]


def test_a_tree_of_an_included_file_counts_where_the_mission_uses_it(tmp_path: Path) -> None:
    eyes = "picktree: 1\nkind: mission\nlibrary: true\ntrees: {Glance: {Observe: {camera: side}}}\n"
    (tmp_path / "eyes.yaml").write_text(eyes)
    text = "scene: three_bins\ninclude: [eyes.yaml]\ntrees: {Main: %s}"
    assert faults(text % "AlwaysSuccess", tmp_path) == []
    assert faults(text % "Glance", tmp_path) == [
        f"P240 {tmp_path}/eyes.yaml:4:36: Glance/Observe: port 'camera': the scene 'three_bins' has no "
        "camera 'side' (known: overhead)"
    ]
