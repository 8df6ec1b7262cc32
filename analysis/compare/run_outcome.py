"""Outcome of a run for a table of two: result, items, causes and times; for a killed run, as far as its log
has them."""

from __future__ import annotations

import statistics
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from picktree.analysis import Run
from picktree.logs import node_visits
from picktree.world import event_types

from .alignment import SIDES, Alignment, Basis, first_bodies


@dataclass(frozen=True, slots=True)
class TimeUse:
    """Duration of some visits, simulated s; `median` is None without visits."""

    count: int
    total: float
    median: float | None


@dataclass(frozen=True, slots=True)
class TimeChange:
    name: str
    """Type of node, or path of a node in A (in B for a node that only B has)."""
    a: TimeUse
    b: TimeUse

    @property
    def change(self) -> float:
        """Difference of the total times, B minus A, simulated s."""
        return self.b.total - self.a.total


@dataclass(frozen=True, slots=True)
class CountChange:
    """Number of occurrences in the two runs."""

    name: str
    a: int
    b: int


@dataclass(frozen=True, slots=True)
class EndingChange:
    """Number of visits of a node with that outcome. `path` as in `TimeChange.name`."""

    path: str
    outcome: str
    a: int
    b: int


@dataclass(frozen=True, slots=True)
class TimeSpent:
    """Changes of durations, the largest first."""

    by_type: tuple[TimeChange, ...]
    """Changes by type, of leaves only: their times are the robot's activities and do not overlap."""
    by_node: tuple[TimeChange, ...]
    """Changes by node, of all nodes; the time of a node contains that of the nodes below it."""


def time_spent(alignment: Alignment) -> TimeSpent:
    nodes = alignment.nodes
    inner = {side: nodes.inner(side) for side in SIDES}
    leaves_a, leaves_b = ([v for v in alignment.visits(side) if v.path not in inner[side]] for side in SIDES)
    path_in_a = nodes.a_by_b
    return TimeSpent(
        _changes(_grouped(leaves_a, lambda v: v.id), _grouped(leaves_b, lambda v: v.id)),
        _changes(
            _grouped(alignment.visits_a, lambda v: v.path),
            _grouped(alignment.visits_b, lambda v: path_in_a.get(v.path, v.path)),
        ),
    )


def cause_changes(alignment: Alignment) -> tuple[CountChange, ...]:
    """Return the number of failures of nodes themselves by cause, all causes of both runs by name."""
    ours = Counter(visit.cause for visit in alignment.visits_a if visit.failed_itself)
    theirs = Counter(visit.cause for visit in alignment.visits_b if visit.failed_itself)
    return tuple(CountChange(cause, ours[cause], theirs[cause]) for cause in sorted({*ours, *theirs}))


def ending_changes(alignment: Alignment) -> tuple[EndingChange, ...]:
    """Return the outcomes of nodes whose numbers differ, in the order of A's tree; nodes that only B has come
    last."""
    path_in_a = alignment.nodes.a_by_b
    ours = Counter((visit.path, visit.outcome) for visit in alignment.visits_a)
    theirs = Counter((path_in_a.get(v.path, v.path), v.outcome) for v in alignment.visits_b)
    order = {pair.a.path: n for n, pair in enumerate(alignment.nodes.pairs)}
    keys = sorted({*ours, *theirs}, key=lambda key: (order.get(key[0], len(order)), key))
    return tuple(EndingChange(*key, ours[key], theirs[key]) for key in keys if ours[key] != theirs[key])


def _grouped(
    visits: Iterable[node_visits.Visit], name: Callable[[node_visits.Visit], str]
) -> dict[str, list[float]]:
    grouped: dict[str, list[float]] = defaultdict(list)
    for visit in visits:
        grouped[name(visit)].append(visit.duration)
    return grouped


def _changes(a: dict[str, list[float]], b: dict[str, list[float]]) -> tuple[TimeChange, ...]:
    changes = [
        TimeChange(name, _time_use(a.get(name)), _time_use(b.get(name))) for name in dict.fromkeys((*a, *b))
    ]
    return tuple(sorted(changes, key=lambda change: -abs(change.change)))


def _time_use(seconds: list[float] | None) -> TimeUse:
    if not seconds:
        return TimeUse(0, 0.0, None)
    return TimeUse(len(seconds), sum(seconds), statistics.median(seconds))


State: TypeAlias = Literal["done", "held", "left", "gone"]
"""State of an item at the end, as the robot believed.

`done`: at its destination; `held`: in the hand; `left`: somewhere else; `gone`: not in the belief.
"""


@dataclass(frozen=True, slots=True)
class ItemEnd:
    """End of one item in one run. Times are simulated s."""

    id: str
    state: State
    place: str
    """Believed place: a bin, the table, in the hand; empty when gone."""
    begun: float | None
    """Start of the first visit for the item; None: no visit."""
    done: float | None
    """Time of its last placement at its destination; None: never."""
    busy: float
    """Total time of its visits; nested ones count once."""
    grasps: int
    """Number of times that the fingers closed on it."""
    failures: int
    """Number of failures of nodes themselves during their visits for it."""


@dataclass(frozen=True, slots=True)
class ItemChange:
    """Item in two runs; None where that run did not know it."""

    a: ItemEnd | None
    b: ItemEnd | None
    basis: Basis | None
    """Basis of the pair; None when only one run knew the item."""

    @property
    def differs(self) -> bool:
        """Whether the item ended differently: in another state or place."""
        return (
            self.a is None or self.b is None or (self.a.state, self.a.place) != (self.b.state, self.b.place)
        )


def item_changes(a: Run, b: Run, alignment: Alignment) -> tuple[ItemChange, ...]:
    """Return all items of both runs, in the order in which A discovered them; items that only B knew come
    last."""
    match = alignment.items
    ours = _ends(a, alignment.visits_a, alignment.since)
    theirs = _ends(b, alignment.visits_b, alignment.since)
    basis = {pair.a: pair for pair in match.pairs}
    changes: list[ItemChange] = []
    for name, end in ours.items():
        pair = basis.get(name)
        changes.append(ItemChange(end, theirs.get(pair.b) if pair else None, pair.basis if pair else None))
    changes += [ItemChange(None, theirs[name], None) for name in match.only_b if name in theirs]
    return tuple(changes)


def _ends(run: Run, visits: Sequence[node_visits.Visit], since: float) -> dict[str, ItemEnd]:
    """Return the ends of all bodies of the role `item` in the belief from `since` on, in the order of
    discovery."""
    done = {
        at.record.object: (at.time, at.record)
        for at in run.events
        if isinstance(at.record, event_types.ItemDoneEvent) and at.time >= since
    }
    last = run.log.belief_at(run.end)
    believed = {body.id: body for body in last.record.bodies} if last else {}
    ends: dict[str, ItemEnd] = {}
    for name in [body.id for body in first_bodies(run, since) if body.role == "item"]:
        body, event = believed.get(name), done.get(name)
        state: State = "gone" if body is None else "held" if body.attached else "left"
        place = "" if body is None else "in the hand" if body.attached else body.place
        if event is not None and state == "left" and body is not None:
            into = body.place if event[1].into is None else event[1].into
            state = "done" if body.place in ("", into) else "left"
            place = body.place or into
        about = [visit for visit in visits if visit.item == name]
        ends[name] = ItemEnd(
            name,
            state,
            place,
            min((visit.start for visit in about), default=None),
            event[0] if event and state == "done" else None,
            node_visits.covered_time((visit.start, visit.end) for visit in about),
            sum(pick.object == name and pick.time >= since for pick in run.picks),
            sum(visit.failed_itself for visit in about),
        )
    return ends


@dataclass(frozen=True, slots=True)
class RunOutcome:
    log: Path
    recovered: str
    """Sentence when the file was not finished; else empty."""
    status: str
    message: str
    """Reason why the tree failed; else empty."""
    end: float
    """End of the run, simulated s."""
    items_total: int | None
    """Number of items, from the scorer; None when the run was killed."""
    items_sorted: int | None
    items_done: int
    """Number of items at their destination, as the robot believed."""
    picks_tried: int
    picks_held: int
    failures: Mapping[str, int]
    """Number of failures of nodes themselves, by cause."""
    recoveries: int
    """Number of handler runs that `Recover` and `RecoveryNode` announced."""
    digest: str
    """Digest of the run, in hex; empty when it was killed."""


def outcome_of(run: Run) -> RunOutcome:
    result = run.result
    failures = Counter(visit.cause for visit in run.account.visits if visit.failed_itself)
    kinds = Counter(at.record.kind for at in run.events)
    return RunOutcome(
        log=run.path,
        recovered=run.recovered,
        status=run.status,
        message="" if result is None else result.message,
        end=run.last_tick,
        items_total=None if result is None else result.items.total,
        items_sorted=None if result is None else result.items.sorted,
        items_done=kinds["item_done"],
        picks_tried=len(run.picks),
        picks_held=sum(pick.held for pick in run.picks),
        failures=dict(sorted(failures.items())),
        recoveries=kinds["recovery"],
        digest="" if result is None else result.digest,
    )
