"""`picktree replay`: what is typed and what is answered, piped and at a terminal."""

from __future__ import annotations

import io
import re
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from picktree.analysis import Cursor, Run
from picktree.apps.cli import answer
from picktree.apps.cli.replay_prompt import ReplayPrompt
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
        prompt = ReplayPrompt(Cursor(run), read, out)
        prompt.converse()
    return out.getvalue()


def test_going_and_what_changed(log: Path) -> None:
    assert (
        replayed(log, "step 2", "failure", "n", "p", "to 0.41", "to start", "to Grasp after back", "back 99")
        == """\
> step 2
0.10 s, tick 2 of 0 … 12; Main/Part/Grasp is RUNNING
  ▶ ForEach Main
    ▶ Sequence Part
      ▶ Grasp
      · Place
since 0.00 s:
     0.10 s  ▶ Part begins
     0.10 s  ▶ Grasp begins with object 'red_block_1'
     0.10 s  blackboard Main/item = 'red_block_1', by Main
     0.10 s  plan to home: found by direct, 12 checks, 1.50 s of motion
> failure
0.25 s, tick 5 of 0 … 12; Main/Part/Grasp is FAILURE
  ▶ ForEach Main
    ✗ Sequence Part  grasp.missed: Main/Part failed
      ✗ Grasp  grasp.missed: Main/Part/Grasp failed
since 0.10 s:
     0.25 s  ✗ Grasp ends in FAILURE: grasp.missed: Main/Part/Grasp failed
     0.25 s  ✗ Part ends in FAILURE: grasp.missed: Main/Part failed
     0.25 s  handled: element 1 of 1 is passed over
> n
0.30 s, tick 6 of 0 … 12; Main/Part/Grasp is RUNNING
  ▶ ForEach Main
    ▶ Sequence Part
      ▶ Grasp
      · Place
in this tick:
  ▶ Part begins
  ▶ Grasp begins with object 'red_block_1'
> p
0.25 s, tick 5 of 0 … 12; Main/Part/Grasp is FAILURE
  ▶ ForEach Main
    ✗ Sequence Part  grasp.missed: Main/Part failed
      ✗ Grasp  grasp.missed: Main/Part/Grasp failed
in this tick:
  ✗ Grasp ends in FAILURE: grasp.missed: Main/Part/Grasp failed
  ✗ Part ends in FAILURE: grasp.missed: Main/Part failed
  handled: element 1 of 1 is passed over
> to 0.41
0.40 s, tick 8 of 0 … 12; Main/Part/Place is RUNNING
  ▶ ForEach Main
    ▶ Sequence Part
      ✓ Grasp
      ▶ Place
since 0.25 s:
     0.30 s  ▶ Part begins
     0.30 s  ▶ Grasp begins with object 'red_block_1'
     0.40 s  ✓ Grasp ends in SUCCESS
     0.40 s  ▶ Place begins with object 'red_block_1'
> to start
0.00 s, tick 0 of 0 … 12; Main is RUNNING
  ▶ ForEach Main
    · Sequence Part
in this tick:
  ▶ Main begins with items ['red_block_1']
  belief: red_block_1: seen for the first time
> to Grasp after back
there is no end of Grasp before 0.00 s
> back 99
this is the first tick
"""
    )


def test_looking(log: Path) -> None:
    assert (
        replayed(
            log, "to red_block_1", "where", "node", "failure 0", "where", "evidence", "failures",
            "blackboard", "belief", "tree Part", "joints", "wrench", "node Place",
        ).partition("> where\n")[2]
        == """\
▶ Main is RUNNING
▶ Main/Part is RUNNING
▶ Main/Part/Grasp is RUNNING
> node
Main/Part/Grasp: Grasp, RUNNING
  object = 'red_block_1'
  began at 0.10 s for red_block_1
> failure 0
0.25 s, tick 5 of 0 … 12; Main/Part/Grasp is FAILURE
  ▶ ForEach Main
    ✗ Sequence Part  grasp.missed: Main/Part failed
      ✗ Grasp  grasp.missed: Main/Part/Grasp failed
since 0.10 s:
     0.25 s  ✗ Grasp ends in FAILURE: grasp.missed: Main/Part/Grasp failed
     0.25 s  ✗ Part ends in FAILURE: grasp.missed: Main/Part failed
     0.25 s  handled: element 1 of 1 is passed over
> where
▶ Main is RUNNING
✗ Main/Part is FAILURE: grasp.missed: Main/Part failed
✗ Main/Part/Grasp is FAILURE: grasp.missed: Main/Part/Grasp failed
> evidence
0.25 s, tick 5: Main/Part/Grasp (red_block_1) failed: grasp.missed
  said: Main/Part/Grasp failed
  means: The fingers closed and hold nothing.
  remedy: observe again
  began at 0.10 s
  read object = 'red_block_1'
  evidence width: 0.0001
  at 0.10 s chose for red_block_1: 8 made, 1 reachable
    top: accepted
  with it ended Part
  then began Main/Part at 0.30 s: SUCCESS
> failures
→ 0: 0.25 s, Main/Part/Grasp (red_block_1): grasp.missed: Main/Part/Grasp failed
> blackboard
Main/item = 'red_block_1'
> belief
red_block_1: red block, item, table, at (0.400, 0.000, 0.020) m, seen 0.2 s ago, confidence 0.90
> tree Part
  ✗ Sequence Part  grasp.missed: Main/Part failed
    ✗ Grasp  grasp.missed: Main/Part/Grasp failed
    · Place
> joints
the log has no joints here
> wrench
the log has no wrench here
> node Place
Main/Part/Place: Place, IDLE
  object = {item}
  it has not begun yet
"""
    )  # fmt: skip


ANSWERS = {
    "foo": "no command 'foo' (`help` lists the commands)",
    "step x": "'x' is no number of ticks",
    "step 0": "'0' is no number of ticks",
    "back": "this is the first tick",
    "failure 7": "there is no failure 7; `failures` lists them",
    "failure on": "failure on: write `failure`, `failure back`, or its number",
    "evidence": "no node has failed by itself yet",
    "to": "to what? A time in seconds, #TICK, a node, an item, `start` or `end`",
    "to #99": "there is no tick 99: the log has ticks 0 to 12",
    "to Grsap": "no node fits 'Grsap' (did you mean 'Grasp'?)",
    "continue": "no breakpoints; `break PATH` sets one",
    "break": "no breakpoints; `break PATH` sets one",
    "break Place after": "1: after Main/Part/Place",
    "delete 3": "there is no breakpoint 3; `break` lists them",
    "blackboard": "nothing is written yet",
    "belief zzz": "no object is called 'zzz'",
    "help back": "back [N]  a tick back, or N",
}


@pytest.mark.parametrize("line", ANSWERS)
def test_what_is_answered(log: Path, line: str) -> None:
    assert replayed(log, line).splitlines()[1] == ANSWERS[line]


def test_breakpoints_stop_at_beginnings_and_ends(log: Path) -> None:
    shown = replayed(log, "b Grasp after", "b Place", "c", "c", "c back", "delete 1", "b", "c back")
    places = [line for line in shown.splitlines() if " tick " in line]
    assert [line.split(",")[0] for line in places] == ["0.25 s", "0.40 s", "0.25 s"]
    assert shown.endswith(
        "2: before Main/Part/Place\n> c back\nthere is no breakpoint that is met before 0.25 s\n"
    )


def test_much_that_changed_is_cut_and_the_last_is_shown(log: Path) -> None:
    shown = replayed(log, "to end", "changes")
    first, rest = shown.split("> changes\n")
    assert "  … 2 before these; `changes` shows all\n" in first
    assert len(rest.splitlines()) == 1 + 2 + 12
    assert first.splitlines()[-12:] == rest.splitlines()[-12:]


def test_words_are_completed(log: Path) -> None:
    with Run(log) as run:
        prompt = ReplayPrompt(Cursor(run), input, io.StringIO())
        assert prompt.completions("fail") == ["failure ", "failures "]
        assert prompt.completions("to red") == ["red_block_1"]
        assert prompt.completions("to Main/Part/P") == [PLACE]
        assert prompt.completions("belief ") == ["red_block_1"]


PAGE = (Path(__file__).parents[2] / "docs" / "replay.md").read_text(encoding="utf-8")


def test_its_page_names_all_commands(log: Path) -> None:
    with Run(log) as run:
        names = [name.strip() for name in ReplayPrompt(Cursor(run), input, io.StringIO()).completions("")]
    listed = "\n".join(line for line in PAGE.splitlines() if line.startswith("|"))
    assert [name for name in names if not re.search(rf"`{name}[ `]", listed)] == []


def test_the_python_of_its_page_runs(
    log: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = re.search(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert found is not None
    exec(compile(found[1].replace('"last"', repr(str(log))).replace("5.0", "0.1"), "replay.md", "exec"), {})
    assert "Main/Part/Grasp grasp.missed {'Main/item': 'red_block_1'}\nSUCCESS" in capsys.readouterr().out


# The command.


def piped(log: Path, lines: str, *options: str) -> subprocess.CompletedProcess[str]:
    return call(["replay", str(log), *options], typed=lines)


def test_a_script_is_shown_as_a_conversation(log: Path) -> None:
    ran = piped(log, "node Grasp\nquit\nstep\n", "--at", "0.3")
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout.splitlines()[0] == "0.30 s, tick 6 of 0 … 12; Main/Part/Grasp is RUNNING"
    assert ran.stdout.splitlines()[-5:] == [
        "(picktree) node Grasp",
        "Main/Part/Grasp: Grasp, RUNNING",
        "  object = 'red_block_1'",
        "  began at 0.30 s, attempt 2 for red_block_1",
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


def test_what_is_no_log_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["replay", str(tmp_path / "none.mcap")]) == 2
    assert capsys.readouterr().err == f"{tmp_path}/none.mcap: there is no such log\n"


def test_at_a_terminal_there_is_a_prompt(log: Path) -> None:
    terminal = Terminal(["replay", str(log)])
    terminal.until("(picktree) ")
    terminal.press(b"failure\n")
    assert "0.25 s, tick 5 of 0 … 12" in terminal.until("passed over")
    terminal.press(b"to Pla\t\n")
    assert "0.40 s, tick 8 of 0 … 12" in terminal.until("Place begins")
    terminal.press(b"back\n")
    terminal.until("tick 7 of")
    terminal.press(b"\n")
    terminal.until("tick 6 of")
    terminal.press(b"quit\n")
    assert terminal.end() == 0


def test_ctrl_c_ends_it_as_everywhere(log: Path) -> None:
    terminal = Terminal(["replay", str(log)])
    terminal.until("(picktree) ")
    terminal.press(b"\x03")
    assert terminal.end() == 130
