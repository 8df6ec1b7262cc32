"""Changes of the blackboard by the operator: refused or made, noted, and repeated from the log."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import pytest

from picktree.analysis import Run, RunChanges, what_if
from picktree.analysis.explain.explanation_text import notes_on
from picktree.analysis.resim import ResimOrder, run_order
from picktree.apps.cli.debug_prompt import DebugPrompt
from picktree.logs import RunResult
from picktree.session import Debugger, RecordedRun, ResumeRequest, Resumption, RunRequest, Session
from picktree.world.event_types import BlackboardSetEvent

MISSION = """\
picktree: 1
kind: mission
name: counting
scene: small.yaml
goal: sorted >= 1
trees:
  Main:
    ports: {rounds: {type: int, default: 5}, speed: {type: float, unit: m/s, default: 0.5}}
    Sequence:
      - Observe: {camera: overhead, objects: "{items}"}
      - ForEach:
          in: "{items}"
          out: "{item}"
          most: 1
          do:
            - Grasp: {object: "{item}"}
            - Place: {object: "{item}", into: "{item.destination}"}
      - Delay: {delay_msec: 200 ms, do: AlwaysSuccess, name: Pause}
      - Log: {message: rounds, value: "{rounds}"}
      - Repeat: {num_cycles: "{rounds}", do: {Delay: {delay_msec: 100 ms, do: AlwaysSuccess}}}
"""
SCENE = "picktree: 1\nkind: scene\nbase: sort_small\ncheckpoint_every: 1\n"


def debugged(tmp_path: Path, *lines: str) -> tuple[RunResult, str]:
    """Run the mission with these lines typed in the debugger; return the result and what was shown."""
    (tmp_path / "counting.yaml").write_text(MISSION)
    (tmp_path / "small.yaml").write_text(SCENE)
    typed: Iterator[str] = iter(lines)
    out = io.StringIO()

    def read(_: str) -> str:
        for line in typed:
            print(f"> {line}", file=out)
            return line
        raise EOFError

    request = RunRequest(tmp_path / "counting.yaml", seed=3, out=tmp_path, backend="kinematic")
    debugger = Debugger(DebugPrompt(read, out))
    return Session(request, observers=[debugger]).run(), out.getvalue()


def changes(run: Run) -> list[tuple[str, object, object]]:
    events = (at.record for at in run.events)
    return [(e.key, e.value, e.previous) for e in events if isinstance(e, BlackboardSetEvent)]


SET_IN_A_TICK = ("break Grasp", "break Log after", "continue", "set item = red_ball_1", "continue")
SET_BETWEEN_TICKS = (
    "set speed = 300 mm/s",
    "set rounds = {= rounds - 3}",
    "step",
    "set rounds = 4",
    "delete",
)


@pytest.fixture(scope="module")
def changed(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunResult, str]:
    folder = tmp_path_factory.mktemp("changed")
    return debugged(folder, *SET_IN_A_TICK, *SET_BETWEEN_TICKS, "continue")


def test_changes_are_noted_with_the_values_before(changed: tuple[RunResult, str]) -> None:
    result, shown = changed
    assert "> set item = red_ball_1\nMain/item is set to 'red_ball_1' by the operator; it was " in shown
    with Run(result.log) as run:
        found = changes(run)
        assert found[1:] == [("Main/speed", 0.3, 0.5), ("Main/rounds", 2, 5), ("Main/rounds", 4, 2)]
        grasped = next(visit for visit in run.visits if visit.path.endswith("/Grasp"))
        assert (found[0][:2], grasped.item) == (("Main/item", "red_ball_1"), "red_ball_1")
        assert sum(visit.path.endswith("/Delay/AlwaysSuccess") for visit in run.visits) == 2
        told = "\n".join(notes_on(run))
    assert "s: Main/rounds is set to 4 by the operator; it was 2" in told


def test_a_resimulation_repeats_changes_at_their_places(changed: tuple[RunResult, str]) -> None:
    answer = run_order(ResimOrder(changed[0].log, RunChanges(), None, None), lambda _: None)
    assert (answer.difference, answer.digest) == (None, changed[0].digest)


def test_a_what_if_repeats_the_changes_after_its_checkpoint(
    changed: tuple[RunResult, str], tmp_path: Path
) -> None:
    with Run(changed[0].log) as run, RecordedRun(run) as recorded:
        (name,) = recorded.checkpoints()[-1:]
        at = recorded.state(name).time
    found = what_if(changed[0].log, f"{at:.2f} s", out=tmp_path)
    assert (found.checkpoint, found.identical) == (name, True)
    with Run(found.new_log) as run:
        assert [key for key, _, _ in changes(run)] == ["Main/speed", "Main/rounds", "Main/rounds"]


def test_a_resumed_run_repeats_the_changes_after_its_checkpoint(tmp_path: Path) -> None:
    lines = ("break Log", "continue", "delete", "set rounds = 2", "step", "quit")
    stopped, _ = debugged(tmp_path, *lines)
    assert stopped.status == "interrupted"
    with Resumption(ResumeRequest(stopped.folder, out=tmp_path)) as resumption:
        resumed = resumption.session().run()
    whole, _ = debugged(tmp_path, *lines[:-1], "continue")
    assert (resumed.status, resumed.digest) == ("success", whole.digest)


def test_what_does_not_fit_is_refused_and_changes_nothing(tmp_path: Path) -> None:
    lines = (
        "break Log", "continue", "set", "set rounds", "set rouns = 2", "set rounds = two",
        "set rounds = {= rounds +}", "set rounds = {= speed}", "set items = 3", "set items = [",
        "set speed = 3 N",
    )  # fmt: skip
    result, shown = debugged(tmp_path, *lines)
    said = shown.split("> set\n")[1]
    assert said.splitlines()[::2] == [
        "set what? A key and its value, as 'set rounds = 3'",
        "set what? A key and its value, as 'set rounds = 3'",
        "the blackboard has no key 'rouns' (did you mean 'Main/rounds'?)",
        "Main/rounds: 'two' is not a whole number",
        "not an expression: a value is missing after '+', at character 11 of '{= rounds +}'",
        "Main/rounds cannot be 0.5: 0.5 is not a whole number",
        "Main/items: 3 is not a list, each an object's id",
        "'[' has no value: not valid YAML: a value is missing here",
        "Main/speed: '3 N' is a force, not a speed (as 100 mm/s)",
    ]
    with Run(result.log) as run:
        assert changes(run) == []
