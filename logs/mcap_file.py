"""Writing MCAP so that the file on disk is whole at every checkpoint, whatever then kills the process.

A checkpoint appends the messages so far as one compressed chunk, and behind it the summary and the footer
with which any reader opens the file; the next checkpoint overwrites these from the end of the data on.
Chunks and summary only grow, so one write both replaces the old ending and never leaves a rest behind.
https://mcap.dev/spec
"""

from __future__ import annotations

import os
import struct
import time
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from ..world.errors import PicktreeError

MAGIC = b"\x89MCAP0\r\n"
_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_HEAD = 22


class SchemaSource(Protocol):
    """What must be known of a topic to write its channel."""

    @property
    def name(self) -> str: ...
    @property
    def schema(self) -> str: ...
    @property
    def encoding(self) -> str: ...
    @property
    def schema_encoding(self) -> str: ...
    def schema_data(self) -> bytes: ...


class McapFile:
    """An MCAP file being written. Times are ns and never go back.

    A checkpoint is due when `checkpoint` seconds have passed in the messages' time or on the wall, or
    `chunk_bytes` are waiting.
    """

    def __init__(
        self,
        path: Path,
        *,
        checkpoint: float = 1.0,
        chunk_bytes: int = 4 << 20,
        wall: Callable[[], float] = time.monotonic,
    ) -> None:
        self.path = path
        self._interval = checkpoint
        self._chunk_bytes = chunk_bytes
        self._wall = wall
        self._file: int | None = None
        self._end = 0
        self._crc = 0
        self._tail = b""
        self._compressor = zstandard.ZstdCompressor(level=3)

        self._chunk = bytearray()
        self._index: dict[int, list[tuple[int, int]]] = {}
        self._chunk_start = self._chunk_end = 0
        self._wall_mark = wall()

        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._schema_records = bytearray()
        self._channel_records = bytearray()
        self._chunk_indexes = bytearray()
        self._attachment_indexes = bytearray()
        self._metadata_indexes = bytearray()
        self._statistics = Statistics(0, 0, {}, 0, 0, 0, 0, 0, 0)

        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o644)
        except OSError as error:
            raise self._failure(error) from None
        self._append(MAGIC + _bytes(Header(profile="", library="picktree")))

    def channel(self, topic: SchemaSource) -> int:
        """The number of the topic's channel, which is made when it is asked for the first time."""
        known = self._channels.get(topic.name)
        if known is not None:
            return known
        schema = self._schemas.get(topic.schema)
        if schema is None:
            schema = self._schemas[topic.schema] = len(self._schemas) + 1
            record = _bytes(
                Schema(id=schema, name=topic.schema, encoding=topic.schema_encoding, data=topic.schema_data())
            )
            self._schema_records += record
            self._chunk += record
            self._statistics.schema_count += 1
        number = self._channels[topic.name] = len(self._channels) + 1
        record = _bytes(
            Channel(
                id=number, topic=topic.name, message_encoding=topic.encoding, metadata={}, schema_id=schema
            )
        )
        self._channel_records += record
        self._chunk += record
        self._statistics.channel_count += 1
        self._statistics.channel_message_counts[number] = 0
        return number

    def message(self, channel: int, log_time: int, data: bytes) -> None:
        if self._index and (
            log_time - self._chunk_start >= self._interval * 1e9
            or len(self._chunk) >= self._chunk_bytes
            or self._wall() - self._wall_mark >= self._interval
        ):
            self.checkpoint()
        if not self._index:
            self._chunk_start = log_time
        statistics = self._statistics
        if statistics.message_count == 0:
            statistics.message_start_time = log_time
        self._index.setdefault(channel, []).append((log_time, len(self._chunk)))
        sequence = statistics.channel_message_counts[channel] + 1
        length = _MESSAGE_HEAD + len(data)
        self._chunk += _MESSAGE.pack(
            Opcode.MESSAGE, length, channel, sequence & 0xFFFFFFFF, log_time, log_time
        )
        self._chunk += data
        self._chunk_end = statistics.message_end_time = log_time
        statistics.message_count += 1
        statistics.channel_message_counts[channel] = sequence

    def attachment(self, name: str, media_type: str, data: bytes, log_time: int = 0) -> None:
        record = _bytes(
            Attachment(create_time=0, log_time=log_time, name=name, media_type=media_type, data=data)
        )
        index = AttachmentIndex(
            offset=self._end,
            length=len(record),
            log_time=log_time,
            create_time=0,
            data_size=len(data),
            name=name,
            media_type=media_type,
        )
        self._attachment_indexes += _bytes(index)
        self._statistics.attachment_count += 1
        self._append(record)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        record = _bytes(Metadata(name=name, metadata=dict(values)))
        self._metadata_indexes += _bytes(MetadataIndex(offset=self._end, length=len(record), name=name))
        self._statistics.metadata_count += 1
        self._append(record)

    def checkpoint(self) -> None:
        """Bring everything so far to disk, as a file that opens."""
        self._wall_mark = self._wall()
        if not self._index:
            self._append(b"")
            return
        data = bytes(self._chunk)
        packed = self._compressor.compress(data)
        chunk = _bytes(
            Chunk(
                compression="zstd",
                data=packed,
                message_start_time=self._chunk_start,
                message_end_time=self._chunk_end,
                uncompressed_crc=zlib.crc32(data),
                uncompressed_size=len(data),
            )
        )
        indexes = bytearray()
        offsets: dict[int, int] = {}
        for channel, entries in self._index.items():
            offsets[channel] = self._end + len(chunk) + len(indexes)
            indexes += _bytes(MessageIndex(channel_id=channel, records=entries))
        index = ChunkIndex(
            chunk_length=len(chunk),
            chunk_start_offset=self._end,
            compression="zstd",
            compressed_size=len(packed),
            message_end_time=self._chunk_end,
            message_index_length=len(indexes),
            message_index_offsets=offsets,
            message_start_time=self._chunk_start,
            uncompressed_size=len(data),
        )
        self._chunk_indexes += _bytes(index)
        self._statistics.chunk_count += 1
        self._append(chunk + indexes)
        self._chunk.clear()
        self._index.clear()

    def finish(self) -> None:
        """Write what is left and close."""
        try:
            if not self.closed:
                self.checkpoint()
        finally:
            self._close()

    @property
    def closed(self) -> bool:
        """Finished, or given up because the disk refused."""
        return self._file is None

    def _append(self, data: bytes) -> None:
        """Put `data` where the data section ends now, and the ending of the file behind it."""
        if self._file is None:
            raise PicktreeError(f"{self.path}: the log is closed")
        crc = zlib.crc32(data, self._crc)
        tail = self._ending(self._end + len(data), crc)
        try:
            _write(self._file, data + tail, self._end)
        except OSError as error:
            self._restore()
            raise self._failure(error) from None
        self._end += len(data)
        self._crc = crc
        self._tail = tail

    def _ending(self, start: int, crc: int) -> bytes:
        """DataEnd, summary, footer and magic of a file whose data section ends at `start`."""
        head = _bytes(DataEnd(data_section_crc=crc))
        summary_start = start + len(head)
        summary, offsets = bytearray(), bytearray()
        for opcode, group in (
            (Opcode.SCHEMA, self._schema_records),
            (Opcode.CHANNEL, self._channel_records),
            (Opcode.STATISTICS, _bytes(self._statistics)),
            (Opcode.CHUNK_INDEX, self._chunk_indexes),
            (Opcode.ATTACHMENT_INDEX, self._attachment_indexes),
            (Opcode.METADATA_INDEX, self._metadata_indexes),
        ):
            if group:
                offsets += _bytes(SummaryOffset(opcode, summary_start + len(summary), len(group)))
                summary += group
        offsets_start = summary_start + len(summary)
        summary += offsets
        # The footer's check sum covers the footer up to itself.
        footer_head = struct.pack("<BQQQ", Opcode.FOOTER, 20, summary_start, offsets_start)
        footer = Footer(summary_start, offsets_start, zlib.crc32(footer_head, zlib.crc32(summary)))
        return head + bytes(summary) + _bytes(footer) + MAGIC

    def _restore(self) -> None:
        """After a failed write: put the old ending back, so that the file opens with what it held before."""
        assert self._file is not None
        try:
            _write(self._file, self._tail, self._end)
            os.ftruncate(self._file, self._end + len(self._tail))
        except OSError:
            pass  # the reader recovers the file from its chunks
        self._close()

    def _close(self) -> None:
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _failure(self, error: OSError) -> PicktreeError:
        return PicktreeError(
            f"{self.path}: the log cannot be written: {error.strerror or error}; "
            "make room there, or give another folder with --out"
        )


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def _write(file: int, data: bytes, offset: int) -> None:
    view = memoryview(data)
    while view:
        written = os.pwrite(file, view, offset)
        view = view[written:]
        offset += written
