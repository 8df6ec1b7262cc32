"""Fault files: their values, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.files import FileError
from picktree.simulation import load_faults, parse_faults
from picktree.simulation.fault_entries import (  # fmt: skip
    KINDS,
    Appear,
    AtNode,
    AtTime,
    Bump,
    CameraDrop,
    CameraMislabel,
    CameraNoise,
    CameraShift,
    FaultExpectation,
    FaultTarget,
    Friction,
    GripperJam,
    GripperWeak,
    Hang,
    Heavier,
    JointWeak,
    Kill,
    Larger,
    NoPlan,
    Raise,
    Remove,
    Slip,
    Stall,
    WrenchBias,
    WrenchDead,
)
from picktree.world.robot_model import load_robot
from picktree.world.scene import load_scene

HEAD = "picktree: 1\nkind: faults\nfaults:\n"
HERE = Path("f.yaml")


def test_faults_are_read(tmp_path: Path) -> None:
    text = (
        HEAD
        + "  - {fault: remove, when: {node: A/B, start: 2, delay: 300 ms}, target: {nearest_to: object}}\n"
        + "  - {fault: friction, when: {at: 3 s}, target: {index: 2}, friction: 0.05, mass: 500 g}\n"
        + "  - {fault: bump, when: {at: 0}, target: {kind: can, colour: red}, velocity: [0.3, 0, 20 cm/s]}\n"
    )
    (tmp_path / "f.yaml").write_text(text)
    read = load_faults(tmp_path / "f.yaml")
    assert read.faults == (
        Remove(AtNode("A/B", 2, 0.3), FaultTarget(nearest_to="object")),
        Friction(AtTime(3.0), FaultTarget(index=2), 0.05, 0.5),
        Bump(AtTime(0.0), FaultTarget(kind="can", colour="red"), (0.3, 0.0, 0.2)),
    )
    assert (read.source, read.text) == (str(tmp_path / "f.yaml"), text)
    assert parse_faults(text, tmp_path / "f.yaml") == read


ENTRIES = """
  - {fault: slip, when: {node: Place, each: true}, probability: 10 %, friction: 0.1, lasts: 300 ms}
  - {fault: appear, when: {at: 1, every: 30 s}, kind: can, colour: red, place: [0.5, 100 mm], yaw: 0.5}
  - {fault: heavier, when: {at: 1}, target: {index: 0}, mass: 600 g}
  - {fault: larger, when: {at: 1}, target: {index: 0}, factor: 1.2}
  - {fault: gripper_jam, when: {at: 1}, lasts: 2 s}
  - {fault: gripper_weak, when: {at: 1}, share: 20 %}
  - {fault: camera_drop, when: {at: 1}, camera: overhead, images: 3}
  - {fault: camera_shift, when: {at: 1}, shift: [8 mm, 0, 0]}
  - {fault: camera_noise, when: {at: 1}, factor: 5, lasts: 3 s}
  - {fault: camera_mislabel, when: {at: 1}, colour: red, shown_as: blue, swapped: true}
  - {fault: wrench_bias, when: {at: 1}, force: [0, 0, 5 N], torque: [100 mNm, 0, 0]}
  - {fault: wrench_dead, when: {at: 1}}
  - {fault: joint_weak, when: {at: 1}, joint: panda_joint4, share: 0.1, lasts: 1 s}
  - {fault: stall, when: {at: 1}, lasts: 1 s}
  - {fault: no_plan, when: {at: 1}, requests: 4}
  - {fault: hang, when: {node: Grasp}}
  - {fault: raise, when: {node: Grasp, start: 2, each: true}}
  - {fault: kill, when: {at: 9 s}}
"""


def test_every_kind_is_read() -> None:
    read = parse_faults(f"{HEAD}{ENTRIES}", HERE).faults
    at, first = AtTime(1.0), FaultTarget(index=0)
    assert read == (
        Slip(AtNode("Place", each=True), 0.1, lasts=0.3, probability=0.1),
        Appear(AtTime(1.0, every=30.0), "can", "red", (0.5, 0.1), 0.5),
        Heavier(at, first, 0.6),
        Larger(at, first, 1.2),
        GripperJam(at, lasts=2.0),
        GripperWeak(at, 0.2),
        CameraDrop(at, images=3, camera="overhead"),
        CameraShift(at, (0.008, 0.0, 0.0)),
        CameraNoise(at, 5.0, lasts=3.0),
        CameraMislabel(at, "red", "blue", swapped=True),
        WrenchBias(at, (0.0, 0.0, 5.0), (0.1, 0.0, 0.0)),
        WrenchDead(at),
        JointWeak(at, "panda_joint4", 0.1, lasts=1.0),
        Stall(at, lasts=1.0),
        NoPlan(at, requests=4),
        Hang(AtNode("Grasp")),
        Raise(AtNode("Grasp", 2, each=True)),
        Kill(AtTime(9.0)),
    )
    new = {line.split(",")[0] for line in ENTRIES.split("{fault: ")[1:]}
    known = {"remove", "friction", "bump", "obstacle"} | new
    assert known == set(KINDS)


def test_what_is_expected_is_read_and_judged() -> None:
    told = "expect: {causes: [grasp.*, world.disturbed], roots: [item.slipped], lost: 1}"
    text = HEAD.replace("faults:\n", f"{told}\nfaults: []\n")
    assert parse_faults(text, HERE).expect == FaultExpectation(
        ("grasp.*", "world.disturbed"), 1, ("item.slipped",)
    )
    assert parse_faults(f"{HEAD}{ENTRIES}", HERE).expect is None


def test_the_cell_that_it_is_to_happen_in_must_have_what_it_names(tmp_path: Path) -> None:
    (tmp_path / "f.yaml").write_text(
        f"{HEAD}  - {{fault: camera_drop, when: {{at: 1}}, camera: side}}\n"
        "  - {fault: joint_weak, when: {at: 1}, joint: elbow, share: 0}\n"
        "  - {fault: appear, when: {at: 1}, kind: bottle, colour: red, place: [0.5, 0]}\n"
    )
    assert len(load_faults(tmp_path / "f.yaml").faults) == 3
    with pytest.raises(FileError) as caught:
        load_faults(tmp_path / "f.yaml", load_scene("sort_small"), load_robot("panda"))
    said = [line.partition("f.yaml:")[2] for line in str(caught.value).split("\n")]
    assert said == [
        "4:49: faults[0].camera: the scene sort_small has no camera 'side' (known: overhead)",
        "5:47: faults[1].joint: the robot of sort_small has no joint 'elbow' (known: "
        + ", ".join(f"panda_joint{n}" for n in range(1, 8))
        + ")",
        "6:42: faults[2].kind: the catalogue of sort_small has no 'bottle' "
        "(known: block, brick, can, ball, plate, nut)",
    ]


def test_an_empty_list_has_no_faults() -> None:
    assert parse_faults("picktree: 1\nkind: faults\nfaults: []\n", HERE).faults == ()


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (
            "{fault: remov, when: {at: 1}, target: {index: 0}}",
            "4:13: faults[0].fault: 'remov' is not known here (did you mean 'remove'?)",
        ),
        ("{fault: remove, target: {index: 0}}", "4:5: faults[0]: 'when' is missing"),
        ("{fault: remove, when: {}, target: {index: 0}}", "4:21: faults[0].when: 'at' or 'node' is missing"),
        (
            "{fault: remove, when: {at: 1, node: A}, target: {index: 0}}",
            "4:21: faults[0].when: 'at' and 'node' exclude each other (give one of them)",
        ),
        (
            "{fault: remove, when: {at: 1, delay: 3}, target: {index: 0}}",
            "4:35: faults[0].when.delay: 'delay' belongs to 'node'",
        ),
        (
            "{fault: remove, when: {at: -1 s}, target: {index: -1}}",
            "4:32: faults[0].when.at: -1 s is negative (a time is 0 or more here)\n"
            "4:55: faults[0].target.index: at least 0 is wanted, not -1",
        ),
        (
            "{fault: remove, when: {node: /, start: 0}, target: {colour: rd}}",
            "4:34: faults[0].when.node: the node is empty (its name, or a path as SortOne/Grasp)\n"
            "4:44: faults[0].when.start: at least 1 is wanted, not 0\n"
            "4:65: faults[0].target.colour: 'rd' is no colour that an item may have (did you mean 'red'?)",
        ),
        (
            "{fault: remove, when: {at: 1}, target: {}}",
            "4:44: faults[0].target: no item is named (index, kind, form, colour or nearest_to)",
        ),
        (
            "{fault: remove, when: {at: 1}, target: {nearest_to: object}}",
            "4:57: faults[0].target.nearest_to: 'object' needs a node in 'when', whose port it is",
        ),
        (
            "{fault: friction, when: {at: 1}, target: {index: 0}}",
            "4:5: faults[0]: 'friction' needs 'friction'",
        ),
        (
            "{fault: bump, when: {at: 1}, target: {index: 0}, velocity: [1, 99, 0], mass: 2}",
            "4:68: faults[0].velocity[1]: 99 m/s is more than 10 m/s\n"
            "4:76: faults[0].mass: 'bump' takes no 'mass'",
        ),
        (
            "{fault: remove, when: {at: 1}, target: {index: 0}, mass: 2}",
            "4:56: faults[0].mass: 'remove' takes no 'mass'",
        ),
        (
            "{fault: heavier, when: {at: 1, every: 2 s}, target: {index: 0}, mass: 2, factor: 3, lasts: 1 s}",
            "4:78: faults[0].factor: 'heavier' takes no 'factor'\n"
            "4:89: faults[0].lasts: 'heavier' takes no 'lasts'",
        ),
        (
            "{fault: obstacle, when: {node: A, every: 1}, body: {box: [1, 1, 1], at: [0, 0, 1]}, lasts: 1 s}",
            "4:39: faults[0].when.every: 'every' belongs to 'at'\n"
            "4:89: faults[0].lasts: 'obstacle' takes no 'lasts' (it has 'stays')",
        ),
        (
            "{fault: camera_mislabel, when: {at: 1}, colour: red, shown_as: red, probability: 0}",
            "4:68: faults[0].shown_as: red is shown as itself\n"
            "4:86: faults[0].probability: 0 is not positive",
        ),
        (
            "{fault: joint_weak, when: {at: 1}, share: 120 %}",
            "4:5: faults[0]: 'joint_weak' needs 'joint'\n4:47: faults[0].share: 120 % is more than 100 %",
        ),
        ("3", "4:5: faults[0]: a mapping is wanted, not 3"),
    ],
)
def test_faulty_entries(entry: str, message: str) -> None:
    with pytest.raises(FileError) as caught:
        parse_faults(f"{HEAD}  - {entry}\n", HERE)
    assert str(caught.value) == "\n".join(f"f.yaml:{line}" for line in message.split("\n"))


def test_items_that_a_feed_brings_may_be_meant() -> None:
    entry = "  - {{fault: remove, when: {{at: 9 s}}, target: {{index: {}, kind: can, colour: red}}}}\n"
    text = HEAD.replace("faults:\n", "scene: continuous\nfaults:\n")
    assert parse_faults(text + entry.format(199), HERE).faults
    with pytest.raises(FileError) as error:
        parse_faults(text + entry.format(200), HERE)
    assert str(error.value) == (
        "f.yaml:5:54: faults[0].target.index: the scene continuous has no item 200 "
        "(it has 200 items, counted from 0)"
    )
