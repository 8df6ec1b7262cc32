"""Salvage of damaged and unfinished files: their readable records, and their losses.

The records are read from the beginning, each by the `mcap` package. Behind a record that is not whole, the
search goes on to the next chunk.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, MessageIndex, Metadata
from mcap.stream_reader import breakup_chunk
from mcap.summary import Summary

from .record_file import DAMAGE_ERRORS, RECORD_HEAD, RecordFile, parsed, unchecked
from .writer import MAGIC

_PRIVATE_OPCODES = 0x80
"""First opcode that other programs may use for records of their own."""
_COMPRESSION_SIGNS = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4")
_SIGN_OFFSET = RECORD_HEAD.size + 28
"""Offset of the compression's name in a chunk's record, bytes."""
_MAX_TIME = 1 << 62
"""Times from here on are damaged, ns."""
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
    """Whether something is lost; else an index only, which was made again."""
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
        """Yield everything readable, without chunks and indexes. A lost file is yielded as it is."""
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
        """Return the offset of a whole record behind the damaged one at `offset`; None when there is none."""
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
