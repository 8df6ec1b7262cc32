"""Salvage of damaged and unfinished files: their readable records, each by its offset, and their losses."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Chunk, Footer, McapRecord, Message, MessageIndex, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary

from picktree.files import PicktreeError

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
_FOOTER_SIZE: Final = 20
_DATA_END_SIZE: Final = RECORD_HEAD.size + 4
_READ_BLOCK_SIZE: Final = 1 << 20


class RecordFile(io.BufferedReader):
    """File of records. Raises PicktreeError when the file cannot be opened."""

    def __init__(self, path: Path) -> None:
        try:
            super().__init__(io.FileIO(path))
            self.size = self.seek(0, io.SEEK_END)
        except OSError as error:
            raise PicktreeError(f"{path}: the log cannot be read: {error.strerror}") from None

    def read(self, size: int | None = -1, /) -> bytes:
        """Read as many bytes, or fewer where the file ends. A damaged length takes no memory."""
        if size is not None and size > _READ_BLOCK_SIZE:
            size = min(size, max(self.size - self.tell(), 0))
        return super().read(size)

    def at(self, offset: int, length: int) -> bytes:
        """Return `length` bytes from `offset`, or fewer where the file ends."""
        self.seek(offset)
        return self.read(length)

    def record(self, offset: int, expected: int | None = None) -> tuple[int, bytes]:
        """Return opcode and content of the record at `offset`. Raises EOFError when the file ends before the
        record does, and ValueError for another opcode than the expected one."""
        head = self.at(offset, RECORD_HEAD.size)
        opcode, length = RECORD_HEAD.unpack(head) if len(head) == RECORD_HEAD.size else (0, self.size)
        if length > self.size - offset - RECORD_HEAD.size:
            raise EOFError("the file ends inside a record")
        if expected not in (None, opcode):
            raise ValueError(f"a record of the kind {opcode} instead of {expected}")
        return opcode, self.read(length)

    def crc(self, start: int, stop: int) -> int:
        """Return the check sum of the bytes from `start` to before `stop`."""
        crc = 0
        for offset in range(start, stop, _READ_BLOCK_SIZE):
            crc = zlib.crc32(self.at(offset, min(_READ_BLOCK_SIZE, stop - offset)), crc)
        return crc

    def find(self, pattern: bytes, start: int) -> int | None:
        """Return the offset of `pattern` at `start` or behind; None when it is not there."""
        while start < self.size:
            block = self.at(start, _READ_BLOCK_SIZE + len(pattern) - 1)
            if (place := block.find(pattern)) >= 0:
                return start + place
            start += _READ_BLOCK_SIZE
        return None

    def indexed(self) -> tuple[SeekingReader, Summary, int]:
        """Return the package's reader, the summary, and the offset at which the data ends.

        The summary is empty in a file without one. The reader keeps it, since a file that is still written
        gets another one at any time. Raises one of `DAMAGE_ERRORS` when the file has no ending, or a damaged
        one.
        """
        ending = self.size - len(MAGIC)
        if ending < _FOOTER_SIZE + len(MAGIC) or self.at(ending, len(MAGIC)) != MAGIC:
            raise ValueError("the file does not end as an MCAP file does")
        self.seek(0)
        reader = SeekingReader(self)
        summary = reader.get_summary() or Summary()
        footer = Footer.read(ReadDataStream(io.BytesIO(self.at(ending - _FOOTER_SIZE, _FOOTER_SIZE))))
        start = footer.summary_start or ending - _FOOTER_SIZE - RECORD_HEAD.size
        if footer.summary_crc and footer.summary_crc != self.crc(start, ending - 4):
            raise ValueError("wrong check sum of the summary")
        self.record(start - _DATA_END_SIZE, Opcode.DATA_END)
        return reader, summary, start - _DATA_END_SIZE


def parsed(opcode: int, body: bytes) -> McapRecord:
    """Return a record, a chunk with its content packed. Raises one of `DAMAGE_ERRORS`."""
    if opcode == Opcode.ATTACHMENT:
        crc = int.from_bytes(body[-4:], "little")
        if crc and zlib.crc32(body[:-4]) != crc:
            raise ValueError("wrong check sum of a file")
    return unchecked(opcode, body)


def unchecked(opcode: int, body: bytes) -> McapRecord:
    """Return a record whatever its check sum. Raises one of `DAMAGE_ERRORS`."""
    raw = io.BytesIO(RECORD_HEAD.pack(opcode, len(body)) + body)
    return next(StreamReader(raw, skip_magic=True, emit_chunks=True).records)


_PRIVATE_OPCODES = 0x80
"""First opcode that other programs may use for records of their own."""
_COMPRESSION_SIGNS = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4")
_SIGN_OFFSET = RECORD_HEAD.size + 28
"""Offset of the compression's name in a chunk's record, bytes."""
_MAX_TIME = 1 << 62
"""Least time that counts as damaged, ns."""
_MAX_UNPACKED_SIZE = 4 << 30
"""Limit of the `mcap` package for a record, applied to an unpacked chunk, bytes."""
_MAX_NAMED_LOSSES = 4
"""Maximum number of losses that the message names."""


@dataclass(frozen=True, slots=True)
class Loss:
    """Damage: its offset, and the content that it makes unreadable."""

    offset: int
    what: str
    lost: bool = True
    """Whether content is lost; otherwise only an index, which was rebuilt."""
    channels: tuple[int, ...] = ()
    """Channels of the lost messages, as far as an index states them."""

    def text(self, topics: Mapping[int, str]) -> str:
        known = [topics[number] for number in self.channels if number in topics]
        of = f" of {known[0]}" if len(known) == 1 else ""
        return f"byte {self.offset} ({self.what}{of}{' lost' if self.lost else ''})"


class Salvage:
    """Pass through the records of a file from its beginning to the end of its data.

    `summary` and `data_end`: the summary of a file with a valid ending, and the offset at which its data
    end.
    """

    def __init__(self, file: RecordFile, summary: Summary | None = None, data_end: int = 0) -> None:
        self._file = file
        self._summary, self._data_end = summary, data_end
        self._topics: dict[int, str] = {}
        self._losses: list[Loss] = []
        self._latest = 0
        """Time of the last message so far, ns."""
        self._has_ending = self._is_right = False
        """Whether the summary follows the data, and whether the check sum of the data is right."""
        self.stop = len(MAGIC)
        """Offset up to which the file was read: the end of the data, or of the last whole record."""
        self.problem = ""
        """Problem at `stop`; empty at the end of the data."""
        self.lost_files: dict[str, int] = {}
        """Offsets of the damaged attachments by name."""

    @property
    def is_whole(self) -> bool:
        """Whether the file has its ending, and all that was written."""
        return self._has_ending and self._is_right and not self._losses

    def text(self, end: int) -> str:
        """Return what is lost, as clauses; empty for a whole file. `end`: time of the last message, ns."""
        rest, losses = "the rest is whole", list(self._losses)
        if self.problem:
            rest = f"the file was not finished; recovered up to byte {self.stop}, {end / 1e9:.2f} s"
        elif self.is_whole:
            return ""
        elif not self._has_ending:
            losses.append(Loss(self.stop, "or later: its index", lost=False))
        elif not losses:
            losses.append(Loss(0, "or later, outside of messages and files", lost=False))
        named = ", ".join(loss.text(self._topics) for loss in losses[:_MAX_NAMED_LOSSES])
        more = len(losses) - _MAX_NAMED_LOSSES
        places = f"{named} and {more} more places" if more > 0 else named
        return f"damaged at {places}; {rest}" if losses else rest

    def records(self) -> Iterator[McapRecord]:
        """Yield everything readable, without chunks and indexes. A lost file is yielded unchanged."""
        if self._summary is not None:
            yield from self._summary.schemas.values()
            yield from map(self._taken, self._summary.channels.values())
        file, offset = self._file, len(MAGIC)
        while offset < file.size:
            try:
                opcode, body = file.record(offset)
                if opcode == Opcode.DATA_END:
                    crc = int.from_bytes(body[:4], "little")
                    self._is_right = not crc or crc == file.crc(0, offset)
                    self._has_ending = self._summary is not None and offset == self._data_end
                    self.stop = offset + RECORD_HEAD.size + len(body)
                    return
                records = _content(opcode, body)
                after = offset + RECORD_HEAD.size + len(body)
            except DAMAGE_ERRORS as error:
                following = self._following(offset)
                if following is None:
                    self.problem = str(error) or type(error).__name__
                    self.stop = offset
                    return
                records, after = self._lose(offset), following
            yield from map(self._taken, records)
            offset = after
        self.stop, self.problem = offset, "the file ends without its summary"

    def _taken(self, record: McapRecord) -> McapRecord:
        if isinstance(record, Channel):
            self._topics.setdefault(record.id, record.topic)
        elif isinstance(record, Message):
            self._latest = max(self._latest, record.log_time)
        return record

    def _following(self, offset: int) -> int | None:
        """Return the offset of a whole record behind the damaged one at `offset`; None: no whole record."""
        after = self._behind(offset)
        if after is not None:
            return after
        found = (self._chunk_behind(offset, sign) for sign in _COMPRESSION_SIGNS)
        return min((place for place in found if place is not None), default=None)

    def _chunk_behind(self, offset: int, sign: bytes) -> int | None:
        at = self._file.find(sign, offset + 1 + _SIGN_OFFSET)
        while at is not None:
            try:
                _content(*self._file.record(at - _SIGN_OFFSET, Opcode.CHUNK))
                return at - _SIGN_OFFSET
            except DAMAGE_ERRORS:
                at = self._file.find(sign, at + 1)
        return None

    def _behind(self, offset: int) -> int | None:
        """Return the offset behind the record when its length is right: a known and whole record follows
        there."""
        try:
            opcode, body = self._file.record(offset)
            after = offset + RECORD_HEAD.size + len(body)
            following, content = self._file.record(after)
        except DAMAGE_ERRORS:
            return None
        known = Opcode.HEADER <= opcode <= Opcode.DATA_END and Opcode.HEADER <= following <= Opcode.DATA_END
        return after if known and body and content else None

    def _lose(self, offset: int) -> list[McapRecord]:
        """Note the loss of the record at `offset`, and of everything behind it that is not read. Return a
        file that is damaged."""
        try:
            record = unchecked(*self._file.record(offset))
        except DAMAGE_ERRORS:
            record = None
        if isinstance(record, Attachment):
            self._losses.append(Loss(offset, f"file {record.name}"))
            self.lost_files.setdefault(record.name, offset)
            return [record]
        if isinstance(record, Metadata):
            self._losses.append(Loss(offset, f"metadata {record.name}"))
        elif isinstance(record, Chunk) and record.message_start_time <= record.message_end_time < _MAX_TIME:
            what = f"{record.message_start_time / 1e9:.2f} s to {record.message_end_time / 1e9:.2f} s"
            self._losses.append(Loss(offset, what, channels=self._indexed_behind(offset)))
        elif not isinstance(record, MessageIndex):  # an index only: the messages are all there
            self._losses.append(Loss(offset, f"messages after {self._latest / 1e9:.2f} s"))
        return []

    def _indexed_behind(self, offset: int) -> tuple[int, ...]:
        """Return the channels in the message indexes behind the chunk at `offset`."""
        found: list[int] = []
        try:
            while True:
                offset += RECORD_HEAD.size + len(self._file.record(offset)[1])
                index = parsed(*self._file.record(offset, Opcode.MESSAGE_INDEX))
                found += [index.channel_id] if isinstance(index, MessageIndex) and index.records else []
        except DAMAGE_ERRORS:
            return tuple(found)


def _content(opcode: int, body: bytes) -> list[McapRecord]:
    """Return the record with this content, or those in a chunk. Raises one of `DAMAGE_ERRORS` when one is
    not whole."""
    if opcode >= _PRIVATE_OPCODES:
        return []
    if not Opcode.HEADER <= opcode < Opcode.DATA_END:
        raise ValueError(f"a record of the unknown kind {opcode}")
    record = parsed(opcode, body)
    if not isinstance(record, Chunk):
        return [] if isinstance(record, MessageIndex) else [record]
    if record.uncompressed_size > _MAX_UNPACKED_SIZE:
        raise ValueError(f"a chunk of {record.uncompressed_size} bytes")
    return breakup_chunk(record, validate_crc=True) if record.uncompressed_size else []
