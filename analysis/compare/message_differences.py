"""Difference of messages: the first message of two runs that differs, and its first differing field.

Bytes of messages are compared first; only differing ones are decoded, to name the field. A topic that an
older log does not have is ignored.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby, zip_longest
from operator import attrgetter
from typing import Any, Final, Literal, TypeAlias, cast

import orjson

from picktree.analysis import Run
from picktree.logs import Gap, message_class, topics
from picktree.logs.mcap import RawMessage

MAX_TEXT_LENGTH = 90
"""Maximum number of characters; longer texts are cut."""


def value_text(value: object) -> str:
    """Return a value as JSON text, cut when it is long; numbers with six digits; a dash for None.

    >>> value_text({"width": 0.0312345678, "held": True})
    '{"width": 0.0312346, "held": true}'
    """
    if value is None:
        return "–"
    if isinstance(value, str):
        return _shortened(value)
    return _shortened(json.dumps(_rounded(value), ensure_ascii=False, default=str))


def _rounded(value: object) -> object:
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, list):
        return [_rounded(one) for one in cast("list[object]", value)]
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in cast("dict[str, object]", value).items()}
    return value


def _shortened(text: str) -> str:
    return text if len(text) <= MAX_TEXT_LENGTH else f"{text[: MAX_TEXT_LENGTH - 1]}…"


NAME_FIELDS = ("path", "id", "name", "child_frame_id", "key", "object", "kind")
"""Fields that name an element of a list, the best first."""


@dataclass(frozen=True, slots=True)
class FieldDifference:
    path: str
    """Path of the field, such as `nodes[3].status`; empty when the values as a whole differ."""
    of: str
    """Name of the innermost list element around the field, when it has one."""
    a: object
    """Value in A; None where there is no such field or element."""
    b: object


def first_differing_field(schema: str, a: bytes, b: bytes) -> FieldDifference | None:
    """Return the first field in which two messages of a schema differ, in the order of A's fields.

    None when the values are equal and only the bytes differ. Undecodable bytes differ as a whole.

    >>> first_differing_field("picktree.Wrench", b'{"force": {"x": 1.0}}', b'{"force": {"x": 1.5}}')
    FieldDifference(path='force.x', of='', a=1.0, b=1.5)
    """
    from google.protobuf.message import DecodeError

    try:
        return first_difference_in_values(_values(schema, a), _values(schema, b))
    except (ValueError, DecodeError):
        return FieldDifference("", "", f"{len(a)} bytes", f"{len(b)} bytes")


def first_difference_in_values(a: object, b: object, path: str = "", of: str = "") -> FieldDifference | None:
    """Return the first difference of two JSON values, in the order of A's fields; None when they are equal.

    >>> a, b = {"nodes": [{"path": "Main", "status": "RUNNING"}]}, {"nodes": [{"path": "Main"}]}
    >>> first_difference_in_values(a, b)
    FieldDifference(path='nodes[0].status', of='Main', a='RUNNING', b=None)
    """
    if isinstance(a, dict) and isinstance(b, dict):
        ours, theirs = cast("dict[str, object]", a), cast("dict[str, object]", b)
        for key in dict.fromkeys((*ours, *theirs)):
            found = first_difference_in_values(
                ours.get(key), theirs.get(key), f"{path}.{key}" if path else key, of
            )
            if found is not None:
                return found
        return None
    if isinstance(a, list) and isinstance(b, list):
        ones, others = cast("list[object]", a), cast("list[object]", b)
        for n in range(max(len(ones), len(others))):
            one, other = (some[n] if n < len(some) else None for some in (ones, others))
            found = first_difference_in_values(one, other, f"{path}[{n}]", _name(one) or _name(other) or of)
            if found is not None:
                return found
        return None
    if isinstance(a, str) and isinstance(b, str) and a != b and a[:1] == b[:1] == "{":
        return _first_difference_in_text(a, b, path, of)
    if a == b and type(cast("object", a)) is type(cast("object", b)):
        return None
    return FieldDifference(path, of, cast("object", a), cast("object", b))


def _first_difference_in_text(a: str, b: str, path: str, of: str) -> FieldDifference | None:
    """Compare two texts that are JSON themselves, as the records in an entity's metadata."""
    try:
        found = first_difference_in_values(orjson.loads(a), orjson.loads(b), path, of)
    except ValueError:
        found = None
    return found or FieldDifference(path, of, a, b)


def _name(element: object) -> str:
    if not isinstance(element, dict):
        return ""
    fields = cast("dict[str, object]", element)
    return next((str(fields[name]) for name in NAME_FIELDS if isinstance(fields.get(name), str)), "")


def _values(schema: str, data: bytes) -> Any:
    """Decode a message into JSON values, with length and check sum for bytes.

    Raises ValueError or DecodeError for data that is no message of the schema.
    """
    from google.protobuf.json_format import MessageToDict

    kind = message_class(schema)
    if kind is None:
        return orjson.loads(data)
    message = kind.FromString(data)
    values = MessageToDict(
        message, preserving_proto_field_name=True, always_print_fields_with_no_presence=True
    )
    for field in kind.DESCRIPTOR.fields:
        if field.type == field.TYPE_BYTES:
            held: bytes = getattr(message, field.name)
            values[field.name] = f"{len(held)} bytes, CRC-32 {zlib.crc32(held):08x}"
    return values


Missing: TypeAlias = Literal["", "a", "b"]
NO_FIELD: Final = FieldDifference("", "", None, None)
"""Difference of messages that differ in no field: in their bytes alone, or one is missing."""


@dataclass(frozen=True, slots=True)
class MessageDifference:
    """First message that differs. Where a run is compared with its record, the record is A."""

    tick: int
    """Number of the tick at the message's time, 0 for the first of the log A."""
    time: float
    """Time of the message, simulated s."""
    topic: str
    missing: Missing
    """Side without such a message at that place; empty: both have it. Its next message may be another one."""
    ended: bool
    """Whether the log of that side ends there."""
    field: str
    """Field in the message, such as `nodes[3].status` or `transforms[7].translation.x`.

    Empty when the message is missing, or when only its bytes differ.
    """
    of: str
    """Name of the innermost list element around the field: a node's path, a frame, a key; else empty."""
    a: object
    """Value of the field in A, as JSON; None where A lacks the field. For a missing message, the whole
    message of the other side."""
    b: object

    @classmethod
    def at(
        cls,
        a: Run,
        topic: str,
        time: int,
        *,
        missing: Missing = "",
        ended: bool = False,
        field: FieldDifference = NO_FIELD,
    ) -> MessageDifference:
        """Return the difference at a message of that topic and time (simulated ns)."""
        tick = a.ticks.number_at(time / 1e9) if a.ticks.times else 0
        return cls(tick, time / 1e9, topic, missing, ended, field.path, field.of, field.a, field.b)


def first_difference(
    a: Run,
    b: Run,
    *,
    since: float | None = None,
    until: float | None = None,
    without: Collection[str] = (),
) -> MessageDifference | None:
    """Return the first difference of the simulated messages from `since` to `until` (simulated s, inclusive).

    None when all messages are equal. Messages of one time are compared topic by topic. Topics in `without`,
    and topics that one of the logs lacks, are ignored. A truncated log ends before the whole log of the run.
    Then the difference has `ended`, and `missing` names the side.
    """
    names = compared_topics(a, b) - set(without)
    gaps = (*a.log.gaps, *b.log.gaps)
    streams = (moments(present(run.log.messages(names, since, until), gaps)) for run in (a, b))
    for one, other in zip_longest(*streams):
        if one is None or other is None or one.time != other.time:
            in_b = one is None or (other is not None and other.time < one.time)
            lone = other if in_b else one
            assert lone is not None
            topic = next(iter(lone.messages))
            if one is None or other is None:
                return MessageDifference.at(a, topic, lone.time, missing="a" if in_b else "b", ended=True)
            return _missing(a, b, topic, lone.time, lone.messages[topic][0], in_b=in_b)
        for topic in dict.fromkeys((*one.messages, *other.messages)):
            for mine, theirs in zip_longest(one.messages.get(topic, ()), other.messages.get(topic, ())):
                if mine is None or theirs is None:
                    return _missing(a, b, topic, one.time, mine or theirs or b"", in_b=mine is None)
                if mine != theirs:
                    schema = a.log.topics[topic].schema
                    found = first_differing_field(schema, mine, theirs) or NO_FIELD
                    return MessageDifference.at(a, topic, one.time, field=found)
    return None


@dataclass(frozen=True, slots=True)
class LogMoment:
    """Contents of the messages of one time (simulated ns), by topic, in the order of the log."""

    time: int
    messages: Mapping[str, Sequence[bytes]]


def moments(messages: Iterable[RawMessage]) -> Iterator[LogMoment]:
    """Yield the messages of each time together. Only those of one topic have an order within a time."""
    for time, group in groupby(messages, key=attrgetter("time")):
        found: dict[str, list[bytes]] = {}
        for message in group:
            found.setdefault(message.topic, []).append(message.data)
        yield LogMoment(time, found)


def present(messages: Iterable[RawMessage], gaps: Sequence[Gap]) -> Iterator[RawMessage]:
    """Yield the messages outside of the gaps, whose first and last ticks may have lost messages, too."""
    return (m for m in messages if not any(gap.contains(m.time / 1e9) for gap in gaps))


def compared_topics(a: Run, b: Run) -> frozenset[str]:
    """Return the simulated topics that both logs have.

    An older log may lack some of today's, and another program may have left out any. A camera that has taken
    images in one run alone is a difference.
    """
    fixed = {topic.name for topic in topics.FIXED if topic.simulated}
    known_a, known_b = set(a.log.topics), set(b.log.topics)
    cameras = {name for name in known_a | known_b if name.startswith("/camera/")}
    for run, known in ((a, known_a), (b, known_b)):
        cameras &= known if run.log.is_rewritten else cameras
    return frozenset(fixed & known_a & known_b | cameras)


def _missing(a: Run, b: Run, topic: str, time: int, data: bytes, *, in_b: bool) -> MessageDifference:
    """Return the difference of a message that only one log has."""
    from google.protobuf.message import DecodeError

    value: object = None
    with suppress(ValueError, DecodeError):  # an unreadable message has no value
        value = _values((b if in_b else a).log.topics[topic].schema, data)
    values = FieldDifference("", "", *((None, value) if in_b else (value, None)))
    return MessageDifference.at(a, topic, time, missing="a" if in_b else "b", field=values)
