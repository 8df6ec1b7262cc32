"""A run that was killed goes on: from its checkpoint as if nothing had been, or as things stood."""

from __future__ import annotations

import gc
import json
import multiprocessing
import os
import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.apps.cli import answer
from picktree.files import PicktreeError
from picktree.logs import RunLog, RunResult, Stamped
from picktree.logs.mcap import McapReader
from picktree.session import (
    Execution,
    Observer,
    PresetAnswers,
    RecordedRun,
    ResumeRequest,
    Resumption,
    RunRequest,
    Session,
)
from picktree.session.execution import TICK_LENGTH
from picktree.session.run_recipe import Recording
from picktree.simulation.kinematic import KinematicHardware
from picktree.world import JournalEvent, Tick

from ..logs.rewriting import ORDER, WRITING, Content

CHUNK = 0x06
"""Opcode of a chunk in MCAP."""
SCENE = "picktree: 1\nkind: scene\nbase: sort_small\ncheckpoint_every: 1\n"
MISSION = """\
picktree: 1
kind: mission
name: two
scene: often
goal: sorted >= 2
trees:
  Main:
    Sequence:
      - Observe: {camera: overhead, objects: "{items}"}
      - ForEach:
          in: "{items}"
          out: "{item}"
          most: 2
          do:
            - Grasp: {object: "{item}"}
            - Place: {object: "{item}", into: "{item.destination}"}
"""
ASKING = """\
picktree: 1
kind: mission
name: asking
scene: sort_small
goal: sorted >= 0
trees:
  Main:
    Sequence:
      - Observe: {camera: overhead, objects: "{items}"}
      - ForEach:
          in: "{items}"
          out: "{item}"
          most: 2
          do:
            - AskForHelp: {reason: "is the {item.kind} there?", object: "{item}", answer: "{answer}"}
            - Log: {message: answered, value: "{answer}"}
"""


class Killer(Observer):
    """Kills its process while the second item is in the hand, when the log has all that was before."""

    def __init__(self) -> None:
        self._log = Path()
        self._held = 0

    def started(self, run: Execution, folder: Path) -> None:
        self._run, self._log = run, folder / "log.mcap"

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        hardware = self._run.hardware
        assert isinstance(hardware, KinematicHardware)
        if items_done == 1 and self._run.world.scene.held is not None and hardware.bodies.held:
            self._held += 1
        while self._held == 9:
            with RunLog(self._log) as log:
                if log.end > now - 1.5 * TICK_LENGTH:
                    os.kill(os.getpid(), signal.SIGKILL)
            time.sleep(0.02)


def run_and_be_killed(mission: Path, out: Path) -> None:
    Session(RunRequest(mission, seed=3, out=out, backend="kinematic"), observers=[Killer()]).run()


def told(run: Run, kind: str) -> list[str]:
    return [at.record.message for at in run.events if at.record.kind == kind]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("killed")
    (folder / "often.yaml").write_text(SCENE)
    (folder / "two.yaml").write_text(MISSION.replace("scene: often", "scene: often.yaml"))
    return folder


@pytest.fixture(scope="module")
def alone(folder: Path) -> RunResult:
    request = RunRequest(folder / "two.yaml", seed=3, out=folder / "alone", backend="kinematic")
    return Session(request).run()


@pytest.fixture(scope="module")
def killed(folder: Path) -> Iterator[Path]:
    """The folder of a run whose process got SIGKILL while the second item was in the hand."""
    out = folder / "killed"
    ran = multiprocessing.get_context("fork").Process(
        target=run_and_be_killed, args=(folder / "two.yaml", out)
    )
    ran.start()
    ran.join()
    assert ran.exitcode == -signal.SIGKILL
    yield next(out.iterdir())


def test_a_killed_run_goes_on_byte_for_byte(killed: Path, alone: RunResult, tmp_path: Path) -> None:
    with Resumption(ResumeRequest(killed, out=tmp_path)) as resumption:
        assert f"{killed / 'log.mcap'} from checkpoint-0001: " in resumption.description
        assert resumption.description.endswith(" s, 1 item done")
        result = resumption.session().run()
    assert (result.status, result.digest) == ("success", alone.digest)
    assert (result.items, result.picks) == (alone.items, alone.picks)


@pytest.mark.parametrize("as_it_stands", [False, True])
def test_of_the_log_only_what_follows_the_checkpoint_is_read_and_nothing_kept(
    killed: Path, monkeypatch: pytest.MonkeyPatch, *, as_it_stands: bool
) -> None:
    read: list[float] = []
    events = RunLog.events

    def heard(
        log: RunLog, start: float | None = None, end: float | None = None
    ) -> Iterator[Stamped[JournalEvent]]:
        for at in events(log, start, end):
            read.append(at.time)
            yield at

    monkeypatch.setattr(RunLog, "events", heard)
    with Resumption(ResumeRequest(killed, as_it_stands=as_it_stands)) as resumption:
        resumption.session()
        logs = [each.path for each in gc.get_objects() if isinstance(each, McapReader)]
        assert killed / "log.mcap" not in logs  # it is of no use any longer, and as large as it is long
    with Run(killed) as run, RecordedRun(run) as recorded:
        checkpoint = recorded.last_checkpoint(run.end)
    assert checkpoint is not None
    assert read and min(read) > checkpoint[1].time > 0.0


@pytest.fixture(scope="module")
def stood(killed: Path, tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """The killed run when it has gone on as things stood."""
    out = tmp_path_factory.mktemp("stood")
    with Resumption(ResumeRequest(killed, out=out, as_it_stands=True)) as resumption:
        assert resumption.description.endswith("; the robot looks first")
        session = resumption.session()
        # The fingers hold an item: that the checkpoint told them to open is over.
        assert session.execution.world.gripper.overdue_failure() is None
        return session.run()


def test_it_goes_on_as_things_stood_and_looks_first(
    stood: RunResult, alone: RunResult, tmp_path: Path
) -> None:
    assert (stood.status, stood.items) == ("success", alone.items)
    assert stood.picks.tried >= alone.picks.tried  # those of before the kill count
    with Run(stood.folder) as run, RecordedRun(run) as recorded:
        assert run.info.continues is not None
        assert (run.info.continues.as_it_stands, run.info.continues.items_done) == (True, 1)
        assert told(run, "put_down") == ["in_hand is put down"]
        first, felt, looked = told(run, "took_stock")
        assert first == "the run goes on as things stand: it looks first, with the belief of before"
        assert felt.startswith("something is in the hand: opening ")
        assert looked == "looked: nothing more is done; 3 to be done"
        names = [at.record.data["object"] for at in run.events if at.record.kind == "pick"]
        with Run(alone.folder) as before:
            picked = [at.record.data["object"] for at in before.events if at.record.kind == "pick"]
        assert set(names) == {picked[1]}  # the same item has the same id
        limit = run.info.continues.time + 0.5
        again = Session(replace(recorded.recipe(), limit=limit), record=Recording(tmp_path)).run()
        with Run(again.folder) as repeated:
            assert told(repeated, "took_stock") == [first, felt]


def test_a_killed_run_that_another_program_rewrote_goes_on_as_things_stood(
    killed: Path, stood: RunResult, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = WRITING["lz4"](ORDER["epoch"](ORDER["shuffled"](Content.of(killed / "log.mcap"))))
    log = content.write(tmp_path / "rewritten.mcap")
    assert answer(["run", "--resume", str(log), "--as-it-stands", "--out", str(tmp_path / "on")]) == 0
    said = capsys.readouterr().err.partition("\n")[0]
    assert said.startswith(f"resuming {log} from its last state at ")
    result = json.loads(next(tmp_path.glob("on/*/result.json")).read_text())
    assert (result["sim_seconds"], result["items"]["sorted"]) == (stood.sim_seconds, stood.items.sorted)


def killed_at_once(folder: Path, out: Path) -> Path:
    """Copy a log up to the end of its first chunk, as a process leaves it that is killed at its start."""
    data, at, chunks = (folder / "log.mcap").read_bytes(), 8, 0
    while not chunks:
        chunks += data[at] == CHUNK
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    out.mkdir()
    (out / "log.mcap").write_bytes(data[:at])
    return out


def test_a_run_that_was_killed_before_its_first_tick_goes_on_where_it_began(
    killed: Path, alone: RunResult, tmp_path: Path
) -> None:
    assert alone.folder is not None
    cut = killed_at_once(alone.folder, tmp_path / "cut")
    for stands in (False, True):
        with Resumption(ResumeRequest(cut, as_it_stands=stands)) as resumption:
            assert resumption.description.endswith(": the run starts from the beginning")
            assert resumption.recipe.start is None
    with Resumption(ResumeRequest(killed, out=tmp_path, as_it_stands=True)) as resumption:
        stood = resumption.recipe.start
        assert stood is not None
        limited = replace(resumption.recipe, limit=stood.state.time + 0.5)
        again = Session(limited, record=Recording(tmp_path)).run()
    assert again.folder is not None
    cut = killed_at_once(again.folder, tmp_path / "cut again")
    with Resumption(ResumeRequest(cut, as_it_stands=True)) as resumption:
        at = f"at {stood.state.time:.2f} s, 1 item done"
        assert resumption.description.endswith(
            f" has no tick of its own: the run resumes from its own start, {at}"
        )
        assert resumption.recipe.start == stood


def test_a_finished_run_is_refused(alone: RunResult) -> None:
    with pytest.raises(PicktreeError) as refused:
        Resumption(ResumeRequest(alone.folder))
    assert str(refused.value) == (
        f"{alone.log}: the run is finished: the goal is reached; `picktree whatif` resumes it from a "
        "checkpoint with changes"
    )


def test_a_run_at_its_limit_goes_on_with_a_later_one(folder: Path, alone: RunResult, tmp_path: Path) -> None:
    request = RunRequest(folder / "two.yaml", seed=3, out=tmp_path, backend="kinematic", limit=0.5)
    ended = Session(request).run()
    assert ended.status == "timeout"
    with pytest.raises(PicktreeError) as refused:
        Resumption(ResumeRequest(ended.folder))
    assert str(refused.value) == (
        f"{ended.log}: the run was ended at its limit, 0.50 s; give a later one, as in --limit '60 s'"
    )
    with Resumption(ResumeRequest(ended.folder, out=tmp_path, limit=60.0)) as resumption:
        assert resumption.description == f"{ended.log} has no checkpoint: the run starts from the beginning"
        assert resumption.recipe.limit == 60.0


def test_a_run_that_asks_for_help_is_paused_and_goes_on_with_the_answer(tmp_path: Path) -> None:
    (tmp_path / "asking.yaml").write_text(ASKING)
    request = RunRequest(tmp_path / "asking.yaml", seed=3, out=tmp_path, backend="kinematic")
    paused = Session(request, observers=[PresetAnswers(["2"])]).run()
    assert (paused.status, paused.reached) == ("paused", False)
    assert paused.asked is not None
    assert paused.asked.choices == ("go on", "set aside", "give up")
    assert paused.to_text("picktree").splitlines()[3] == (
        f"resume with picktree run --resume {paused.folder} --answer 'go on'"
    )
    assert RunResult.from_json_text(paused.to_json_text(), paused.log).asked == paused.asked

    with Resumption(ResumeRequest(paused.folder, out=tmp_path, answers=("give",))) as resumption:
        assert "from checkpoint-0001" in resumption.description
        result = resumption.session().run()
    assert (result.status, result.message) == (
        "failure",
        f"help was asked for, and given up: {paused.asked.reason}",
    )
    with Run(paused.folder) as run, RecordedRun(run) as recorded:
        assert told(run, "log") == ["answered: 'set aside'"]
        assert told(run, "help_wanted")[-1] == f"help is wanted: {paused.asked.reason}"
        again = Session(recorded.recipe(), record=Recording(tmp_path), observers=[recorded.operator()]).run()
        assert run.explanation.outcome.sentence.startswith(f"the run waits for help: {paused.asked.reason}")
    assert (again.status, again.digest) == ("paused", paused.digest)


def test_an_answer_that_is_no_choice_is_refused(tmp_path: Path) -> None:
    (tmp_path / "asking.yaml").write_text(ASKING)
    request = RunRequest(tmp_path / "asking.yaml", seed=3, out=tmp_path, backend="kinematic")
    with pytest.raises(PicktreeError) as refused:
        Session(request, observers=[PresetAnswers(["perhaps"])]).run()
    assert str(refused.value) == (
        "--answer perhaps: Main/Sequence/ForEach/Sequence/AskForHelp asks, and takes one of these: "
        "go on, set aside, give up"
    )
