"""The first message in which two logs tell of different simulations.

Bytes are compared first; only what differs is decoded, to name the field. A topic that an older log does not
know at all is passed over.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from itertools import zip_longest
from typing import Literal

from ...logs.mcap.reader import RawMessage
from ...logs.schema import topics
from ..run import Run
from .message_fields import FieldDifference, decoded, first_field


@dataclass(frozen=True, slots=True)
class Difference:
    """The first message that differs."""

    tick: int
    """Number of the tick to whose time it belongs, 0 for the first of the log A."""
    time: float
    """Simulated s."""
    topic: str
    missing: Literal["", "a", "b"]
    """The side that has no such message there; its log may tell of something else first."""
    ended: bool
    """Whether the log of that side ends there."""
    field: str
    """Where in the message, such as `nodes[3].status` or `transforms[7].translation.x`; empty when the
    message is missing, or when only its bytes differ."""
    of: str
    """What the innermost list element on the way is called: a node's path, a frame, a key; else empty."""
    a: object
    """The values of the field, as JSON has them; of a missing message the whole other one. None where there
    is none."""
    b: object


def first_difference(
    a: Run,
    b: Run,
    *,
    since: float | None = None,
    until: float | None = None,
    without: Collection[str] = (),
) -> Difference | None:
    """None when both logs hold the same simulated messages from `since` to `until` (simulated s, inclusive),
    apart from those on the topics `without`.

    A log that was cut ends earlier than the one of the same run that is whole: then the difference has
    `ended`, and `missing` says which.
    """
    names = _compared(a, b) - set(without)
    streams = (run.log.messages(names, since, until) for run in (a, b))
    for one, other in zip_longest(*streams):
        if one is None or other is None or (one.topic, one.time) != (other.topic, other.time):
            return _unpaired(a, b, one, other)
        if one.data != other.data:
            schema = a.log.topics[one.topic].schema
            found = first_field(schema, one.data, other.data) or FieldDifference("", "", None, None)
            return Difference(
                _tick(a, one), one.time / 1e9, one.topic, "", False, found.path, found.of, found.a, found.b
            )
    return None


def _compared(a: Run, b: Run) -> frozenset[str]:
    """The simulated topics; of those that every log has now, an older log may not know all."""
    fixed = {topic.name for topic in topics.FIXED if topic.simulated}
    known_a, known_b = set(a.log.topics), set(b.log.topics)
    cameras = {name for name in known_a | known_b if name.startswith("/camera/")}
    return frozenset(fixed & known_a & known_b | cameras)


def _unpaired(a: Run, b: Run, one: RawMessage | None, other: RawMessage | None) -> Difference:
    """Of two messages that are not of one topic and time: the one that the other log does not have."""
    if one is not None and other is not None:
        ended = False
        in_b = other.time < one.time or (other.time == one.time and _count(b, other) > _count(a, other))
    else:
        ended, in_b = True, one is None
    lone, missing = (other, "a") if in_b else (one, "b")
    assert lone is not None
    value = None if ended else decoded((b if in_b else a).log.topics[lone.topic].schema, lone.data)
    return Difference(
        _tick(a, lone), lone.time / 1e9, lone.topic, missing, ended, "", "",
        None if in_b else value, value if in_b else None,
    )  # fmt: skip


def _count(run: Run, like: RawMessage) -> int:
    """How many messages of that topic and time the log holds."""
    time = like.time / 1e9
    return sum(1 for _ in run.log.messages([like.topic], time, time))


def _tick(run: Run, message: RawMessage) -> int:
    times = run.ticks.times
    return run.ticks.number_at(message.time / 1e9) if times else 0
