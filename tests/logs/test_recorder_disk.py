"""Disks that refuse, and messages that must not wait."""

import errno
import os
import resource
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import pytest
from mcap.reader import make_reader

from picktree.files import PicktreeError
from picktree.logs import RunLog
from picktree.logs.mcap import McapFile
from picktree.logs.recording import Recorder
from picktree.world import PlanningScene

ADVICE = "make room there, or give another folder with --out"


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


@contextmanager
def room_for(size: int) -> Generator[None]:
    """No file may get larger than that."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_disk_that_is_full_at_the_very_start_leaves_nothing_behind(
    sample: ModuleType, tmp_path: Path
) -> None:
    path = tmp_path / "log.mcap"
    with room_for(100), pytest.raises(PicktreeError) as raised:
        Recorder(path, sample.RUN)
    assert str(raised.value) == f"{path}: the log cannot be written: File too large; {ADVICE}"
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_gets_full_is_one_clear_error_and_costs_the_last_second(
    sample: ModuleType, tmp_path: Path
) -> None:
    path = tmp_path / "log.mcap"
    scene = PlanningScene([sample.TABLE], [sample.BIN])
    ticks = -1
    with room_for(100_000), pytest.raises(PicktreeError) as raised, Recorder(path, sample.RUN) as recorder:
        sample.start(recorder)
        for ticks in range(10_000):
            sample.step(recorder, scene, ticks)
    assert str(raised.value) == (
        f"{path}: the log cannot be written any further: File too large; it keeps what it held until then; "
        f"{ADVICE}"
    )
    assert ticks > 60
    assert path.stat().st_size <= 100_000
    with path.open("rb") as stream:
        assert sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages()) > 0
    with RunLog(path) as log:
        assert (log.recovered, log.result) == ("", {})
        assert len(list(log.ticks())) >= ticks - 21


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
