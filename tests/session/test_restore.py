"""A run goes on from any of its checkpoints, from its log alone, exactly as it went on before."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from picktree.analysis import Run
from picktree.files import PicktreeError
from picktree.logs import RunResult
from picktree.logs.mcap import RawMessage
from picktree.session import RecordedRun, RunRequest, Session, simulated_messages
from picktree.session.checkpoints import RunState
from picktree.session.recorded_recipe import complete_state
from picktree.session.run_recipe import Recording
from picktree.simulation import Backend

from ..other_process import OtherProcess

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SCENE = "picktree: 1\nkind: scene\nbase: sort_small\ncheckpoint_every: 1\n"
FAULTS = """\
picktree: 1
kind: faults
faults:
  - {fault: remove, when: {node: Grasp, start: 2, delay: 500 ms}, target: {nearest_to: object}}
  - {fault: friction, when: {at: 15 s}, target: {index: 3}, friction: 0.2}
"""


def record(folder: Path, backend: Backend) -> RunResult:
    (folder / "often.yaml").write_text(SCENE)
    (folder / "faults.yaml").write_text(FAULTS)
    request = RunRequest(
        EXAMPLES / "sort_by_colour.yaml",
        scene=str(folder / "often.yaml"),
        seed=3,
        faults=folder / "faults.yaml",
        out=folder,
        backend=backend,
        verify=backend == "kinematic",
        limit=60.0 if backend == "kinematic" else 7.0,
    )
    return Session(request).run()


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RecordedRun]:
    with Run(record(tmp_path_factory.mktemp("record"), "kinematic").log) as run, RecordedRun(run) as found:
        yield found


def go_on(recorded: RecordedRun, checkpoint: str, out: Path) -> RunResult:
    recipe = recorded.from_checkpoint(checkpoint, recorded.state(checkpoint))
    return Session(recipe, record=Recording(out)).run()


def without_wall(result: RunResult) -> dict[str, object]:
    return {
        k: v for k, v in result.to_json().items() if k not in ("cpu_seconds", "wall_seconds", "log", "folder")
    }


def told(message: RawMessage) -> tuple[str, int, bytes]:
    return message.topic, message.time, message.data


def test_first_and_last_checkpoint_go_on_byte_for_byte(recorded: RecordedRun, tmp_path: Path) -> None:
    run = recorded.run
    assert run.result is not None
    assert run.result.failures["grasp.missed"] == 1
    names = recorded.checkpoints()
    assert len(names) == 3
    for name in names[::2]:
        again = go_on(recorded, name, tmp_path)
        assert without_wall(again) == without_wall(run.result)
        with Run(again.log) as other:
            assert other.info.continues is not None
            time = other.info.continues.time
            new = [told(m) for m in simulated_messages(other.log)]
            assert new == [told(m) for m in simulated_messages(run.log, time)]
            assert new


def test_what_goes_on_is_in_the_state_of_the_checkpoint(recorded: RecordedRun, tmp_path: Path) -> None:
    name = recorded.checkpoints()[-1]
    state = recorded.state(name)
    assert state.recording is not None and state.bins_seen and state.streams
    assert state.grip is not None and state.grip.time > 0.0  # fingers may still open
    first = recorded.state(recorded.checkpoints()[0])
    shapes = {type(each.shape).__name__ for each in first.belief.scene.objects}
    assert shapes == {"Box", "Cylinder", "Sphere"}
    session = Session(recorded.from_checkpoint(name, state), record=Recording(tmp_path))
    assert session.execution.checkpoint(state.recording) == state
    # The way back to where the arm came from.
    assert state.way is not None
    back = session.execution.world.move.way_back()
    assert back is not None
    assert np.allclose(back.start, state.control["hold"], atol=0.02)


def test_a_continued_log_stands_alone(recorded: RecordedRun, tmp_path: Path) -> None:
    name = recorded.checkpoints()[1]
    state = recorded.state(name)
    again = go_on(recorded, name, tmp_path)
    with Run(again.log) as other, RecordedRun(other) as once_more:
        assert other.info.continues is not None
        assert other.info.continues.log == str(recorded.run.path.absolute())
        assert (other.info.continues.checkpoint, other.info.continues.items_done) == (name, 2)
        assert other.ticks.times[0] == pytest.approx(state.time)
        assert dict(other.blackboard_at(state.time)) == state.tree["blackboard"]
        moment, before = other.at(state.time), recorded.run.at(state.time)
        assert moment.belief is not None and before.belief is not None
        assert moment.belief.bodies == before.belief.bodies
        assert other.tree_at(state.time) == recorded.run.tree_at(state.time)
        assert other.log.digest() == again.digest
        running = {visit.path for visit in other.visits if visit.start == pytest.approx(state.time)}
        assert "Main/Repeat/Sequence/ForEach" in running
        assert Session(once_more.recipe(), record=Recording(tmp_path)).run().digest == again.digest


def test_what_an_older_checkpoint_lacks_is_in_the_log(recorded: RecordedRun) -> None:
    for name in recorded.checkpoints():
        state = recorded.state(name)
        made = complete_state(replace(state, tally=None, recording=None), recorded.run)
        assert made.tally == state.tally
        assert made.recording is not None and state.recording is not None
        assert made.recording.digest == state.recording.digest
        assert made.recording.believed == pytest.approx(state.recording.believed)
        assert made.recording.true == pytest.approx(state.recording.true)
        assert made.recording.failing == state.recording.failing
        assert made.recording.cameras == state.recording.cameras


def test_a_checkpoint_of_another_seed_and_what_is_none_are_refused(
    recorded: RecordedRun, tmp_path: Path
) -> None:
    name = recorded.checkpoints()[0]
    recipe = recorded.from_checkpoint(name, recorded.state(name))
    with pytest.raises(PicktreeError) as caught:
        Session(replace(recipe, seed=4), record=Recording(tmp_path))
    assert str(caught.value) == "the checkpoint is of seed 3, but this run has seed 4"
    with pytest.raises(PicktreeError, match="this is no checkpoint: Field required"):
        RunState.from_json(b'{"time": 1.0}')


def digest_from_the_first_checkpoint(log: Path, out: Path) -> str:
    with Run(log) as run, RecordedRun(run) as recorded:
        return go_on(recorded, recorded.checkpoints()[0], out).digest


def test_physics_goes_on_bit_for_bit_in_another_process(tmp_path: Path, elsewhere: OtherProcess) -> None:
    result = record(tmp_path, "physics")
    again = elsewhere.call(digest_from_the_first_checkpoint, result.log, tmp_path / "again")
    assert again == result.digest
