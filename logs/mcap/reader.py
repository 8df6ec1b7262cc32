"""MCAP reader for whole and damaged files. A file that is neither gives one error.

The `mcap` package reads messages, files and metadata: directly from a file as picktree wrote it, and from a
sorted copy of any other file. A query costs 2 to 3 times the CPU time of slicing the unpacked chunks without
a record for each message.
"""

from __future__ import annotations

import zlib
from collections.abc import Collection, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from heapq import heappop, heappush
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Final, NamedTuple, TypeAlias

import numpy as np
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from picktree.files import PicktreeError

from .salvage import DAMAGE_ERRORS, RecordFile, Salvage, parsed
from .writer import LIBRARY, MAGIC

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
        by_number = mine[np.argsort(numbers[mine], kind="stable")]
        if (by_number != mine).any() and np.abs(times[by_number] - times[mine]).max() <= _MAX_DELAY:
            times[by_number] = times[mine]
            order[places] = by_number
    return order


def _is_original(rows: Column) -> NDArray[np.bool_]:
    """Return for each row whether it is an original, not a copy of an earlier row.

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


class RawMessage(NamedTuple):
    """Undecoded message of the file. `time` in ns."""

    topic: str
    time: int
    data: bytes


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

    def __init__(self, path: Path) -> None:
        self.path = path
        self.recovered = ""
        self._header = Header("", "")
        self._lost_files: dict[str, int] = {}
        """Offsets of the damaged attachments by name."""
        self._file = RecordFile(path)
        self._copy: IO[bytes] | None = None
        try:
            self._reader, self._summary = self._open()
        except PicktreeError:
            self.close()
            raise
        except OSError as error:
            self.close()
            raise PicktreeError(f"{path}: the log cannot be read: {error.strerror}") from None

    def close(self) -> None:
        self._file.close()
        if self._copy is not None:
            self._copy.close()

    @property
    def writer(self) -> str:
        """Program that wrote the file, in its own words, with the profile of its messages."""
        return " ".join(filter(None, (self._header.library, self._header.profile)))

    @property
    def is_rewritten(self) -> bool:
        """Whether another program has written the file, or it is damaged."""
        return self._copy is not None

    @property
    def start(self) -> int:
        """Time of the first message, ns; 0 without messages."""
        return self._summary.statistics.message_start_time if self._summary.statistics else 0

    @property
    def end(self) -> int:
        """Time of the last message, ns; 0 without messages."""
        return self._summary.statistics.message_end_time if self._summary.statistics else 0

    @property
    def channels(self) -> tuple[ChannelInfo, ...]:
        """Topics with their numbers of messages."""
        summary = self._summary
        counts = summary.statistics.channel_message_counts if summary.statistics else {}
        found: list[ChannelInfo] = []
        for number, channel in summary.channels.items():
            schema = summary.schemas.get(channel.schema_id)
            name = schema.name if schema else ""
            found.append(ChannelInfo(channel.topic, name, channel.message_encoding, counts.get(number, 0)))
        return tuple(found)

    @property
    def attachments(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(index.name for index in self._summary.attachment_indexes))

    def set_times(self, times: NDArray[np.int64]) -> None:
        """Give the messages, in their order, other times (n,), ns. A time before 0 becomes 0."""

        if self._copy is None:
            self._copy = sorted_copy(_records(self._file))
        with self._copy as before:
            times = np.maximum(times, 0)
            self._copy = _written(_rearranged(before, times, np.argsort(times, kind="stable")))[0]
        self._reader, self._summary = _indexed(self._copy)

    def places(self) -> NDArray[np.int64]:
        """Return numbers (n,) of all messages that grow with their places in the file."""
        return np.array([message.publish_time for _, _, message in self._reader.iter_messages()], np.int64)

    def messages(
        self,
        topics: Collection[str] | None = None,
        start: int | None = None,
        end: int | None = None,
        *,
        newest_first: bool = False,
    ) -> Iterator[RawMessage]:
        """Yield messages of these topics with start ≤ time ≤ end (ns), in order of time."""
        start, end = max(start or 0, self.start), self.end if end is None else min(end, self.end)
        if start > end:
            return
        with self._damage_at(0):
            for _, channel, message in self._reader.iter_messages(
                topics, starting_at=start, ending_at=end, reverse=newest_first
            ):
                yield RawMessage(channel.topic, message.log_time, message.data)

    def times(self, topic: str, start: int | None = None) -> list[int]:
        """Return the times (ns) of a topic's messages from `start` on."""
        return [message.time for message in self.messages((topic,), start)]

    def attachment(self, name: str) -> Attachment | None:
        """Return the attachment; None without one of that name."""
        if name in self._lost_files:
            raise self._damaged(self._lost_files[name], "wrong check sum of a file")
        for index in self._summary.attachment_indexes:
            if index.name == name:
                stream = self._copy or self._file
                stream.seek(index.offset)
                with self._damage_at(index.offset):
                    found = next(StreamReader(stream, skip_magic=True).records)
                    assert isinstance(found, Attachment)
                    return found
        return None

    def metadata(self) -> dict[str, dict[str, str]]:
        """Return all metadata by the records' names; of two records of one name the later one counts.

        Raises PicktreeError when two records of picktree contradict each other: the file holds two runs.
        """
        found: dict[str, dict[str, str]] = {}
        with self._damage_at(0):
            records = list(self._reader.iter_metadata())
        for record in records:
            words = found.setdefault(record.name, {})
            for name, value in record.metadata.items():
                if words.setdefault(name, value) != value and record.name.startswith(LIBRARY):
                    raise PicktreeError(
                        f"{self.path}: a file of more than one run: its metadata {record.name} state for "
                        f"{name} both {words[name]!r} and {value!r}; give the log of one run"
                    )
                words[name] = value
        return found

    def _open(self) -> tuple[SeekingReader, Summary]:
        """Check the file, and copy it unless it is as picktree writes it. Return the package's reader of the
        file or its copy, and the summary."""

        file, summary = self._file, None
        if file.at(0, len(MAGIC)) != MAGIC:
            raise PicktreeError(f"{self.path}: not a log: {_description(file.at(0, 4096))}")
        data_end = 0
        try:
            header = parsed(*file.record(len(MAGIC), Opcode.HEADER))
            assert isinstance(header, Header)
            self._header = header
            reader, summary, data_end = file.indexed()
            if header.library == LIBRARY and _is_as_written(file, summary, data_end):
                return reader, summary
            for index in summary.attachment_indexes:
                parsed(*file.record(index.offset, Opcode.ATTACHMENT))
            self._copy = sorted_copy(_records(file))
            return _indexed(self._copy)
        except DAMAGE_ERRORS:
            pass
        salvage = Salvage(file, summary, data_end)
        self._copy = sorted_copy(salvage.records())
        self._lost_files = salvage.lost_files
        reader, copied = _indexed(self._copy)
        assert copied.statistics is not None
        text = salvage.text(copied.statistics.message_end_time)
        if text and not copied.statistics.message_count:
            raise self._damaged(salvage.stop, f"{salvage.problem or 'nothing is left'}; it holds no messages")
        self.recovered = text and f"{self.path}: {text}"
        return reader, copied

    @contextmanager
    def _damage_at(self, offset: int) -> Generator[None]:
        try:
            yield
        except DAMAGE_ERRORS as error:
            raise self._damaged(offset, str(error) or type(error).__name__) from None

    def _damaged(self, offset: int, why: str) -> PicktreeError:
        return PicktreeError(f"{self.path}: damaged at byte {offset}: {why}")


def _indexed(copy: IO[bytes]) -> tuple[SeekingReader, Summary]:
    copy.seek(0)
    reader = SeekingReader(copy)
    return reader, reader.get_summary() or Summary()


def _records(file: RecordFile) -> Iterable[McapRecord]:
    """Return all records, those in chunks, too. Its iterator raises one of `DAMAGE_ERRORS`."""
    file.seek(0)
    return StreamReader(file, validate_crcs=True, record_size_limit=file.size).records


def _is_as_written(file: RecordFile, summary: Summary, data_end: int) -> bool:
    """Whether the data are as picktree writes them: all of them indexed, and numbered in order of time.

    Raises one of `DAMAGE_ERRORS` when their check sum is wrong.
    """
    crc = int.from_bytes(file.record(data_end, Opcode.DATA_END)[1][:4], "little")
    statistics, chunks = summary.statistics, summary.chunk_indexes
    if not crc or statistics is None:
        return False
    if crc != file.crc(0, data_end):
        raise ValueError("wrong check sum of the data")
    listed = (summary.schemas, summary.channels, chunks, summary.attachment_indexes, summary.metadata_indexes)
    counts = (
        statistics.schema_count,
        statistics.channel_count,
        statistics.chunk_count,
        statistics.attachment_count,
    )
    if tuple(map(len, listed)) != (*counts, statistics.metadata_count):
        return False
    if any(b.message_start_time < a.message_end_time for a, b in pairwise(chunks)):
        return False
    last = parsed(*file.record(chunks[-1].chunk_start_offset, Opcode.CHUNK)) if chunks else None
    messages = breakup_chunk(last) if isinstance(last, Chunk) else []
    numbers = {each.channel_id: each.sequence for each in messages if isinstance(each, Message)}
    totals = statistics.channel_message_counts
    return all(number == totals[channel] & 0xFFFFFFFF for channel, number in numbers.items())


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
    """Return a description of a file with these first bytes, and of the expected beginning."""
    known = next((name for sign, name in _OTHER_FILES if head.startswith(sign)), "")
    if not head:
        known = "an empty file"
    elif not known and b"\0" not in head and not head.startswith(MAGIC[:4]):
        known = "a text file"
    return "; ".join(filter(None, (known, _EXPECTED)))
