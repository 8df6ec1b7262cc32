"""Killed writers, cut and damaged files."""

import signal
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest
from mcap.reader import make_reader
from mcap.records import ChunkIndex

from picktree.logs.recorder import Recorder
from picktree.logs.run_log import RunLog
from picktree.world.errors import PicktreeError
from picktree.world.scene.planning_scene import PlanningScene

WRITER = """
import importlib.util, sys, time
from pathlib import Path
spec = importlib.util.spec_from_file_location("logs_sample", sys.argv[1])
sample = importlib.util.module_from_spec(spec); spec.loader.exec_module(sample)
from picktree.logs.recorder import Recorder
from picktree.world.scene.planning_scene import PlanningScene
scene = PlanningScene([sample.TABLE], [sample.BIN])
with Recorder(Path(sys.argv[2]), sample.RUN) as recorder:
    sample.start(recorder)
    print("started", flush=True)
    for k in range(10**9):
        sample.step(recorder, scene, k)
        time.sleep(0.0002)
"""


def stopped_writer(sample: ModuleType, path: Path, number: int, after: float) -> subprocess.Popen[str]:
    assert sample.__file__ is not None
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, sample.__file__, str(path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "started\n"
    time.sleep(after)
    process.send_signal(number)
    try:
        process.communicate(timeout=20)
    finally:
        process.kill()
    return process


@pytest.mark.parametrize("after", [0.05, 0.21, 0.37])
def test_a_killed_writer_leaves_a_file_that_the_stock_reader_opens(
    sample: ModuleType, tmp_path: Path, after: float
) -> None:
    path = tmp_path / "log.mcap"
    stopped_writer(sample, path, signal.SIGKILL, after)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        times = [m.log_time for _, c, m in reader.iter_messages() if c.topic == "/bt/tick"]
    assert times == [round(k * 0.05 * 1e9) for k in range(len(times))]
    with RunLog(path) as log:
        assert log.recovered == ""
        assert log.result == {}
        assert len(log.tree().nodes) == 2


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_in_a_finished_file(sample: ModuleType, tmp_path: Path, number: int) -> None:
    path = tmp_path / "log.mcap"
    stopped_writer(sample, path, number, 0.3)
    with RunLog(path) as log:
        assert log.result["ended"] == "KeyboardInterrupt"
        assert log.result["digest"] == log.digest()


def test_an_exception_ends_in_a_finished_file(sample: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with pytest.raises(ZeroDivisionError), Recorder(path, sample.RUN) as recorder:
        sample.start(recorder)
        sample.step(recorder, PlanningScene([sample.TABLE], [sample.BIN]), 0)
        _ = 1 / 0
    with RunLog(path) as log:
        assert log.result["ended"] == "ZeroDivisionError"
        assert len(list(log.ticks())) == 1


def chunks_of(path: Path) -> list[ChunkIndex]:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    return summary.chunk_indexes


def test_a_cut_file_is_recovered_up_to_the_cut(log_path: Path, tmp_path: Path) -> None:
    chunk = chunks_of(log_path)[-3]
    stop = chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log_path.read_bytes()[: stop + 100])
    with RunLog(cut) as log:
        end = chunk.message_end_time / 1e9
        assert log.recovered == (
            f"{cut}: the file was not finished; recovered up to byte {stop}, {end:.2f} s"
        )
        assert [round(t.time, 2) for t in log.ticks()][-1] == end
        assert log.topics["/bt/tick"].messages == len(list(log.ticks()))
        assert log.run.seed == 7
        assert log.attachment("mission.yaml").startswith(b"picktree: 1")


def test_damage_inside_a_chunk_costs_that_chunk(log_path: Path, tmp_path: Path) -> None:
    chunk = chunks_of(log_path)[-2]
    data = bytearray(log_path.read_bytes())
    data[chunk.chunk_start_offset + chunk.chunk_length - 50] ^= 0xFF
    path = tmp_path / "damaged.mcap"
    path.write_bytes(data)
    start, end = chunk.message_start_time / 1e9, chunk.message_end_time / 1e9
    with RunLog(log_path) as whole, RunLog(path) as log:
        assert log.recovered == (
            f"{path}: damaged at byte {chunk.chunk_start_offset} ({start:.2f} s to {end:.2f} s lost); "
            "the rest is whole"
        )
        left = [at for at in whole.ticks() if not start <= at.time <= end]
        assert list(log.ticks()) == left
        assert log.topics["/bt/tick"].messages == len(left)
        assert log.result == whole.result


def test_no_damage_shows_as_anything_but_our_error(log_path: Path, tmp_path: Path) -> None:
    whole = log_path.read_bytes()
    path = tmp_path / "damaged.mcap"
    for k in range(0, len(whole), 613):
        for data in (whole[:k], whole[:k] + b"\xff" * 9 + whole[k + 9 :]):
            path.write_bytes(data)
            try:
                with RunLog(path) as log:
                    list(log.messages())
                    list(log.ticks())
                    [log.attachment(name) for name in log.attachments]
            except PicktreeError as error:
                assert str(path) in str(error)


def test_what_is_no_log_is_told_so(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("not a log at all")
    with pytest.raises(PicktreeError) as raised:
        RunLog(path)
    assert str(raised.value) == f"{path}: not a log: it does not begin as an MCAP file does"


def test_the_ending_carries_valid_check_sums(log_path: Path) -> None:
    """The stock reader checks neither the summary's nor the data's sum when it seeks: read it through."""
    from mcap.stream_reader import StreamReader

    with log_path.open("rb") as stream:
        records = list(StreamReader(stream, validate_crcs=True).records)
    assert records[-1].summary_crc != 0  # pyright: ignore
