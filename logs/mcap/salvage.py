"""Files without a complete index, and damaged or unfinished ones: their content and their losses.

The records are read from the beginning, each by the `mcap` package. Behind a record that is not whole, the
search goes on to the next chunk.
"""

from __future__ import annotations

import io
from dataclasses import dataclass

from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    Schema,
)
from mcap.stream_reader import StreamReader

from .blocks import (
    DAMAGE_ERRORS,
    RECORD_HEAD,
    Block,
    Contents,
    NamedAt,
    RecordFile,
    attachment,
    chunk_data,
    scan,
)
from .writer import MAGIC

_PRIVATE_OPCODES = 0x80
"""First opcode that other programs may use for records of their own."""
_COMPRESSION_SIGNS = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4")
_MAX_TIME = 1 << 62
"""Times from here on are damaged, ns."""
_SIGN_OFFSET = RECORD_HEAD.size + 28
"""Offset of the compression's name in a chunk's record, bytes."""


@dataclass(frozen=True, slots=True)
class Loss:
    """Damage: its offset, and the content that it makes unreadable."""

    offset: int
    what: str
    lost: bool = True
    """Whether something is lost; else an index only, which was made again."""
    channels: tuple[int, ...] = ()
    """Channels of the lost messages, as far as an index states them."""

    def text(self, contents: Contents) -> str:
        channels = [contents.channels[number] for number in self.channels if number in contents.channels]
        of = f" of {channels[0].topic}" if len(channels) == 1 else ""
        lost = " lost" if self.lost else ""
        return f"byte {self.offset} ({self.what}{of}{lost})"


@dataclass(frozen=True, slots=True)
class Salvaged:
    contents: Contents
    losses: tuple[Loss, ...]
    stop: int
    """Offset up to which the file was read: the end of the data, or of the first record that is not whole."""
    problem: str
    """Problem at `stop`; empty at the end of the data."""
    has_ending: bool
    """Whether a whole summary follows the data, and nothing follows it."""
    whole: bool
    """Whether the file has its ending, and all that was written."""


def salvaged(file: RecordFile) -> Salvaged:
    """Return everything readable of a file; without blocks when nothing is readable."""
    return _Walk(file).result()


def _parsed(opcode: int, body: bytes) -> McapRecord:
    raw = io.BytesIO(RECORD_HEAD.pack(opcode, len(body)) + body)
    return next(StreamReader(raw, skip_magic=True, emit_chunks=True).records)


class _Walk:
    """Pass through the records from the beginning to the end."""

    def __init__(self, file: RecordFile) -> None:
        self._file = file
        self._contents = Contents()
        self._losses: list[Loss] = []
        self._latest = 0
        """Time of the last message so far, ns."""

    def result(self) -> Salvaged:
        file, offset = self._file, len(MAGIC)
        problem = "the file ends without its summary"
        ended = agrees = False
        while offset < file.size and not ended:
            try:
                opcode, body = file.record(offset)
                ended = opcode == Opcode.DATA_END
                if ended:
                    problem = ""
                    crc = int.from_bytes(body[:4], "little")
                    agrees = not crc or crc == file.crc(0, offset)
                self._take(offset, opcode, body)
                offset += RECORD_HEAD.size + len(body)
            except DAMAGE_ERRORS as error:
                after = self._next(offset)
                if after is None:
                    problem = str(error) or type(error).__name__
                    break
                self._lose(offset)
                offset = after
        has_ending = ended and self._finish(offset)
        whole = has_ending and agrees and not self._losses
        return Salvaged(self._contents, tuple(self._losses), offset, problem, has_ending, whole)

    def _take(self, offset: int, opcode: int, body: bytes) -> None:
        """Take the record at `offset`. Raises one of `DAMAGE_ERRORS` when it is not whole."""
        contents, stop = self._contents, offset + RECORD_HEAD.size + len(body)
        if opcode == Opcode.CHUNK:
            messages, definitions = scan(chunk_data(body))
            for record in definitions:
                contents.define(record)
            times = [message.time for message in messages] or [self._latest]
            contents.blocks.append(Block(offset, min(times), max(times)))
            self._latest = max(self._latest, *times)
        elif opcode == Opcode.ATTACHMENT:
            contents.attachments.append(NamedAt(offset, attachment(self._file, offset).name))
        elif opcode == Opcode.METADATA:
            record = _parsed(opcode, body)
            assert isinstance(record, Metadata)
            contents.metadata.append(NamedAt(offset, record.name))
        elif opcode == Opcode.HEADER:
            record = _parsed(opcode, body)
            assert isinstance(record, Header)
            contents.library, contents.profile = record.library, record.profile
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            messages, definitions = scan(self._file.read(offset, stop - offset))
            for record in definitions:
                contents.define(record)
            self._latest = max([self._latest, *(message.time for message in messages)])
            contents.extend(offset, stop)
        elif not (Opcode.HEADER <= opcode <= Opcode.DATA_END or opcode >= _PRIVATE_OPCODES):
            raise ValueError(f"a record of the unknown kind {opcode}")

    def _finish(self, offset: int) -> bool:
        """Read the summary. Return whether it is whole, and the last thing in the file.

        Its schemas and channels replace those of a lost first chunk.
        """
        start, record = offset, None
        try:
            while not isinstance(record, Footer):
                opcode, body = self._file.record(offset)
                record = _parsed(opcode, body)
                if isinstance(record, Schema | Channel):
                    self._contents.define(record)
                offset += RECORD_HEAD.size + len(body)
        except DAMAGE_ERRORS:
            return False
        is_right = record.summary_crc in (0, self._file.crc(start, offset - 4))
        return is_right and self._file.read(offset, len(MAGIC) + 1) == MAGIC

    def _next(self, offset: int) -> int | None:
        """Return the offset of a whole record behind the damaged one at `offset`; None when there is none."""
        after = self._behind(offset)
        if after is not None:
            return after
        found = (self._chunk_behind(offset, sign) for sign in _COMPRESSION_SIGNS)
        return min((place for place in found if place is not None), default=None)

    def _chunk_behind(self, offset: int, sign: bytes) -> int | None:
        for at in self._file.places(sign, offset + 1):
            place = at - _SIGN_OFFSET
            if place <= offset:
                continue
            try:
                scan(chunk_data(self._file.record(place, Opcode.CHUNK)[1]))
            except DAMAGE_ERRORS:
                continue
            return place
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

    def _lose(self, offset: int) -> None:
        """Note the loss of the record at `offset`, and of everything behind it that is not read."""
        try:
            record = _parsed(*self._file.record(offset))
        except DAMAGE_ERRORS:
            record = None
        if isinstance(record, Attachment):
            self._contents.attachments.append(NamedAt(offset, record.name))
            self._losses.append(Loss(offset, f"file {record.name}"))
        elif isinstance(record, Metadata):
            self._losses.append(Loss(offset, f"metadata {record.name}"))
        elif isinstance(record, Chunk) and record.message_start_time <= record.message_end_time < _MAX_TIME:
            what = f"{record.message_start_time / 1e9:.2f} s to {record.message_end_time / 1e9:.2f} s"
            self._losses.append(Loss(offset, what, channels=self._indexed_behind(offset)))
        elif not isinstance(record, MessageIndex):  # an index only: the messages are all there
            what = f"messages after {self._latest / 1e9:.2f} s"
            self._losses.append(Loss(offset, what))

    def _indexed_behind(self, offset: int) -> tuple[int, ...]:
        """Return the channels in the message indexes behind the chunk at `offset`."""
        found: list[int] = []
        try:
            while True:
                offset += RECORD_HEAD.size + len(self._file.record(offset)[1])
                index = _parsed(*self._file.record(offset, Opcode.MESSAGE_INDEX))
                found += [index.channel_id] if isinstance(index, MessageIndex) and index.records else []
        except DAMAGE_ERRORS:
            return tuple(found)
