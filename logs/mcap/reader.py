"""MCAP reader for whole and damaged files. A file that is neither gives one error.

Salvage of a damaged MCAP file: its readable content and its losses.

A file whose summary is whole is checked record by record when the check sum of its data is wrong. A file
without a summary is read from its beginning. Behind a record that is not whole, the search goes on to the
next chunk.
"""

from __future__ import annotations

import zlib
from collections.abc import Collection, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema

from ...errors import PicktreeError
from .chunks import (
    DAMAGE_ERRORS,
    DATA_END,
    ChunkAt,
    Contents,
    MessageAt,
    NamedAt,
    RecordFile,
    chunk_content,
    chunk_data,
    contents_of,
    stream,
)
from .writer import MAGIC

_KNOWN_OPCODES = frozenset(range(Opcode.HEADER, Opcode.DATA_END + 1))
_CHUNK_SIGN = b"\x04\x00\x00\x00zstd"
_CHUNK_SIGN_OFFSET = 9 + 28
"""Offset of the sign in a chunk's record, bytes."""


@dataclass(frozen=True, slots=True)
class Loss:
    """Damage: its offset, and the content that it makes unreadable."""

    offset: int
    what: str

    def text(self) -> str:
        return f"byte {self.offset} ({self.what})"


@dataclass(frozen=True, slots=True)
class Salvaged:
    contents: Contents
    losses: tuple[Loss, ...]
    stop: int
    """Offset up to which the file was read: the end of the data, or of the first record that is not whole."""
    problem: str
    """Problem at `stop`; empty at the end of the data."""


def losses_of(file: RecordFile, contents: Contents) -> tuple[Loss, ...]:
    """Return the damage in a file with a whole summary.

    Unreadable chunks and metadata are removed from `contents`; attachments stay.
    """
    if file.read(0, len(MAGIC)) == MAGIC and _has_right_sum(file, contents.data_end):
        return ()
    losses: list[Loss] = []
    chunks: list[ChunkAt] = []
    contents.counts.clear()
    for chunk in contents.chunks:
        try:
            contents.counts.update(chunk_content(_body(file, chunk.offset, Opcode.CHUNK)).counts())
            chunks.append(chunk)
        except DAMAGE_ERRORS:
            losses.append(Loss(chunk.offset, _lost_span(chunk, contents)))
    metadata: list[NamedAt] = []
    for entry in contents.metadata:
        try:
            Metadata.read(stream(_body(file, entry.offset, Opcode.METADATA)))
            metadata.append(entry)
        except DAMAGE_ERRORS:
            losses.append(Loss(entry.offset, f"metadata {entry.name} lost"))
    for entry in contents.attachments:
        try:
            attachment(file, entry.offset)
        except DAMAGE_ERRORS:
            losses.append(Loss(entry.offset, f"file {entry.name} lost"))
    contents.chunks[:], contents.metadata[:] = chunks, metadata
    if not losses:
        losses.append(Loss(0, "or later, outside of messages and files"))
    return tuple(sorted(losses, key=lambda loss: loss.offset))


def salvaged(file: RecordFile) -> Salvaged:
    """Return everything readable of a file without a whole summary; without chunks when nothing is
    readable."""
    return _Walk(file).result()


def attachment(file: RecordFile, offset: int) -> Attachment:
    """Return an attachment. Raises one of `DAMAGE_ERRORS` when it is not as it was written."""
    body = _body(file, offset, Opcode.ATTACHMENT)
    if zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], "little"):
        raise ValueError("wrong check sum of a file")
    return Attachment.read(stream(body))


class _Walk:
    """Pass through the records from the beginning to the end."""

    def __init__(self, file: RecordFile) -> None:
        self._file = file
        self._contents = Contents()
        self._losses: list[Loss] = []

    def result(self) -> Salvaged:
        file, offset = self._file, len(MAGIC)
        problem = "the file ends without its summary"
        while offset < file.size:
            try:
                offset, ended = self._take(offset)
            except DAMAGE_ERRORS as error:
                after = self._next(offset)
                if after is None:
                    problem = str(error) or type(error).__name__
                    break
                self._lose(offset, after)
                offset = after
                continue
            if ended:
                self._take_definitions(offset)
                problem = ""
                break
        return Salvaged(self._contents, tuple(self._losses), offset, problem)

    def _take(self, offset: int) -> tuple[int, bool]:
        """Read the record at `offset`. Return the offset of the next one, and whether this one ended the
        data."""
        contents = self._contents
        opcode, body = self._file.record(offset)
        if opcode not in _KNOWN_OPCODES:
            raise ValueError(f"a record of the unknown kind {opcode}")
        if opcode == Opcode.CHUNK:
            content = chunk_content(body)
            contents.schemas.update((schema.id, schema) for schema in content.schemas)
            contents.channels.update((channel.id, channel) for channel in content.channels)
            counts = content.counts()
            contents.counts.update(counts)
            contents.chunks.append(ChunkAt(offset, content.start, content.end, frozenset(counts)))
        elif opcode == Opcode.ATTACHMENT:
            contents.attachments.append(NamedAt(offset, attachment(self._file, offset).name))
        elif opcode == Opcode.METADATA:
            contents.metadata.append(NamedAt(offset, Metadata.read(stream(body)).name))
        return offset + 9 + len(body), opcode == Opcode.DATA_END

    def _take_definitions(self, offset: int) -> None:
        """Read schemas and channels in a damaged summary; they replace those of a lost first chunk."""
        contents = self._contents
        while offset < self._file.size:
            try:
                opcode, body = self._file.record(offset)
                if opcode == Opcode.SCHEMA:
                    schema = Schema.read(stream(body))
                    contents.schemas.setdefault(schema.id, schema)
                elif opcode == Opcode.CHANNEL:
                    channel = Channel.read(stream(body))
                    contents.channels.setdefault(channel.id, channel)
                else:
                    return
            except DAMAGE_ERRORS:
                return
            offset += 9 + len(body)

    def _next(self, offset: int) -> int | None:
        """Return the offset of a whole record behind the damaged one at `offset`; None when there is none."""
        after = self._behind(offset)
        if after is not None:
            return after
        for sign in self._file.places(_CHUNK_SIGN, offset + 1):
            place = sign - _CHUNK_SIGN_OFFSET
            if place <= offset:
                continue
            try:
                chunk_content(_body(self._file, place, Opcode.CHUNK))
            except DAMAGE_ERRORS:
                continue
            return place
        return None

    def _behind(self, offset: int) -> int | None:
        """Return the offset behind the record when its length is right: a known and whole record follows
        there."""
        try:
            opcode, body = self._file.record(offset)
            after = offset + 9 + len(body)
            following, content = self._file.record(after)
        except DAMAGE_ERRORS:
            return None
        if opcode not in _KNOWN_OPCODES or following not in _KNOWN_OPCODES or not body or not content:
            return None
        return after

    def _lose(self, offset: int, after: int) -> None:
        """Note a loss between two offsets."""
        try:
            opcode, _ = self._file.record(offset)
        except DAMAGE_ERRORS:
            opcode = None
        if opcode == Opcode.ATTACHMENT:
            what = "a file lost"
        elif opcode == Opcode.METADATA:
            what = "metadata lost"
        elif opcode == Opcode.MESSAGE_INDEX:
            return  # an index only: the messages are all there
        else:
            before = self._contents.chunks[-1].end / 1e9 if self._contents.chunks else 0.0
            what = f"messages after {before:.2f} s lost"
        self._losses.append(Loss(offset, what))


def _has_right_sum(file: RecordFile, data_end: int) -> bool:
    written = file.read(data_end, DATA_END.size)
    if len(written) < DATA_END.size:
        return False
    opcode, length, crc = DATA_END.unpack(written)
    return opcode == Opcode.DATA_END and length == 4 and crc == file.crc(0, data_end)


def _body(file: RecordFile, offset: int, expected: int) -> bytes:
    opcode, body = file.record(offset)
    if opcode != expected:
        raise ValueError(f"a record of the kind {opcode} instead of {expected}")
    return body


def _lost_span(chunk: ChunkAt, contents: Contents) -> str:
    topics = [channel.topic for n, channel in contents.channels.items() if n in chunk.channels]
    of = f" of {topics[0]}" if len(topics) == 1 else ""
    return f"{chunk.start / 1e9:.2f} s to {chunk.end / 1e9:.2f} s{of} lost"


_MAX_UNPACKED_CHUNKS = 4
"""Number of chunks that are kept unpacked for random access; of a deep mission one has 2 MB."""
_MAX_INDEXED_CHUNKS = 4096
"""Number of chunks whose places of messages are kept, a few kB each; their check sums were right."""
_MAX_NAMED_LOSSES = 4
"""Maximum number of losses that the message names."""


class RawMessage(NamedTuple):
    """Undecoded message of the file. `time` in ns."""

    topic: str
    time: int
    data: bytes


class McapReader:
    """MCAP file that is open for reading. Methods raise PicktreeError.

    `recovered` is a sentence about the losses when the file has no valid ending or is damaged somewhere; else
    empty.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.recovered = ""
        self._file = RecordFile(path)
        self._data = lru_cache(_MAX_UNPACKED_CHUNKS)(self._unpack)
        self._places = lru_cache(_MAX_INDEXED_CHUNKS)(self._index)
        self._checked = (-1, b"")
        """Offset and records of the chunk whose check sum was compared last."""
        try:
            self.contents = self._open()
            self._chunks = sorted(self.contents.chunks, key=lambda chunk: chunk.start)
        except PicktreeError:
            self._file.close()
            raise

    def close(self) -> None:
        self._data.cache_clear()
        self._places.cache_clear()
        self._file.close()

    @property
    def size(self) -> int:
        """Size of the file, bytes."""
        return self._file.size

    def messages(
        self,
        topics: Collection[str] | None = None,
        start: int | None = None,
        end: int | None = None,
        *,
        newest_first: bool = False,
    ) -> Iterator[RawMessage]:
        """Yield messages of these topics with start ≤ time ≤ end (ns), in order of time."""
        for chunk, found in self._found(topics, start, end, newest_first=newest_first):
            data = self._data(chunk.offset)
            for channel, time, begin, stop in found:
                yield RawMessage(self.contents.channels[channel].topic, time, data[begin:stop])

    def times(self, topic: str, start: int | None = None) -> list[int]:
        """Return the times (ns) of a topic's messages from `start` on."""
        chunks = self._found((topic,), start, None, newest_first=False)
        return [message.time for _, found in chunks for message in found]

    def _found(
        self, topics: Collection[str] | None, start: int | None, end: int | None, *, newest_first: bool
    ) -> Iterator[tuple[ChunkAt, Sequence[MessageAt]]]:
        """Yield the chunks with such messages, and the places of these."""
        names = {n for n, c in self.contents.channels.items() if topics is None or c.topic in topics}
        for chunk in reversed(self._chunks) if newest_first else self._chunks:
            if (start is not None and chunk.end < start) or (end is not None and chunk.start > end):
                continue
            if chunk.channels and chunk.channels.isdisjoint(names):
                continue
            found = [
                message
                for message in self._places(chunk.offset)
                if message.channel in names
                and (start is None or message.time >= start)
                and (end is None or message.time <= end)
            ]
            if found:
                yield chunk, found[::-1] if newest_first else found

    def attachment(self, name: str) -> Attachment | None:
        """Return the attachment; None when there is none of that name."""
        for entry in self.contents.attachments:
            if entry.name == name:
                with self._damage_at(entry.offset):
                    return attachment(self._file, entry.offset)
        return None

    def metadata(self) -> dict[str, dict[str, str]]:
        """Return all metadata by the records' names."""
        found: dict[str, dict[str, str]] = {}
        for entry in self.contents.metadata:
            with self._damage_at(entry.offset):
                opcode, body = self._file.record(entry.offset)
                if opcode != Opcode.METADATA:
                    raise ValueError(f"a record of the kind {opcode} instead of {Opcode.METADATA.value}")
                record = Metadata.read(stream(body))
                found[record.name] = dict(record.metadata)
        return found

    def _index(self, offset: int) -> tuple[MessageAt, ...]:
        """Return the places of a chunk's messages, once its check sum has been compared."""
        with self._damage_at(offset):
            content = chunk_content(self._file.record(offset)[1])
        self._checked = offset, content.data
        return content.messages

    def _unpack(self, offset: int) -> bytes:
        if self._checked[0] == offset:
            return self._checked[1]
        with self._damage_at(offset):
            return chunk_data(self._file.record(offset)[1])

    def _open(self) -> Contents:
        contents = contents_of(self._file)
        if contents is not None:
            losses = losses_of(self._file, contents)
            if contents.chunks or not losses:
                if losses:
                    self._tell(losses, "the rest is whole")
                return contents
            raise self._damaged(losses[0].offset, losses[0].what)
        if self._file.read(0, len(MAGIC)) != MAGIC:
            raise PicktreeError(f"{self.path}: not a log: it does not begin as an MCAP file does")
        found = salvaged(self._file)
        if not found.contents.chunks:
            raise self._damaged(found.stop, found.problem or "it holds no messages")
        if found.problem:
            last = max(chunk.end for chunk in found.contents.chunks) / 1e9
            self._tell(
                found.losses,
                f"the file was not finished; recovered up to byte {found.stop}, {last:.2f} s",
            )
        else:
            losses = (*found.losses, Loss(found.stop, "or later: its index"))
            self._tell(losses, "the rest is whole")
        return found.contents

    def _tell(self, losses: Collection[Loss], rest: str) -> None:
        more = (
            f" and {len(losses) - _MAX_NAMED_LOSSES} more places" if len(losses) > _MAX_NAMED_LOSSES else ""
        )
        places = ", ".join(loss.text() for loss in list(losses)[:_MAX_NAMED_LOSSES])
        damage = f"damaged at {places}{more}; " if losses else ""
        self.recovered = f"{self.path}: {damage}{rest}"

    @contextmanager
    def _damage_at(self, offset: int) -> Generator[None]:
        try:
            yield
        except DAMAGE_ERRORS as error:
            raise self._damaged(offset, str(error) or type(error).__name__) from None

    def _damaged(self, offset: int, why: str) -> PicktreeError:
        return PicktreeError(f"{self.path}: damaged at byte {offset}: {why}")
