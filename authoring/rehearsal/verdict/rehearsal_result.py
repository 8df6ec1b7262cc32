"""Result of a rehearsal as values, and as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ....files.marks import Diagnostic, Mark
from ....world.journal import Plain
from ..stage.trace import (
    ConditionAnswered,
    ControlFailed,
    Event,
    FailureHandled,
    KeyWritten,
    LeafEnded,
    LeafRun,
    LeafStarted,
    NoteTaken,
)
from .coverage import Coverage
from .verdict import ExpectationMiss


@dataclass(frozen=True, slots=True)
class CaseResult:
    """Result of one case: its end, and its differences from the expectation."""

    name: str
    doc: str
    mark: Mark
    status: str
    """Last status of the mission."""
    cause: str
    message: str
    ticks: int
    seconds: float
    """Simulated time, s."""
    differences: tuple[ExpectationMiss, ...]
    runs: tuple[LeafRun, ...]
    """Runs of the leaves, in the order of their starts."""
    handled: tuple[FailureHandled, ...]
    events: tuple[Event, ...]
    unused: tuple[Mark, ...]
    """Answers of the case itself that no leaf has used."""

    @property
    def passed(self) -> bool:
        return not self.differences


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """Results of all cases of a file, or of the selected ones."""

    mission: str
    file: Path
    cases: tuple[CaseResult, ...]
    coverage: Coverage
    complete: bool
    """Whether all cases of the file were rehearsed."""
    warnings: tuple[Diagnostic, ...]
    """Warnings about the cases file."""
    names: Mapping[str, str]
    """Short names of the nodes for display, by path."""

    @property
    def passed(self) -> bool:
        return all(case.passed for case in self.cases)

    @property
    def failed(self) -> tuple[CaseResult, ...]:
        return tuple(case for case in self.cases if not case.passed)


def to_json(rehearsal: Rehearsal) -> dict[str, Plain]:
    """Return the whole result, traces included."""
    return {
        "mission": rehearsal.mission,
        "file": str(rehearsal.file),
        "passed": rehearsal.passed,
        "complete": rehearsal.complete,
        "warnings": [
            {"place": _place(w.mark), "code": w.code, "where": w.where, "message": w.message, "hint": w.hint}
            for w in rehearsal.warnings
        ],
        "cases": [_case(case) for case in rehearsal.cases],
        "coverage": _coverage(rehearsal.coverage),
    }


def to_json_text(rehearsal: Rehearsal) -> str:
    """Return one JSON object with a trailing newline."""
    return json.dumps(to_json(rehearsal), ensure_ascii=False, indent=2, allow_nan=False) + "\n"


def _case(case: CaseResult) -> dict[str, Plain]:
    return {
        "name": case.name,
        "doc": case.doc,
        "place": _place(case.mark),
        "passed": case.passed,
        "status": case.status,
        "cause": case.cause or None,
        "message": case.message,
        "ticks": case.ticks,
        "seconds": case.seconds,
        "differences": [
            {"place": _place(d.mark), "where": d.where, "message": d.message, "tick": d.tick}
            for d in case.differences
        ],
        "unused_answers": [_place(mark) for mark in case.unused],
        "leaves": [_run(run) for run in case.runs],
        "handled": [_handled(one) for one in case.handled],
        "events": [_event(event) for event in case.events],
    }


def _run(run: LeafRun) -> dict[str, Plain]:
    return {
        "node": run.path,
        "tick": run.tick,
        "last": run.last,
        "outcome": run.outcome,
        "cause": run.cause or None,
        "message": run.message,
    }


def _handled(one: FailureHandled) -> dict[str, Plain]:
    return {
        "tick": one.tick,
        "cause": one.cause,
        "failed": one.failed,
        "by": one.by,
        "handler": one.handler or None,
    }


def _event(event: Event) -> dict[str, Plain]:
    match event:
        case LeafStarted(tick, run):
            return {"tick": tick, "kind": "started", "node": run.path}
        case LeafEnded(tick, run):
            return {
                "tick": tick,
                "kind": "ended",
                "node": run.path,
                "outcome": run.outcome,
                "cause": run.cause or None,
            }
        case ConditionAnswered(tick, path, status):
            return {"tick": tick, "kind": "answered", "node": path, "outcome": status.value}
        case KeyWritten(tick, path, key, value):
            return {"tick": tick, "kind": "wrote", "node": path, "key": key, "value": value}
        case ControlFailed(tick, path, cause, message):
            return {"tick": tick, "kind": "failed", "node": path, "cause": cause, "message": message}
        case FailureHandled():
            return {"kind": "handled", **_handled(event)}
        case NoteTaken(tick, path, kind, message):
            return {"tick": tick, "kind": "noted", "node": path, "about": kind, "message": message}


def _coverage(coverage: Coverage) -> dict[str, Plain]:
    return {
        "percent": coverage.percent,
        "reached": coverage.reached,
        "total": len(coverage.points),
        "missed": [
            {"place": _place(p.mark), "node": p.node, "kind": p.kind, "message": p.missed}
            for p in coverage.missed
        ],
        "causes": [
            {"place": _place(c.mark), "node": c.node, "cause": c.cause, "raised": c.raised}
            for c in coverage.causes
        ],
    }


def _place(mark: Mark) -> dict[str, Plain]:
    return {"file": mark.file, "line": mark.line, "column": mark.column}
