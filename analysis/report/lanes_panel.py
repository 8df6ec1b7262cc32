"""Lanes panel: each node's visits over time, and the item in work."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import orjson

from ...logs.schema.event_records import BeliefEvent
from ...logs.visits import HALTED, Visit
from ..run import Run
from .packing import Packable, Section, StringTable
from .tick_table import ABSENT, STATUSES, TICKED, TickTable, tick_table

OUTCOMES: Final = ("RUNNING", "SUCCESS", "FAILURE", "SKIPPED", HALTED)
"""Outcomes by code."""

_MARKED_KINDS: Final = frozenset({"recovery", "fault", "item_done", "safety_stop", "mission_edited"})
"""Kinds of event that the lanes mark."""


@dataclass(frozen=True, slots=True)
class ItemSpan:
    """Span of ticks in which nodes worked on one item."""

    item: str
    first: int
    """Number of the first tick."""
    last: int
    outcome: str
    """Outcome of the last visit for the item."""
    visit: int


def pack_lanes(run: Run) -> Section:
    table = tick_table(run)
    if not len(table.times):
        return Section("lanes", {"empty": "The log holds no tick."})
    whole = run.log.format >= 2
    visits = run.visits if whole else tuple(_visits_from_statuses(table))
    colours = _colours(run)
    return Section(
        "lanes",
        {
            "nodes": _nodes(table),
            "outcomes": list(OUTCOMES),
            "visits": _visits(visits, table),
            "items": [
                {
                    "item": span.item,
                    "first": span.first,
                    "last": span.last,
                    "outcome": span.outcome,
                    "colour": colours.get(span.item, ""),
                    "visit": span.visit,
                }
                for span in item_spans(visits)
            ],
            "marks": [
                {
                    "time": at.time,
                    "kind": at.record.kind,
                    "message": at.record.message,
                    "node": at.record.node,
                }
                for at in run.events
                if at.record.kind in _MARKED_KINDS
            ],
            "note": ""
            if whole
            else "This log is of format 1: beginnings and ends are told from the statuses of the ticks, "
            "without inputs and items.",
        },
    )


def item_spans(visits: Sequence[Visit]) -> tuple[ItemSpan, ...]:
    """Return the spans in order of time.

    Work on an item by several nodes in a row is one span; the next visit of a node begins another.
    """
    spans: list[ItemSpan] = []
    paths: set[str] = set()
    for visit in visits:
        around = "" if visit.parent is None else visits[visit.parent].item
        if not visit.item or around:
            continue
        if spans and spans[-1].item == visit.item and visit.path not in paths:
            before = spans.pop()
            span = ItemSpan(
                visit.item, before.first, max(before.last, visit.last), visit.outcome, visit.number
            )
        else:
            paths.clear()
            span = ItemSpan(visit.item, visit.first, visit.last, visit.outcome, visit.number)
        spans.append(span)
        paths.add(visit.path)
    return tuple(spans)


def _nodes(table: TickTable) -> list[Packable]:
    return [
        {"path": node.path, "id": node.id, "name": node.name, "parent": node.parent, "leaf": node.leaf}
        for node in table.nodes
    ]


def _visits(visits: Sequence[Visit], table: TickTable) -> Packable:
    """Pack the visits by column, in order of their starts.

    Texts are numbers of `words`; inputs and evidence are JSON.
    """
    numbers = {node.path: number for number, node in enumerate(table.nodes)}
    known = [visit for visit in visits if visit.path in numbers]
    places = {visit.number: place for place, visit in enumerate(known)}
    words = StringTable()
    columns: dict[str, Packable] = {
        "node": np.array([numbers[visit.path] for visit in known], dtype=np.uint16),
        "first": np.array([visit.first for visit in known], dtype=np.uint32),
        "last": np.array([visit.last for visit in known], dtype=np.uint32),
        "outcome": np.array([OUTCOMES.index(visit.outcome) for visit in known], dtype=np.uint8),
        "attempt": np.array([visit.attempt for visit in known], dtype=np.uint32),
        "parent": np.array(
            [-1 if visit.parent is None else places.get(visit.parent, -1) for visit in known], dtype=np.int32
        ),
        "item": words.numbers([visit.item for visit in known]),
        "cause": words.numbers([visit.cause for visit in known]),
        "origin": words.numbers([visit.origin for visit in known]),
        "message": words.numbers([visit.message for visit in known]),
        "inputs": words.numbers([_json(visit.inputs) for visit in known]),
        "evidence": words.numbers([_json(visit.evidence) for visit in known]),
    }
    return {**columns, "words": list(words.texts)}


def _json(values: object) -> str:
    return orjson.dumps(values).decode() if values else ""


def _colours(run: Run) -> dict[str, str]:
    """Return the colour of each item that ever was in the belief."""
    found: dict[str, str] = {}
    for at in run.events:
        if isinstance(at.record, BeliefEvent) and at.record.after is not None:
            found.setdefault(at.record.after.id, at.record.after.colour)
    return found


def _visits_from_statuses(table: TickTable) -> Iterator[Visit]:
    """Yield visits from the statuses alone, for a log without transitions.

    Events between two ticks are lost.
    """
    found: list[Visit] = []
    last = len(table.times) - 1
    for row, node in enumerate(table.nodes):
        for first, end, status in _runs(table, row):
            said = table.said.get((row, end))
            found.append(
                Visit(
                    number=0,
                    path=node.path,
                    id=node.id,
                    parent=None,
                    item="",
                    attempt=1,
                    start=float(table.times[first]),
                    end=float(table.times[end]),
                    first=first,
                    last=end,
                    outcome=HALTED if status == "RUNNING" and end < last else status,
                    cause=said.cause if said else "",
                    message=said.message if said else "",
                )
            )
    return iter(sorted(found, key=lambda visit: (visit.first, visit.path.count("/"))))


def _runs(table: TickTable, row: int) -> Iterator[tuple[int, int, str]]:
    """Yield first tick, last tick and outcome of each unbroken run of a node."""
    first: int | None = None
    for tick, code in enumerate(map(int, table.codes[row])):
        status = "IDLE" if code == ABSENT or code < TICKED else STATUSES[code - TICKED]
        if status == "RUNNING":
            first = tick if first is None else first
            continue
        if status != "IDLE":
            yield (tick if first is None else first), tick, status
        elif first is not None:
            yield first, tick - 1, "RUNNING"
        first = None
    if first is not None:
        yield first, table.codes.shape[1] - 1, "RUNNING"
