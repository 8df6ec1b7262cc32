"""The digest tells what was simulated, and nothing else."""

from pathlib import Path
from types import ModuleType

from picktree.logs import RunLog

from ..other_process import OtherProcess
from .sample import record


def test_only_what_is_simulated_changes_it(sample: ModuleType, tmp_path: Path) -> None:
    digest = sample.record(tmp_path / "a.mcap")
    with RunLog(tmp_path / "a.mcap") as log:
        assert log.result == {"digest": digest, "status": "SUCCESS"}
        assert log.digest() == digest
    assert sample.record(tmp_path / "b.mcap", chunk_bytes=2000) == digest
    assert sample.record(tmp_path / "c.mcap", checkpoint=0.1) == digest
    assert sample.record(tmp_path / "d.mcap", wall_time=0.5) == digest
    assert sample.record(tmp_path / "e.mcap", ticks=61) != digest


def test_another_process_and_hash_seed_give_the_same(tmp_path: Path, elsewhere: OtherProcess) -> None:
    there = elsewhere.call(record, tmp_path / "there.mcap")
    assert there == record(tmp_path / "here.mcap")
