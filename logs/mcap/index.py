"""Index of an MCAP file: its content with offsets, from the summary at the end of the file."""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass, field

from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    MetadataIndex,
    Schema,
    Statistics,
)

from .chunks import DAMAGE_ERRORS, RecordFile, stream
from .writer import MAGIC

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
