"""Tape of a recorder's writes, step by step, which gives the file of every moment at which it could die."""

from __future__ import annotations

import bisect
import hashlib
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from picktree.files import PicktreeError
from picktree.logs import RunLog
from picktree.logs.mcap import McapFile, writer
from picktree.logs.mcap.salvage import DAMAGE_ERRORS
from picktree.logs.mcap.writer import RawFile

from mcap.reader import make_reader

SECOND = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Step:
    kind: Literal["seek", "write", "truncate"]
    offset: int
    """Where it took place; of a truncation, the size that is left."""
    data: bytes = b""

    @property
    def length(self) -> int:
        """Moments at which it can be cut off: one, or one for each byte."""
        return len(self.data) if self.kind == "write" else 1


@dataclass(frozen=True, slots=True)
class Handed:
    """A message that the recorder was given when the tape had this length."""

    length: int
    time: int
    """Simulated ns."""
    link: bytes
    """Chain of hashes of all messages up to this one."""


@dataclass(slots=True)
class Tape:
    """One file's steps. A moment is a number from 0 to `length`."""

    steps: list[Step] = field(default_factory=list[Step])
    handed: list[Handed] = field(default_factory=list[Handed])
    length: int = 0
    published: int = 0
    """The moment from which the file has its name."""

    def add(self, step: Step) -> None:
        self.steps.append(step)
        self.length += step.length

    def states(self, moments: Iterable[int]) -> Iterator[tuple[int, bytes]]:
        """The file at each of these moments, which are in order."""
        state = bytearray()
        coming = iter(self.steps)
        step: Step | None = next(coming, None)
        before = 0
        for moment in moments:
            while step is not None and before + step.length <= moment:
                _apply(state, step, step.length)
                before += step.length
                step = next(coming, None)
            if step is None or moment == before:
                yield moment, bytes(state)
            else:
                cut = bytearray(state)
                _apply(cut, step, moment - before)
                yield moment, bytes(cut)

    def must_hold(self, moment: int) -> int:
        """Return the number of messages that a file of that moment must hold: all but the last second's."""
        known = bisect.bisect_right(self.handed, moment, key=lambda handed: handed.length)
        if known == 0:
            return 0
        limit = self.handed[known - 1].time - SECOND
        return bisect.bisect_left(self.handed, limit, hi=known, key=lambda handed: handed.time)


def _apply(state: bytearray, step: Step, length: int) -> None:
    if step.kind == "write":
        if len(state) < step.offset:
            state.extend(bytes(step.offset - len(state)))
        state[step.offset : step.offset + length] = step.data[:length]
    elif step.kind == "truncate":
        del state[step.offset :]


class _Taped:
    """A file whose steps are kept."""

    def __init__(self, file: RawFile, tape: Tape) -> None:
        self._file, self._tape, self._at = file, tape, 0

    def seek(self, offset: int, /) -> int:
        self._at = offset
        self._tape.add(Step("seek", offset))
        return self._file.seek(offset)

    def write(self, data: memoryview, /) -> int | None:
        self._tape.add(Step("write", self._at, bytes(data)))
        self._at += len(data)
        return self._file.write(data)

    def truncate(self, size: int, /) -> int:
        self._tape.add(Step("truncate", size))
        return self._file.truncate(size)

    def fileno(self) -> int:
        return self._file.fileno()

    def close(self) -> None:
        self._file.close()


@contextmanager
def taped() -> Generator[Tape]:
    """The steps of the one log that is recorded in here, in one file."""
    tape = Tape()
    opened, handed, published = writer.open_raw, McapFile.message, writer.TrailerFile.publish
    link = b""

    def open_taped(path: Path) -> RawFile:
        assert not tape.steps, "more than one file is written"
        return _Taped(opened(path), tape)

    def hand(self: McapFile, channel: int, log_time: int, data: bytes) -> None:
        nonlocal link
        link = hash_link(link, log_time, data)
        tape.handed.append(Handed(tape.length, log_time, link))
        handed(self, channel, log_time, data)

    def publish(self: writer.TrailerFile) -> None:
        tape.published = tape.published or tape.length
        published(self)

    writer.open_raw, McapFile.message, writer.TrailerFile.publish = open_taped, hand, publish
    try:
        yield tape
    finally:
        writer.open_raw, McapFile.message, writer.TrailerFile.publish = opened, handed, published


def hash_link(link: bytes, time: int, data: bytes) -> bytes:
    return hashlib.blake2b(link + time.to_bytes(8, "little") + data, digest_size=8).digest()


@dataclass(frozen=True, slots=True)
class Opened:
    """Outcome of opening the file of one moment."""

    stock: bool
    """Whether the mcap package's reader opens it."""
    recovered: bool
    """Whether ours had to piece it together."""
    lost: int
    """Messages that were handed over and are not in it."""


def opens_in_stock_reader(path: Path) -> bool:
    """Whether the mcap package finds the summary, by which it reads everything else."""
    try:
        with path.open("rb") as stream:
            return make_reader(stream, validate_crcs=True).get_summary() is not None
    except DAMAGE_ERRORS:
        return False


def open_moment(tape: Tape, moment: int, data: bytes, path: Path) -> Opened:
    """Write the file of a moment to `path` and open it. Raises AssertionError when it does not open, does not
    hold what it must, or holds anything else."""
    path.write_bytes(data)
    stock = opens_in_stock_reader(path)
    try:
        with RunLog(path) as log:
            recovered = log.recovered != ""
            link, count = b"", 0
            for message in log.messages():
                link = hash_link(link, message.time, message.data)
                count += 1
            assert log.run.mission
            assert log.tree().nodes
    except PicktreeError as error:
        raise AssertionError(f"moment {moment} of {tape.length}: {error}") from None
    assert stock or recovered, f"moment {moment}: nobody has noticed that the ending is not whole"
    must = tape.must_hold(moment)
    assert count >= must, f"moment {moment}: {count} messages instead of {must} or more"
    assert count == 0 or link == tape.handed[count - 1].link, f"moment {moment}: other messages"
    known = bisect.bisect_right(tape.handed, moment, key=lambda handed: handed.length)
    return Opened(stock, recovered, known - count)
