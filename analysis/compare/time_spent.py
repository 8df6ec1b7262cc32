"""Where the time went in two runs, by type of leaf and by node; and how often what came of which node."""

from __future__ import annotations

import statistics
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from ...logs.visits import Visit
from .alignment import Alignment


@dataclass(frozen=True, slots=True)
class TimeUse:
    """Simulated s of some visits; `median` is None when there are none."""

    count: int
    total: float
    median: float | None


@dataclass(frozen=True, slots=True)
class TimeChange:
    name: str
    """A type of node, or the path of a node in A (in B for a node that only B has)."""
    a: TimeUse
    b: TimeUse

    @property
    def change(self) -> float:
        """Simulated s that B took longer, in all."""
        return self.b.total - self.a.total


@dataclass(frozen=True, slots=True)
class CountChange:
    """How often something was in the two runs."""

    name: str
    a: int
    b: int


@dataclass(frozen=True, slots=True)
class EndingChange:
    """How often a node ended so. `path` as in `TimeChange.name`."""

    path: str
    outcome: str
    a: int
    b: int


@dataclass(frozen=True, slots=True)
class TimeSpent:
    """The largest changes first."""

    by_type: tuple[TimeChange, ...]
    """Of leaves: what the robot does, and nothing twice."""
    by_node: tuple[TimeChange, ...]
    """Of all nodes; the time of a node contains that of the nodes below it."""


def time_spent(alignment: Alignment) -> TimeSpent:
    inner = _inner(alignment)
    leaves_a = [visit for visit in alignment.visits_a if visit.path not in inner[0]]
    leaves_b = [visit for visit in alignment.visits_b if visit.path not in inner[1]]
    path_in_a = alignment.nodes.a_by_b
    return TimeSpent(
        _changes(_grouped(leaves_a, lambda v: v.id), _grouped(leaves_b, lambda v: v.id)),
        _changes(
            _grouped(alignment.visits_a, lambda v: v.path),
            _grouped(alignment.visits_b, lambda v: path_in_a.get(v.path, v.path)),
        ),
    )


def causes(alignment: Alignment) -> tuple[CountChange, ...]:
    """How often a node failed by itself with each cause, all causes of both runs by name."""
    ours = Counter(visit.cause for visit in alignment.visits_a if visit.failed_itself)
    theirs = Counter(visit.cause for visit in alignment.visits_b if visit.failed_itself)
    return tuple(CountChange(cause, ours[cause], theirs[cause]) for cause in sorted({*ours, *theirs}))


def ways(alignment: Alignment) -> tuple[EndingChange, ...]:
    """What came of each node, where that is not the same number of times; in the order of A's tree, what only
    B has last."""
    path_in_a = alignment.nodes.a_by_b
    ours = Counter((visit.path, visit.outcome) for visit in alignment.visits_a)
    theirs = Counter((path_in_a.get(v.path, v.path), v.outcome) for v in alignment.visits_b)
    order = {pair.a.path: n for n, pair in enumerate(alignment.nodes.pairs)}
    keys = sorted({*ours, *theirs}, key=lambda key: (order.get(key[0], len(order)), key))
    return tuple(EndingChange(*key, ours[key], theirs[key]) for key in keys if ours[key] != theirs[key])


def _inner(alignment: Alignment) -> tuple[set[str], set[str]]:
    """Paths of the nodes with children, in A and in B."""
    nodes = alignment.nodes
    return (
        {n.path for n in (*(p.a for p in nodes.pairs), *nodes.only_a) if n.children},
        {n.path for n in (*(p.b for p in nodes.pairs), *nodes.only_b) if n.children},
    )


def _grouped(visits: Iterable[Visit], name: Callable[[Visit], str]) -> dict[str, list[float]]:
    grouped: dict[str, list[float]] = defaultdict(list)
    for visit in visits:
        grouped[name(visit)].append(visit.duration)
    return grouped


def _changes(a: dict[str, list[float]], b: dict[str, list[float]]) -> tuple[TimeChange, ...]:
    changes = [TimeChange(name, _spent(a.get(name)), _spent(b.get(name))) for name in dict.fromkeys((*a, *b))]
    return tuple(sorted(changes, key=lambda change: -abs(change.change)))


def _spent(seconds: list[float] | None) -> TimeUse:
    if not seconds:
        return TimeUse(0, 0.0, None)
    return TimeUse(len(seconds), sum(seconds), statistics.median(seconds))
