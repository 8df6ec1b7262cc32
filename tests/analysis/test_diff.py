"""Two runs compared as a whole, from logs that were made up for it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.analysis.compare import diff
from picktree.analysis.compare.run_diff import FileChange, RunDiff, to_json_text, to_text
from picktree.logs import PickCount, RunResult, WallSeconds
from picktree.world import BlackboardWrite, ItemCount, JournalEvent, Transition
from picktree.world.event_types import ItemDoneEvent, PickEvent

from ..logs.scripted_log import Seen, begins, ends, record, tree

NODES = tree("Main:Sequence", "Main/Grasp", "Main/Place")
GRASP, PLACE = "Main/Grasp", "Main/Place"
ITEM = "red_block_1"
SEEN = [Seen(ITEM, 0.4)]
Script = Mapping[int, Sequence[Transition | BlackboardWrite | JournalEvent]]

GOOD: Script = {
    0: [begins("Main"), begins(GRASP, ITEM)],
    3: [PickEvent("held", GRASP, object=ITEM, held=True)],
    4: [ends(GRASP), begins(PLACE, ITEM, into="red_bin")],
    8: [ends(PLACE), ends("Main"), ItemDoneEvent("placed", PLACE, object=ITEM, into="red_bin")],
}
BAD: Script = {
    0: GOOD[0],
    3: [PickEvent("not held", GRASP, object=ITEM, held=False)],
    5: [ends(GRASP, "FAILURE", "grasp.missed", width=0.00012345678), ends("Main", "FAILURE", "grasp.missed")],
}


def result(status: str, sorted_: int, message: str = "") -> RunResult:
    return RunResult(
        status=status,  # pyright: ignore[reportArgumentType]
        seed=0,
        digest=status * 4,
        items=ItemCount(1, sorted_, 0, 1 - sorted_, {}),
        picks=PickCount(1, sorted_, 1, sorted_),
        sim_seconds=0.4,
        cpu_seconds=1.0,
        wall_seconds=WallSeconds(1.0, 0.5, 0.1, 0.1, 0.1),
        log=Path("log.mcap"),
        folder=Path("."),
        message=message,
    )


def compared(a: Path, b: Path) -> RunDiff:
    with Run(a) as one, Run(b) as other:
        return diff(one, other)


@pytest.fixture
def good(tmp_path: Path) -> Path:
    return record(
        tmp_path / "good.mcap", NODES, 9, GOOD,
        seen=SEEN, files={"mission.yaml": "a\nb\nc\n"}, result=result("success", 1),
    )  # fmt: skip


@pytest.fixture
def bad(tmp_path: Path) -> Path:
    return record(
        tmp_path / "bad.mcap", NODES, 6, BAD, seen=SEEN,
        files={"mission.yaml": "a\nB\nc\n", "faults.yaml": "x"}, result=result("failure", 0, "it missed"),
    )  # fmt: skip


def test_what_is_told_of_two_runs(good: Path, bad: Path) -> None:
    text = to_text(compared(good, bad)).replace(str(good.parent), "…")
    parts = [part.splitlines() for part in text.split("\n\n")]
    assert parts[0] == [
        "A  …/good.mcap",
        "   success, 1 of 1 items sorted, 0.40 s",
        "B  …/bad.mcap",
        "   failure, 0 of 1 items sorted, 0.25 s: it missed",
    ]
    assert parts[1] == [
        "the runs diverge at 0.20 s: Grasp ends differently, fails with another cause, takes another time",
        "  A  Main/Grasp (red_block_1)",
        "     0.00 to 0.20 s: SUCCESS",
        "  B  Main/Grasp (red_block_1)",
        "     0.00 to 0.25 s: FAILURE, grasp.missed: Main/Grasp failed",
        "     evidence of B: width 0.000123457",
        "  then A  Main/Place (red_block_1) from 0.20 s: SUCCESS",
        "  then B  nothing more begins",
        "first value that differs: tick 3, 0.15 s, /events message",
        "  A  held",
        "  B  not held",
        "arithmetic not recorded: the log is of an older version",
    ]
    assert parts[2][1] == "  mission.yaml: changed, 1 lines of A, 1 of B"
    assert parts[2][-4:] == ["    -b", "    +B", "     c", "  faults.yaml: only in B"]
    rows = [re.split("  +", line.strip()) for part in parts[3:] for line in part]
    for row in (
        ["result", "success", "failure"],
        ["items sorted", "1 of 1", "0 of 1"],
        ["grasps held", "1 of 1", "0 of 1"],
        ["Place", "1", "0.20", "0.20", "–", "–", "–", "-0.20"],  # time, by type of leaf and by node
        ["Main", "1", "0.40", "0.40", "1", "0.25", "0.25", "-0.15"],
        ["grasp.missed", "0", "2"],
        ["Main", "1 SUCCESS", "1 FAILURE"],
        ["≠ red_block_1", "done, red_bin", "0.40", "1", "0.40", "left, table", "1", "0.25"],
    ):
        assert row in rows


def test_the_same_in_json(good: Path, bad: Path) -> None:
    said = json.loads(to_json_text(compared(good, bad)))
    assert said["verdict"] == "apart"
    assert said["a"]["status"] == "success"
    assert said["b"]["failures"] == {"grasp.missed": 2}
    assert said["files"][1] == {"name": "faults.yaml", "how": "only_b", "diff": []}
    assert (said["first_value"]["topic"], said["first_value"]["tick"]) == ("/events", 3)
    parting = said["parting"]
    assert (parting["how"], parting["a"]["path"], parting["b"]["cause"]) == ("outcome", GRASP, "grasp.missed")
    assert parting["evidence"] == [{"name": "width", "a": None, "b": 0.00012345678}]
    assert parting["next_b"] is None
    assert said["time"]["by_type"][0]["name"] == "Place"
    assert said["causes"] == [{"name": "grasp.missed", "a": 0, "b": 2}]
    assert said["items"][0]["a"]["state"] == "done"
    assert said["item_pairs"] == [{"a": ITEM, "b": ITEM, "basis": "place"}]


def test_identical_runs(good: Path) -> None:
    found = compared(good, good)
    assert found.same
    assert to_text(found).splitlines()[-1] == ("identical: every simulated message is the same, up to 0.40 s")


def test_a_run_that_was_killed(good: Path, tmp_path: Path) -> None:
    killed = record(tmp_path / "killed.mcap", NODES, 6, GOOD, seen=SEEN, files={"mission.yaml": "a\nb\nc\n"})
    found = compared(good, killed)
    assert (found.verdict, found.b.status, found.b.digest) == ("cut", "killed", "")
    text = to_text(found).splitlines()
    assert text[3] == "   killed, 0.25 s"
    assert text[5:12] == [
        "nothing differs until the log B ends, at 0.25 s",
        "  A  Main/Place (red_block_1)",
        "     0.20 to 0.40 s: SUCCESS",
        "  B  Main/Place (red_block_1)",
        "     0.20 to 0.25 s: still runs when the log ends",
        "  then A  nothing more begins",
        "  then B  nothing more begins",
    ]
    assert "  result                   success  killed: no result in the log" in text


def test_values_may_differ_where_the_nodes_do_not(tmp_path: Path, good: Path) -> None:
    other = record(tmp_path / "other.mcap", NODES, 9, GOOD, seen=[Seen(ITEM, 0.401)])
    found = compared(good, other)
    assert (found.verdict, found.alignment.parting) == ("alike", None)
    assert to_text(found).splitlines()[5:9] == [
        "every node did the same at the same times, but values differ",
        "first value that differs: tick 0, 0.00 s, /events data.after.pose.position[0]",
        "  A  0.4",
        "  B  0.401",
    ]


def test_another_tree_is_not_the_first_value_that_differs(tmp_path: Path, good: Path) -> None:
    nodes = tree("Main:Sequence", "Main/Grasp", "Main/Look", "Main/Place")
    found = compared(good, record(tmp_path / "other.mcap", nodes, 6, BAD, seen=SEEN))
    assert found.first is not None and found.first.topic == "/events"
    assert "  nodes only in B:\n    Main/Look\n" in to_text(found)


def test_a_run_that_goes_on_from_a_checkpoint_is_compared_from_there(good: Path, tmp_path: Path) -> None:
    missed = [ends(PLACE, "FAILURE", "place.missed"), ends("Main", "FAILURE", "place.missed", PLACE)]
    script = {4: [ends(GRASP)], 8: missed}
    other = record(
        tmp_path / "b.mcap", NODES, 9, script, first=4, running=["Main", PLACE], seen=SEEN,
        files={"mission.yaml": "a\nb\nc\n"},
    )  # fmt: skip
    found = compared(good, other)
    assert found.first is not None and found.first.tick == 8
    assert to_text(found).splitlines()[5:7] == [
        "compared from 0.225 s on: one log begins there",
        "the runs diverge at 0.40 s: Place ends differently, fails with another cause",
    ]
    assert [(change.a.busy, change.b.busy) for change in found.items if change.a and change.b] == [
        (pytest.approx(0.175), pytest.approx(0.175))
    ]


def test_files_that_are_no_text_or_have_the_same_lines(tmp_path: Path) -> None:
    a = record(tmp_path / "a.mcap", NODES, 2, GOOD, files={"x": "a\n", "y": "1"})
    b = record(tmp_path / "b.mcap", NODES, 2, GOOD, files={"x": "a"})
    found = compared(a, b)
    assert found.set_up.files == (FileChange("x", "changed", ()), FileChange("y", "only_a", ()))
    assert "x: changed (its lines are the same, or it is no text)" not in to_text(compared(a, a))
