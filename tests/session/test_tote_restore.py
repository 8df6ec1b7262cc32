"""A run that empties a tote goes on from its checkpoints as it was: with the heap that it saw."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from picktree.analysis.run import Run
from picktree.logs.run_result import RunResult
from picktree.session.resume.recorded_recipe import RecordedRun, simulated_messages
from picktree.session.session import Recording, RunRequest, Session

SCENE = """\
picktree: 1
kind: scene
base: tote
checkpoint_every: 1
cameras: {overhead: {size: [320, 240]}}
spawn: [{of: {assortment: 3}, colours: [red, blue], into: tote, drop: heap}]
"""
SEED = 5
MISSION = """\
picktree: 1
kind: mission
name: two
scene: few.yaml
goal: sorted >= 2
trees:
  Main:
    Repeat:
      num_cycles: 2
      do:
        Sequence:
          - PickAny: {from: tote, out: "{thing}"}
          - Place: {object: "{thing}", into: "{thing.destination}"}
"""


@pytest.fixture(scope="module")
def emptied(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    folder = tmp_path_factory.mktemp("tote")
    (folder / "few.yaml").write_text(SCENE)
    (folder / "two.yaml").write_text(MISSION)
    return Session(RunRequest(folder / "two.yaml", seed=SEED, out=folder)).run()


@pytest.fixture
def recorded(emptied: RunResult) -> Iterator[RecordedRun]:
    with Run(emptied.log) as run, RecordedRun(run) as found:
        yield found


def test_two_things_are_sorted(emptied: RunResult) -> None:
    assert (emptied.status, emptied.items.sorted, emptied.items.misplaced) == ("success", 2, 0)


def test_it_goes_on_with_the_heap_that_was_seen(recorded: RecordedRun, tmp_path: Path) -> None:
    run = recorded.run
    assert run.result is not None
    name = recorded.checkpoints()[0]
    state = recorded.state(name)
    assert set(state.heaps) == {"tote"}
    again = Session(recorded.from_checkpoint(name, state), record=Recording(tmp_path)).run()
    assert again.digest == run.result.digest
    with Run(again.log) as other:
        assert other.info.continues is not None
        new = [(m.topic, m.time, m.data) for m in simulated_messages(other.log)]
        before = simulated_messages(run.log, other.info.continues.time)
        assert new == [(m.topic, m.time, m.data) for m in before]
        assert len(new) > 100
