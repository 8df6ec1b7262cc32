"""A file of records with a head of opcode and length, read at any offset."""

from __future__ import annotations

import io
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from ...errors import PicktreeError
from .chunks import HEAD

_BLOCK = 1 << 20


class RecordFile:
    """Raises PicktreeError when the file cannot be read."""

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
        """Fewer bytes where the file ends."""
        self._stream.seek(offset)
        return self._stream.read(length)

    def record(self, offset: int) -> tuple[int, bytes]:
        """Opcode and content of the record at `offset`. Raises EOFError when the file ends before the record
        does."""
        head = self.read(offset, HEAD.size)
        opcode, length = HEAD.unpack(head) if len(head) == HEAD.size else (0, self.size)
        if length > self.size - offset - HEAD.size:
            raise EOFError("the file ends inside a record")
        return opcode, self._stream.read(length)

    def crc(self, start: int, stop: int) -> int:
        """Check sum of the bytes from `start` to before `stop`."""
        crc = 0
        self._stream.seek(start)
        while start < stop:
            block = self._stream.read(min(_BLOCK, stop - start))
            if not block:
                break
            crc = zlib.crc32(block, crc)
            start += len(block)
        return crc

    def places(self, pattern: bytes, start: int) -> Iterator[int]:
        """Where `pattern` stands from `start` on."""
        overlap = len(pattern) - 1
        while start < self.size:
            block = self.read(start, _BLOCK)
            at = block.find(pattern)
            while at >= 0:
                yield start + at
                at = block.find(pattern, at + 1)
            if len(block) <= overlap:
                return
            start += len(block) - overlap
