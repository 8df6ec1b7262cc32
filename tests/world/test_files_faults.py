"""Fault files: their values, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.world.faults.description import AtNode, AtTime, Bump, Friction, Remove, Target
from picktree.world.faults.load import load_faults, parse_faults
from picktree.world.files.document import FileError

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
        Remove(AtNode("A/B", 2, 0.3), Target(nearest_to="object")),
        Friction(AtTime(3.0), Target(index=2), 0.05, 0.5),
        Bump(AtTime(0.0), Target(kind="can", colour="red"), (0.3, 0.0, 0.2)),
    )
    assert (read.source, read.text) == (str(tmp_path / "f.yaml"), text)
    assert parse_faults(text, tmp_path / "f.yaml") == read


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
