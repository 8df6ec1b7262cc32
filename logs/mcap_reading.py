"""Reading MCAP: the stock reader's summary, checked; recovery of a cut file; one error for all damage."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Collection, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
)
from mcap.stream_reader import breakup_chunk
from mcap.summary import Summary
from zstandard import ZstdError

from ..world.errors import PicktreeError
from .mcap_file import MAGIC

_FOOTER = struct.Struct("<BQQQI")
_DAMAGE = (McapError, ZstdError, struct.error, ValueError, OverflowError, KeyError, EOFError, MemoryError)
"""What the libraries raise on damaged bytes. UnicodeDecodeError and a wrong check sum are ValueErrors."""


@dataclass(frozen=True, slots=True)
class RawMessage:
    """A message as it stands in the file. `time` in ns."""

    topic: str
    time: int
    data: bytes


class McapReading:
    """An MCAP file, open for reading.

    `recovered` is a sentence when the file has no valid ending and was pieced together from its chunks.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.recovered = ""
        try:
            self._stream: IO[bytes] = path.open("rb")
        except OSError as error:
            raise PicktreeError(f"{path}: the log cannot be read: {error.strerror}") from None
        try:
            self.size = self._stream.seek(0, io.SEEK_END)
            self._stream.seek(0)
            if self._stream.read(len(MAGIC)) != MAGIC:
                raise PicktreeError(f"{path}: not a log: it does not begin as an MCAP file does")
            summary = self._summary()
            self.summary = summary if summary is not None else self._recover()
        except PicktreeError:
            self._stream.close()
            raise

    def close(self) -> None:
        self._stream.close()

    def messages(
        self,
        topics: Collection[str] | None = None,
        start: int | None = None,
        end: int | None = None,
        *,
        newest_first: bool = False,
    ) -> Iterator[RawMessage]:
        """Messages of these topics with start ≤ time ≤ end (ns), in the order of time."""
        wanted = {n for n, c in self.summary.channels.items() if topics is None or c.topic in topics}
        indexes = sorted(self.summary.chunk_indexes, key=lambda c: c.message_start_time, reverse=newest_first)
        for index in indexes:
            if (start is not None and index.message_end_time < start) or (
                end is not None and index.message_start_time > end
            ):
                continue
            if index.message_index_offsets and wanted.isdisjoint(index.message_index_offsets):
                continue
            found = [
                record
                for record in self._chunk(index.chunk_start_offset)
                if isinstance(record, Message)
                and record.channel_id in wanted
                and (start is None or record.log_time >= start)
                and (end is None or record.log_time <= end)
            ]
            for record in reversed(found) if newest_first else found:
                topic = self.summary.channels[record.channel_id].topic
                yield RawMessage(topic, record.log_time, record.data)

    def attachments(self) -> Iterator[Attachment]:
        for index in self.summary.attachment_indexes:
            with self._damage_at(index.offset):
                opcode, body = self._record(index.offset)
                if opcode != Opcode.ATTACHMENT:
                    raise ValueError(f"record {opcode} where an attachment should be")
                if zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], "little"):
                    raise ValueError("wrong check sum of an attachment")
                record = Attachment.read(_stream(body))
            yield record

    def metadata(self) -> Iterator[Metadata]:
        for index in self.summary.metadata_indexes:
            with self._damage_at(index.offset):
                opcode, body = self._record(index.offset)
                if opcode != Opcode.METADATA:
                    raise ValueError(f"record {opcode} where metadata should be")
                record = Metadata.read(_stream(body))
            yield record

    def _chunk(self, offset: int) -> list[McapRecord]:
        with self._damage_at(offset):
            opcode, body = self._record(offset)
            if opcode != Opcode.CHUNK:
                raise ValueError(f"record {opcode} where a chunk should be")
            return breakup_chunk(Chunk.read(_stream(body)), validate_crc=True)

    def _record(self, offset: int) -> tuple[int, bytes]:
        """Opcode and content of the record at `offset`."""
        self._stream.seek(offset)
        opcode, length = struct.unpack("<BQ", self._stream.read(9))
        if length > self.size - offset - 9:
            raise EOFError("the file ends inside a record")
        return opcode, self._stream.read(length)

    @contextmanager
    def _damage_at(self, offset: int) -> Generator[None]:
        try:
            yield
        except _DAMAGE as error:
            raise self._damaged(offset, error) from None

    def _damaged(self, offset: int, error: BaseException) -> PicktreeError:
        why = str(error) or type(error).__name__
        return PicktreeError(f"{self.path}: damaged at byte {offset}: {why}")

    def _summary(self) -> Summary | None:
        """The summary at the end of the file; None when there is none that is whole."""
        ending = _FOOTER.size + len(MAGIC)
        if self.size < len(MAGIC) + ending:
            return None
        self._stream.seek(-ending, io.SEEK_END)
        opcode, length, start, _, crc = _FOOTER.unpack(self._stream.read(_FOOTER.size))
        if self._stream.read() != MAGIC or opcode != Opcode.FOOTER or length != _FOOTER.size - 9:
            return None
        stop = self.size - len(MAGIC) - 4
        if not len(MAGIC) <= start < stop:
            return None
        self._stream.seek(start)
        if crc != 0 and zlib.crc32(self._stream.read(stop - start)) != crc:
            return None
        with self._damage_at(start):
            self._stream.seek(0)
            return make_reader(self._stream, validate_crcs=True).get_summary()

    def _recover(self) -> Summary:
        """The summary as it follows from the records, up to the first that is not whole."""
        summary = Summary()
        offset = len(MAGIC)
        problem: BaseException = EOFError("the file ends without its summary")
        while offset < self.size:
            try:
                opcode, body = self._record(offset)
                length = 9 + len(body)
                if opcode == Opcode.DATA_END:
                    break
                self._note(summary, opcode, body, offset)
            except _DAMAGE as error:
                problem = error
                break
            offset += length
        if not summary.chunk_indexes:
            raise self._damaged(offset, problem)
        last = max(c.message_end_time for c in summary.chunk_indexes) / 1e9
        self.recovered = (
            f"{self.path}: the file was not finished; recovered up to byte {offset}, {last:.2f} s"
        )
        return summary

    @staticmethod
    def _note(summary: Summary, opcode: int, body: bytes, offset: int) -> None:
        length = 9 + len(body)
        if opcode == Opcode.CHUNK:
            chunk = Chunk.read(_stream(body))
            for record in breakup_chunk(chunk, validate_crc=True):
                if isinstance(record, Schema):
                    summary.schemas[record.id] = record
                elif isinstance(record, Channel):
                    summary.channels[record.id] = record
            summary.chunk_indexes.append(
                ChunkIndex(
                    chunk_length=length,
                    chunk_start_offset=offset,
                    compression=chunk.compression,
                    compressed_size=len(chunk.data),
                    message_end_time=chunk.message_end_time,
                    message_index_length=0,
                    message_index_offsets={},
                    message_start_time=chunk.message_start_time,
                    uncompressed_size=chunk.uncompressed_size,
                )
            )
        elif opcode == Opcode.ATTACHMENT:
            a = Attachment.read(_stream(body))
            summary.attachment_indexes.append(
                AttachmentIndex(offset, length, a.log_time, a.create_time, len(a.data), a.name, a.media_type)
            )
        elif opcode == Opcode.METADATA:
            summary.metadata_indexes.append(MetadataIndex(offset, length, Metadata.read(_stream(body)).name))


def _stream(data: bytes) -> ReadDataStream:
    return ReadDataStream(io.BytesIO(data))
