"""Content of an MCAP file as the `mcap` package reads it: definitions, blocks of messages, attachments and
metadata.

A block is a chunk, or a run of records outside of chunks; both hold records of the same form.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    Footer,
    Header,
    McapRecord,
    Metadata,
    Schema,
)
from mcap.stream_reader import get_chunk_data_stream
from mcap.summary import Summary

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
    RuntimeError,
)
"""Exceptions of the libraries on damaged bytes. UnicodeDecodeError and a wrong check sum are ValueErrors; lz4
raises RuntimeError."""

RECORD_HEAD: Final = struct.Struct("<BQ")
"""Start of every record: opcode, length of the content in bytes."""
_MESSAGE: Final = struct.Struct("<HIQQ")
_FOOTER_SIZE: Final = 20
_DATA_END_SIZE: Final = RECORD_HEAD.size + 4
_READ_BLOCK_SIZE: Final = 1 << 20
_MAX_LOOSE_SIZE: Final = 4 << 20
"""Size at which a run of records outside of chunks continues in a further block, bytes."""
_MAX_UNPACKED_SIZE: Final = 4 << 30
"""Limit of the `mcap` package for a record, applied to an unpacked chunk, bytes."""


class RecordFile:
    """File of records. Raises PicktreeError when the file cannot be read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self.stream: IO[bytes] = path.open("rb")
            self.size = self.stream.seek(0, io.SEEK_END)
        except OSError as error:
            raise PicktreeError(f"{path}: the log cannot be read: {error.strerror}") from None

    def close(self) -> None:
        self.stream.close()

    def read(self, offset: int, length: int) -> bytes:
        """Return `length` bytes from `offset`, or fewer where the file ends."""
        self.stream.seek(offset)
        return self.stream.read(length)

    def record(self, offset: int, expected: int | None = None) -> tuple[int, bytes]:
        """Return opcode and content of the record at `offset`. Raises EOFError when the file ends before the
        record does, and ValueError for another opcode than the expected one."""
        head = self.read(offset, RECORD_HEAD.size)
        opcode, length = RECORD_HEAD.unpack(head) if len(head) == RECORD_HEAD.size else (0, self.size)
        if length > self.size - offset - RECORD_HEAD.size:
            raise EOFError("the file ends inside a record")
        if expected not in (None, opcode):
            raise ValueError(f"a record of the kind {opcode} instead of {expected}")
        return opcode, self.stream.read(length)

    def crc(self, start: int, stop: int) -> int:
        """Return the check sum of the bytes from `start` to before `stop`."""
        crc = 0
        self.stream.seek(start)
        while start < stop:
            block = self.stream.read(min(_READ_BLOCK_SIZE, stop - start))
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


def parser(data: bytes) -> ReadDataStream:
    """Return the content of a record as the `mcap` package parses it."""
    return ReadDataStream(io.BytesIO(data))


class Block(NamedTuple):
    """Chunk, or run of records outside of chunks."""

    offset: int
    start: int = 0
    end: int = 0
    """Times of the first and last message, ns; 0 while they are unknown."""
    stop: int = 0
    """Offset behind the last record of a run; 0: a chunk."""


class NamedAt(NamedTuple):
    """Offset and name of an attachment or a metadata record."""

    offset: int
    name: str


@dataclass(slots=True)
class Contents:
    """Definitions of a file, and the places of its blocks, attachments and metadata."""

    library: str = ""
    """Program that wrote the file, in its own words."""
    profile: str = ""
    schemas: dict[int, Schema] = field(default_factory=dict[int, Schema])
    channels: dict[int, Channel] = field(default_factory=dict[int, Channel])
    blocks: list[Block] = field(default_factory=list[Block])
    attachments: list[NamedAt] = field(default_factory=list[NamedAt])
    metadata: list[NamedAt] = field(default_factory=list[NamedAt])
    counts: dict[int, int] = field(default_factory=dict[int, int])
    """Number of messages by channel; empty while they are not counted."""

    def extend(self, offset: int, stop: int) -> None:
        """Add a schema, channel or message outside of chunks, from `offset` to before `stop`."""
        last = self.blocks[-1] if self.blocks else Block(0)
        if last.stop == offset and stop - last.offset <= _MAX_LOOSE_SIZE:
            self.blocks[-1] = last._replace(stop=stop)
        else:
            self.blocks.append(Block(offset, stop=stop))

    def define(self, record: McapRecord) -> None:
        """Take the definition of a schema or a channel. The first of a number stays."""
        if isinstance(record, Schema):
            self.schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            self.channels.setdefault(record.id, record)


def indexed_contents(file: RecordFile) -> tuple[Contents, bool | None] | None:
    """Return the content of a file by its summary; None when the summary does not list everything.

    The second value states whether the check sum of the data is right; None: the file has none. Raises one of
    `DAMAGE_ERRORS` when the file has no ending, or a damaged one.
    """
    ending = file.size - len(MAGIC)
    if ending < _FOOTER_SIZE + len(MAGIC) or file.read(ending, len(MAGIC)) != MAGIC:
        raise ValueError("the file does not end as an MCAP file does")
    file.stream.seek(0)
    summary = SeekingReader(file.stream).get_summary()
    footer = Footer.read(parser(file.read(ending - _FOOTER_SIZE, _FOOTER_SIZE)))
    if summary is None:
        return None
    if footer.summary_crc and footer.summary_crc != file.crc(footer.summary_start, ending - 4):
        raise ValueError("wrong check sum of the summary")
    data_end = footer.summary_start - _DATA_END_SIZE
    opcode, body = file.record(data_end)
    header = file.record(len(MAGIC), Opcode.HEADER)[1]
    if opcode != Opcode.DATA_END or not _lists_everything(
        summary, data_end - len(MAGIC) - RECORD_HEAD.size - len(header)
    ):
        return None
    words = Header.read(parser(header))
    crc = int.from_bytes(body[:4], "little")
    assert summary.statistics is not None
    contents = Contents(
        words.library,
        words.profile,
        dict(summary.schemas),
        dict(summary.channels),
        [
            Block(index.chunk_start_offset, index.message_start_time, index.message_end_time)
            for index in summary.chunk_indexes
        ],
        [NamedAt(index.offset, index.name) for index in summary.attachment_indexes],
        [NamedAt(index.offset, index.name) for index in summary.metadata_indexes],
        dict(summary.statistics.channel_message_counts),
    )
    return contents, file.crc(0, data_end) == crc if crc else None


def _lists_everything(summary: Summary, size: int) -> bool:
    """Whether the indexed records fill the data section, whose records behind the header have this size."""
    listed = sum(index.chunk_length + index.message_index_length for index in summary.chunk_indexes)
    listed += sum(index.length for index in (*summary.attachment_indexes, *summary.metadata_indexes))
    used = {number for index in summary.chunk_indexes for number in index.message_index_offsets}
    schemas = {channel.schema_id for channel in summary.channels.values()} - {0}
    return (
        summary.statistics is not None
        and listed == size
        and all(index.message_index_offsets for index in summary.chunk_indexes)
        and used <= summary.channels.keys()
        and schemas <= summary.schemas.keys()
    )


def unpacked(file: RecordFile, block: Block) -> bytes:
    """Return the records of a block. Raises one of `DAMAGE_ERRORS` when they are not as they were written."""
    if block.stop:
        return file.read(block.offset, block.stop - block.offset)
    return chunk_data(file.record(block.offset, Opcode.CHUNK)[1])


def chunk_data(body: bytes) -> bytes:
    """Return the records of a chunk, once its check sum has been compared, if it has one."""
    chunk = Chunk.read(parser(body))
    if chunk.uncompressed_size > _MAX_UNPACKED_SIZE:
        raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes")
    if chunk.compression not in ("", "zstd", "lz4"):
        raise ValueError(f"unknown compression {chunk.compression!r}")
    if not chunk.uncompressed_size:
        return b""
    stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    if length != chunk.uncompressed_size:
        raise ValueError("wrong size of a chunk")
    return stream.read(length)


class MessageAt(NamedTuple):
    """Position of a message's content in its block. `time` in ns."""

    channel: int
    time: int
    sequence: int
    start: int
    stop: int


def scan(data: bytes) -> tuple[list[MessageAt], list[Schema | Channel]]:
    """Return the positions of a block's messages, and the definitions in it. Raises one of `DAMAGE_ERRORS`.

    The `mcap` package builds an object with a copy of the content for each message: six times the time.
    """
    messages: list[MessageAt] = []
    definitions: list[Schema | Channel] = []
    new: Any = tuple.__new__  # pyright: ignore - without the functions of a named tuple, for each message
    offset, size = 0, len(data)
    while offset < size:
        opcode, length = RECORD_HEAD.unpack_from(data, offset)
        begin = offset + RECORD_HEAD.size
        offset = begin + length
        if offset > size:
            raise EOFError("a chunk ends inside a record")
        if opcode == Opcode.MESSAGE:
            channel, sequence, time, _ = _MESSAGE.unpack_from(data, begin)
            messages.append(new(MessageAt, (channel, time, sequence, begin + _MESSAGE.size, offset)))
        elif opcode == Opcode.SCHEMA:
            definitions.append(Schema.read(parser(data[begin:offset])))
        elif opcode == Opcode.CHANNEL:
            definitions.append(Channel.read(parser(data[begin:offset])))
    return messages, definitions


def attachment(file: RecordFile, offset: int) -> Attachment:
    """Return an attachment. Raises one of `DAMAGE_ERRORS` when it is not as it was written."""
    body = file.record(offset, Opcode.ATTACHMENT)[1]
    crc = int.from_bytes(body[-4:], "little")
    if crc and zlib.crc32(body[:-4]) != crc:
        raise ValueError("wrong check sum of a file")
    return Attachment.read(parser(body))


def metadata(file: RecordFile, offset: int) -> Metadata:
    """Return a metadata record. Raises one of `DAMAGE_ERRORS` when it is not as it was written."""
    return Metadata.read(parser(file.record(offset, Opcode.METADATA)[1]))
