"""The digest tells what was simulated, and nothing else."""

import subprocess
import sys
from pathlib import Path
from types import ModuleType

from picktree.logs.run_log import RunLog


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


def test_another_process_and_hash_seed_give_the_same(sample: ModuleType, tmp_path: Path) -> None:
    assert sample.__file__ is not None
    program = (
        "import importlib.util, sys; from pathlib import Path;"
        "spec = importlib.util.spec_from_file_location('s', sys.argv[1]);"
        "m = importlib.util.module_from_spec(spec); spec.loader.exec_module(m);"
        "print(m.record(Path(sys.argv[2])))"
    )
    answers = {
        subprocess.run(
            [sys.executable, "-c", program, sample.__file__, str(tmp_path / f"{seed}.mcap")],
            env={"PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
        for seed in ("1", "2")
    }
    assert answers == {sample.record(tmp_path / "here.mcap")}
