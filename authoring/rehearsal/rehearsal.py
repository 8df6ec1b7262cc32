"""Rehearsal of a mission: its real tree is ticked, and its leaves answer as each case defines; results as
values, text, JSON and JUnit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, TypeAlias

from picktree.authoring import check_mission
from picktree.files import (
    Diagnostic,
    FileError,
    JunitCase,
    Mark,
    PicktreeError,
    fault_codes,
    junit_text,
    short_names,
    suggest_name,
)
from picktree.files.yaml import Document, read_document
from picktree.trees import Mission, NodeStatus
from picktree.world import Plain, all_causes, matches

from .case_checks import examine_cases
from .cases import CaseFile, RehearsalCase
from .leaf_roles import NodeRole
from .mission_staging import StubbedMission, play_case, scene_of, stub_mission
from .rehearsal_world import TICK_PERIOD
from .trace import (
    ConditionAnswered,
    ControlFailed,
    Event,
    FailureHandled,
    KeyWritten,
    LeafEnded,
    LeafRun,
    LeafStarted,
    NoteTaken,
    Trace,
)
from .verdict import ExpectationMiss, differences

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
    roles = {role.text: role for role in staging.roles}
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

    @property
    def end(self) -> str:
        """Last status of the mission with its cause, and the number of ticks."""
        status = self.status + (f" {self.cause}" if self.cause else "")
        return f"{status} after {self.ticks} tick" + ("" if self.ticks == 1 else "s")


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
    coverage, recovery = rehearsal.coverage, rehearsal.coverage.recovery
    return {
        "mission": rehearsal.mission,
        "file": str(rehearsal.file),
        "passed": rehearsal.passed,
        "complete": rehearsal.complete,
        "warnings": [
            _fields(each, "mark", "code", "where", "message", "hint") for each in rehearsal.warnings
        ],
        "cases": [_case_json(case) for case in rehearsal.cases],
        "coverage": {
            **_share(coverage),
            "recovery": _share(recovery),
            "missed": [_fields(point, "mark", "node", "kind", "missed") for point in coverage.missed],
            "causes": [_fields(cause, "mark", "node", "cause", "raised") for cause in coverage.causes],
        },
    }


def _share(coverage: Coverage) -> dict[str, Plain]:
    return {**_fields(coverage, "percent", "reached"), "total": len(coverage.points)}


def _case_json(case: CaseResult) -> dict[str, Plain]:
    return {
        **_fields(case, "name", "doc", "mark", "passed", "status", "cause", "message", "ticks", "seconds"),
        "differences": [_fields(each, "mark", "where", "message", "tick") for each in case.differences],
        "unused_answers": [_place(mark) for mark in case.unused],
        "leaves": [_fields(run, "path", "tick", "last", "outcome", "cause", "message") for run in case.runs],
        "handled": [_fields(one, *_HANDLED) for one in case.handled],
        "events": [_event(event) for event in case.events],
    }


_HANDLED = ("tick", "cause", "failed", "by", "handler")
_KEYS = {"mark": "place", "path": "node", "missed": "message"}
"""Keys in JSON of fields with another name."""


def _fields(value: object, *names: str) -> dict[str, Plain]:
    """Return fields of a value for JSON: marks as places, null for a cause or handler that is empty."""
    found: dict[str, Plain] = {}
    for name in names:
        field = getattr(value, name)
        absent = name in ("cause", "handler") and not field
        found[_KEYS.get(name, name)] = None if absent else _place(field) if isinstance(field, Mark) else field
    return found


def _event(event: Event) -> dict[str, Plain]:
    match event:
        case LeafStarted():
            kind, found = "started", _fields(event.run, "path")
        case LeafEnded():
            kind, found = "ended", _fields(event.run, "path", "outcome", "cause")
        case ConditionAnswered():
            kind, found = "answered", {**_fields(event, "path"), "outcome": event.status.value}
        case KeyWritten():
            kind, found = "wrote", _fields(event, "path", "key", "value")
        case ControlFailed():
            kind, found = "failed", _fields(event, "path", "cause", "message")
        case FailureHandled():
            kind, found = "handled", _fields(event, *_HANDLED)
        case NoteTaken():
            kind, found = "noted", {**_fields(event, "path", "message"), "about": event.kind}
    return {"tick": event.tick, "kind": kind, **found}


def _place(mark: Mark) -> dict[str, Plain]:
    return {"file": mark.file, "line": mark.line, "column": mark.column}


def rehearse_files(
    mission: Path,
    cases: Path | None = None,
    names: Collection[str] = (),
    robot: str | None = None,
    *,
    text: str | None = None,
) -> Rehearsal:
    """Rehearse the files. Default for `cases`: the file with the mission's name in `cases` next to it.

    `robot`: shipped robot or robot file instead of the scene's; the mission is checked with its poses.
    `text`: the mission's text where it is not saved. Raises FileError with all errors of the mission, of its
    scene or of the cases.
    """
    if cases is None:
        cases = mission.parent / "cases" / mission.name
        if (text is not None or mission.is_file()) and not cases.is_file():
            raise PicktreeError(f"there are no cases {cases}; name the file with --cases")
    document = read_document(mission, "mission", text)
    loaded = check_mission(document, robot=robot).required()
    found = examine_cases(read_document(cases, "cases"), loaded)
    if found.errors:
        raise FileError(found.errors)
    given = found.cases.document
    codes = [page.code for page in fault_codes.pages()]
    warnings = fault_codes.apply_suppressions(
        found.faults, given.text, str(given.path), codes, complete=False
    )
    return replace(rehearse(loaded, found.cases, names), warnings=warnings)


def rehearse(mission: Mission, cases: CaseFile, names: Collection[str] = ()) -> Rehearsal:
    """Rehearse all cases of the file, or those with these names. The cases were checked for this mission.

    Raises PicktreeError for an unknown name, and for a faulty scene of the mission.
    """
    known = [case.name for case in cases.cases]
    for name in names:
        if name not in known:
            raise PicktreeError(f"{cases.document.path} has no case {name!r}; {suggest_name(name, known)}")
    staging = stub_mission(mission, scene_of(mission))
    reached = CoverageRecord()
    results = tuple(
        rehearse_case(staging, case, cases.document, reached)
        for case in cases.cases
        if not names or case.name in names
    )
    short = short_names([mission.main.name, *(role.path for role in staging.roles)])
    return Rehearsal(
        mission.name,
        cases.document.path,
        results,
        coverage(staging, reached),
        complete=len(results) == len(cases.cases),
        warnings=(),
        names=short,
    )


def rehearse_case(
    staging: StubbedMission, case: RehearsalCase, document: Document, reached: CoverageRecord
) -> CaseResult:
    tree, world = play_case(staging, case)
    trace = world.trace
    if trace.tick == case.entry.halt_after and tree.status is NodeStatus.RUNNING:
        trace.flush(tree.halt().writes)
    reached.take(staging, trace)
    return CaseResult(
        name=case.name,
        doc=case.entry.doc,
        mark=document.key_mark(case.loc),
        status=tree.status.value,
        cause=tree.failure.cause.name if tree.failure else "",
        message=tree.failure.message if tree.failure else "",
        ticks=trace.tick,
        seconds=round(trace.tick * TICK_PERIOD, 9),
        differences=differences(document, case, tree, world),
        runs=tuple(trace.runs),
        handled=tuple(trace.handled),
        events=tuple(trace.events),
        unused=tuple(document.mark(loc) for loc in world.prompter.unused() if loc[:1] == ("cases",)),
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
    index = 0
    while index < len(events):
        event = events[index]
        index += 1
        match event:
            case LeafStarted(tick, run):
                written: list[KeyWritten] = []
                for after in events[index:]:
                    if not isinstance(after, KeyWritten) or after.path != run.path:
                        break
                    written.append(after)
                if events[index + len(written) :][:1] == (LeafEnded(run.last or 0, run),):
                    ticks = f"{run.tick}" if run.last in (None, run.tick) else f"{run.tick}–{run.last}"
                    outputs = ", ".join(map(_assignment, written))
                    yield ticks, run.path, f"{_ending(run)}  {outputs}".rstrip()
                    index += len(written) + 1
                else:
                    yield f"{tick}", run.path, "starts"
            case LeafEnded(tick, run):
                yield f"{tick}", run.path, _ending(run)
            case KeyWritten(tick, path):
                yield f"{tick}", path, _assignment(event)
            case ConditionAnswered(tick, path, status):
                yield f"{tick}", path, status.value
            case ControlFailed(tick, path, cause, message):
                yield f"{tick}", path, f"FAILURE {cause}: {message}"
            case FailureHandled():
                handler = f" with '{event.handler}'" if event.handler else ""
                yield f"{event.tick}", event.by, f"takes up {event.cause}{handler}"
            case NoteTaken():
                yield f"{event.tick}", event.path, event.message


def _ending(run: LeafRun) -> str:
    return f"FAILURE {run.cause}: {run.message}" if run.cause else run.outcome


def _assignment(write: KeyWritten) -> str:
    return f"{write.key.rpartition('/')[2]} = {show(write.value)}"


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
        lines += _case_lines(case, rehearsal.names, quiet=quiet)
    if rehearsal.complete:
        lines += _coverage_lines(rehearsal.coverage, causes=causes)
    passed, total = len(rehearsal.cases) - len(rehearsal.failed), len(rehearsal.cases)
    what = "case" if total == 1 else "cases"
    lines.append(f"{rehearsal.mission}: {passed} of {total} {what} passed")
    return "\n".join(lines)


def _case_lines(case: CaseResult, names: Mapping[str, str], *, quiet: bool) -> list[str]:
    verdict = f"{'passed' if case.passed else 'FAILED'}  {case.name}: {case.end}, {case.seconds:g} s"
    below = [f"    {difference}" for difference in case.differences]
    below += [f"    {mark}: no leaf has given this answer" for mark in case.unused]
    if quiet:
        return [verdict, *below]
    title = f"{case.name}: {case.doc}" if case.doc else case.name
    return [title, *trace_lines(case.events, names), verdict, *below, ""]


def _coverage_lines(coverage: Coverage, *, causes: bool) -> list[str]:
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
        lines += [
            f"    {cause.mark}: {cause.node}: never fails with {cause.cause}"
            for cause in coverage.causes
            if not cause.raised
        ]
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
    """Return the uppermost ancestor that never starts; of points about a result also the node itself."""
    parts = point.node.split("/")
    most = len(parts) if point.kind in _STARTS else len(parts) + 1
    ends = ("/".join(parts[:n]) for n in range(1, most))
    return next((end for end in ends if end in starts), None)


def to_junit(rehearsal: Rehearsal, gaps: Iterable[str] = ()) -> str:
    """Return a file with a test case for each case, and one that fails for each of the `gaps` in coverage.

    Times are simulated seconds.
    """
    group = rehearsal.file.stem
    cases = [_junit_case(rehearsal, case, group) for case in rehearsal.cases]
    file = str(rehearsal.file)
    cases += [
        JunitCase(group, "coverage", outcome="failure", kind="coverage", message=gap, detail=gap, file=file)
        for gap in gaps
    ]
    coverage = rehearsal.coverage
    properties = {
        "coverage": f"{coverage.percent} %",
        "recovery coverage": f"{coverage.recovery.percent} %",
    }
    return junit_text(rehearsal.mission, cases, properties if rehearsal.complete else None)


def _junit_case(rehearsal: Rehearsal, case: CaseResult, group: str) -> JunitCase:
    place = case.mark
    if case.passed:
        return JunitCase(group, case.name, case.seconds, output=case.doc, file=place.file, line=place.line)
    return JunitCase(
        group,
        case.name,
        case.seconds,
        "failure",
        case.cause or case.status,
        case.differences[0].message,
        "\n".join([case.end, *map(str, case.differences)]),
        "\n".join(trace_lines(case.events, rehearsal.names)),
        place.file,
        place.line,
    )
