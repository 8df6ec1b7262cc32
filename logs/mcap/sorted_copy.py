"""Temporary copy of a log in order of time, with an index and without copies of messages."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from dataclasses import replace
from heapq import heappop, heappush
from tempfile import TemporaryFile
from typing import IO, Final, TypeAlias

import numpy as np
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

_MAX_DELAY: Final = 200_000_000
"""Largest difference between a message's time and that of its place in its topic, ns.

A recorder that takes messages from a network stamps them so late.
"""
_LATEST: Final = (1 << 63) - 1

Column: TypeAlias = NDArray[np.int64]


def sorted_copy(records: Iterable[McapRecord]) -> IO[bytes]:
    """Return a copy of these records, which the `mcap` package reads by topic and time.

    Messages of one time stay in their order when all are in order, else in the order of their numbers.
    A topic whose numbers show that its messages were stamped late is in the order of its numbers. The publish
    time of a message is its place in the file. Raises the exceptions of `records`, and OSError when the disk
    is full.
    """
    copy, rows = _written(_placed(records))
    by_time = np.argsort(rows[:, 0], kind="stable")  # the order in which the package reads the copy
    times = rows[by_time, 0]
    order = _order(rows, by_time)
    order = order[_is_original(rows[order])]
    if np.array_equal(order, by_time) and np.array_equal(times, rows[by_time, 0]):
        return copy
    with copy:
        return _written(_rearranged(copy, rows[by_time, 0], np.argsort(by_time)[order]))[0]


def retimed_copy(copy: IO[bytes], times: Column) -> IO[bytes]:
    """Return a copy of a copy whose messages, in their order, have these times (n,), ns."""
    return _written(_rearranged(copy, times, np.argsort(times, kind="stable")))[0]


def _placed(records: Iterable[McapRecord]) -> Iterator[McapRecord]:
    for place, record in enumerate(records):
        if isinstance(record, Message):
            record.publish_time = place
        yield record


def _written(records: Iterable[McapRecord]) -> tuple[IO[bytes], Column]:
    """Write the records. Return the file, and time, topic, number, size and check sum of its messages."""
    copy = TemporaryFile()  # noqa: SIM115 - open for as long as the log
    writer = Writer(copy, compression=CompressionType.LZ4)
    writer.start()
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    topics: dict[str, int] = {}
    rows: list[tuple[int, int, int, int, int]] = []
    for record in records:
        if isinstance(record, Message):
            channel = channels.get(record.channel_id)
            if channel is not None:
                time, data = min(record.log_time, _LATEST), record.data
                writer.add_message(channel, time, data, record.publish_time, record.sequence)
                rows.append((time, channel, record.sequence, len(data), zlib.crc32(data)))
        elif isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in channels:
            if record.topic not in topics:
                topics[record.topic] = writer.register_channel(
                    record.topic, record.message_encoding, schemas.get(record.schema_id, 0), record.metadata
                )
            channels[record.id] = topics[record.topic]
        elif isinstance(record, Attachment):
            writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
    writer.finish()
    return copy, np.array(rows, np.int64).reshape(len(rows), 5)


def _rearranged(copy: IO[bytes], times: Column, order: Column) -> Iterator[McapRecord]:
    """Yield the records of a copy with other times of its messages, and only the messages of `order`."""
    copy.seek(0)
    reader = SeekingReader(copy)
    summary = reader.get_summary()
    assert summary is not None
    yield from (*summary.schemas.values(), *summary.channels.values())
    yield from (*reader.iter_attachments(), *reader.iter_metadata())
    places = np.full(len(times), -1)
    places[order] = np.arange(len(order))
    waiting: list[tuple[int, Message]] = []
    due = 0
    for (_, _, message), time, place in zip(
        reader.iter_messages(), times.tolist(), places.tolist(), strict=True
    ):
        if place >= 0:
            heappush(waiting, (place, replace(message, log_time=time)))
        while waiting and waiting[0][0] == due:
            yield heappop(waiting)[1]
            due += 1


def _order(rows: Column, by_time: Column) -> Column:
    """Return the order of the messages. The times of late ones are changed."""
    times, topics, numbers = rows[:, 0], rows[:, 1], rows[:, 2]
    in_file = np.arange(len(rows))
    order = in_file.copy() if np.array_equal(by_time, in_file) else np.lexsort((numbers, topics, times))
    for topic in np.unique(topics).tolist():
        places = np.flatnonzero(topics[order] == topic)
        mine = order[places]
        told = mine[np.argsort(numbers[mine], kind="stable")]
        if (told != mine).any() and np.abs(times[told] - times[mine]).max() <= _MAX_DELAY:
            times[told] = times[mine]
            order[places] = told
    return order


def _is_original(rows: Column) -> NDArray[np.bool_]:
    """Return for each row whether it is no copy of one before.

    A copy has the topic, time and content of another message, and its number. When several different messages
    of one time are all there twice, a program has copied them and may have numbered the copies.
    """
    _, looks = np.unique(rows[:, [0, 1, 3, 4]], axis=0, return_inverse=True)
    first = _first_of_each(np.column_stack((looks, rows[:, 2])))
    left, times = looks[first], rows[first, 0]
    _, kind, counts = np.unique(left, return_inverse=True, return_counts=True)
    if len(left) and (counts > 1).any():
        begins = np.flatnonzero(np.r_[True, np.diff(times) != 0])
        lengths = np.diff(np.r_[begins, len(left)])
        least, most = (reduce.reduceat(counts[kind], begins) for reduce in (np.minimum, np.maximum))
        copied = np.repeat((least > 1) & (most < lengths), lengths)
        first[first] = ~copied | _first_of_each(left)
    return first


def _first_of_each(values: Column) -> NDArray[np.bool_]:
    first = np.zeros(len(values), np.bool_)
    first[np.unique(values, axis=0, return_index=True)[1]] = True
    return first
