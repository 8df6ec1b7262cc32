"""Chunks of an MCAP file, parsed and checked, and access to a file's records.

https://mcap.dev/spec#chunk-op0x06
"""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from ...errors import PicktreeError

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


@dataclass(frozen=True, slots=True)
class MessageAt:
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
    start, end, size, crc, name_length = _CHUNK.unpack_from(body)
    offset = _CHUNK.size
    compression = body[offset : offset + name_length].decode()
    offset += name_length
    (length,) = struct.unpack_from("<Q", body, offset)
    packed = memoryview(body)[offset + 8 :]
    if length != len(packed):
        raise ValueError("wrong length of a chunk")
    data = _unpacked(packed, compression, size)
    if crc and zlib.crc32(data) != crc:
        raise ValueError("wrong check sum of a chunk")
    return _content(start, end, data)


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
    offset, size = 0, len(data)
    while offset < size:
        opcode, length = RECORD_HEAD.unpack_from(data, offset)
        begin = offset + RECORD_HEAD.size
        offset = begin + length
        if offset > size:
            raise EOFError("a chunk ends inside a record")
        if opcode == Opcode.MESSAGE:
            channel, _, time, _ = _MESSAGE.unpack_from(data, begin)
            messages.append(MessageAt(channel, time, begin + _MESSAGE.size, offset))
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
