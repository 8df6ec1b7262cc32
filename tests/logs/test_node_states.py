"""The state of every node in every tick is rebuilt from snapshots and transitions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from picktree.files import PicktreeError
from picktree.logs import RunLog
from picktree.logs.log_records import NodesMessage, decode
from picktree.logs.node_states import with_updates
from picktree.logs.recording import Recorder
from picktree.world import NodeState, Tick, Transition, Tree, TreeNode

A = NodeState("Main", "Sequence", "RUNNING", ticked=True)
B = NodeState("Main/Grasp", "Grasp", "RUNNING", ticked=True, message="closes")
LIFTS = replace(B, message="lifts")
UNTICKED = replace(B, ticked=False)
IDLE = replace(B, status="IDLE", message="")


def update(state: NodeState) -> Transition:
    return Transition(state.path, state.status, message=state.message, ticked=state.ticked, update=True)


TICKS = (
    Tick(
        "RUNNING",
        B.path,
        (A, B),
        (),
        (Transition("Main", "RUNNING"), Transition(B.path, "RUNNING"), update(B)),
    ),
    Tick("RUNNING", B.path, (A, B)),
    Tick("RUNNING", B.path, (A, LIFTS), (), (update(LIFTS),)),
    Tick("RUNNING", B.path, (A, replace(LIFTS, ticked=False)), (), (update(replace(LIFTS, ticked=False)),)),
    # The skill ends, is reset, begins and ends again within one tick.
    Tick(
        "RUNNING",
        "Main",
        (A, replace(IDLE, status="SUCCESS", message="held")),
        (),
        (
            Transition(B.path, "FAILURE", cause="grasp.slipped", origin=B.path, message="it slipped"),
            update(IDLE),
            Transition(B.path, "RUNNING"),
            Transition(B.path, "SUCCESS", message="held"),
        ),
    ),
    Tick("IDLE", "", (replace(A, status="IDLE"), IDLE), (), (update(IDLE), Transition("Main", "IDLE"))),
)


def record(sample: ModuleType, path: Path, ticks: int, *, checkpoint: float = 1.0) -> Path:
    with Recorder(path, sample.RUN, checkpoint=checkpoint) as recorder:
        sample.start(recorder)
        for k in range(ticks):
            recorder.tick(k * 0.05, TICKS[k % len(TICKS)])
    return path


@pytest.mark.parametrize("checkpoint", [0.05, 0.2, 1.0])
def test_each_tick_is_read_as_it_was_written(sample: ModuleType, tmp_path: Path, checkpoint: float) -> None:
    with RunLog(record(sample, tmp_path / "log.mcap", 60, checkpoint=checkpoint)) as log:
        ticks = [at.record for at in log.ticks()]
        assert ticks == [TICKS[k % len(TICKS)] for k in range(60)]
        assert [at.record for at in log.ticks(1.31, 2.0)] == ticks[27:41]
        for k in (0, 19, 20, 43):
            at = log.tick_at(k * 0.05 + 0.02)
            assert at is not None and at.record == ticks[k]


def test_a_tick_without_changes_has_the_same_states(sample: ModuleType, tmp_path: Path) -> None:
    with RunLog(record(sample, tmp_path / "log.mcap", 2)) as log:
        first, second = (at.record for at in log.ticks())
    assert first.nodes is second.nodes


def test_starts_and_ends_are_told_from_updates() -> None:
    assert [(edge.status, edge.starts, edge.ends) for edge in TICKS[4].edges] == [
        ("FAILURE", False, True),
        ("RUNNING", True, False),
        ("SUCCESS", False, True),
    ]


def test_each_chunk_has_a_snapshot_of_its_first_tick(sample: ModuleType, tmp_path: Path) -> None:
    """So the states behind a damaged chunk are known again at once."""
    with RunLog(record(sample, tmp_path / "log.mcap", 60, checkpoint=0.2)) as log:
        snapshots = {
            round(message.time / 5e7): decode(NodesMessage, message.data).nodes
            for message in log.messages(["/bt/nodes"])
        }
    assert {*range(0, 60, 4)} <= snapshots.keys()
    assert all(nodes == TICKS[k % len(TICKS)].nodes for k, nodes in snapshots.items())


def test_an_edited_tree_begins_with_a_snapshot(sample: ModuleType, tmp_path: Path) -> None:
    other = replace(B, path="Main/Place", id="Place")
    with Recorder(tmp_path / "log.mcap", sample.RUN) as recorder:
        sample.start(recorder)
        recorder.tick(0.0, TICKS[0])
        recorder.edited_tree(
            0.05,
            Tree(
                (TreeNode("Main", "Sequence", "Main", ""), TreeNode("Main/Place", "Place", "Place", "Main"))
            ),
        )
        recorder.tick(0.05, Tick("RUNNING", other.path, (A, other)))
    with RunLog(tmp_path / "log.mcap") as log:
        assert [at.record.nodes for at in log.ticks()] == [(A, B), (A, other)]


def test_a_log_without_snapshots_begins_with_idle_nodes(sample: ModuleType, tmp_path: Path) -> None:
    path = record(sample, tmp_path / "log.mcap", 12)
    with RunLog(path) as log:
        whole = [at.record.nodes[1:] for at in log.ticks()]
    with RunLog(path) as log:
        every = log.messages
        log.messages = lambda *args, **kw: (m for m in every(*args, **kw) if m.topic != "/bt/nodes")  # type: ignore[method-assign]
        assert [tuple(n for n in at.record.nodes if n.path == B.path) for at in log.ticks()] == whole


def test_updates_of_format_2_follow_from_the_states_of_its_nodes() -> None:
    old = [(0.05 * k, replace(tick, transitions=tick.edges)) for k, tick in enumerate(TICKS)]
    states: dict[str, NodeState] = {}
    for (_, made), tick in zip(with_updates(old), TICKS, strict=True):
        assert made.edges == tick.edges
        assert made.nodes == tick.nodes
        for each in made.transitions:
            states[each.path] = each.state({"Main": "Sequence"}.get(each.path, "Grasp"))
        assert tuple(states.values()) == tick.nodes


def test_a_log_of_format_1_is_refused(
    sample: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("picktree.logs.log_records.FORMAT", 1)
    path = record(sample, tmp_path / "log.mcap", 2)
    with pytest.raises(PicktreeError) as raised:
        RunLog(path)
    assert str(raised.value) == (
        f"{path}: the log has format 1, and this picktree reads formats 2 and 3; read it with the version of "
        "picktree that wrote it"
    )
