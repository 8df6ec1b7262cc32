"""`picktree replay`: what is typed and what is answered, piped and at a terminal."""

from __future__ import annotations

import io
import re
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.apps.cli.replay_stepper import ReplayStepper
from picktree.world import (
    BlackboardWrite,
    Candidate,
    Candidates,
    JournalEvent,
    ObjectId,
    OtherEvent,
    Plan,
    StageCount,
    Transition,
)

from ..commands import Terminal, call
from ..logs.scripted_log import Seen, begins, ends, record, tree

GOLDEN = Path(__file__).parents[1] / "logs" / "golden" / "format-2.mcap"
NODES = tree("Main:ForEach", "Main/Part:Sequence", "Main/Part/Grasp", "Main/Part/Place", object="{item}")
PART, GRASP, PLACE = "Main/Part", "Main/Part/Grasp", "Main/Part/Place"
SCRIPT: Mapping[int, Sequence[Transition | BlackboardWrite | JournalEvent | Plan | Candidates]] = {
    0: [begins("Main", items=["red_block_1"])],
    2: [
        BlackboardWrite("Main/item", "red_block_1", "Main"),
        begins(PART),
        begins(GRASP, "red_block_1"),
        Candidates(
            "grasp",
            ObjectId("red_block_1"),
            (StageCount("made", 8), StageCount("reachable", 1)),
            (Candidate("top", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 0.7, "accepted"),),
        ),
        Plan("to home", "direct", 12, 0.0003, "found", "", 1.5, ((0.0, 1.0), (0.5, 1.5)), ()),
    ],
    5: [
        ends(GRASP, "FAILURE", "grasp.missed", width=0.0001),
        ends(PART, "FAILURE", "grasp.missed", GRASP),
        OtherEvent("element 1 of 1 is passed over", "Main", name="handled"),
    ],
    6: [begins(PART), begins(GRASP, "red_block_1")],
    8: [ends(GRASP), begins(PLACE, "red_block_1")],
    11: [ends(PLACE), ends(PART), ends("Main")],
}


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return record(tmp_path / "log.mcap", NODES, 13, SCRIPT, seen=[Seen("red_block_1", 0.4)])


def replayed(log: Path, *lines: str) -> str:
    """Return the output for these piped lines, without what is shown before the first."""
    out = io.StringIO()
    typed = iter(lines)

    def read(prompt: str) -> str:
        line = next(typed, None)
        if line is None:
            raise EOFError
        print(f"> {line}".rstrip(), file=out)
        return line

    with Run(log) as run:
        ReplayStepper(run, 0.0, read, out).converse()
    return out.getvalue()


SEEN = "     0.00 s  belief: red_block_1: seen for the first time"
PASSED = "     0.25 s  handled: element 1 of 1 is passed over"


def test_going_shows_the_tick_the_tree_and_the_last_events(log: Path) -> None:
    shown = replayed(log, "n 2", "failure", "p 99", "failure back", "to end", "failure")
    told = [part.splitlines()[1:] for part in shown.split("> ")[1:]]
    assert told[0] == [
        "0.10 s, tick 2 of 0 … 12", "  ▶ ForEach Main", "    ▶ Sequence Part", "      ▶ Grasp",
        "      · Place", SEEN,
    ]  # fmt: skip
    assert told[1] == [
        "0.25 s, tick 5 of 0 … 12",
        "  ▶ ForEach Main",
        "    ✗ Sequence Part  grasp.missed: Main/Part failed",
        "      ✗ Grasp  grasp.missed: Main/Part/Grasp failed",
        SEEN,
        PASSED,
        "Main/Part/Grasp (red_block_1) failed: grasp.missed: Main/Part/Grasp failed",
        "  remedy: observe again",
        "  began at 0.10 s",
        "  read object = 'red_block_1'",
        "  width: 0.0001",
    ]
    assert told[2] == ["0.00 s, tick 0 of 0 … 12", "  ▶ ForEach Main", "    · Sequence Part", SEEN]
    assert told[3] == ["there is no failure before 0.00 s"]
    assert told[4] == ["0.60 s, tick 12 of 0 … 12", "  ✓ ForEach Main", SEEN, PASSED]
    assert told[5] == ["there is no failure after 0.60 s"]


def test_looking(log: Path) -> None:
    shown = replayed(log, "to 0.41", "tree", "events", "blackboard", "belief")
    told = [part.splitlines()[1:] for part in shown.split("> ")[1:]]
    assert told[0][0] == "0.40 s, tick 8 of 0 … 12"
    assert told[1] == ["  ▶ ForEach Main", "    ▶ Sequence Part", "      ✓ Grasp", "      ▶ Place"]
    assert told[2] == [SEEN, PASSED]
    assert told[3] == ["Main/item = 'red_block_1'"]
    assert told[4] == [
        "red_block_1: red block, item, table, at (0.400, 0.000, 0.020) m, seen 0.4 s ago, confidence 0.90"
    ]


ANSWERS = {
    "foo": "no command 'foo' (`help` lists the commands)",
    "next x": "'x' is no number of ticks",
    "previous": "this is the first tick",
    "failure on": "failure on: write `failure` or `failure back`",
    "to": "to ?: write a time in seconds, as `to 12.5`, or `to end`",
    "to Grasp": "to Grasp: write a time in seconds, as `to 12.5`, or `to end`",
    "blackboard": "nothing is written yet",
    "belief zzz": "no object is called 'zzz'",
    "help previous": "previous [N]  go one tick back, or N ticks",
}


@pytest.mark.parametrize("line", ANSWERS)
def test_what_is_answered(log: Path, line: str) -> None:
    assert replayed(log, line).splitlines()[1] == ANSWERS[line]


PAGE = (Path(__file__).parents[2] / "docs" / "replay.md").read_text(encoding="utf-8")


def test_its_page_names_all_commands(log: Path) -> None:
    with Run(log) as run:
        names = [name.strip() for name in ReplayStepper(run, 0.0, input, io.StringIO()).completions("")]
    listed = "\n".join(line for line in PAGE.splitlines() if line.startswith("|"))
    assert [name for name in names if not re.search(rf"`{name}[ `]", listed)] == []


# The command.


def piped(log: Path, lines: str, *options: str) -> subprocess.CompletedProcess[str]:
    return call(["replay", str(log), *options], typed=lines)


def test_a_script_is_shown_as_a_conversation(log: Path) -> None:
    ran = piped(log, "blackboard\nquit\nnext\n", "--at", "0.3")
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout.splitlines()[0] == "0.30 s, tick 6 of 0 … 12"
    assert ran.stdout.splitlines()[-3:] == [
        "(picktree) blackboard",
        "Main/item = 'red_block_1'",
        "(picktree) quit",
    ]


def test_a_log_that_was_cut_says_so_and_one_of_format_2_is_read(log: Path, tmp_path: Path) -> None:
    whole = log.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[:-40])
    cut = piped(tmp_path / "cut.mcap", "")
    assert cut.returncode == 0
    assert cut.stderr.startswith(f"{tmp_path}/cut.mcap: ")
    assert cut.stdout.startswith("0.00 s, tick 0 of ")
    old = piped(GOLDEN, "failure\n")
    assert old.returncode == 0
    assert old.stderr == ""
    assert "1.50 s, tick 30 of 0 … 59" in old.stdout


def test_at_a_terminal_there_is_a_prompt(log: Path) -> None:
    terminal = Terminal(["replay", str(log)])
    terminal.until("(picktree) ")
    terminal.press(b"failure\n")
    assert "0.25 s, tick 5 of 0 … 12" in terminal.until("width: 0.0001")
    terminal.press(b"previous\n")
    terminal.until("tick 4 of")
    terminal.press(b"\n")
    terminal.until("tick 3 of")
    terminal.press(b"\x03")
    assert terminal.end() == 130
