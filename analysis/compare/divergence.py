"""Divergence of two runs: the first moment at which their visits differ, and the first message that differs.

Bytes of messages are compared first; only differing ones are decoded, to name the field. A topic that an
older log does not have is ignored.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, zip_longest
from operator import attrgetter
from typing import Final, Literal, TypeAlias

from ...logs.mcap.reader import RawMessage
from ...logs.run_settings import Gap
from ...logs.schema import topics
from ...logs.visits import Visit
from ..run import Run
from .matching import TIME_TOLERANCE, Aspect, NodeMatch, VisitPair
from .message_fields import FieldDifference, decode_message, first_differing_field

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
    """Value of the field in A, as JSON; None where there is none. For a missing message, the whole other
    one."""
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

    None when there is none. Messages of one time are compared topic by topic. Topics in `without`, and what
    one of the logs lacks, are ignored. A log that was cut ends earlier than the whole log of the same run.
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
    value = decode_message((b if in_b else a).log.topics[topic].schema, data)
    values = FieldDifference("", "", *((None, value) if in_b else (value, None)))
    return MessageDifference.at(a, topic, time, missing="a" if in_b else "b", field=values)


Side: TypeAlias = Literal["a", "b"]
SIDES: Final[tuple[Side, Side]] = ("a", "b")
How: TypeAlias = Aspect | Literal["order", "end"]
AT_START: Final[tuple[Aspect, ...]] = ("type", "inputs")
"""Aspects that differ already at the start of a visit."""


@dataclass(frozen=True, slots=True)
class Divergence:
    """First moment (simulated s) at which two runs differ, and the visits of both there.

    `how` is the aspect in which the same visit differs. `order`: another visit begins, or the same at another
    time. `end`: the log of one ends, while the other continues.
    """

    time: float
    how: How
    also: tuple[Aspect, ...]
    """Further aspects in which the same visit differs, in order of time."""
    a: Visit | None
    """Visit of A at the divergence; with `order` the one that begins next.

    None when no further visit begins, or the log ends.
    """
    b: Visit | None
    next_a: Visit | None
    """First leaf that begins afterwards in A; None when there is none."""
    next_b: Visit | None


@dataclass(frozen=True, slots=True)
class ComparedRuns:
    """Visits of two compared runs, and the time of the last tick of each, simulated s."""

    pairs: Sequence[VisitPair]
    only_a: Sequence[Visit]
    only_b: Sequence[Visit]
    end_a: float
    end_b: float
    nodes: NodeMatch

    def all(self, side: Side) -> Sequence[Visit]:
        if side == "a":
            return [*(pair.a for pair in self.pairs), *self.only_a]
        return [*(pair.b for pair in self.pairs), *self.only_b]


_Rank: TypeAlias = tuple[float, int, int]
"""Rank of a moment: time, phase within the tick, place within the phase.

Phases are 0 for ends, 1 for starts, 2 for ends of visits that began in the same tick. Ends go from below
upwards, starts from above downwards.
"""


@dataclass(frozen=True, slots=True)
class _Candidate:
    rank: _Rank
    how: How
    a: Visit | None
    b: Visit | None
    also: tuple[Aspect, ...] = ()


def find_parting(sides: ComparedRuns) -> Divergence | None:
    """Return the first divergence; None when there is none.

    A node with children that only one mission has is no divergence by itself: the behaviour of its children
    counts.
    """
    first = min(_candidates(sides), key=lambda candidate: candidate.rank, default=None)
    over = min(sides.end_a, sides.end_b)
    if first is None or first.rank[0] > over + TIME_TOLERANCE:
        return _log_end_divergence(sides, over)
    time, a, b = first.rank[0], first.a, first.b
    if first.how == "order":
        a, b = a or _next(sides, "a", time, new=True), b or _next(sides, "b", time, new=True)
    return Divergence(
        time,
        first.how,
        first.also,
        a,
        b,
        _next(sides, "a", time, leaf=True, beside=a),
        _next(sides, "b", time, leaf=True, beside=b),
    )


def _candidates(sides: ComparedRuns) -> Iterator[_Candidate]:
    for pair in sides.pairs:
        a, b = pair.a, pair.b
        begun = min(a.start, b.start)
        if abs(a.start - b.start) > TIME_TOLERANCE:
            early_a = a.start < b.start
            rank = (begun, 1, a.number if early_a else b.number)
            yield _Candidate(rank, "order", a if early_a else None, None if early_a else b)
            continue
        if pair.differs and pair.differs[0] in AT_START:
            yield _Candidate((begun, 1, a.number), pair.differs[0], a, b, pair.differs[1:])
        elif pair.differs:
            ended = min(one.end for one in (a, b) if one.outcome != "RUNNING")
            phase = 2 if ended <= begun + TIME_TOLERANCE else 0
            yield _Candidate((ended, phase, -a.path.count("/")), pair.differs[0], a, b, pair.differs[1:])
    inner = {node.path for node in (*sides.nodes.only_a, *sides.nodes.only_b) if node.children}
    for visit in sides.only_a:
        if visit.path not in inner:
            yield _Candidate((visit.start, 1, visit.number), "order", visit, None)
    for visit in sides.only_b:
        if visit.path not in inner:
            yield _Candidate((visit.start, 1, visit.number), "order", None, visit)


def _log_end_divergence(sides: ComparedRuns, over: float) -> Divergence | None:
    """Return the divergence at the end of one log when nothing differed before; None when both end
    together."""
    if abs(sides.end_a - sides.end_b) <= TIME_TOLERANCE or not sides.pairs:
        return None
    a, b = (_deepest_open_visit(sides.all(side), over) for side in SIDES)
    next_a, next_b = (_next(sides, side, over + TIME_TOLERANCE, leaf=True) for side in SIDES)
    return Divergence(over, "end", (), a, b, next_a, next_b)


def _deepest_open_visit(visits: Sequence[Visit], time: float) -> Visit | None:
    """Return the deepest visit that is open at that time."""
    open_ = [
        v for v in visits if v.start <= time + TIME_TOLERANCE and (v.outcome == "RUNNING" or v.end > time)
    ]
    return max(open_, key=lambda visit: visit.path.count("/"), default=None)


def _next(
    sides: ComparedRuns,
    side: Side,
    time: float,
    *,
    new: bool = False,
    leaf: bool = False,
    beside: Visit | None = None,
) -> Visit | None:
    """Return the first visit of that side that begins at `time` or later.

    `new`: it does not begin at the same time in the other run; `leaf`: its node has no children; `beside`: it
    is not this visit.
    """
    alike: set[int] = set()
    if new:
        alike = {
            (pair.a if side == "a" else pair.b).number
            for pair in sides.pairs
            if abs(pair.a.start - pair.b.start) <= TIME_TOLERANCE
        }
    nodes = [pair.a if side == "a" else pair.b for pair in sides.nodes.pairs]
    nodes += sides.nodes.only_a if side == "a" else sides.nodes.only_b
    inner = {node.path for node in nodes if node.children}
    fitting = (
        visit
        for visit in sides.all(side)
        if visit.start >= time - TIME_TOLERANCE
        and visit.number not in alike
        and not (leaf and visit.path in inner)
        and (beside is None or visit.number != beside.number)
    )
    return min(fitting, key=lambda visit: visit.number, default=None)
