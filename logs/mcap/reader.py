"""MCAP reader for whole and damaged files. A file that is neither gives one error.

The `mcap` package reads the summary of a whole file. Files without a complete one, and damaged ones, are read
record by record.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from mcap.records import Attachment
from numpy.typing import NDArray

from ...errors import PicktreeError
from .blocks import DAMAGE_ERRORS, Contents, RecordFile, attachment, indexed_contents, metadata, unpacked
from .message_table import MessageTable, RawMessage
from .salvage import Loss, salvaged
from .writer import LIBRARY, MAGIC

_MAX_UNPACKED_BLOCKS = 4
"""Number of blocks that are kept unpacked for random access; of a deep mission one has 2 MB."""
_MAX_NAMED_LOSSES = 4
"""Maximum number of losses that the message names."""


@dataclass(frozen=True, slots=True)
class ChannelInfo:
    topic: str
    schema: str
    encoding: str
    messages: int


class McapReader:
    """MCAP file that is open for reading. Methods raise PicktreeError.

    `recovered` is a sentence about the losses when the file has no valid ending or is damaged somewhere; else
    empty.
    """

    def __init__(self, path: Path, keep: Collection[str] = (), limit: int = 0) -> None:
        """Open the file. The messages of the topics `keep` stay in memory once the file has been indexed, up
        to `limit` bytes."""
        self.path = path
        self.recovered = ""
        self._keep, self._limit = keep, limit
        self._indexed: MessageTable | None = None
        self._file = RecordFile(path)
        self._unpack = lru_cache(_MAX_UNPACKED_BLOCKS)(self._unpacked)
        try:
            self._contents = Contents()
            self._open()
        except PicktreeError:
            self._file.close()
            raise
        except OSError as error:
            self._file.close()
            raise PicktreeError(f"{path}: the log cannot be read: {error.strerror}") from None

    def close(self) -> None:
        self._unpack.cache_clear()
        self._file.close()

    @property
    def writer(self) -> str:
        """Program that wrote the file, in its own words, with the profile of its messages."""
        return " ".join(filter(None, (self._contents.library, self._contents.profile)))

    @property
    def is_rewritten(self) -> bool:
        """Whether another program has written the file, or it is damaged."""
        return bool(self.recovered) or self._contents.library != LIBRARY or self._indexed is not None

    @property
    def start(self) -> int:
        """Time of the first message, ns; 0 when there is none."""
        if self._indexed is not None:
            return int(self._indexed.times[0]) if len(self._indexed) else 0
        return min((block.start for block in self._contents.blocks), default=0)

    @property
    def end(self) -> int:
        """Time of the last message, ns; 0 when there is none."""
        if self._indexed is not None:
            return int(self._indexed.times[-1]) if len(self._indexed) else 0
        return max((block.end for block in self._contents.blocks), default=0)

    @property
    def channels(self) -> tuple[ChannelInfo, ...]:
        """Topics with their numbers of messages; several channels of one topic count together."""
        contents, counts = self._contents, Counter[str]()
        found: dict[str, ChannelInfo] = {}
        for number, channel in contents.channels.items():
            schema = contents.schemas.get(channel.schema_id)
            info = ChannelInfo(channel.topic, schema.name if schema else "", channel.message_encoding, 0)
            found.setdefault(channel.topic, info)
            counts[channel.topic] += contents.counts.get(number, 0)
        if self._indexed is not None:
            counts = Counter(self._indexed.counts())
        return tuple(ChannelInfo(c.topic, c.schema, c.encoding, counts[c.topic]) for c in found.values())

    @property
    def attachments(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(entry.name for entry in self._contents.attachments))

    def shift(self, by: int) -> None:
        """Add `by` (ns) to the time of each message."""
        if by:
            self._table.shift(by)

    def set_times(self, times: Mapping[str, NDArray[np.int64]]) -> None:
        """Give the messages of topics other times (ns), in their order."""
        self._table.set_times(times)

    def messages(
        self,
        topics: Collection[str] | None = None,
        start: int | None = None,
        end: int | None = None,
        *,
        newest_first: bool = False,
    ) -> Iterator[RawMessage]:
        """Yield messages of these topics with start ≤ time ≤ end (ns), in order of time."""
        if start is not None and start > self.end:
            return
        rows = self._table.select(topics, start, end)
        with self._damage_at(0):
            yield from self._table.read(rows[::-1] if newest_first else rows)

    def times(self, topic: str, start: int | None = None) -> list[int]:
        """Return the times (ns) of a topic's messages from `start` on."""
        return self._table.times[self._table.select((topic,), start, None)].tolist()

    def attachment(self, name: str) -> Attachment | None:
        """Return the attachment; None when there is none of that name."""
        for entry in self._contents.attachments:
            if entry.name == name:
                with self._damage_at(entry.offset):
                    return attachment(self._file, entry.offset)
        return None

    def metadata(self) -> dict[str, dict[str, str]]:
        """Return all metadata by the records' names; of two records of one name the later one counts.

        Raises PicktreeError when two records of picktree contradict each other: the file holds two runs.
        """
        found: dict[str, dict[str, str]] = {}
        for entry in self._contents.metadata:
            with self._damage_at(entry.offset):
                record = metadata(self._file, entry.offset)
            words = found.setdefault(record.name, {})
            for name, value in record.metadata.items():
                if words.setdefault(name, value) != value and record.name.startswith(LIBRARY):
                    raise PicktreeError(
                        f"{self.path}: a file of more than one run: its metadata {record.name} state for "
                        f"{name} both {words[name]!r} and {value!r}; give the log of one run"
                    )
                words[name] = value
        return found

    @property
    def _table(self) -> MessageTable:
        if self._indexed is None:
            with self._damage_at(0):
                self._indexed = MessageTable(self._contents, self._unpack, self._keep, self._limit)
        return self._indexed

    def _unpacked(self, block: int) -> bytes:
        return unpacked(self._file, self._contents.blocks[block])

    def _open(self) -> None:
        if self._file.read(0, len(MAGIC)) != MAGIC:
            raise PicktreeError(f"{self.path}: not a log: {_description(self._file.read(0, 4096))}")
        try:
            indexed = indexed_contents(self._file)
            if indexed is not None and indexed[1] is not False:
                self._contents, is_checked = indexed
                if not is_checked:
                    self._check()
                return
        except DAMAGE_ERRORS:
            pass
        found = salvaged(self._file)
        self._contents, self._indexed = found.contents, None
        if not len(self._table) and not found.whole:
            raise self._damaged(found.stop, f"{found.problem or 'nothing is left'}; it holds no messages")
        if found.problem:
            where = f"recovered up to byte {found.stop}, {self.end / 1e9:.2f} s"
            self._tell(found.losses, f"the file was not finished; {where}")
        elif not found.whole:
            index = Loss(found.stop, "or later: its index", lost=False)
            outside = Loss(0, "or later, outside of messages and files", lost=False)
            losses = found.losses if found.has_ending else (*found.losses, index)
            self._tell(losses or (outside,), "the rest is whole")

    def _check(self) -> None:
        """Look at every record of a file without a check sum. Raises one of `DAMAGE_ERRORS`."""
        self._indexed = MessageTable(self._contents, self._unpack, self._keep, self._limit)
        for entry in self._contents.attachments:
            attachment(self._file, entry.offset)
        for entry in self._contents.metadata:
            metadata(self._file, entry.offset)

    def _tell(self, losses: Collection[Loss], rest: str) -> None:
        more = (
            f" and {len(losses) - _MAX_NAMED_LOSSES} more places" if len(losses) > _MAX_NAMED_LOSSES else ""
        )
        places = ", ".join(loss.text(self._contents) for loss in list(losses)[:_MAX_NAMED_LOSSES])
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


_EXPECTED = "it does not begin as an MCAP file does; give a run's folder, or its log.mcap"
_OTHER_FILES = (
    (b"#ROSBAG", "a bag of ROS 1"),
    (b"SQLite format 3", "an SQLite database, such as a bag of ROS 2"),
    (b"\x89PNG", "a picture"),
    (b"%PDF", "a PDF document"),
    (b"PK\x03\x04", "a ZIP archive"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"\x28\xb5\x2f\xfd", "a zstd archive"),
    (b"\x04\x22\x4d\x18", "an lz4 archive"),
)


def _description(head: bytes) -> str:
    """Return what a file with these first bytes is, and that it should begin otherwise."""
    known = next((name for sign, name in _OTHER_FILES if head.startswith(sign)), "")
    if not head:
        known = "an empty file"
    elif not known and b"\0" not in head and not head.startswith(MAGIC[:4]):
        known = "a text file"
    return "; ".join(filter(None, (known, _EXPECTED)))
