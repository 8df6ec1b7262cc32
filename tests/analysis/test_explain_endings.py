"""Runs that ended by something else than a skill's failure: conditions, faults of code, a crash, edits."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.analysis.explain import to_text, true_world
from picktree.analysis.explain.explanation_text import notes_on
from picktree.apps.cli.replay_stepper import evidence_lines
from picktree.logs import RunLog
from picktree.logs.log_files import Rotation
from picktree.session import ResumeRequest, Resumption, RunRequest, Session

from .test_explain_devices import CAN
from .test_explain_roots import BALL, BLOCK
from .test_explain_roots import MISSION as SORT
from .test_explain_roots import run as run_sort

HEAD = "picktree: 1\nkind: mission\nscene: sort_small\n"
PLUGIN = """
from picktree.trees import In, port
from picktree.trees import Skill, Steps
from picktree.robot import World


class Broken(Skill):
    '''Fails by a fault of its own.'''

    uses = ()
    example = "Broken"

    def run(self, world: World) -> Steps:
        yield
        raise ZeroDivisionError("one over nothing")


NODES = (Broken,)
"""


def run(folder: Path, trees: str) -> Path:
    (folder / "mission.yaml").write_text(HEAD + trees, encoding="utf-8")
    request = RunRequest(mission=folder / "mission.yaml", backend="kinematic", out=folder)
    return Session(request).run().folder


def test_a_condition_that_does_not_hold(tmp_path: Path) -> None:
    folder = run(
        tmp_path, "trees:\n  Main:\n    Sequence:\n      - AlwaysSuccess\n      - Condition: {if: 1 > 2}\n"
    )
    with Run(folder) as log:
        found = log.explanation
    assert found.outcome.sentence == (
        "the mission ended in FAILURE: a condition did not hold; 0 of 4 items are where they belong, 4 left"
    )
    assert found.failures == ()
    (cause,) = found.root_causes
    assert (cause.cause, cause.ended_run) == ("tree.condition", True)
    assert cause.title == "a condition did not hold, and the mission ends there: 1 > 2"
    assert cause.reasons == ("Main/Sequence/Condition was checked at 0.00 s",)


def test_an_object_that_the_belief_never_had_is_a_name_of_the_mission(tmp_path: Path) -> None:
    trees = "trees:\n  Main:\n    Sequence: [{Observe: {objects: '{items}'}}, {Grasp: {object: item}}]\n"
    with Run(run(tmp_path, trees)) as log:
        cause = log.explanation.root_causes[0]
    assert (cause.cause, cause.ended_run) == ("world.unknown_object", True)
    assert cause.title == "the mission names the object 'item', which was never in the belief"
    assert "red_can_1" in cause.reasons[0]
    assert cause.reasons[1] == 'a key of the blackboard needs braces, as "{item}"'


def test_an_item_that_still_rolls_in_its_bin_when_the_run_is_scored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("picktree.session.execution._MAX_SETTLING_TICKS", 0)
    (tmp_path / "one_ball.yaml").write_text(
        "picktree: 1\nkind: scene\nbase: sort_small\nspawn:\n"
        "  - {of: {ball: 1}, colours: [red], area: {min: [0.4, -0.1], max: [0.6, 0.1]}}\n"
    )
    (tmp_path / "mission.yaml").write_text(
        "picktree: 1\nkind: mission\nscene: one_ball.yaml\ntrees:\n  Main:\n    Sequence:\n"
        '      - Observe: {camera: overhead, objects: "{items}"}\n'
        '      - ForEach: {in: "{items}", out: "{item}", do: {Sequence: [{Grasp: {object: "{item}"}}, '
        '{Place: {object: "{item}", into: red_bin}}]}}\n'
        "      - Observe: {camera: overhead}\n"
    )
    faults = tmp_path / "faults.yaml"
    faults.write_text(
        "picktree: 1\nkind: faults\nfaults:\n  - {fault: bump, when: {node: Observe, start: 2}, "
        "target: {kind: ball}, velocity: [0, 0.2, 0]}\n"
    )
    result = Session(RunRequest(tmp_path / "mission.yaml", faults=faults, out=tmp_path)).run()
    assert (result.status, result.items.sorted) == ("incomplete", 0)
    with Run(result.folder) as log:
        (cause,) = log.explanation.root_causes
        (story,) = log.explanation.items
    assert (cause.cause, cause.ended_run) == ("place.not_at_rest", True)
    assert cause.title == "red_ball_1 still moved in red_bin when the mission ended"
    assert story.truth == "truly in red_bin, where it belongs, but is not at rest in it"


def test_a_fault_in_the_code_of_a_node(tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text(PLUGIN, encoding="utf-8")
    with Run(run(tmp_path, "plugins: [broken.py]\ntrees:\n  Main:\n    Broken\n")) as log:
        (cause,) = log.explanation.root_causes
        (failure,) = log.failures
        shown = [
            line for visit in log.account.visits if visit.failed_itself for line in evidence_lines(visit)
        ]
    assert (cause.cause, cause.ended_run, failure.fate) == ("internal.error", True, "ended")
    assert "one over nothing" in cause.title
    line = 1 + next(k for k, text in enumerate(PLUGIN.splitlines()) if "one over nothing" in text)
    assert f"(broken.py, line {line})" in failure.message
    assert failure.remedy == f"mend broken.py, line {line}; where that line is right, report it with the log"
    assert cause.reasons[0].startswith(f'File "broken.py", line {line}, in ')
    assert cause.reasons[-1] == "ZeroDivisionError: one over nothing"
    assert f"  remedy: {failure.remedy}" in shown
    assert "    ZeroDivisionError: one over nothing" in shown


WAITING = HEAD + "trees:\n  Main:\n    Delay: {delay_msec: 3 s, do: {GoTo: {pose: rest}}}\n"


def test_a_run_that_goes_on_is_not_called_killed(tmp_path: Path) -> None:
    (tmp_path / "mission.yaml").write_text(WAITING, encoding="utf-8")
    session = Session(RunRequest(mission=tmp_path / "mission.yaml", backend="kinematic", out=tmp_path))
    step, seen = session.execution.world.control.step_tick, list[tuple[str, str, str]]()

    def look(period: float) -> None:
        if session.execution.world.clock.now > 1.2 and not seen:
            with Run(session.folder) as log:
                found = log.explanation
            seen.append((found.outcome.status, found.root_causes[0].cause, found.outcome.sentence))
        step(period)

    session.execution.world.control.step_tick = look  # pyright: ignore[reportAttributeAccessIssue]
    session.run()
    ((status, cause, sentence),) = seen
    assert (status, cause) == ("running", "run.going_on")
    assert sentence.startswith("the run is still in progress: its log has come to ")
    with Run(session.folder) as log:
        assert log.explanation.outcome.status == "incomplete"


def test_a_file_of_a_rotated_log_that_another_continues_is_not_called_killed(tmp_path: Path) -> None:
    (tmp_path / "mission.yaml").write_text(WAITING, encoding="utf-8")
    request = RunRequest(
        mission=tmp_path / "mission.yaml", backend="kinematic", out=tmp_path, rotation=Rotation(seconds=1.0)
    )
    folder = Session(request).run().folder
    with Run(folder / "log-0002.mcap") as log:
        found = log.explanation
    assert (found.outcome.status, found.root_causes) == ("continued", ())
    assert found.outcome.sentence == (
        "this file of the log ends at 1.95 s while Delay was running; the run continues in log-0003.mcap"
    )
    with Run(max(folder.glob("log-*.mcap"))) as log:
        assert log.explanation.outcome.status == "incomplete"


def test_what_was_done_before_a_log_began_is_one_item_in_it(in_parts: tuple[Path, Path]) -> None:
    """In a later file of a rotated log, and in that of a resumed run."""
    folder, resumed = in_parts
    for log in (folder, folder / "log-0002.mcap", resumed):
        with Run(log) as run:
            items = run.explanation.items
        assert len(items) == 12
        assert all(item.truth.startswith("truly ") for item in items)
        assert not any("never seen" in item.truth for item in items)
        done = [item for item in items if item.state == "done"]
        assert all(item.truth.endswith("_bin, where it belongs") for item in done)
        assert len(done) >= 4
    with Run(resumed) as run:
        (note,) = notes_on(run)
        begun = run.info.continues
    assert begun is not None
    assert note == (
        f"the log begins at {begun.time:.2f} s, at a checkpoint of {begun.log}; earlier events are not in it"
    )


def test_a_program_that_died_while_it_ran(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mission.yaml").write_text(
        HEAD + "trees:\n  Main:\n    GoTo: {pose: rest}\n", encoding="utf-8"
    )
    session = Session(RunRequest(mission=tmp_path / "mission.yaml", backend="kinematic", out=tmp_path))

    def die(period: float) -> None:
        if session.execution.world.clock.now > 0.5:
            raise RuntimeError("the power is gone")
        step(period)

    step = session.execution.world.control.step_tick
    monkeypatch.setattr(session.execution.world.control, "step_tick", die)
    with pytest.raises(RuntimeError):
        session.run()
    with Run(session.folder) as log:
        found = log.explanation
    assert found.outcome.status == "crashed"
    assert found.outcome.sentence.startswith("the run was ended at ")
    assert found.outcome.sentence.endswith("by an error of the program (RuntimeError) while GoTo was running")
    assert [cause.cause for cause in found.root_causes] == ["run.crashed"]


def test_a_mission_that_was_edited_while_it_ran(edited: Path) -> None:
    with Run(edited) as log:
        (note,) = notes_on(log)
        text = to_text(log, log.explanation, str(edited))
    assert note.startswith("the mission was edited while it ran, at ")
    assert "Note: the mission was edited while it ran" in text


def _no_states(_: RunLog) -> Iterator[tuple[float, Mapping[str, object]]]:
    return iter(())


def test_a_run_that_was_killed_while_an_item_fell_has_no_other_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The truth is older than the last tick: the item seems to be in the hand still. A log without states of
    the simulation, as older ones are, has it once a second."""
    (tmp_path / "mission.yaml").write_text(SORT, encoding="utf-8")
    (tmp_path / "scene.yaml").write_text(
        f"picktree: 1\nkind: scene\nbase: sort_small\nspawn:\n{BALL}{BLOCK}", encoding="utf-8"
    )
    session = Session(RunRequest(mission=tmp_path / "mission.yaml", backend="physics", out=tmp_path / "run"))
    world = session.execution.world
    step, placed, copies = world.control.step_tick, list[float](), list[Path]()

    def watch(period: float) -> None:
        now = world.clock.now
        if world.journal.items_done > len(placed):
            placed.append(now)
        if placed and now - placed[-1] < 0.6:
            copies.append(Path(shutil.copytree(session.folder, tmp_path / f"killed_{now:.2f}")))
        step(period)

    world.control.step_tick = watch  # pyright: ignore[reportAttributeAccessIssue]
    assert session.run().status == "success"
    assert len(copies) >= 12
    monkeypatch.setattr(true_world, "true_states", _no_states)
    for folder in copies:
        with Run(folder) as log:
            found = log.explanation
        assert (folder.name, found.outcome.status) == (folder.name, "killed")
        assert [cause.cause for cause in found.root_causes] == ["run.killed"], folder.name


def test_a_resumed_run_takes_over_what_was_lost_before(tmp_path: Path) -> None:
    fault = "{fault: remove, when: {node: Grasp, delay: 500 ms}, target: {nearest_to: object}}"
    folder = run_sort(
        tmp_path,
        items=BALL + BLOCK + CAN.replace("0.5,", "0.58,").replace("0.52,", "0.6,"),
        fault=fault,
        limit=13.0,
    )
    with Resumption(ResumeRequest(folder, out=tmp_path / "resumed", limit=60.0)) as resumption:
        resumed = resumption.session().run().folder
    with Run(resumed) as log:
        found = log.explanation
    (cause,) = found.root_causes
    assert (found.outcome.status, cause.cause, cause.items) == ("incomplete", "item.gone", ("blue_block_1",))
    assert cause.time is not None and cause.time < 1.0
    assert cause.reasons[0].startswith("this log begins later, at ")
