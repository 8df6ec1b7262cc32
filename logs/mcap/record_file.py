"""Records of an MCAP file by their offsets, each read by the `mcap` package."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path
from typing import Final

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Footer, McapRecord
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

from ...files.errors import PicktreeError
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
