"""The digest tells what was simulated, and nothing else."""

from pathlib import Path
from types import ModuleType

from picktree.logs import RunLog, encode
from picktree.logs.log_records import NodeStatusRecord, Tick, WriteRecord
from picktree.logs.recording.journal_records import TickMessages

from ..other_process import OtherProcess
from .sample import record


def test_chunks_and_wall_time_do_not_change_it(sample: ModuleType, tmp_path: Path) -> None:
    reference = sample.record(tmp_path / "a.mcap")
    assert sample.record(tmp_path / "b.mcap", chunk_bytes=2000) == reference
    assert sample.record(tmp_path / "c.mcap", checkpoint=0.1) == reference
    assert sample.record(tmp_path / "d.mcap", wall_time=0.5) == reference


def test_it_can_be_computed_from_the_log(sample: ModuleType, tmp_path: Path) -> None:
    digest = sample.record(tmp_path / "log.mcap")
    with RunLog(tmp_path / "log.mcap") as log:
        assert log.result == {"digest": digest, "status": "SUCCESS"}
        assert log.digest() == digest


def test_anything_simulated_changes_it(sample: ModuleType, tmp_path: Path) -> None:
    assert sample.record(tmp_path / "a.mcap", ticks=20) != sample.record(tmp_path / "b.mcap", ticks=21)


def test_another_process_and_hash_seed_give_the_same(tmp_path: Path, elsewhere: OtherProcess) -> None:
    there = elsewhere.call(record, tmp_path / "there.mcap")
    assert there == record(tmp_path / "here.mcap")


def test_a_tick_is_encoded_as_if_no_node_had_been_encoded_before() -> None:
    idle = NodeStatusRecord("/Main", "Sequence", "IDLE", False, "", "", {})
    moved = NodeStatusRecord("/Main/GoTo", "GoTo", "RUNNING", True, "on the way", "", {})
    failed = NodeStatusRecord(
        "/Main/GoTo", "GoTo", "FAILURE", True, "off", "control.tracking", {"off": [0.1]}
    )
    messages = TickMessages()
    for nodes in ((idle, moved), (idle, moved), (idle, failed), (idle,), (moved, idle), (idle, moved)):
        for written in ("é", "è"):  # the second time no node has changed
            tick = Tick("RUNNING", "/Main/GoTo", nodes, (WriteRecord("/item", written, "/Main"),))
            assert messages.encode(tick) == encode(tick)
