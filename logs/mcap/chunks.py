"""Chunks of an MCAP file, and the index of its chunks, attachments and metadata."""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    MetadataIndex,
    Schema,
    Statistics,
)

from ...errors import PicktreeError
from .writer import MAGIC

DAMAGE_ERRORS = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    OverflowError,
    KeyError,
    EOFError,
    MemoryError,
)
"""Exceptions of the libraries on damaged bytes. UnicodeDecodeError and a wrong check sum are ValueErrors."""

RECORD_HEAD = struct.Struct("<BQ")
"""Start of every record: opcode, length of the content in bytes."""
_CHUNK = struct.Struct("<QQQII")
_MESSAGE = struct.Struct("<HIQQ")
_MAX_CHUNK_SIZE = 1 << 28
"""Maximum size of a chunk, bytes; picktree's recorder begins another long before."""


class MessageAt(NamedTuple):
    """Position of a message's content in its chunk. `time` in ns."""

    channel: int
    time: int
    start: int
    stop: int


@dataclass(frozen=True, slots=True)
class ChunkContent:
    start: int
    end: int
    """Times of the first and last message, ns."""
    data: bytes
    messages: tuple[MessageAt, ...]
    schemas: tuple[Schema, ...]
    channels: tuple[Channel, ...]

    def counts(self) -> Counter[int]:
        """Return the number of messages by channel."""
        return Counter(message.channel for message in self.messages)


def chunk_content(body: bytes) -> ChunkContent:
    """Parse a chunk. Raises one of `DAMAGE_ERRORS` when any of it is not as it was written."""
    start, end, _, crc, _ = _CHUNK.unpack_from(body)
    data = chunk_data(body)
    if crc and zlib.crc32(data) != crc:
        raise ValueError("wrong check sum of a chunk")
    return _content(start, end, data)


def chunk_data(body: bytes) -> bytes:
    """Return the records of a chunk, without a look at its check sum. Raises one of `DAMAGE_ERRORS`."""
    _, _, size, _, name_length = _CHUNK.unpack_from(body)
    offset = _CHUNK.size
    compression = body[offset : offset + name_length].decode()
    offset += name_length
    (length,) = struct.unpack_from("<Q", body, offset)
    packed = memoryview(body)[offset + 8 :]
    if length != len(packed):
        raise ValueError("wrong length of a chunk")
    return _unpacked(packed, compression, size)


def _unpacked(packed: memoryview, compression: str, size: int) -> bytes:
    if size > _MAX_CHUNK_SIZE:
        raise ValueError(f"a chunk of {size} bytes")
    if compression == "":
        data = bytes(packed)
    elif compression == "zstd":
        told = zstandard.get_frame_parameters(packed).content_size
        if told not in (size, zstandard.CONTENTSIZE_UNKNOWN):
            raise ValueError("wrong size of a chunk")
        data = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    else:
        raise ValueError(f"unknown compression {compression!r}")
    if len(data) != size:
        raise ValueError("wrong size of a chunk")
    return data


def _content(start: int, end: int, data: bytes) -> ChunkContent:
    messages: list[MessageAt] = []
    schemas: list[Schema] = []
    channels: list[Channel] = []
    new: Any = tuple.__new__  # pyright: ignore - without the functions of a named tuple, for each message
    offset, size = 0, len(data)
    while offset < size:
        opcode, length = RECORD_HEAD.unpack_from(data, offset)
        begin = offset + RECORD_HEAD.size
        offset = begin + length
        if offset > size:
            raise EOFError("a chunk ends inside a record")
        if opcode == Opcode.MESSAGE:
            channel, _, time, _ = _MESSAGE.unpack_from(data, begin)
            messages.append(new(MessageAt, (channel, time, begin + _MESSAGE.size, offset)))
        elif opcode == Opcode.SCHEMA:
            schemas.append(Schema.read(stream(data[begin:offset])))
        elif opcode == Opcode.CHANNEL:
            channels.append(Channel.read(stream(data[begin:offset])))
    return ChunkContent(start, end, data, tuple(messages), tuple(schemas), tuple(channels))


def stream(data: bytes) -> ReadDataStream:
    return ReadDataStream(io.BytesIO(data))


_READ_BLOCK_SIZE = 1 << 20


class RecordFile:
    """File of records. Raises PicktreeError when the file cannot be read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._stream: IO[bytes] = path.open("rb")
            self.size = self._stream.seek(0, io.SEEK_END)
        except OSError as error:
            raise PicktreeError(f"{path}: the log cannot be read: {error.strerror}") from None

    def close(self) -> None:
        self._stream.close()

    def read(self, offset: int, length: int) -> bytes:
        """Return `length` bytes from `offset`, or fewer where the file ends."""
        self._stream.seek(offset)
        return self._stream.read(length)

    def record(self, offset: int) -> tuple[int, bytes]:
        """Return opcode and content of the record at `offset`. Raises EOFError when the file ends before the
        record does."""
        head = self.read(offset, RECORD_HEAD.size)
        opcode, length = RECORD_HEAD.unpack(head) if len(head) == RECORD_HEAD.size else (0, self.size)
        if length > self.size - offset - RECORD_HEAD.size:
            raise EOFError("the file ends inside a record")
        return opcode, self._stream.read(length)

    def crc(self, start: int, stop: int) -> int:
        """Return the check sum of the bytes from `start` to before `stop`."""
        crc = 0
        self._stream.seek(start)
        while start < stop:
            block = self._stream.read(min(_READ_BLOCK_SIZE, stop - start))
            if not block:
                break
            crc = zlib.crc32(block, crc)
            start += len(block)
        return crc

    def places(self, pattern: bytes, start: int) -> Iterator[int]:
        """Yield the offsets of `pattern` from `start` on."""
        overlap = len(pattern) - 1
        while start < self.size:
            block = self.read(start, _READ_BLOCK_SIZE)
            at = block.find(pattern)
            while at >= 0:
                yield start + at
                at = block.find(pattern, at + 1)
            if len(block) <= overlap:
                return
            start += len(block) - overlap


FOOTER = struct.Struct("<BQQQI")
DATA_END = struct.Struct("<BQI")


@dataclass(frozen=True, slots=True)
class ChunkAt:
    offset: int
    start: int
    end: int
    """Times of the first and last message, ns."""
    channels: frozenset[int] = frozenset()
    """Channels of the messages; empty when unknown."""


@dataclass(frozen=True, slots=True)
class NamedAt:
    """Offset and name of an attachment or a metadata record."""

    offset: int
    name: str


@dataclass(slots=True)
class Contents:
    schemas: dict[int, Schema] = field(default_factory=dict[int, Schema])
    channels: dict[int, Channel] = field(default_factory=dict[int, Channel])
    chunks: list[ChunkAt] = field(default_factory=list[ChunkAt])
    attachments: list[NamedAt] = field(default_factory=list[NamedAt])
    metadata: list[NamedAt] = field(default_factory=list[NamedAt])
    counts: Counter[int] = field(default_factory=Counter[int])
    """Number of messages by channel."""
    data_end: int = 0
    """Offset behind the last byte of data."""

    def holding(self, topic: str) -> int:
        """Return the number of chunks that may hold messages of a topic."""
        numbers = {n for n, channel in self.channels.items() if channel.topic == topic}
        return sum(not chunk.channels or not chunk.channels.isdisjoint(numbers) for chunk in self.chunks)


def contents_of(file: RecordFile) -> Contents | None:
    """Return the content of a file; None when it has no complete summary."""
    ending = FOOTER.size + len(MAGIC)
    if file.size < ending or file.read(file.size - len(MAGIC), len(MAGIC)) != MAGIC:
        return None
    opcode, length, start, _, crc = FOOTER.unpack(file.read(file.size - ending, FOOTER.size))
    stop = file.size - ending
    if opcode != Opcode.FOOTER or length != FOOTER.size - 9 or not len(MAGIC) <= start < stop:
        return None
    if crc and file.crc(start, file.size - len(MAGIC) - 4) != crc:
        return None
    contents = Contents(data_end=max(start - DATA_END.size, 0))
    offset = start
    try:
        while offset < stop:
            opcode, body = file.record(offset)
            offset += 9 + len(body)
            _note(contents, opcode, body)
    except DAMAGE_ERRORS:
        return None
    return contents


def _note(contents: Contents, opcode: int, body: bytes) -> None:
    match opcode:
        case Opcode.SCHEMA:
            schema = Schema.read(stream(body))
            contents.schemas[schema.id] = schema
        case Opcode.CHANNEL:
            channel = Channel.read(stream(body))
            contents.channels[channel.id] = channel
        case Opcode.STATISTICS:
            contents.counts.update(Statistics.read(stream(body)).channel_message_counts)
        case Opcode.CHUNK_INDEX:
            index = ChunkIndex.read(stream(body))
            contents.chunks.append(
                ChunkAt(
                    index.chunk_start_offset,
                    index.message_start_time,
                    index.message_end_time,
                    frozenset(index.message_index_offsets),
                )
            )
        case Opcode.ATTACHMENT_INDEX:
            attachment = AttachmentIndex.read(stream(body))
            contents.attachments.append(NamedAt(attachment.offset, attachment.name))
        case Opcode.METADATA_INDEX:
            metadata = MetadataIndex.read(stream(body))
            contents.metadata.append(NamedAt(metadata.offset, metadata.name))
        case _:
            pass
