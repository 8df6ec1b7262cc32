"""Messages of a file in order of time, whatever their order in the file; copies count once."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .blocks import Contents, MessageAt, scan

_MAX_DELAY: Final = 200_000_000
"""Largest difference between a message's time and that of its place in its topic, ns.

A recorder that takes messages from a network stamps them so late.
"""
_LATEST: Final = (1 << 63) - 1
_MAX_BATCH_BYTES: Final = 16 << 20
"""Content of the messages that are read together, bytes."""

_KEPT: Final = -1
"""Block of the messages whose content is kept."""

Column: TypeAlias = NDArray[np.int64]
Unpack: TypeAlias = Callable[[int], bytes]


class RawMessage(NamedTuple):
    """Undecoded message of the file. `time` in ns."""

    topic: str
    time: int
    data: bytes


class MessageTable:
    """Index of all messages, 40 bytes for each, in order of time; some topics with their content.

    Messages of one time stay in the order of the file when the file is in order, else in the order of their
    numbers. A topic whose numbers show that its messages were stamped late is in the order of its numbers.
    """

    def __init__(self, contents: Contents, unpack: Unpack, keep: Collection[str], limit: int) -> None:
        """Index the messages of all blocks, and add the definitions in them to `contents`.

        `unpack` returns the records of the block of that number. The content of the topics `keep` stays in
        memory, up to `limit` bytes. Raises one of `DAMAGE_ERRORS`.
        """
        self._unpack = unpack
        self._kept: list[bytes] = []
        parts = [np.zeros((0, 7), np.int64)]
        topics: dict[str, int] = {}
        for number in range(len(contents.blocks)):
            data = unpack(number)
            messages, definitions = scan(data)
            for record in definitions:
                contents.define(record)
            ranks = {n: topics.setdefault(c.topic, len(topics)) for n, c in contents.channels.items()}
            rows = _rows(number, data, messages, ranks)
            kept = {topics[topic] for topic in keep if topic in topics}
            for row in rows if limit > 0 else ():
                if row[1] in kept:
                    content = data[row[4] : row[5]]
                    limit -= len(content)
                    row[3:5] = _KEPT, len(self._kept)
                    row[5] = row[4] + len(content)
                    self._kept.append(content)
            parts.append(np.array(rows, np.int64).reshape(len(rows), 7))
        columns = np.concatenate(parts)
        rows = columns[_order(columns)]
        rows = rows[_is_original(rows)]
        self.topics = tuple(topics)
        self.times, self._topics, _, self._blocks, self._starts, self._stops, _ = (
            np.ascontiguousarray(column) for column in rows.T
        )

    def __len__(self) -> int:
        return len(self.times)

    def shift(self, by: int) -> None:
        """Add `by` (ns) to all times. A time before 0 becomes 0."""
        self.times = np.maximum(self.times + by, 0)

    def set_times(self, times: Mapping[str, Column]) -> None:
        """Give the messages of topics other times (ns), in their order."""
        for topic, values in times.items():
            self.times[self._topics == self.topics.index(topic)] = values
        order = np.argsort(self.times, kind="stable")
        self.times, self._topics, self._blocks, self._starts, self._stops = (
            column[order] for column in (self.times, self._topics, self._blocks, self._starts, self._stops)
        )

    def counts(self) -> dict[str, int]:
        """Return the number of messages by topic."""
        counted = np.bincount(self._topics, minlength=len(self.topics))
        return dict(zip(self.topics, counted.tolist(), strict=True))

    def select(self, topics: Collection[str] | None, start: int | None, end: int | None) -> Column:
        """Return the rows of these topics with start ≤ time ≤ end (ns), in order of time."""
        first = 0 if start is None else int(np.searchsorted(self.times, start, "left"))
        stop = len(self) if end is None else int(np.searchsorted(self.times, end, "right"))
        if topics is None:
            return np.arange(first, stop)
        wanted = [n for n, topic in enumerate(self.topics) if topic in topics]
        return first + np.flatnonzero(np.isin(self._topics[first:stop], wanted))

    def read(self, rows: Column) -> Iterator[RawMessage]:
        """Yield the messages of these rows, in their order. Raises one of `DAMAGE_ERRORS`."""
        size = 1
        while len(rows):
            sizes = np.cumsum(self._stops[rows[:size]] - self._starts[rows[:size]])
            batch = rows[: max(int(np.searchsorted(sizes, _MAX_BATCH_BYTES, "right")), 1)]
            blocks = self._blocks[batch]
            contents = [b""] * len(batch)
            starts, stops = self._starts[batch].tolist(), self._stops[batch].tolist()
            for block in np.unique(blocks).tolist():
                places = np.flatnonzero(blocks == block).tolist()
                data = b"" if block == _KEPT else self._unpack(block)
                for place in places:
                    start = starts[place]
                    contents[place] = self._kept[start] if block == _KEPT else data[start : stops[place]]
            for time, topic, content in zip(
                self.times[batch].tolist(), self._topics[batch].tolist(), contents, strict=True
            ):
                yield RawMessage(self.topics[topic], time, content)
            rows = rows[len(batch) :]
            size = min(8 * size, 1 << 16)


def _rows(number: int, data: bytes, messages: list[MessageAt], ranks: Mapping[int, int]) -> list[list[int]]:
    """Return time, topic, number, block, start, stop and check sum of each message with a channel."""
    return [
        [min(time, _LATEST), ranks[channel], sequence, number, start, stop, zlib.crc32(data[start:stop])]
        for channel, time, sequence, start, stop in messages
        if channel in ranks
    ]


def _order(columns: Column) -> Column:
    """Return the rows in order of time."""
    times, topics, numbers = columns[:, 0], columns[:, 1], columns[:, 2]
    rows = np.arange(len(columns))
    if not (np.diff(times) >= 0).all():
        rows = np.lexsort((rows, numbers, topics, times))
    for topic in np.unique(topics).tolist():
        places = np.flatnonzero(topics[rows] == topic)
        mine = rows[places]
        told = mine[np.argsort(numbers[mine], kind="stable")]
        if (told != mine).any() and np.abs(times[told] - times[mine]).max() <= _MAX_DELAY:
            columns[told, 0] = times[mine]
            rows[places] = told
    return rows


def _is_original(rows: Column) -> NDArray[np.bool_]:
    """Return for each row whether it is no copy of one before.

    A copy has the topic, time and content of another message, and its number. When several different messages
    of one time are all there twice, a program has copied them and may have numbered the copies.
    """
    looks = _mixed(rows[:, 0], rows[:, 1], rows[:, 5] - rows[:, 4], rows[:, 6])
    first = _first_of_each(_mixed(looks, rows[:, 2]))
    left, times = looks[first], rows[first, 0]
    _, kind, counts = np.unique(left, return_inverse=True, return_counts=True)
    if len(left) and (counts > 1).any():
        begins = np.flatnonzero(np.r_[True, np.diff(times) != 0])
        lengths = np.diff(np.r_[begins, len(left)])
        least, most = (reduce.reduceat(counts[kind], begins) for reduce in (np.minimum, np.maximum))
        copied = np.repeat((least > 1) & (most < lengths), lengths)
        first[first] = ~copied | _first_of_each(left)
    return first


def _first_of_each(values: NDArray[np.uint64]) -> NDArray[np.bool_]:
    first = np.zeros(len(values), np.bool_)
    first[np.unique(values, return_index=True)[1]] = True
    return first


def _mixed(*columns: Column | NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return a hash of each row of these columns."""
    mixed = np.zeros(len(columns[0]), np.uint64)
    for column in columns:
        mixed = (mixed ^ column.astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    return mixed
