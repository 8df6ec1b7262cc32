"""Disks that refuse, and messages that must not wait."""

import errno
import multiprocessing
import os
import resource
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from mcap.reader import make_reader

from picktree.files import PicktreeError
from picktree.logs import RunLog
from picktree.logs.mcap import McapFile, writer
from picktree.logs.mcap.writer import RawFile
from picktree.logs.recording import Recorder
from picktree.world import PlanningScene

ADVICE = "make room there, or give another folder with --out"


class Full:
    """A file on a disk with room for so many bytes."""

    def __init__(self, file: RawFile, room: int) -> None:
        self._file, self._room, self._at = file, room, 0

    def seek(self, offset: int, /) -> int:
        self._at = offset
        return self._file.seek(offset)

    def write(self, data: memoryview, /) -> int | None:
        if self._at >= self._room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = self._file.write(data[: self._room - self._at])
        self._at += written or 0
        return written

    def truncate(self, size: int, /) -> int:
        return self._file.truncate(size)

    def fileno(self) -> int:
        return self._file.fileno()

    def close(self) -> None:
        self._file.close()


@pytest.fixture
def small_disk(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    real = writer.open_raw

    def with_room(room: int) -> None:
        monkeypatch.setattr(writer, "open_raw", lambda path: Full(real(path), room))  # pyright: ignore

    return with_room


def test_a_folder_that_cannot_be_written_is_one_clear_error(sample: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    path = tmp_path / "file" / "log.mcap"
    with pytest.raises(PicktreeError) as raised:
        Recorder(path, sample.RUN)
    assert str(raised.value) == f"{path}: the log cannot be written: File exists; {ADVICE}"


def test_a_disk_that_is_nearly_full_is_one_clear_error_before_anything_is_written(
    sample: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("picktree.logs.mcap.writer.MIN_FREE_BYTES", 10**18)
    path = tmp_path / "runs" / "log.mcap"
    with pytest.raises(PicktreeError) as raised:
        Recorder(path, sample.RUN)
    text = str(raised.value)
    assert text.startswith(f"{path}: only ")
    assert text.endswith(f" MB are free there, and a log begins with 1000000000000 MB of room; {ADVICE}")
    assert list(path.parent.iterdir()) == []


def test_a_disk_that_is_full_at_the_very_start_leaves_nothing_behind(
    sample: ModuleType, tmp_path: Path, small_disk: Callable[[int], None]
) -> None:
    small_disk(100)
    path = tmp_path / "log.mcap"
    with pytest.raises(PicktreeError) as raised:
        Recorder(path, sample.RUN)
    assert str(raised.value) == f"{path}: the log cannot be written: No space left on device; {ADVICE}"
    assert list(tmp_path.iterdir()) == []


def record_until_refused(sample: ModuleType, path: Path) -> tuple[str, int]:
    """The error, and how many ticks were handed over."""
    scene = PlanningScene([sample.TABLE], [sample.BIN])
    k = -1
    with pytest.raises(PicktreeError) as raised, Recorder(path, sample.RUN) as recorder:
        sample.start(recorder)
        for k in range(10_000):
            sample.step(recorder, scene, k)
    return str(raised.value), k


def assert_whole_but_for_the_last_second(path: Path, ticks: int) -> None:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) > 0
    with RunLog(path) as log:
        assert log.recovered == ""
        assert log.result == {}
        assert len(list(log.ticks())) >= ticks - 21


def test_a_disk_that_gets_full_is_one_clear_error_and_the_file_still_opens(
    sample: ModuleType, tmp_path: Path, small_disk: Callable[[int], None]
) -> None:
    small_disk(80_000)
    path = tmp_path / "log.mcap"
    error, ticks = record_until_refused(sample, path)
    assert error == (
        f"{path}: the log cannot be written any further: No space left on device; it keeps what it held "
        f"until then; {ADVICE}"
    )
    assert ticks > 60
    assert_whole_but_for_the_last_second(path, ticks)


class Deadly(Full):
    """A file whose process is killed inside the write that gets past so many bytes."""

    def write(self, data: memoryview, /) -> int | None:
        if self._at >= self._room:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().write(data)


@pytest.mark.parametrize("room", [50_000, 80_000, 110_000])
def test_a_kill_inside_a_write_costs_the_last_second(
    sample: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    path = tmp_path / "log.mcap"
    real = writer.open_raw
    monkeypatch.setattr(writer, "open_raw", lambda path: Deadly(real(path), room))  # pyright: ignore
    fork = multiprocessing.get_context("fork")
    given = fork.Value("i", 0)

    def record() -> None:
        scene = PlanningScene([sample.TABLE], [sample.BIN])
        with Recorder(path, sample.RUN) as recorder:
            sample.start(recorder)
            for given.value in range(10_000):
                sample.step(recorder, scene, given.value)

    process = fork.Process(target=record)
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    with RunLog(path) as log:
        assert log.recovered.startswith(f"{path}: ")
        assert log.result == {}
        assert len(list(log.ticks())) >= given.value - 21


def test_the_limit_of_a_real_file_is_met_in_the_same_way(sample: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
    try:
        error, ticks = record_until_refused(sample, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert error.startswith(f"{path}: the log cannot be written any further: File too large; ")
    assert path.stat().st_size <= 100_000
    assert_whole_but_for_the_last_second(path, ticks)


def test_a_disk_that_refuses_between_two_messages_is_told_at_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(file: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    file = McapFile(tmp_path / "log.mcap")
    channel = file.channel(TOPIC)
    file.message(channel, 0, b"{}")
    file.checkpoint()
    monkeypatch.setattr("picktree.logs.mcap.writer.os.fsync", refuse)
    file.keep_up(0.0)
    with pytest.raises(PicktreeError, match="any further: Input/output error"):
        file.finish()
    with pytest.raises(PicktreeError, match="any further: Input/output error"):
        file.message(channel, 1, b"{}")


class OneTopic:
    name, schema, encoding, schema_encoding = "/t", "test.T", "json", "jsonschema"

    def schema_data(self) -> bytes:
        return b'{"type": "object"}'


TOPIC = OneTopic()


@pytest.fixture
def quick_beats(monkeypatch: pytest.MonkeyPatch) -> None:
    """The wall second, shortened to a twentieth."""
    monkeypatch.setattr("picktree.logs.recording.recorder._HEARTBEAT_PERIOD", 0.0125)
    monkeypatch.setattr("picktree.logs.recording.recorder._MAX_MESSAGE_AGE", 0.025)


@pytest.mark.usefixtures("quick_beats")
def test_a_message_is_on_disk_within_a_second_though_no_other_follows(
    sample: ModuleType, tmp_path: Path
) -> None:
    path = tmp_path / "log.mcap"
    arrived = threading.Event()

    def planning() -> None:
        """One long tick: the main thread is busy with something else."""
        deadline = time.monotonic() + 5.0
        while time.monotonic() < deadline:
            with RunLog(path) as log:
                if any(at.record.message == "thinking" for at in log.lines()):
                    arrived.set()
                    return
            time.sleep(0.005)

    with Recorder(path, sample.RUN) as recorder:
        sample.start(recorder)
        recorder.log(0.0, "INFO", "thinking")
        planning()
    assert arrived.is_set()
    assert not any(thread.name == "log" for thread in threading.enumerate())
