"""MCAP reader for whole and damaged files. A file that is neither gives one error."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Attachment, Metadata

from ...errors import PicktreeError
from .chunks import DAMAGE_ERRORS, ChunkContent, Contents, RecordFile, chunk_content, contents_of, stream
from .salvage import Loss, attachment, losses_of, salvaged
from .writer import MAGIC

_MAX_UNPACKED_CHUNKS = 128
"""Number of chunks that are kept unpacked for random access."""
_MAX_NAMED_LOSSES = 4
"""Maximum number of losses that the message names."""


@dataclass(frozen=True, slots=True)
class RawMessage:
    """Undecoded message of the file. `time` in ns."""

    topic: str
    time: int
    data: bytes


class McapReader:
    """MCAP file that is open for reading. Methods raise PicktreeError.

    `recovered` is a sentence about the losses when the file has no valid ending or is damaged somewhere; else
    empty.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.recovered = ""
        self._file = RecordFile(path)
        self._unpacked = lru_cache(_MAX_UNPACKED_CHUNKS)(self._unpack)
        try:
            self.contents = self._open()
        except PicktreeError:
            self._file.close()
            raise

    def close(self) -> None:
        self._unpacked.cache_clear()
        self._file.close()

    @property
    def size(self) -> int:
        """Size of the file, bytes."""
        return self._file.size

    def messages(
        self,
        topics: Collection[str] | None = None,
        start: int | None = None,
        end: int | None = None,
        *,
        newest_first: bool = False,
    ) -> Iterator[RawMessage]:
        """Yield messages of these topics with start ≤ time ≤ end (ns), in order of time."""
        names = {n: c.topic for n, c in self.contents.channels.items() if topics is None or c.topic in topics}
        chunks = sorted(self.contents.chunks, key=lambda chunk: chunk.start)
        for chunk in reversed(chunks) if newest_first else chunks:
            if (start is not None and chunk.end < start) or (end is not None and chunk.start > end):
                continue
            if chunk.channels and chunk.channels.isdisjoint(names):
                continue
            content = self._unpacked(chunk.offset)
            found = [
                message
                for message in content.messages
                if message.channel in names
                and (start is None or message.time >= start)
                and (end is None or message.time <= end)
            ]
            data = content.data
            for m in reversed(found) if newest_first else found:
                yield RawMessage(names[m.channel], m.time, data[m.start : m.stop])

    def attachment(self, name: str) -> Attachment | None:
        """Return the attachment; None when there is none of that name."""
        for entry in self.contents.attachments:
            if entry.name == name:
                with self._damage_at(entry.offset):
                    return attachment(self._file, entry.offset)
        return None

    def metadata(self) -> dict[str, dict[str, str]]:
        """Return all metadata by the records' names."""
        found: dict[str, dict[str, str]] = {}
        for entry in self.contents.metadata:
            with self._damage_at(entry.offset):
                opcode, body = self._file.record(entry.offset)
                if opcode != Opcode.METADATA:
                    raise ValueError(f"a record of the kind {opcode} instead of {Opcode.METADATA.value}")
                record = Metadata.read(stream(body))
                found[record.name] = dict(record.metadata)
        return found

    def _unpack(self, offset: int) -> ChunkContent:
        with self._damage_at(offset):
            _, body = self._file.record(offset)
            return chunk_content(body)

    def _open(self) -> Contents:
        contents = contents_of(self._file)
        if contents is not None:
            losses = losses_of(self._file, contents)
            if contents.chunks or not losses:
                if losses:
                    self._tell(losses, "the rest is whole")
                return contents
            raise self._damaged(losses[0].offset, losses[0].what)
        if self._file.read(0, len(MAGIC)) != MAGIC:
            raise PicktreeError(f"{self.path}: not a log: it does not begin as an MCAP file does")
        found = salvaged(self._file)
        if not found.contents.chunks:
            raise self._damaged(found.stop, found.problem or "it holds no messages")
        if found.problem:
            last = max(chunk.end for chunk in found.contents.chunks) / 1e9
            self._tell(
                found.losses,
                f"the file was not finished; recovered up to byte {found.stop}, {last:.2f} s",
            )
        else:
            losses = (*found.losses, Loss(found.stop, "or later: its index"))
            self._tell(losses, "the rest is whole")
        return found.contents

    def _tell(self, losses: Collection[Loss], rest: str) -> None:
        more = (
            f" and {len(losses) - _MAX_NAMED_LOSSES} more places" if len(losses) > _MAX_NAMED_LOSSES else ""
        )
        places = ", ".join(loss.text() for loss in list(losses)[:_MAX_NAMED_LOSSES])
        damage = f"damaged at {places}{more}; " if losses else ""
        self.recovered = f"{self.path}: {damage}{rest}"

    @contextmanager
    def _damage_at(self, offset: int) -> Generator[None]:
        try:
            yield
        except DAMAGE_ERRORS as error:
            raise self._damaged(offset, str(error) or type(error).__name__) from None

    def _damaged(self, offset: int, why: str) -> PicktreeError:
        return PicktreeError(f"{self.path}: damaged at byte {offset}: {why}")
