"""Logs as broken disks, cables and programs leave them, and what must come of opening one."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import random
import re
import struct
import tempfile
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path

from picktree.analysis import Run
from picktree.apps.cli import answer
from picktree.files import PicktreeError
from picktree.logs import RunLog

MAGIC_LENGTH = 8
_NOTE = re.compile("recovered up to byte|the rest is whole")
"""What is said of a damaged log before anything else."""
HUGE = (2**63 - 1, 2**63, 2**64 - 1, 2**40, 2**31, 2**32 + 5)


def cut(data: bytearray, rng: random.Random) -> bytearray:
    return data[: rng.randrange(len(data))]


def cut_at_front(data: bytearray, rng: random.Random) -> bytearray:
    return data[rng.randrange(1, len(data)) :]


def hole(data: bytearray, rng: random.Random) -> bytearray:
    """A stretch is missing."""
    start = rng.randrange(len(data))
    return data[:start] + data[start + rng.choice((1, 8, 500, 4096, 50_000)) :]


def flipped(data: bytearray, rng: random.Random) -> bytearray:
    for _ in range(rng.choice((1, 1, 1, 3, 30))):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return data


def flipped_at_ends(data: bytearray, rng: random.Random) -> bytearray:
    """Where the file says what it is: its first records, its summary."""
    place = rng.randrange(4000)
    data[place if rng.random() < 0.5 else -1 - place] ^= rng.randrange(1, 256)
    return data


def zeroed(data: bytearray, rng: random.Random) -> bytearray:
    start, length = rng.randrange(len(data)), rng.choice((1, 16, 512, 4096, 65536, len(data)))
    data[start : start + length] = bytes(len(data[start : start + length]))
    return data


def zeroed_from(data: bytearray, rng: random.Random) -> bytearray:
    """What a disk leaves that had made the file longer, but not written it."""
    start = rng.randrange(len(data))
    data[start:] = bytes(len(data) - start)
    return data


def noisy(data: bytearray, rng: random.Random) -> bytearray:
    start, length = rng.randrange(len(data)), rng.choice((4, 512, 4096))
    data[start : start + length] = rng.randbytes(len(data[start : start + length]))
    return data


def wrong_magic(data: bytearray, rng: random.Random) -> bytearray:
    place = rng.choice((rng.randrange(MAGIC_LENGTH), -1 - rng.randrange(MAGIC_LENGTH)))
    data[place] ^= rng.randrange(1, 256)
    return data


def empty(data: bytearray, rng: random.Random) -> bytearray:
    return bytearray(rng.choice((b"", b"\x89", bytes(data[:MAGIC_LENGTH]), bytes(data[:MAGIC_LENGTH]) * 2)))


def not_mcap(data: bytearray, rng: random.Random) -> bytearray:
    return bytearray(
        rng.choice(
            (
                b"picktree: 1\nkind: mission\n",
                b"\x89PNG\r\n\x1a\n" + rng.randbytes(300),
                b"PK\x03\x04" + rng.randbytes(300),
                b"\x89MCAP1\r\n" + bytes(data[MAGIC_LENGTH:]),
                rng.randbytes(5000),
                bytes(100_000),
                bytes(data[:MAGIC_LENGTH]) + rng.randbytes(5000),
                bytes(data[:MAGIC_LENGTH]) + bytes(100_000) + bytes(data[:MAGIC_LENGTH]),
            )
        )
    )


def huge_length(data: bytearray, rng: random.Random) -> bytearray:
    """One of the numbers in the file says that more follows than there is."""
    places = record_places(data)
    place = rng.choice(places) + rng.choice((1, 1, 1, 9, 25, 37, 45))
    place = min(place, len(data) - 8)
    data[place : place + 8] = struct.pack("<Q", rng.choice(HUGE))
    return data


def long_string(data: bytearray, rng: random.Random) -> bytearray:
    """A 32-bit length is wrong."""
    place = min(rng.choice(record_places(data)) + rng.randrange(9, 60), len(data) - 4)
    data[place : place + 4] = struct.pack("<I", rng.choice((2**32 - 1, 2**31, 70_000, 0)))
    return data


def doubled(data: bytearray, rng: random.Random) -> bytearray:
    """A stretch is there twice."""
    start = rng.randrange(len(data))
    length = rng.choice((1, 512, 4096, 100_000))
    return data[: start + length] + data[start:]


def longer(data: bytearray, rng: random.Random) -> bytearray:
    return data + rng.choice((b"\0", b"\n", bytes(4096), rng.randbytes(100)))


KINDS: tuple[Callable[[bytearray, random.Random], bytearray], ...] = (
    cut, cut_at_front, hole, flipped, flipped_at_ends, zeroed, zeroed_from, noisy, wrong_magic, empty,
    not_mcap, huge_length, long_string, doubled, longer,
)  # fmt: skip


def record_places(data: bytearray) -> list[int]:
    """Where the records of a whole file begin."""
    places: list[int] = []
    offset = MAGIC_LENGTH
    while offset < len(data) - MAGIC_LENGTH:
        places.append(offset)
        offset += 9 + int.from_bytes(data[offset + 1 : offset + 9], "little")
    return places


@dataclass(frozen=True, slots=True)
class Whole:
    """A log that nothing has happened to."""

    data: bytes
    messages: frozenset[bytes]
    """Hash of each."""
    files: dict[str, bytes]

    @classmethod
    def of(cls, path: Path) -> Whole:
        with RunLog(path) as log:
            return cls(
                path.read_bytes(),
                frozenset(_hash(m.topic, m.time, m.data) for m in log.messages()),
                {name: log.attachment(name) for name in log.attachments},
            )


def _hash(topic: str, time: int, data: bytes) -> bytes:
    return hashlib.blake2b(f"{topic} {time} ".encode() + data, digest_size=12).digest()


def opened(path: Path, whole: Whole) -> str:
    """Open a damaged log and read all of it. Answers the error, or what it says was lost. Raises
    AssertionError when it says nothing, or holds anything that the whole one does not."""
    try:
        with RunLog(path) as log:
            for message in log.messages():
                found = _hash(message.topic, message.time, message.data)
                assert found in whole.messages, f"a message that nobody wrote: {message.topic}"
            for name in log.attachments:
                with contextlib.suppress(PicktreeError):
                    data = log.attachment(name)
                    assert whole.files.get(name, b"") == data, f"the file {name} is another"
            _ = log.run, log.topics, log.digest()
            assert log.recovered, "it does not say that it is damaged"
            said = log.recovered
        with Run(path) as run:
            _ = run.visits, run.plans, run.picks, run.events, run.lines, run.joints, run.end
            if len(run.ticks):
                run.at(run.end / 2)
    except PicktreeError as error:
        said = str(error)
    assert str(path) in said and "\n" not in said, said
    return said


@dataclass(frozen=True, slots=True)
class Answered:
    code: int
    told: bool
    """Whether it has said, on whichever way, that something is damaged or lost."""


def commanded(arguments: list[str], codes: frozenset[int] = frozenset({0, 2})) -> Answered:
    """Carry out a command. Raises AssertionError for a traceback, another exit code, or an error without a
    sentence."""
    out, errors = io.StringIO(), io.StringIO()
    with _caught(1) as printed, contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        code = answer(arguments)
    said = errors.getvalue()
    assert code in codes, f"{' '.join(arguments)}: exit code {code}: {said}"
    assert "Traceback" not in said, said
    errors_told = [line for line in said.strip().splitlines() if not _NOTE.search(line)]
    assert code != 2 or len(errors_told) == 1 or said.count("\n") == 1, said
    everything = said + out.getvalue() + printed.getvalue()
    return Answered(code, any(word in everything for word in ("damaged", "not finished", "missing", "lost")))


@contextlib.contextmanager
def _caught(number: int) -> Generator[io.StringIO]:
    """What is written to a file descriptor, once it is over."""
    text = io.StringIO()
    before = os.dup(number)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), number)
        try:
            yield text
        finally:
            os.dup2(before, number)
            os.close(before)
            file.seek(0)
            text.write(file.read().decode(errors="replace"))
