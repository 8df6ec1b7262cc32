"""Where two runs part: the first moment at which their visits differ.

The first message in which two logs tell of different simulations.

Bytes are compared first; only what differs is decoded, to name the field. A topic that an older log does not
know at all is passed over.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Final, Literal, TypeAlias

from ...logs.mcap.reader import RawMessage
from ...logs.schema import topics
from ...logs.visits import Visit
from ..run import Run
from .matching import NodeMatch
from .message_fields import FieldDifference, decoded, first_field
from .visit_pair import EPSILON, Aspect, VisitPair


@dataclass(frozen=True, slots=True)
class MessageDifference:
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
) -> MessageDifference | None:
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
            return MessageDifference(
                _tick(a, one), one.time / 1e9, one.topic, "", False, found.path, found.of, found.a, found.b
            )
    return None


def _compared(a: Run, b: Run) -> frozenset[str]:
    """The simulated topics; of those that every log has now, an older log may not know all."""
    fixed = {topic.name for topic in topics.FIXED if topic.simulated}
    known_a, known_b = set(a.log.topics), set(b.log.topics)
    cameras = {name for name in known_a | known_b if name.startswith("/camera/")}
    return frozenset(fixed & known_a & known_b | cameras)


def _unpaired(a: Run, b: Run, one: RawMessage | None, other: RawMessage | None) -> MessageDifference:
    """Of two messages that are not of one topic and time: the one that the other log does not have."""
    if one is not None and other is not None:
        ended = False
        in_b = other.time < one.time or (other.time == one.time and _count(b, other) > _count(a, other))
    else:
        ended, in_b = True, one is None
    lone, missing = (other, "a") if in_b else (one, "b")
    assert lone is not None
    value = None if ended else decoded((b if in_b else a).log.topics[lone.topic].schema, lone.data)
    return MessageDifference(
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


Side: TypeAlias = Literal["a", "b"]
SIDES: Final[tuple[Side, Side]] = ("a", "b")
How: TypeAlias = Aspect | Literal["order", "end"]
AT_START: Final[tuple[Aspect, ...]] = ("type", "inputs")
"""What differs already when a visit begins."""


@dataclass(frozen=True, slots=True)
class Divergence:
    """The first moment (simulated s) at which two runs differ, and what each did then.

    `how`: in what the same visit differs; `order`: another visit begins, or the same at another time; `end`:
    the log of one ends, while the other goes on.
    """

    time: float
    how: How
    also: tuple[Aspect, ...]
    """In what else the same visit differs, first to last."""
    a: Visit | None
    """The visit at which they part; with `order` the one that begins next. None when nothing more begins,
    and on the side where the log ends."""
    b: Visit | None
    next_a: Visit | None
    """The first leaf that begins afterwards."""
    next_b: Visit | None


@dataclass(frozen=True, slots=True)
class ComparedRuns:
    """The visits of two runs that are compared, and the time of the last tick of each (simulated s)."""

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
"""Time; within a tick 0 for ends, 1 for beginnings, 2 for the ends of what began in it; and the place among
these: ends come from below, beginnings from above."""


@dataclass(frozen=True, slots=True)
class _Candidate:
    rank: _Rank
    how: How
    a: Visit | None
    b: Visit | None
    also: tuple[Aspect, ...] = ()


def find_parting(sides: ComparedRuns) -> Divergence | None:
    """A node that only one mission has does not part the runs by itself as long as it has children: what it
    does is what they do."""
    first = min(_candidates(sides), key=lambda candidate: candidate.rank, default=None)
    over = min(sides.end_a, sides.end_b)
    if first is None or first.rank[0] > over + EPSILON:
        return _ended(sides, over)
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
        if abs(a.start - b.start) > EPSILON:
            early_a = a.start < b.start
            rank = (begun, 1, a.number if early_a else b.number)
            yield _Candidate(rank, "order", a if early_a else None, None if early_a else b)
            continue
        if pair.differs and pair.differs[0] in AT_START:
            yield _Candidate((begun, 1, a.number), pair.differs[0], a, b, pair.differs[1:])
        elif pair.differs:
            ended = min(one.end for one in (a, b) if one.outcome != "RUNNING")
            phase = 2 if ended <= begun + EPSILON else 0
            yield _Candidate((ended, phase, -a.path.count("/")), pair.differs[0], a, b, pair.differs[1:])
    inner = {node.path for node in (*sides.nodes.only_a, *sides.nodes.only_b) if node.children}
    for visit in sides.only_a:
        if visit.path not in inner:
            yield _Candidate((visit.start, 1, visit.number), "order", visit, None)
    for visit in sides.only_b:
        if visit.path not in inner:
            yield _Candidate((visit.start, 1, visit.number), "order", None, visit)


def _ended(sides: ComparedRuns, over: float) -> Divergence | None:
    """The log of one side ends, and nothing differed until then."""
    if abs(sides.end_a - sides.end_b) <= EPSILON or not sides.pairs:
        return None
    a, b = (_under_way(sides.all(side), over) for side in SIDES)
    next_a, next_b = (_next(sides, side, over + EPSILON, leaf=True) for side in SIDES)
    return Divergence(over, "end", (), a, b, next_a, next_b)


def _under_way(visits: Sequence[Visit], time: float) -> Visit | None:
    """The deepest visit at that time."""
    open_ = [v for v in visits if v.start <= time + EPSILON and (v.outcome == "RUNNING" or v.end > time)]
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
    """The first visit of that side that begins at `time` or later. `new`: and does not begin alike in the
    other run; `leaf`: of a node without children; `beside`: other than this one."""
    alike: set[int] = set()
    if new:
        alike = {
            (pair.a if side == "a" else pair.b).number
            for pair in sides.pairs
            if abs(pair.a.start - pair.b.start) <= EPSILON
        }
    nodes = [pair.a if side == "a" else pair.b for pair in sides.nodes.pairs]
    nodes += sides.nodes.only_a if side == "a" else sides.nodes.only_b
    inner = {node.path for node in nodes if node.children}
    fitting = (
        visit
        for visit in sides.all(side)
        if visit.start >= time - EPSILON
        and visit.number not in alike
        and not (leaf and visit.path in inner)
        and (beside is None or visit.number != beside.number)
    )
    return min(fitting, key=lambda visit: visit.number, default=None)
