"""A rehearsal as text: the trace of each case, its verdict, and what no case has reached."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping

from .coverage import CauseRaised, Coverage, Point
from .rehearsal_result import CaseResult, Rehearsal
from .trace_text import trace_lines

_STARTS = ("node", "branch")
"""Kinds of points that are reached when a node starts."""


def to_text(rehearsal: Rehearsal, *, quiet: bool = False, causes: bool = False) -> str:
    """Trace and verdict of each case, then the coverage if these were all cases, without a line's end.
    `quiet`: no traces; `causes`: also which declared causes no case has raised."""
    lines: list[str] = []
    for case in rehearsal.cases:
        lines += _case(case, rehearsal.names, quiet=quiet)
    if rehearsal.complete:
        lines += _coverage(rehearsal.coverage, causes=causes)
    passed, total = len(rehearsal.cases) - len(rehearsal.failed), len(rehearsal.cases)
    what = "case" if total == 1 else "cases"
    lines.append(f"{rehearsal.mission}: {passed} of {total} {what} passed")
    return "\n".join(lines)


def _case(case: CaseResult, names: Mapping[str, str], *, quiet: bool) -> list[str]:
    ticks = f"{case.ticks} tick" + ("" if case.ticks == 1 else "s")
    end = case.status + (f" {case.cause}" if case.cause else "")
    verdict = f"{'passed' if case.passed else 'FAILED'}  {case.name}: {end} after {ticks}, {case.seconds:g} s"
    below = [f"    {difference}" for difference in case.differences]
    below += [f"    {mark}: no leaf has given this answer" for mark in case.unused]
    if quiet:
        return [verdict, *below]
    title = f"{case.name}: {case.doc}" if case.doc else case.name
    return [title, *trace_lines(case.events, names), verdict, *below, ""]


def _coverage(coverage: Coverage, *, causes: bool) -> list[str]:
    lines = [f"coverage  {coverage.percent} %: {coverage.reached} of {len(coverage.points)} reached"]
    if coverage.missed:
        lines[0] += "; what no case reaches:"
    lines += _missed(coverage.missed)
    raised = sum(cause.raised for cause in coverage.causes)
    lines.append(f"causes    {raised} of {len(coverage.causes)} that leaves declare are raised by some case")
    if causes:
        lines += [_never_raised(cause) for cause in coverage.causes if not cause.raised]
    return lines


def _missed(missed: tuple[Point, ...]) -> list[str]:
    """A line for each that does not go without saying: what stands in a branch that is never used does."""
    starts = {point.node for point in missed if point.kind in _STARTS}
    said = [point for point in missed if _head(point, starts) is None]
    below = Counter(_head(point, starts) for point in missed if point.kind in _STARTS)
    lines: list[str] = []
    for point in said:
        count = below[point.node] if point.kind in _STARTS else 0
        rest = f", nor {count} below" if count else ""
        lines.append(f"    {point.mark}: {point.node}: {point.missed}{rest}")
    return lines


def _head(point: Point, starts: Collection[str]) -> str | None:
    """The uppermost node above it that never starts; itself where it is about what the node would answer."""
    parts = point.node.split("/")
    most = len(parts) if point.kind in _STARTS else len(parts) + 1
    ends = ("/".join(parts[:n]) for n in range(1, most))
    return next((end for end in ends if end in starts), None)


def _never_raised(cause: CauseRaised) -> str:
    return f"    {cause.mark}: {cause.node}: never fails with {cause.cause}"
