"""Text output of a rehearsal: trace and verdict of each case, and the coverage gaps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping

from ...world.journal import Plain
from .rehearsal_result import CaseResult, CauseRaised, Coverage, CoveragePoint, Rehearsal
from .trace import (
    ConditionAnswered,
    ControlFailed,
    Event,
    FailureHandled,
    KeyWritten,
    LeafEnded,
    LeafRun,
    LeafStarted,
)

_MAX_NAME_WIDTH = 44
"""Maximum column width for node names; a longer name moves the rest of its line."""


def trace_lines(events: tuple[Event, ...], names: Mapping[str, str]) -> list[str]:
    """Return the lines of a trace; `names` gives the displayed names of nodes by path.

    There is a line for each start and end of a leaf, write, handled failure and note. Start and end share a
    line when nothing happens between them.
    """
    rows = [(when, names.get(path, path), what) for when, path, what in _rows(events)]
    wide = max((len(when) for when, _, _ in rows), default=0)
    width = min(_MAX_NAME_WIDTH, max((len(name) for _, name, _ in rows), default=0))
    return [f"  {when:>{wide}}  {name:<{width}}  {what}".rstrip() for when, name, what in rows]


def _rows(events: tuple[Event, ...]) -> Iterator[tuple[str, str, str]]:
    """Yield (tick or ticks, path of the node, action) for each line."""
    for index, event in enumerate(events):
        if isinstance(event, LeafStarted):
            written, after = _writes(events, index + 1, event.run)
            ended = events[after] if after < len(events) else None
            if isinstance(ended, LeafEnded) and ended.run is event.run:
                yield _ticks(event.run), event.run.path, _ending(event.run, written)
                continue
            yield f"{event.tick}", event.run.path, "starts"
        elif isinstance(event, LeafEnded):
            if not _in_one_line(events, index):
                yield f"{event.tick}", event.run.path, _ending(event.run, {})
        elif isinstance(event, KeyWritten):
            if not _told_with_its_run(events, index):
                yield f"{event.tick}", event.path, f"{event.key.rpartition('/')[2]} = {show(event.value)}"
        elif isinstance(event, ConditionAnswered):
            yield f"{event.tick}", event.path, event.status.value
        elif isinstance(event, ControlFailed):
            yield f"{event.tick}", event.path, f"FAILURE {event.cause}: {event.message}"
        elif isinstance(event, FailureHandled):
            handler = f" with '{event.handler}'" if event.handler else ""
            yield f"{event.tick}", event.by, f"takes up {event.cause}{handler}"
        else:
            yield f"{event.tick}", event.path, event.message


def _writes(events: tuple[Event, ...], index: int, run: LeafRun) -> tuple[dict[str, Plain], int]:
    """Return a leaf's writes right after its start, and the index of the event after them."""
    written: dict[str, Plain] = {}
    while index < len(events):
        event = events[index]
        if not isinstance(event, KeyWritten) or event.path != run.path:
            break
        written[event.key.rpartition("/")[2]] = event.value
        index += 1
    return written, index


def _in_one_line(events: tuple[Event, ...], index: int) -> bool:
    """Whether an end shares the line of its start."""
    ended = events[index]
    while index > 0 and isinstance(events[index - 1], KeyWritten):
        index -= 1
    before = events[index - 1] if index > 0 else None
    return isinstance(ended, LeafEnded) and isinstance(before, LeafStarted) and before.run is ended.run


def _told_with_its_run(events: tuple[Event, ...], index: int) -> bool:
    while index < len(events) and isinstance(events[index], KeyWritten):
        index += 1
    return index < len(events) and isinstance(events[index], LeafEnded) and _in_one_line(events, index)


def _ticks(run: LeafRun) -> str:
    return f"{run.tick}" if run.last in (None, run.tick) else f"{run.tick}–{run.last}"


def _ending(run: LeafRun, written: Mapping[str, Plain]) -> str:
    what = f"FAILURE {run.cause}: {run.message}" if run.cause else run.outcome
    outputs = ", ".join(f"{key} = {show(value)}" for key, value in written.items())
    return f"{what}  {outputs}" if outputs else what


def show(value: Plain) -> str:
    """Return a blackboard value in one line as YAML writes it, shortened when long."""
    match value:
        case None:
            text = "null"
        case bool():
            text = str(value).lower()
        case list():
            text = f"[{', '.join(map(show, value))}]"
        case dict():
            text = "{" + ", ".join(f"{key}: {show(item)}" for key, item in value.items()) + "}"
        case _:
            text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."


_STARTS = ("node", "branch")
"""Kinds of points that are reached when a node starts."""


def to_text(rehearsal: Rehearsal, *, quiet: bool = False, causes: bool = False) -> str:
    """Return trace and verdict of each case, then the coverage if all cases ran, without a trailing newline.

    `quiet`: no traces. `causes`: also list the declared causes that no case has raised.
    """
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
    recovery = coverage.recovery
    if recovery.points:
        told = f"{recovery.reached} of {len(recovery.points)} branches of recovery reached"
        lines.append(f"recovery  {recovery.percent} %: {told}")
    raised = sum(cause.raised for cause in coverage.causes)
    lines.append(f"causes    {raised} of {len(coverage.causes)} that leaves declare are raised by some case")
    if causes:
        lines += [_never_raised(cause) for cause in coverage.causes if not cause.raised]
    return lines


def _missed(missed: tuple[CoveragePoint, ...]) -> list[str]:
    """Return a line for each missed point; points inside an unused branch are implied and left out."""
    starts = {point.node for point in missed if point.kind in _STARTS}
    said = [point for point in missed if _head(point, starts) is None]
    below = Counter(_head(point, starts) for point in missed if point.kind in _STARTS)
    lines: list[str] = []
    for point in said:
        count = below[point.node] if point.kind in _STARTS else 0
        rest = f", nor {count} below" if count else ""
        lines.append(f"    {point.mark}: {point.node}: {point.missed}{rest}")
    return lines


def _head(point: CoveragePoint, starts: Collection[str]) -> str | None:
    """Return the uppermost ancestor that never starts; for points about a result, the node itself counts,
    too."""
    parts = point.node.split("/")
    most = len(parts) if point.kind in _STARTS else len(parts) + 1
    ends = ("/".join(parts[:n]) for n in range(1, most))
    return next((end for end in ends if end in starts), None)


def _never_raised(cause: CauseRaised) -> str:
    return f"    {cause.mark}: {cause.node}: never fails with {cause.cause}"
