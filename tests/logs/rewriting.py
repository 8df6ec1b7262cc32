"""Logs rewritten as other MCAP tools do it: each mode writes the same messages in another form."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, Metadata, Schema
from mcap.writer import CompressionType, IndexType, Writer

SECOND = 1_000_000_000
EPOCH = 1_700_000_000 * SECOND


@dataclass(frozen=True)
class Sent:
    """A message with the topic and the schema that it is written with."""

    topic: str
    encoding: str
    schema: Schema | None
    time: int
    data: bytes
    sequence: int
    publish_time: int
    channel: str = ""
    """Tells channels of the same topic apart."""


@dataclass
class Content:
    messages: list[Sent]
    attachments: list[Attachment]
    metadata: list[Metadata]
    library: str = "other tool"
    profile: str = ""
    options: dict[str, Any] = field(default_factory=dict[str, Any])
    """Options of the stock writer."""

    @classmethod
    def of(cls, path: Path) -> Content:
        with path.open("rb") as stream:
            reader = make_reader(stream)
            messages = [
                Sent(
                    channel.topic, channel.message_encoding, schema, message.log_time, message.data,
                    message.sequence, message.publish_time,
                )
                for schema, channel, message in reader.iter_messages()
            ]  # fmt: skip
            return cls(messages, list(reader.iter_attachments()), list(reader.iter_metadata()))

    def write(self, path: Path) -> Path:
        options: dict[str, Any] = {"compression": CompressionType.ZSTD, **self.options}
        with path.open("wb") as stream:
            writer = Writer(stream, **options)
            writer.start(self.profile, self.library)
            for a in self.attachments:
                writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
            for m in self.metadata:
                writer.add_metadata(m.name, m.metadata)
            schemas: dict[tuple[str, bytes], int] = {}
            channels: dict[tuple[str, str], int] = {}
            for sent in self.messages:
                schema = 0
                if sent.schema is not None:
                    key = (sent.schema.name, sent.schema.data)
                    if key not in schemas:
                        schemas[key] = writer.register_schema(
                            sent.schema.name, sent.schema.encoding, sent.schema.data
                        )
                    schema = schemas[key]
                name = (sent.topic, sent.channel)
                if name not in channels:
                    channels[name] = writer.register_channel(
                        sent.topic, sent.encoding, schema, {"of": sent.channel}
                    )
                writer.add_message(channels[name], sent.time, sent.data, sent.publish_time, sent.sequence)
            writer.finish()
        return path

    def each(self, change: Callable[[Sent], Sent]) -> Content:
        return replace(self, messages=[change(sent) for sent in self.messages])

    def ordered(self, messages: Iterable[Sent]) -> Content:
        return replace(self, messages=list(messages))

    def with_options(self, **options: object) -> Content:
        return replace(self, options={**self.options, **options})


def _shuffled(content: Content) -> Content:
    messages = list(content.messages)
    random.Random(1).shuffle(messages)
    return content.ordered(messages)


def _locally_late(content: Content) -> Content:
    """As a recorder of a network writes: neighbours change places, the times are right."""
    rng = random.Random(2)
    return content.ordered(sorted(content.messages, key=lambda sent: sent.time + rng.randrange(SECOND // 2)))


def _numbered_by_file(content: Content) -> Content:
    return content.ordered(replace(sent, sequence=n) for n, sent in enumerate(content.messages))


def _twice(content: Content) -> Iterator[Sent]:
    for sent in content.messages:
        yield from (sent, sent)


def _foreign(content: Content) -> Content:
    """Messages of other programs between ours, of all encodings, and one without a schema."""
    ros = Schema(9, b"uint32 data", "ros2msg", "std_msgs/msg/UInt32")
    others = [
        Sent("/rosout", "cdr", ros, 5, b"\0\1\2\3", 1, 5),
        Sent("/free", "json", None, 7, b"{}", 1, 7),
        Sent("/image", "protobuf", Schema(9, b"\1\2", "protobuf", "foxglove.Nothing"), SECOND, b"\xff", 1, 5),
    ]
    return content.ordered([*others, *content.messages, *others])


def _two_channels(content: Content) -> Content:
    turn = iter(range(len(content.messages)))
    return content.each(lambda sent: replace(sent, channel=str(next(turn) % 2)))


def _late_joined(content: Content) -> Content:
    """Two recordings of the run that overlap, one behind the other."""
    half = len(content.messages) // 2
    return content.ordered([*content.messages[half - 90 :], *content.messages[: half + 90]])


WRITING: dict[str, Callable[[Content], Content]] = {
    "lz4": lambda c: c.with_options(compression=CompressionType.LZ4),
    "plain": lambda c: c.with_options(compression=CompressionType.NONE),
    "unchunked": lambda c: c.with_options(compression=CompressionType.NONE, use_chunking=False),
    "no index": lambda c: c.with_options(
        index_types=IndexType.NONE,
        use_statistics=False,
        use_summary_offsets=False,
        repeat_channels=False,
        repeat_schemas=False,
    ),
    "no message index": lambda c: c.with_options(
        index_types=IndexType.CHUNK | IndexType.ATTACHMENT | IndexType.METADATA
    ),
    "no chunk index": lambda c: c.with_options(index_types=IndexType.MESSAGE),
    "no attachment index": lambda c: c.with_options(index_types=IndexType.CHUNK | IndexType.MESSAGE),
    "no statistics": lambda c: c.with_options(use_statistics=False),
    "no repeated channels": lambda c: c.with_options(repeat_channels=False),
    "no repeated schemas": lambda c: c.with_options(repeat_schemas=False),
    "data sum": lambda c: c.with_options(enable_data_crcs=True),
    "no sums": lambda c: c.with_options(enable_crcs=False),
    "one chunk": lambda c: c.with_options(chunk_size=1 << 28),
    "tiny chunks": lambda c: c.with_options(chunk_size=100),
    "ROS profile": lambda c: replace(c, profile="ros2"),
    "our name": lambda c: replace(c, library="picktree").with_options(enable_data_crcs=True),
}
"""Other forms of the same file."""

ORDER: dict[str, Callable[[Content], Content]] = {
    "reversed": lambda c: c.ordered(c.messages[::-1]),
    "shuffled": _shuffled,
    "locally late": _locally_late,
    "by topic": lambda c: c.ordered(sorted(c.messages, key=lambda sent: sent.topic)),
    "twice": lambda c: c.ordered(_twice(c)),
    "appended twice": lambda c: c.ordered([*c.messages, *c.messages]),
    "twice with other numbers": lambda c: _numbered_by_file(c.ordered(_twice(c))),
    "overlapping": _late_joined,
    "numbered by file": _numbered_by_file,
    "not numbered": lambda c: c.each(lambda sent: replace(sent, sequence=0)),
    "epoch": lambda c: c.each(lambda sent: replace(sent, time=sent.time + EPOCH, publish_time=EPOCH)),
    "an hour later": lambda c: c.each(lambda sent: replace(sent, time=sent.time + 3600 * SECOND)),
    "other publish times": lambda c: c.each(lambda sent: replace(sent, publish_time=EPOCH)),
    "foreign topics": _foreign,
    "two channels a topic": _two_channels,
    "metadata twice": lambda c: replace(c, metadata=[*c.metadata, *c.metadata]),
    "attachments twice": lambda c: replace(c, attachments=[*c.attachments, *c.attachments]),
}
"""Other orders, times and neighbours of the same messages."""


def jittered(content: Content, most: int) -> Content:
    rng = random.Random(5)
    late = {id(sent): rng.randint(-most, most) if sent.time else 0 for sent in content.messages}
    return content.each(lambda sent: replace(sent, time=max(sent.time + late[id(sent)], 0)))


def without_attachment_sums(path: Path) -> Path:
    """Zero the check sums of the attachments; the file has no other sums."""
    data = bytearray(path.read_bytes())
    offset = 8
    while data[offset] != Opcode.DATA_END:
        (length,) = struct.unpack_from("<Q", data, offset + 1)
        if data[offset] == Opcode.ATTACHMENT:
            data[offset + 5 + length : offset + 9 + length] = bytes(4)
        offset += 9 + length
    path.write_bytes(data)
    return path


def with_record(path: Path, opcode: int, body: bytes, out: Path) -> Path:
    """Write the file with one more record behind each chunk, and without a summary."""
    data = path.read_bytes()
    pieces = [data[:8]]
    offset = 8
    while True:
        kind, length = struct.unpack_from("<BQ", data, offset)
        if kind == Opcode.DATA_END:
            break
        pieces.append(data[offset : offset + 9 + length])
        offset += 9 + length
        if kind == Opcode.CHUNK:
            pieces.append(struct.pack("<BQ", opcode, len(body)) + body)
    pieces.append(struct.pack("<BQI", Opcode.DATA_END, 4, 0))
    pieces.append(struct.pack("<BQQQI", Opcode.FOOTER, 20, 0, 0, 0))
    out.write_bytes(b"".join(pieces) + data[:8])
    return out
