"""Alignment of two runs: pairs of their items, nodes and visits, and where the visits first differ.

Nodes with the same path are a pair. The others (a node inside a renamed one, or wrapped into another, as in a
new `Recover`) are paired below the nearest pair above them. There, nodes of the same type and name form pairs
in their order.

Ids of items are the robot's own: `red_block_3` is the third red block that it found. Two runs may number the
same block differently. With one seed, items start at the same places, so the place decides. The rest, and all
items when the seeds differ, are paired by the order of discovery within one kind and colour. With different
seeds, a pair therefore only means the same kind and colour.

The key of a visit is (item, node path, attempt). On both sides attempts are counted from `since` on, so that
a resumed run aligns with the run that it continues. Times are simulated seconds.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import SequenceMatcher
from typing import Final, Literal, TypeAlias, cast

from picktree.analysis import Run
from picktree.logs import log_records, node_visits
from picktree.world import TreeNode

MAX_SAME_PLACE_DISTANCE = 0.02
"""Maximum distance of the same place, m: half an item, above the error of perception, below the gap of two
items."""
Side: TypeAlias = Literal["a", "b"]
Basis: TypeAlias = Literal["place", "order"]


@dataclass(frozen=True, slots=True)
class ItemPair:
    a: str
    b: str
    basis: Basis
    """Reason for the pair. `place`: the items were at the same place. `order`: kind, colour and number in the
    order of discovery agree."""


@dataclass(frozen=True, slots=True)
class ItemMatch:
    """Pairs of the objects of two runs, by their ids."""

    pairs: tuple[ItemPair, ...]
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]

    @property
    def a_by_b(self) -> Mapping[str, str]:
        """Ids in run A of the objects of B."""
        return {pair.b: pair.a for pair in self.pairs}


def match_items(a: Run, b: Run, *, since: float = 0.0) -> ItemMatch:
    """Pair the objects of two runs. Objects that are known at `since` (simulated s) count with their place
    then."""
    in_a, in_b = first_bodies(a, since), first_bodies(b, since)
    pairs: list[ItemPair] = []
    if a.info.seed == b.info.seed:
        near = sorted(
            (math.dist(one.pose.position, other.pose.position), one.id != other.id, n, m)
            for n, one in enumerate(in_a)
            for m, other in enumerate(in_b)
            if (one.kind, one.colour) == (other.kind, other.colour)
        )
        taken_a: set[int] = set()
        taken_b: set[int] = set()
        for distance, _, n, m in near:
            if distance <= MAX_SAME_PLACE_DISTANCE and n not in taken_a and m not in taken_b:
                taken_a.add(n)
                taken_b.add(m)
                pairs.append(ItemPair(in_a[n].id, in_b[m].id, "place"))
    left_a = _unpaired_ids(in_a, (pair.a for pair in pairs))
    left_b = _unpaired_ids(in_b, (pair.b for pair in pairs))
    for sort, ones in left_a.items():
        for one, other in zip(ones, left_b.get(sort, ()), strict=False):
            pairs.append(ItemPair(one, other, "order"))
    paired_a, paired_b = {pair.a for pair in pairs}, {pair.b for pair in pairs}
    order: dict[str, int] = {sighting.id: n for n, sighting in enumerate(in_a)}
    return ItemMatch(
        tuple(sorted(pairs, key=lambda pair: order[pair.a])),
        tuple(s.id for s in in_a if s.id not in paired_a),
        tuple(s.id for s in in_b if s.id not in paired_b),
    )


def first_bodies(run: Run, since: float = 0.0) -> tuple[log_records.BodyRecord, ...]:
    """Return every object as the robot first believed in it from `since` (simulated s) on, in the order of
    discovery."""
    found: dict[str, log_records.BodyRecord] = {}
    known = run.log.belief_at(since)
    for at in run.log.beliefs(known.time if known else since):
        for body in at.record.bodies:
            found.setdefault(body.id, body)
    return tuple(found.values())


def _unpaired_ids(
    known: Iterable[log_records.BodyRecord], paired: Iterable[str]
) -> dict[tuple[str, str], list[str]]:
    """Return the ids without a partner, by kind and colour."""
    done = set(paired)
    left: dict[tuple[str, str], list[str]] = {}
    for sighting in known:
        if sighting.id not in done:
            left.setdefault((sighting.kind, sighting.colour), []).append(sighting.id)
    return left


@dataclass(frozen=True, slots=True)
class PortChange:
    """Port with different values in the two missions; empty where the mission does not set it."""

    path: str
    """Path of the node in A."""
    port: str
    a: str
    b: str


@dataclass(frozen=True, slots=True)
class NodePair:
    a: TreeNode
    b: TreeNode


@dataclass(frozen=True, slots=True)
class NodeMatch:
    """Pairs of the nodes of two runs. When the mission was edited during a run, all its trees count."""

    pairs: tuple[NodePair, ...]
    only_a: tuple[TreeNode, ...]
    only_b: tuple[TreeNode, ...]

    @property
    def a_by_b(self) -> Mapping[str, str]:
        """Paths in A of the nodes of B."""
        return {pair.b.path: pair.a.path for pair in self.pairs}

    def inner(self, side: Side) -> frozenset[str]:
        """Return the paths of that side's nodes with children."""
        nodes = [pair.a if side == "a" else pair.b for pair in self.pairs]
        nodes += self.only_a if side == "a" else self.only_b
        return frozenset(node.path for node in nodes if node.children)

    @property
    def moved(self) -> tuple[NodePair, ...]:
        """Pairs with different paths."""
        return tuple(pair for pair in self.pairs if pair.a.path != pair.b.path)

    @property
    def retyped(self) -> tuple[NodePair, ...]:
        """Pairs of the same path, but of another type."""
        return tuple(pair for pair in self.pairs if pair.a.id != pair.b.id)

    @property
    def rewired(self) -> tuple[PortChange, ...]:
        return tuple(
            PortChange(pair.a.path, port, pair.a.ports.get(port, ""), pair.b.ports.get(port, ""))
            for pair in self.pairs
            for port in dict.fromkeys((*pair.a.ports, *pair.b.ports))
            if pair.a.ports.get(port, "") != pair.b.ports.get(port, "")
        )


def match_nodes(a: Run, b: Run) -> NodeMatch:
    in_a, in_b = {node.path: node for node in a.nodes}, {node.path: node for node in b.nodes}
    b_of = {path: path for path in in_a if path in in_b}
    same_in_b = {path: path for path in b_of}
    left_a, left_b = _unpaired_below(in_a, b_of), _unpaired_below(in_b, same_in_b)
    for top, ones in left_a.items():
        others = left_b.get(top, [])
        matcher = SequenceMatcher(None, [_kind(n) for n in ones], [_kind(n) for n in others], autojunk=False)
        for block in matcher.get_matching_blocks():
            for k in range(block.size):
                b_of[ones[block.a + k].path] = others[block.b + k].path
    taken = set(b_of.values())
    return NodeMatch(
        tuple(NodePair(node, in_b[b_of[path]]) for path, node in in_a.items() if path in b_of),
        tuple(node for path, node in in_a.items() if path not in b_of),
        tuple(node for path, node in in_b.items() if path not in taken),
    )


def _unpaired_below(nodes: Mapping[str, TreeNode], paired: Mapping[str, str]) -> dict[str, list[TreeNode]]:
    """Return the unpaired nodes in the order of the tree, by the nearest paired node above them."""
    below: dict[str, list[TreeNode]] = {}
    for node in nodes.values():
        if node.path in paired:
            continue
        above = node.parent
        while above and above not in paired and above in nodes:
            above = nodes[above].parent
        below.setdefault(above, []).append(node)
    return below


def _kind(node: TreeNode) -> tuple[str, str]:
    """Return type and name without the number that distinguishes siblings; nodes with equal results are
    alike."""
    return node.id, node.name.split("#")[0]


TIME_TOLERANCE: Final = 1e-6
"""Difference below which two times are equal, s."""
Aspect: TypeAlias = Literal["type", "inputs", "outcome", "cause", "length"]


@dataclass(frozen=True, slots=True)
class VisitPair:
    """Same visit in both runs, each with the item, path and times of its own run."""

    a: node_visits.Visit
    b: node_visits.Visit
    differs: tuple[Aspect, ...]
    """Aspects that differ, apart from the start time."""


def differences(
    a: node_visits.Visit, b: node_visits.Visit, items: Mapping[str, str], *, resumed: bool
) -> tuple[Aspect, ...]:
    """Return the aspects in which two visits differ.

    `items`: ids in A of the objects of B. `resumed`: one of the visits had begun before the comparison, so
    its inputs are unknown. A visit that is cut off by the end of its log differs only when the other one had
    ended by that time.
    """
    found: list[Aspect] = []
    if a.id != b.id:
        found.append("type")
    if not resumed and a.inputs != {port: renamed(value, items) for port, value in b.inputs.items()}:
        found.append("inputs")
    if "RUNNING" in (a.outcome, b.outcome):
        open_, other = (a, b) if a.outcome == "RUNNING" else (b, a)
        if other.outcome != "RUNNING" and other.end - other.start < open_.end - open_.start - TIME_TOLERANCE:
            found.append("length")
        return tuple(found)
    if a.outcome != b.outcome:
        found.append("outcome")
    if (a.cause, a.origin == a.path) != (b.cause, b.origin == b.path):
        found.append("cause")
    if abs(a.duration - b.duration) > TIME_TOLERANCE:
        found.append("length")
    return tuple(found)


def renamed(value: object, names: Mapping[str, str]) -> object:
    """Return the value with each text that is a name in `names` replaced, also in lists and mappings.

    >>> renamed(["red_ball_1", {"object": "red_ball_2"}], {"red_ball_1": "red_ball_2", "red_ball_2": "x"})
    ['red_ball_2', {'object': 'x'}]
    """
    if isinstance(value, str):
        return names.get(value, value)
    if isinstance(value, list):
        return [renamed(one, names) for one in cast("list[object]", value)]
    if isinstance(value, dict):
        return {key: renamed(one, names) for key, one in cast("dict[str, object]", value).items()}
    return value


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
    a: node_visits.Visit | None
    """Visit of A at the divergence; with `order` the one that begins next.

    None when no further visit begins, or the log ends.
    """
    b: node_visits.Visit | None
    next_a: node_visits.Visit | None
    """First leaf of A that begins after the divergence; None: no leaf begins after it."""
    next_b: node_visits.Visit | None


@dataclass(frozen=True, slots=True)
class Alignment:
    """Two runs with their visits in pairs.

    Visits that were open at `since` count as if they had begun then, and `attempt` is counted from there.
    `number`, `parent` and the numbers of ticks are those of the visit's own run.
    """

    since: float
    """Start of the comparison, simulated s; 0.0: the beginning."""
    items: ItemMatch
    nodes: NodeMatch
    pairs: tuple[VisitPair, ...]
    """Pairs in the order of their starts in A."""
    only_a: tuple[node_visits.Visit, ...]
    only_b: tuple[node_visits.Visit, ...]
    until: float | None = None
    """End of the compared visits, simulated s: a gap of one of the logs begins there. None: no gap."""
    parting: Divergence | None = None
    """First divergence; None when nothing differs."""

    def visits(self, side: Side) -> tuple[node_visits.Visit, ...]:
        return self.visits_a if side == "a" else self.visits_b

    @property
    def visits_a(self) -> tuple[node_visits.Visit, ...]:
        return (*(pair.a for pair in self.pairs), *self.only_a)

    @property
    def visits_b(self) -> tuple[node_visits.Visit, ...]:
        return (*(pair.b for pair in self.pairs), *self.only_b)


_Rank: TypeAlias = tuple[float, int, int]
"""Rank of a moment: time, phase within the tick, place within the phase.

Phases are 0 for ends, 1 for starts, 2 for ends of visits that began in the same tick. Ends go from below
upwards, starts from above downwards.
"""


@dataclass(frozen=True, slots=True)
class _Candidate:
    rank: _Rank
    how: How
    a: node_visits.Visit | None
    b: node_visits.Visit | None
    also: tuple[Aspect, ...] = ()


def find_parting(sides: Alignment, end_a: float, end_b: float) -> Divergence | None:
    """Return the first divergence; None for equal runs. The ends are those of the runs, simulated s.

    A node with children that only one mission has is no divergence by itself: the behaviour of its children
    counts.
    """
    first = min(_candidates(sides), key=lambda candidate: candidate.rank, default=None)
    over = min(end_a, end_b)
    if first is None or first.rank[0] > over + TIME_TOLERANCE:
        return None if abs(end_a - end_b) <= TIME_TOLERANCE else _log_end_divergence(sides, over)
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


def _candidates(sides: Alignment) -> Iterator[_Candidate]:
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


def _log_end_divergence(sides: Alignment, over: float) -> Divergence | None:
    """Return the divergence at the end of one log when nothing differed before; None without pairs."""
    if not sides.pairs:
        return None
    a, b = (_deepest_open_visit(sides.visits(side), over) for side in SIDES)
    next_a, next_b = (_next(sides, side, over + TIME_TOLERANCE, leaf=True) for side in SIDES)
    return Divergence(over, "end", (), a, b, next_a, next_b)


def _deepest_open_visit(visits: Sequence[node_visits.Visit], time: float) -> node_visits.Visit | None:
    open_ = [
        v for v in visits if v.start <= time + TIME_TOLERANCE and (v.outcome == "RUNNING" or v.end > time)
    ]
    return max(open_, key=lambda visit: visit.path.count("/"), default=None)


def _next(
    sides: Alignment,
    side: Side,
    time: float,
    *,
    new: bool = False,
    leaf: bool = False,
    beside: node_visits.Visit | None = None,
) -> node_visits.Visit | None:
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
    inner = sides.nodes.inner(side)
    fitting = (
        visit
        for visit in sides.visits(side)
        if visit.start >= time - TIME_TOLERANCE
        and visit.number not in alike
        and not (leaf and visit.path in inner)
        and (beside is None or visit.number != beside.number)
    )
    return min(fitting, key=lambda visit: visit.number, default=None)


@dataclass(frozen=True, slots=True)
class _Side:
    """Visits of one run, from the first compared tick on."""

    visits: tuple[node_visits.Visit, ...]
    keys: tuple[node_visits.Key, ...]
    """Keys of the visits, with the names of run A."""
    resumed: frozenset[int]
    """Indices of the visits that had begun before the comparison."""


def align(a: Run, b: Run, *, since: float = 0.0) -> Alignment:
    """Pair the visits of two runs from `since` (simulated s) on, up to the first gap of a log.

    A log that begins later than its run, as that of a resumed run, is compared from after its first tick on.
    So is the other log. That tick only holds the state at the checkpoint.
    """
    begun = max((run.ticks.times[0] for run in (a, b) if run.ticks.times), default=0.0)
    if begun > TIME_TOLERANCE:
        since = max(since, begun + a.info.tick / 2)
    gaps = (gap.start for run in (a, b) for gap in run.log.gaps if gap.start is not None)
    until = min((start for start in gaps if start > since), default=None)
    items, nodes = match_items(a, b, since=since), match_nodes(a, b)
    # An item that only B has must not be taken for an item of A with the same name.
    names = {**{name: f"{name} of B" for name in items.only_b}, **items.a_by_b}
    called = {pair.a: pair.b for pair in items.pairs}
    side_a = _side(a.account.visits, since, until, {}, {})
    side_b = _side(b.account.visits, since, until, names, nodes.a_by_b)
    index_b = {key: m for m, key in enumerate(side_b.keys)}
    partners = {n: index_b[key] for n, key in enumerate(side_a.keys) if key in index_b}
    pairs: list[VisitPair] = []
    for n, m in partners.items():
        one, other = side_a.visits[n], side_b.visits[m]
        resumed = n in side_a.resumed or m in side_b.resumed
        if resumed and one.item and not other.item:
            other = replace(other, item=called.get(one.item, one.item))
        pairs.append(VisitPair(one, other, differences(one, other, names, resumed=resumed)))
    taken = set(partners.values())
    only_a = tuple(visit for n, visit in enumerate(side_a.visits) if n not in partners)
    only_b = tuple(visit for m, visit in enumerate(side_b.visits) if m not in taken)
    end_a, end_b = (run.last_tick if until is None else min(run.last_tick, until) for run in (a, b))
    found = Alignment(since, items, nodes, tuple(pairs), only_a, only_b, until)
    return replace(found, parting=find_parting(found, end_a, end_b))


def _side(
    of_run: Sequence[node_visits.Visit],
    since: float,
    until: float | None,
    items: Mapping[str, str],
    nodes: Mapping[str, str],
) -> _Side:
    counts: Counter[tuple[str, str]] = Counter()
    visits: list[node_visits.Visit] = []
    keys: list[node_visits.Key] = []
    resumed: set[int] = set()
    for visit in of_run:
        if visit.end < since - TIME_TOLERANCE or (until is not None and visit.start > until + TIME_TOLERANCE):
            continue
        if until is not None and visit.end > until + TIME_TOLERANCE:
            visit = replace(visit, end=until, outcome="RUNNING", cause="", origin="", message="", evidence={})
        item, path = items.get(visit.item, visit.item), nodes.get(visit.path, visit.path)
        if visit.start < since - TIME_TOLERANCE:
            # A node has one such visit. A run from a checkpoint cannot know its item.
            resumed.add(len(visits))
            visits.append(replace(visit, start=since, attempt=0))
            keys.append(("", path, 0))
            continue
        counts[item, path] += 1
        visits.append(replace(visit, attempt=counts[item, path]))
        keys.append((item, path, counts[item, path]))
    return _Side(tuple(visits), tuple(keys), frozenset(resumed))
