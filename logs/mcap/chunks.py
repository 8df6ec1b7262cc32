"""What stands inside a chunk of an MCAP file, taken apart and checked.

https://mcap.dev/spec#chunk-op0x06
"""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from dataclasses import dataclass

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

DAMAGE = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    OverflowError,
    KeyError,
    EOFError,
    MemoryError,
)
"""What the libraries raise on damaged bytes. UnicodeDecodeError and a wrong check sum are ValueErrors."""

HEAD = struct.Struct("<BQ")
"""Of every record: opcode, length of what follows."""
_CHUNK = struct.Struct("<QQQII")
_MESSAGE = struct.Struct("<HIQQ")
_LARGEST = 1 << 28
"""Bytes in a chunk: a recorder of ours begins another long before."""


@dataclass(frozen=True, slots=True)
class MessageAt:
    """Where a message's content stands in its chunk. `time` in ns."""

    channel: int
    time: int
    start: int
    stop: int


@dataclass(frozen=True, slots=True)
class ChunkContent:
    start: int
    end: int
    """Of its messages, ns."""
    data: bytes
    messages: tuple[MessageAt, ...]
    schemas: tuple[Schema, ...]
    channels: tuple[Channel, ...]

    def counts(self) -> Counter[int]:
        """Messages by channel."""
        return Counter(message.channel for message in self.messages)


def chunk_content(body: bytes) -> ChunkContent:
    """Raises one of `DAMAGE` when any of it is not as it was written."""
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
    if size > _LARGEST:
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
        opcode, length = HEAD.unpack_from(data, offset)
        begin = offset + HEAD.size
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
