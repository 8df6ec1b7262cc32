"""The digest tells what was simulated, and nothing else."""

from pathlib import Path
from types import ModuleType

from picktree.logs import RunLog

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
