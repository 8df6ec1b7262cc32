"""Killed writers, cut and damaged files."""

import importlib.util
import multiprocessing
import os
import random
import signal
import sys
import time
import tracemalloc
from itertools import count
from pathlib import Path
from types import ModuleType

import pytest
from mcap.reader import make_reader
from mcap.records import ChunkIndex

from picktree.files import PicktreeError
from picktree.logs import RunLog
from picktree.logs.recording import Recorder
from picktree.world import PlanningScene

EXPECTED = "it does not begin as an MCAP file does; give a run's folder, or its log.mcap"


def write(sample: ModuleType, path: Path) -> None:
    """Record for as long as the process lives."""
    scene = PlanningScene([sample.TABLE], [sample.BIN])
    with Recorder(path, sample.RUN) as recorder:
        sample.start(recorder)
        for k in count():
            sample.step(recorder, scene, k)


def killed_writer(sample: ModuleType, path: Path, size: int) -> None:
    """Kill a process that records when it has written so many bytes.

    It is halted first, which waits for the end of a write. `test_recorder_moments.py` is about kills inside.
    """
    process = multiprocessing.get_context("fork").Process(target=write, args=(sample, path))
    process.start()
    assert process.pid is not None
    while process.is_alive() and not (path.exists() and path.stat().st_size >= size):
        time.sleep(0.001)
    assert process.is_alive()
    os.kill(process.pid, signal.SIGSTOP)
    os.waitpid(process.pid, os.WUNTRACED)
    os.kill(process.pid, signal.SIGKILL)
    process.join()


@pytest.mark.parametrize("size", [10_000, 90_000])
def test_a_killed_writer_leaves_a_file_that_the_stock_reader_opens(
    sample: ModuleType, tmp_path: Path, size: int
) -> None:
    path = tmp_path / "log.mcap"
    killed_writer(sample, path, size)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        times = [m.log_time for _, c, m in reader.iter_messages() if c.topic == "/bt/tick"]
    assert times == [round(k * 0.05 * 1e9) for k in range(len(times))]
    with RunLog(path) as log:
        assert log.recovered == ""
        assert log.result == {}
        assert len(log.tree().nodes) == 2


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


@pytest.fixture(scope="module")
def damages() -> ModuleType:
    """`benchmarks/_damage.py`."""
    path = Path(__file__).parents[2] / "benchmarks" / "_damage.py"
    spec = importlib.util.spec_from_file_location("_damage", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["_damage"] = module
    spec.loader.exec_module(module)
    return module


def test_each_damage_is_one_clear_error_or_costs_what_is_said(
    damages: ModuleType, log_path: Path, tmp_path: Path
) -> None:
    """`benchmarks/damage.py` does it with a thousand files of a real run, and with all commands."""
    whole = damages.Whole.of(log_path)
    path = tmp_path / "damaged.mcap"
    rng = random.Random(3)
    said: set[str] = set()
    for number in range(30):
        kind = damages.KINDS[number % len(damages.KINDS)]
        data = bytes(kind(bytearray(whole.data), rng))
        if data == whole.data:
            continue
        path.write_bytes(data)
        said.add(damages.opened(path, whole).removeprefix(f"{path}: ").partition(" at byte")[0])
        if number % 10 == 3:
            damages.commanded(["explain", str(path)])
        if number % 50 == 3:
            damages.commanded(["snapshot", str(path), "--at", "1", "-o", str(tmp_path / "a.png")])
    assert {"damaged", f"not a log: {EXPECTED}"} <= said
    assert any(text.startswith("the file was not finished; recovered up to byte") for text in said)


def test_a_loss_names_what_is_lost(log_path: Path, tmp_path: Path) -> None:
    """The robot's model, a file, and a file's name that another one has."""
    data = bytearray(log_path.read_bytes())
    robot = chunks_of(log_path)[1].chunk_start_offset
    data[robot + 100] ^= 1
    mission = data.index(b"picktree: 1")
    data[mission] ^= 1
    path = tmp_path / "damaged.mcap"
    path.write_bytes(data)
    file = mission - 9 - 8 - 8 - 4 - len("mission.yaml") - 4 - len("application/yaml") - 8
    with RunLog(path) as log:
        assert log.recovered == (
            f"{path}: damaged at byte {file} (file mission.yaml lost), byte {robot} "
            "(0.00 s to 0.00 s of /scene/robot lost); the rest is whole"
        )
        assert log.robot_model() == ()
        assert log.attachments == ("mission.yaml",)
        with pytest.raises(PicktreeError) as raised:
            log.attachment("mission.yaml")
    assert str(raised.value) == f"{path}: damaged at byte {file}: wrong check sum of a file"


def test_what_lies_behind_a_damaged_record_is_found_without_an_index(log_path: Path, tmp_path: Path) -> None:
    chunk = chunks_of(log_path)[-2]
    data = bytearray(log_path.read_bytes())
    place = chunk.chunk_start_offset
    data[place + 1 : place + 9] = b"\xff" * 8
    path = tmp_path / "damaged.mcap"
    path.write_bytes(data[:-200])
    start, end = chunk.message_start_time / 1e9, chunk.message_end_time / 1e9
    with RunLog(log_path) as whole, RunLog(path) as log:
        assert list(log.ticks()) == [at for at in whole.ticks() if not start <= at.time <= end]
        before = chunks_of(log_path)[-3].message_end_time / 1e9
        assert f"damaged at byte {place} (messages after {before:.2f} s lost)" in log.recovered


def test_a_huge_chunk_takes_no_memory(log_path: Path, tmp_path: Path) -> None:
    """The size that it claims is believed nowhere."""
    chunk = chunks_of(log_path)[-1]
    data = bytearray(log_path.read_bytes())
    size = chunk.chunk_start_offset + 9 + 16
    data[size : size + 8] = (1 << 40).to_bytes(8, "little")
    path = tmp_path / "damaged.mcap"
    path.write_bytes(data)
    tracemalloc.start()
    with RunLog(path) as log:
        assert f"byte {chunk.chunk_start_offset} (" in log.recovered
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50_000_000


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"\x89MCAP0\r\n", "damaged at byte 8: the file ends without its summary; it holds no messages"),
        (b"\x89MCAP0\r\n" * 2, "damaged at byte 8: the file ends inside a record; it holds no messages"),
        (
            b"\x89MCAP0\r\n" + bytes(30),
            "damaged at byte 8: a record of the unknown kind 0; it holds no messages",
        ),
        (b"", f"not a log: an empty file; {EXPECTED}"),
        (b"not a log at all", f"not a log: a text file; {EXPECTED}"),
    ],
)
def test_a_file_with_nothing_in_it_says_why(tmp_path: Path, data: bytes, why: str) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(data)
    with pytest.raises(PicktreeError) as raised:
        RunLog(path)
    assert str(raised.value) == f"{path}: {why}"


def test_the_ending_carries_valid_check_sums(log_path: Path) -> None:
    """The stock reader checks neither the summary's nor the data's sum when it seeks: read it through."""
    from mcap.stream_reader import StreamReader

    with log_path.open("rb") as stream:
        records = list(StreamReader(stream, validate_crcs=True).records)
    assert records[-1].summary_crc != 0  # pyright: ignore
