"""Events panel: journal events, plans, changes of the belief and failures in one list."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import orjson

from ...logs.episodes.episode_counts import CauseCount
from ...logs.schema.records import Plan
from ..run import Run
from .packing import Packable, Section, StringTable


def pack_failures(run: Run) -> Section:
    """Pack all of `run.explanation`, field by field, with the causes of its episodes in `causes`."""
    explanation = run.explanation
    named = {field.name: plain_value(getattr(explanation, field.name)) for field in fields(explanation)}
    causes = explanation.recovery.causes
    return Section("failures", {**named, "causes": [_packed_cause(each) for each in causes]})


def _packed_cause(found: CauseCount) -> dict[str, Packable]:
    """Return counts, time lost and cures of a cause."""
    total = found.total
    return {
        "cause": found.cause,
        "seen": total.seen,
        "cured": total.cured,
        "seconds": total.seconds,
        "told": found.to_text(),
    }


def plain_value(value: object) -> Packable:
    """Return a dataclass and its content as JSON: fields by name."""
    plain: Packable = orjson.loads(orjson.dumps(value, default=str, option=orjson.OPT_NON_STR_KEYS))
    return plain


_KINDS_WITH_PANEL: Final = frozenset({"image"})
"""Kinds of event with a panel of their own."""
_ORDER_IN_TICK: Final = {"failure": 1, "recovery": 2, "handled": 3}
"""Order of events within one tick."""


@dataclass(frozen=True, slots=True)
class ReportEvent:
    time: float
    """Time of the event, simulated s."""
    kind: str
    text: str
    node: str


def pack_events(run: Run) -> Section:
    found = report_events(run)
    if not found:
        return Section("events", {"empty": "The log tells of no event."})
    words = StringTable()
    return Section(
        "events",
        {
            "time": np.array([one.time for one in found], dtype=np.float64),
            "kind": words.numbers([one.kind for one in found]),
            "text": words.numbers([one.text for one in found]),
            "node": words.numbers([one.node for one in found]),
            "words": list(words.texts),
        },
    )


def report_events(run: Run) -> tuple[ReportEvent, ...]:
    """Return the events in order of time; in one tick failures before their recoveries."""
    found = [*_events(run), *_plans(run), *_lines(run)]
    return tuple(sorted(found, key=lambda one: (one.time, _ORDER_IN_TICK.get(one.kind, 0))))


def _events(run: Run) -> Iterator[ReportEvent]:
    for at in run.events:
        event = at.record
        if event.kind not in _KINDS_WITH_PANEL:
            yield ReportEvent(at.time, event.kind, event.message, event.node)


def _plans(run: Run) -> Iterator[ReportEvent]:
    for at in run.plans:
        kind = "plan" if at.record.outcome == "found" else "no plan"
        yield ReportEvent(at.time, kind, plan_line(at.record), "")


def plan_line(plan: Plan) -> str:
    """Return a plan in one line."""
    cost = f"{plan.checks} checks by {plan.planner}" if plan.planner else f"{plan.checks} checks"
    if plan.outcome == "found":
        return f"{plan.request}: {plan.duration:.2f} s of motion, {cost}"
    said = f": {plan.message}" if plan.message else ""
    return f"{plan.request}: {plan.outcome}{said} ({cost})"


def _lines(run: Run) -> Iterator[ReportEvent]:
    """Yield the log lines without an event: failures, and messages of the mission."""
    told = {(at.time, at.record.message) for at in run.events}
    for at in run.lines:
        line = at.record
        if (at.time, line.message) not in told:
            kind = "failure" if line.level in ("ERROR", "FATAL") else "log"
            yield ReportEvent(at.time, kind, line.message, line.name)
