"""Logs in other people's readers: npm's @mcap/core (of Foxglove and Lichtblick) and Rerun."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from picktree import run
from picktree.logs import RunLog
from picktree.logs.log_files import Rotation

from ..needs import RERUN, RERUN_PROGRAM, needs, packages

NODE = Path(__file__).parent / "node"
MISSION = Path(__file__).parents[2] / "examples" / "one_pick.yaml"


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The files of a rotated log."""
    folder = tmp_path_factory.mktemp("runs")
    result = run(MISSION, seed=1, backend="kinematic", out=folder, rotation=Rotation(seconds=3.0))
    assert result.reached
    found = sorted(result.folder.glob("*.mcap"))
    assert len(found) == 2
    return found


def test_a_rotated_run_is_the_same_run(logs: list[Path], tmp_path: Path) -> None:
    whole = run(MISSION, seed=1, backend="kinematic", out=tmp_path)
    with RunLog(logs[0].parent) as log:
        assert log.paths == (logs[1], logs[0])
        assert log.digest() == log.result["digest"] == whole.digest
        assert [at.time for at in log.ticks()] == pytest.approx(
            [k * 0.05 for k in range(len(list(log.ticks())))]
        )


@needs(packages("logs"))
def test_mcap_core_reads_every_topic(logs: list[Path], log_path: Path, tmp_path: Path) -> None:
    """The made-up log has messages on each."""
    for path in (log_path, *logs):
        done = subprocess.run(["node", "read.mjs", str(path)], cwd=NODE, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        found = json.loads(done.stdout)
        with RunLog(shutil.copy(path, tmp_path / "alone.mcap")) as log:  # without those that go on with it
            assert found["topics"] == {
                name: {"schema": info.schema, "encoding": info.encoding, "count": info.messages}
                for name, info in log.topics.items()
                if info.messages
            }
            assert len(found["topics"]) >= 11
            assert found["attachments"] == list(log.attachments)
            assert set(found["metadata"]) == set(log.metadata)


@needs(RERUN)
def test_rerun_finds_nothing_wrong_but_a_missing_ending(logs: list[Path], tmp_path: Path) -> None:
    for path in logs:
        done = checked(path)
        assert done.returncode == 0, done.stdout + done.stderr
        rows = [line.split() for line in done.stdout.splitlines() if line.startswith("ok ")]
        assert "/bt/tick" in {row[3] for row in rows}
        assert {row[4] for row in rows} == {"—"}, "an issue"
        assert len(rows) == sum("  /" in line for line in done.stdout.splitlines())
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(logs[0].read_bytes()[:-100])
    assert checked(cut).returncode != 0


def checked(path: Path) -> subprocess.CompletedProcess[str]:
    assert RERUN_PROGRAM is not None
    command = [RERUN_PROGRAM, "mcap", "check", "--full", str(path)]
    return subprocess.run(command, capture_output=True, text=True)
