"""Result of a rehearsal as values, and as JSON.

Coverage of a mission's text by cases: nodes, branches of recovery and choice, both results of
conditions.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

from ...files.marks import Diagnostic, Mark
from ...world.causes import all_causes, matches
from ...world.journal import Plain
from .mission_staging import StubbedMission
from .trace import (
    ConditionAnswered,
    ControlFailed,
    Event,
    FailureHandled,
    KeyWritten,
    LeafEnded,
    LeafRun,
    LeafStarted,
    NodeRole,
    NoteTaken,
    Trace,
)
from .verdict import ExpectationMiss

PointKind: TypeAlias = Literal["node", "branch", "expression", "answer"]


@dataclass(frozen=True, slots=True)
class CoveragePoint:
    """Part of a mission that a case can reach. `node`: path in the tree of the file that `mark` is in."""

    kind: PointKind
    mark: Mark
    node: str
    missed: str
    """Message when no case reaches the point: `never starts`."""
    reached: bool
    recovers: bool = False
    """Whether it is the start of a branch of recovery: a node that runs only after a failure."""


@dataclass(frozen=True, slots=True)
class CauseRaised:
    """Cause that a leaf declares, and whether some case makes it fail so."""

    mark: Mark
    node: str
    cause: str
    raised: bool


@dataclass(frozen=True, slots=True)
class Coverage:
    """All points in the order of the mission's text. Causes are counted apart: no mission needs them all."""

    points: tuple[CoveragePoint, ...]
    causes: tuple[CauseRaised, ...]

    @property
    def missed(self) -> tuple[CoveragePoint, ...]:
        return tuple(point for point in self.points if not point.reached)

    @property
    def full(self) -> bool:
        return not self.missed

    @property
    def reached(self) -> int:
        return len(self.points) - len(self.missed)

    @property
    def percent(self) -> int:
        """Share of reached points, %, rounded down, so that 100 means all."""
        return 100 * self.reached // len(self.points) if self.points else 100

    @property
    def recovery(self) -> Coverage:
        """Coverage of the branches of recovery alone, each by its start."""
        return Coverage(tuple(point for point in self.points if point.recovers), ())


def coverage_gaps(coverage: Coverage, *, full: bool, recovery: int) -> tuple[str, ...]:
    """Return a sentence for each demand that the coverage misses.

    `full`: every point is demanded. `recovery`: least share of the branches of recovery, %.
    """
    gaps: list[str] = []
    if full and not coverage.full:
        gaps.append(
            f"coverage is {coverage.percent} %: {len(coverage.missed)} of {len(coverage.points)} are not "
            "reached, and --full-coverage demands all"
        )
    below = coverage.recovery
    if 100 * below.reached < recovery * len(below.points):
        missed = ", ".join(point.node for point in below.missed[:3]) + (", …" if below.missed[3:] else "")
        gaps.append(
            f"coverage of recovery is {below.percent} %, less than {recovery} %: no case reaches {missed}"
        )
    return tuple(gaps)


@dataclass(slots=True)
class CoverageRecord:
    """Coverage of the cases so far, by paths in the file's trees; expressions record their own results."""

    started: set[str] = field(default_factory=set[str])
    raised: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])
    answered: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])

    def take(self, staging: StubbedMission, trace: Trace) -> None:
        """Add the coverage of one case."""
        texts = staging.texts
        self.started |= {texts[path] for path in trace.started if path in texts}
        self.raised |= {(texts[path], cause) for path, cause in trace.raised if path in texts}
        self.answered |= {(texts[run.path], run.outcome) for run in trace.runs}


def coverage(staging: StubbedMission, reached: CoverageRecord) -> Coverage:
    """Return the coverage of all points; trees that are never called do not count."""
    roles = {role.text: role for role in staging.roles.all}
    points = [point for role in roles.values() for point in _points(staging, reached, role)]
    causes = [cause for role in roles.values() if role.played for cause in _causes(reached, role)]
    return Coverage(tuple(sorted(points, key=lambda p: p.mark)), tuple(causes))


def _points(staging: StubbedMission, reached: CoverageRecord, role: NodeRole) -> Iterator[CoveragePoint]:
    mark, text = role.spec.mark, role.text
    missed = f"'{role.branch}' is never used" if role.branch else "never starts"
    kind: PointKind = "branch" if role.branch else "node"
    yield CoveragePoint(kind, mark, text, missed, text in reached.started, role.recovers)
    if role.played and role.spec.node is not None and role.spec.node.kind == "condition":
        for answer in ("SUCCESS", "FAILURE"):
            yield CoveragePoint("answer", mark, text, f"never {answer}", (text, answer) in reached.answered)
    for key, expression in staging.expressions.get(text, {}).items():
        name = key.split()[0]
        place = role.spec.places.get(name, mark)
        if name in role.spec.postconditions:
            yield CoveragePoint("expression", place, text, f"'{name}' never runs", bool(expression.seen))
        elif expression.names:
            for answer in (True, False):
                missed = f"'{key}: {expression}' is never {str(answer).lower()}"
                yield CoveragePoint("expression", place, text, missed, answer in expression.seen)


def _causes(reached: CoverageRecord, role: NodeRole) -> Iterator[CauseRaised]:
    declared = [str(cause) for cause in role.causes]
    for cause in all_causes():
        if any(matches(pattern, cause) for pattern in declared):
            raised = (role.text, cause.name) in reached.raised
            yield CauseRaised(role.spec.mark, role.text, cause.name, raised)


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
        "recovery": {
            "percent": coverage.recovery.percent,
            "reached": coverage.recovery.reached,
            "total": len(coverage.recovery.points),
        },
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
