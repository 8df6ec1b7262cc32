"""The debugger's prompt: what is typed and what is answered, at a terminal and in a script."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest

from picktree.apps.cli import answer
from picktree.apps.cli.debug_prompt import DebugPrompt
from picktree.session import Debugger, RunRequest, Session
from picktree.trees import NodeStatus

from ..commands import Terminal, call
from ..trees.scripted import FakeWorld, start

MISSION = """
Main:
  ports: {speed: {type: float, default: 0.5}}
  Sequence:
    - Find: {ids: [red_1, blue_1], found: "{items}"}
    - ForEach:
        in: "{items}"
        out: "{item}"
        on_failure: continue
        do: {Part: {item: "{item}"}}
Part:
  ports: {item: {type: object}}
  Fallback:
    - Scripted: {name: try it, script: grasp.missed, breakpoint: after}
    - Take: {object: "{item}", colour: "{item.colour}", _skipIf: item == 'none'}
"""
PART = "Main/Sequence/ForEach/Part"


class Typed:
    """Lines as somebody types them; the output with what was typed in it, as on a terminal."""

    def __init__(self, *lines: str) -> None:
        self._lines = list(lines)
        self.out = io.StringIO()
        self.prompt = DebugPrompt(self._read, self.out)

    def _read(self, prompt: str) -> str:
        if not self._lines:
            raise EOFError
        line = self._lines.pop(0)
        print(f"> {line}".rstrip(), file=self.out)
        return line

    @property
    def text(self) -> str:
        return self.out.getvalue()


def session(*lines: str) -> str:
    """What is shown when these lines are typed, from the start of the mission on."""
    world = FakeWorld()
    for identity, colour in (("red_1", "red"), ("blue_1", "blue")):
        world.put(identity, colour)
    run = start(MISSION, world)
    typed = Typed(*lines)
    debugger = Debugger(typed.prompt)
    debugger.attach(run.tree)
    try:
        while True:
            status = run.tick()
            debugger.pause_after_tick()
            if status is not NodeStatus.RUNNING:
                break
    except KeyboardInterrupt:
        typed.out.write("(interrupted)\n")
    return typed.text


def test_looking_around() -> None:
    """What docs/running.md does not show."""
    shown = session("continue", "where", "tree", "node", "node Take", "p speed * 2", "quit")
    told = dict(part.partition("\n")[::2] for part in shown.split("> ")[1:])
    failed = f"{PART}/Fallback/try it"
    assert told["continue"] == f"0.05 s, after {failed}: FAILURE, grasp.missed: try it was told to\n"
    assert told["where"].splitlines()[0] == "▶ Main is RUNNING"
    assert told["where"].splitlines()[-1] == f"✗ {failed} is FAILURE: grasp.missed: try it was told to"
    assert told["tree"].splitlines()[-4:] == [
        "        ▶ Part",
        "          ▶ Fallback",
        "→           ✗ Scripted try it  grasp.missed: try it was told to",
        "            · Take",
    ]
    assert told["node"] == (
        f"{failed}: Scripted, action, FAILURE\n  script = 'grasp.missed'\n  breakpoint 1: after\n"
        f"  failed in {failed}: grasp.missed: try it was told to\n    turn: 0\n"
    )
    assert told["node Take"].splitlines()[1:] == [
        "  object = {item} 'red_1'",
        "  force = 30.0 by default",
        "  colour = {item.colour} 'red'",
        "  hand = 'left' by default",
        "  _skipIf: item == 'none'",
    ]
    assert told["p speed * 2"].endswith("unknown name 'speed'; known: item, time\n")
    assert told["quit"] == "(interrupted)\n"


def test_going_on() -> None:
    shown = session("n", "", "", "node Find", "s 2", "break Take", "b", "delete 1", "c", "d", "c")
    assert shown.split("\n> ")[1:] == [
        "n\n0.00 s, before Main/Sequence\n>\n0.00 s, before Main/Sequence/Find\n>\n"
        "0.05 s, after Main/Sequence/Find: SUCCESS",
        "node Find\nMain/Sequence/Find: Find, action, SUCCESS\n  ids = ['red_1', 'blue_1']\n"
        "  found → {items} ['red_1', 'blue_1']",
        f"s 2\n0.05 s, after {PART}/Fallback/try it: FAILURE, grasp.missed: try it was told to",
        f"break Take\n2: before {PART}/Fallback/Take",
        f"b\n1: after {PART}/Fallback/try it\n2: before {PART}/Fallback/Take",
        "delete 1",
        f"c\n0.05 s, before {PART}/Fallback/Take",
        "d",
        "c\n",
    ]


def test_at_the_end_of_the_input_the_run_goes_on_without_another_stop() -> None:
    assert session("b Take") == (
        "0.00 s, before Main\n"
        "> b Take\n"
        f"2: before {PART}/Fallback/Take\n"
        "the input ends here: the run continues without another stop\n"
    )


ANSWERS = {
    "foo": "no command 'foo' (`help` lists the commands)",
    "tre": "",
    "braek": "no command 'braek' (did you mean 'break'?)",
    "be": "no object is known yet",
    "bl": "nothing is written yet",
    "blackboard zzz": "no key contains 'zzz'",
    "belief zzz": "no object is called 'zzz'",
    "node Tkae": "no node fits 'Tkae' (did you mean 'Take'?)",
    "break 12": "no node fits '12'",
    "step -1": "'-1' is no number of ticks",
    "step 1.5": "'1.5' is no number of ticks",
    "delete 7": "there is no breakpoint 7; `break` lists them",
    "print": "print what? An expression, as 'items_left and not holding'",
    "print 1 +": "not an expression",
    "help next": "next  continue to the next start or end of a node",
    "break Take after": f"2: after {PART}/Fallback/Take",
    "b Take before": f"2: before {PART}/Fallback/Take",
}  # fmt: skip


@pytest.mark.parametrize("line", ANSWERS)
def test_what_is_answered(line: str) -> None:
    run = start(MISSION)
    typed = Typed(line)
    debugger = Debugger(typed.prompt)
    debugger.attach(run.tree)
    run.tick()
    said = typed.text.splitlines()
    assert said[1] == f"> {line}"
    assert said[2].startswith(ANSWERS[line])


def test_several_nodes_that_fit_are_named() -> None:
    run = start("Main: {Sequence: [{Scripted: {name: A}}, {Inverter: {Scripted: {name: B}}}]}")
    typed = Typed("node Scripted", "break Scripted after", "delete", "break")
    debugger = Debugger(typed.prompt)
    debugger.attach(run.tree)
    run.tick()
    assert typed.text.splitlines()[2:-1] == [
        "2 nodes fit 'Scripted': Main/Sequence/A, Main/Sequence/Inverter/B",
        "> break Scripted after",
        "1: after Main/Sequence/A",
        "2: after Main/Sequence/Inverter/B",
        "> delete",
        "> break",
        "no breakpoints; `break PATH` sets one",
    ]


def test_a_fault_of_a_view_does_not_reach_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("picktree.apps.cli.debug_prompt.where_lines", lambda *_: 1 / 0)
    shown = session("where", "quit")
    assert "`where` failed: ZeroDivisionError: division by zero" in shown


def test_words_are_completed() -> None:
    run = start(MISSION)
    typed = Typed("c")
    debugger = Debugger(typed.prompt)
    debugger.attach(run.tree)
    assert typed.prompt.completions("be") == ["belief "]
    assert typed.prompt.completions("node Main/") == []  # nothing runs yet
    run.tick()
    assert typed.prompt.completions("b") == ["blackboard ", "belief ", "break "]
    assert typed.prompt.completions("node Main/Sequence/Fi") == ["Main/Sequence/Find"]
    assert typed.prompt.completions("b Main/Sequence/ForEach/Part/Fallback/T") == [f"{PART}/Fallback/Take"]
    assert typed.prompt.completions("blackboard Main/") == ["Main/speed"]
    assert typed.prompt.completions("help wh") == ["where"]
    assert typed.prompt.completions("delete ") == ["1"]
    assert typed.prompt.completions("zzz a") == []
    assert "zzz" not in typed.text


# The command.

QUICK = """\
picktree: 1
kind: mission
scene: sort_small
goal: sorted == 0
trees:
  Main:
    Sequence:
      - GoTo: {pose: home, breakpoint: before}
      - Log: {message: there}
"""


def test_a_script_debugs_and_stdout_is_the_answers(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(QUICK)
    line = ["run", str(tmp_path / "m.yaml"), "--backend", "kinematic", "--out", str(tmp_path)]
    debugged = call([*line, "--json", "--debug"], typed="c\nnode\nstep\nnext\nn\nbelief\ntree\nc\n")
    assert debugged.returncode == 0
    plain = Session(RunRequest(mission=tmp_path / "m.yaml", backend="kinematic", out=tmp_path)).run()
    assert json.loads(debugged.stdout)["digest"] == plain.digest
    assert debugged.stderr.splitlines()[1:6] == [
        "0.00 s, before Main",
        "(picktree) c",
        "0.00 s, before Main/Sequence/GoTo",
        "(picktree) node",
        "Main/Sequence/GoTo: GoTo, action, RUNNING",
    ]


def typed(folder: Path, monkeypatch: pytest.MonkeyPatch, lines: str, *options: str) -> int:
    """The exit code of a run into whose stdin somebody types these lines."""
    (folder / "m.yaml").write_text(QUICK)
    monkeypatch.setattr("sys.stdin", io.StringIO(lines))
    return answer(["run", str(folder / "m.yaml"), "--backend", "kinematic", "--out", str(folder), *options])


def test_without_debug_breakpoints_do_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert typed(tmp_path, monkeypatch, "quit\n") == 0
    assert "(picktree)" not in "".join(capsys.readouterr())


def test_quitting_interrupts_the_run_and_leaves_a_whole_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert typed(tmp_path, monkeypatch, "c\nquit\n", "--debug") == 130
    assert "interrupted: the run was interrupted" in capsys.readouterr().out
    (log,) = tmp_path.glob("*/log.mcap")
    (result,) = tmp_path.glob("*/result.json")
    assert json.loads(result.read_text())["status"] == "interrupted"
    assert log.read_bytes().endswith(b"\x89MCAP0\r\n")


def test_at_a_terminal_tab_completes_and_ctrl_c_interrupts(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(QUICK)
    words = ["run", str(tmp_path / "m.yaml"), "--backend", "kinematic", "--out", str(tmp_path), "--debug"]
    terminal = Terminal(words, "dumb")
    assert "before Main" in terminal.until("(picktree) ")
    terminal.press(b"cont\t\n")
    assert "continue" in terminal.until("(picktree) ")
    # One that comes between the prompt and the wait for input waits for the next key, in Python's readline.
    terminal.until("interrupted: the run was interrupted", press=b"\x03")
    assert terminal.end() == 130
