"""Difference of two whole runs: one value, its text with the most important facts first, and its JSON."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, TypeAlias

from picktree.analysis import Run
from picktree.files import short_names
from picktree.logs import arithmetic_record, is_simulated, lacking_topics, log_records, node_visits, topics
from picktree.session import environment
from picktree.world import TreeNode, Values

from .alignment import Alignment, Divergence, How, align
from .message_differences import (
    MessageDifference,
    compared_topics,
    first_difference,
    first_difference_in_values,
    value_text,
)
from .run_outcome import (
    CountChange,
    EndingChange,
    ItemChange,
    ItemEnd,
    RunOutcome,
    TimeChange,
    TimeSpent,
    TimeUse,
    cause_changes,
    ending_changes,
    item_changes,
    outcome_of,
    time_spent,
)

Verdict: TypeAlias = Literal["identical", "cut", "alike", "apart"]
"""Verdict: `identical`: every simulated message is the same. `cut`: they are, until one log ends.

`alike`: some values differ, but every node did the same at the same times. `apart`: the nodes did not.
"""


@dataclass(frozen=True, slots=True)
class RunDiff:
    """Differences of two runs; times are simulated s."""

    verdict: Verdict
    a: RunOutcome
    b: RunOutcome
    set_up: SetupDiff
    first: MessageDifference | None
    """First simulated value that differs. When the trees differ, messages about their nodes are ignored."""
    alignment: Alignment
    """Alignment of the runs, with their divergence."""
    time: TimeSpent
    causes: tuple[CountChange, ...]
    ways: tuple[EndingChange, ...]
    items: tuple[ItemChange, ...]
    left_out: tuple[str, ...] = ()
    """Sentences about what one of the logs lacks, which is not compared."""

    @property
    def same(self) -> bool:
        return self.verdict == "identical"


def diff(a: Run, b: Run) -> RunDiff:
    """Compare two runs of any missions, finished or cut.

    The comparison begins at the first tick that both have, also for a run and its continuation from a
    checkpoint. Raises PicktreeError for a damaged log.
    """
    alignment = align(a, b)
    since = alignment.since or None
    ends = [gap.start for run in (a, b) for gap in run.log.gaps if gap.end is None]
    last = min((end for end in ends if end is not None), default=None)
    first = first_difference(a, b, since=since, until=last)
    if first is not None and first.topic == topics.TREE.name:
        node_topics = (topics.TREE.name, topics.TICK.name)
        first = first_difference(a, b, since=since, until=last, without=node_topics) or first
    return RunDiff(
        _verdict(alignment, first),
        outcome_of(a),
        outcome_of(b),
        compare_settings(a, b),
        first,
        alignment,
        time_spent(alignment),
        cause_changes(alignment),
        ending_changes(alignment),
        item_changes(a, b, alignment),
        tuple(_left_out(a, b)),
    )


def _left_out(a: Run, b: Run) -> Iterator[str]:
    compared = compared_topics(a, b)
    for name, run, other in (("A", a, b), ("B", b, a)):
        yield from (f"{name}: {gap.text()}" for gap in run.log.gaps)
        if run.log.is_rewritten:
            held = [topic for topic, info in other.log.topics.items() if info.messages]
            lacking = [topic for topic in held if is_simulated(topic) and topic not in compared]
            if lacking:
                yield f"{name}: {lacking_topics(lacking)}"


def _verdict(alignment: Alignment, first: MessageDifference | None) -> Verdict:
    if first is None:
        return "identical"
    if first.missing and first.ended:
        return "cut"
    return "alike" if alignment.pairs and alignment.parting is None else "apart"


CONTEXT_LINES = 2
"""Number of unchanged lines around a change of a file."""
_RUN_FILE_PREFIXES = ("checkpoint-", "refused-")
"""Prefixes of attachments that a run makes itself."""


@dataclass(frozen=True, slots=True)
class ValueChange:
    """Named value in two runs; None in a run that lacks it."""

    name: str
    a: object
    b: object


@dataclass(frozen=True, slots=True)
class FileChange:
    """File that differs between the two logs.

    `diff` are the lines of a unified diff without its head; for picktree's sources, sentences. It is empty
    for a file that is no text, or that only one run has.
    """

    name: str
    how: Literal["changed", "only_a", "only_b"]
    diff: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SetupDiff:
    settings: tuple[ValueChange, ...]
    """Settings that differ: mission, scene, robot, seed, versions and others."""
    files: tuple[FileChange, ...]
    arithmetic: str = ""
    """Sentence when the runs were computed with different arithmetic, or it was not recorded; else empty."""


def compare_settings(a: Run, b: Run) -> SetupDiff:
    return SetupDiff(
        value_changes(_settings(a.info), _settings(b.info)),
        tuple(_files(a, b)),
        arithmetic_record.arithmetic_difference(a.info.arithmetic, b.info.arithmetic, "in B"),
    )


def value_changes(a: Mapping[str, object], b: Mapping[str, object]) -> tuple[ValueChange, ...]:
    """Return the values that differ, in the order of A."""
    return tuple(
        ValueChange(name, a.get(name), b.get(name))
        for name in dict.fromkeys((*a, *b))
        if a.get(name) != b.get(name)
    )


def _settings(info: log_records.RunInfo) -> dict[str, object]:
    """Return the settings by user-visible names; the version of picktree has no prefix."""
    fields = ("mission", "scene", "robot", "seed", "backend", "tick", "revision")
    named: dict[str, object] = {name: getattr(info, name) for name in fields}
    for prefix, values in (("set ", info.parameters), ("", info.physics), ("", info.versions)):
        named.update({f"{prefix}{name}": value for name, value in values.items()})
    return named


def _files(a: Run, b: Run) -> Iterator[FileChange]:
    in_a, in_b = _contents(a), _contents(b)
    for name in dict.fromkeys((*in_a, *in_b)):
        ours, theirs = in_a.get(name), in_b.get(name)
        if theirs is None:
            yield FileChange(name, "only_a", ())
        elif ours is None:
            yield FileChange(name, "only_b", ())
        elif name == environment.SOURCES_ATTACHMENT:
            changes = environment.source_changes(
                environment.sources_from_text(ours.decode()), environment.sources_from_text(theirs.decode())
            )
            if changes:
                yield FileChange(name, "changed", changes)
        elif ours != theirs:
            yield FileChange(name, "changed", _unified(ours, theirs))


def _contents(run: Run) -> dict[str, bytes]:
    names = [name for name in run.log.attachments if not name.startswith(_RUN_FILE_PREFIXES)]
    return {name: run.log.attachment(name) for name in names}


def _unified(a: bytes, b: bytes) -> tuple[str, ...]:
    try:
        ours, theirs = a.decode().splitlines(), b.decode().splitlines()
    except UnicodeDecodeError:
        return ()
    lines = difflib.unified_diff(ours, theirs, n=CONTEXT_LINES, lineterm="")
    return tuple(line for n, line in enumerate(lines) if n >= 2)


DIVERGENCE_TEXTS: Mapping[How, str] = {
    "type": "is of another type",
    "inputs": "begins with other inputs",
    "outcome": "ends differently",
    "cause": "fails with another cause",
    "length": "takes another time",
    "order": "another node begins",
    "end": "",
}


def parting_lines(parting: Divergence) -> Iterator[str]:
    a, b = parting.a, parting.b
    same = a is not None and b is not None and parting.how not in ("order", "end")
    if parting.how != "end":
        yield f"the runs diverge at {parting.time:.2f} s: {_divergence_phrase(parting, a if same else None)}"
    for side, visit in (("A", a), ("B", b)):
        if visit is None:
            yield f"  {side}  nothing more begins" if parting.how == "order" else f"  {side}  –"
            continue
        yield f"  {side}  {visit.path}{visit.about}"
        yield f"     {visit.start:.2f} to {visit.end:.2f} s: {end_text(visit)}"
    if a is not None and b is not None and same:
        yield from _differing_values("read", a.inputs, b.inputs)
        yield from _differing_values("evidence", a.evidence, b.evidence)
    for side, visit in (("A", parting.next_a), ("B", parting.next_b)):
        if visit is not None:
            yield f"  then {side}  {visit.path}{visit.about} from {visit.start:.2f} s: {end_text(visit)}"
        else:
            yield f"  then {side}  nothing more begins"


def first_value_lines(first: MessageDifference) -> Iterator[str]:
    """Yield lines about the first simulated value that differs."""
    where = f"tick {first.tick}, {first.time:.2f} s, {first.topic}"
    if first.missing:
        side, value = ("B", first.b) if first.missing == "a" else ("A", first.a)
        yield f"first message that differs: {where}: only in {side}"
        yield f"  {side}  {value_text(value)}"
        return
    of = f" ({first.of})" if first.of else ""
    yield f"first value that differs: {where} {first.field}{of}"
    yield f"  A  {value_text(first.a)}"
    yield f"  B  {value_text(first.b)}"


def _differing_values(title: str, a: Values, b: Values) -> Iterator[str]:
    """Yield the values that differ; for lists the first differing element."""
    if not a or not b:
        for side, values in (("A", a), ("B", b)):
            if values:
                text = ", ".join(f"{name} {value_text(value)}" for name, value in values.items())
                yield f"     {title} of {side}: {text}"
        return
    for change in value_changes(a, b):
        found = first_difference_in_values(change.a, change.b, change.name)
        if found is not None:
            yield f"     {title} {found.path}: A {value_text(found.a)}, B {value_text(found.b)}"


def _divergence_phrase(parting: Divergence, same: node_visits.Visit | None) -> str:
    if same is None:
        return DIVERGENCE_TEXTS[parting.how]
    also = "".join(f", {DIVERGENCE_TEXTS[aspect]}" for aspect in parting.also)
    return f"{same.name} {DIVERGENCE_TEXTS[parting.how]}{also}"


def end_text(visit: node_visits.Visit, *, short: bool = False) -> str:
    """Return how a visit ended; `short`: of a failure its cause alone."""
    if visit.outcome == "RUNNING":
        return "still runs when the log ends"
    if visit.outcome == node_visits.HALTED:
        return "was halted"
    if short:
        return visit.cause or visit.outcome
    reason = ": ".join(part for part in (visit.cause, visit.message) if part)
    return f"{visit.outcome}, {reason}" if reason else visit.outcome


def aligned(rows: list[tuple[str, ...]], *, right: bool = False) -> Iterator[str]:
    """Yield rows with columns of minimum width; `right`: numbers from the second column on."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))] if rows else []
    for row in rows:
        cells = (
            cell.rjust(width) if right and k else cell.ljust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        yield "  ".join(cells).rstrip()


def to_json_text(diff: RunDiff) -> str:
    """Return one JSON object, with a trailing newline."""
    return json.dumps(to_json(diff), ensure_ascii=False, indent=2, allow_nan=False, default=str) + "\n"


def to_json(diff: RunDiff) -> dict[str, Any]:
    nodes, items = diff.alignment.nodes, diff.alignment.items
    return {
        "verdict": diff.verdict,
        "a": _outcome_json(diff.a),
        "b": _outcome_json(diff.b),
        "settings": [asdict(change) for change in diff.set_up.settings],
        "files": [asdict(change) for change in diff.set_up.files],
        "arithmetic": diff.set_up.arithmetic,
        "nodes": {
            "only_a": [node.path for node in nodes.only_a],
            "only_b": [node.path for node in nodes.only_b],
            "moved": [{"a": pair.a.path, "b": pair.b.path} for pair in nodes.moved],
            "retyped": [{"path": p.a.path, "a": p.a.id, "b": p.b.id} for p in nodes.retyped],
            "ports": [asdict(change) for change in nodes.rewired],
        },
        "first_value": None if diff.first is None else asdict(diff.first),
        "left_out": list(diff.left_out),
        "parting": None if diff.alignment.parting is None else _parting(diff.alignment.parting),
        "time": {
            name: [{**asdict(change), "change": change.change} for change in changes]
            for name, changes in (("by_type", diff.time.by_type), ("by_node", diff.time.by_node))
        },
        "causes": [asdict(change) for change in diff.causes],
        "ways": [asdict(change) for change in diff.ways],
        "items": [{**asdict(change), "differs": change.differs} for change in diff.items],
        "item_pairs": [asdict(pair) for pair in items.pairs],
    }


def _outcome_json(outcome: RunOutcome) -> dict[str, Any]:
    return {**asdict(outcome), "log": str(outcome.log.absolute())}


def _parting(parting: Divergence) -> dict[str, Any]:
    evidence = value_changes(parting.a.evidence if parting.a else {}, parting.b.evidence if parting.b else {})
    return {**asdict(parting), "evidence": [asdict(change) for change in evidence]}


MAX_TABLE_ROWS = 8
"""Maximum number of rows of a table; the others are only counted."""
_MAX_DIFF_LINES = 24
"""Maximum number of lines about one file's changes."""
_MIN_TIME_CHANGE = 0.005
"""Change below which a time counts as unchanged, s."""


def to_text(diff: RunDiff) -> str:
    """Return the text without a trailing newline."""
    return "\n".join(_lines(diff))


def _lines(diff: RunDiff) -> Iterator[str]:
    yield from _head(diff)
    yield ""
    yield from _verdict_lines(diff)
    if diff.verdict == "identical":
        return
    names = short_names(_parent_paths(diff))
    for title, lines in (
        ("files and settings", _set_up(diff)),
        ("outcome", _outcome(diff.a, diff.b)),
        ("time, by type of leaf (simulated s)", _times(diff.time.by_type, {})),
        (
            "time, by node (simulated s; with the nodes below it)",
            _times(_without_repeated_parents(diff), names),
        ),
        ("failures by cause", _counts(diff)),
        ("branches that A and B took a different number of times", _ending_rows(diff, names)),
        ("items", _items(diff)),
    ):
        shown = list(lines)
        if shown:
            yield ""
            yield title
            yield from (f"  {line}" for line in shown)


def _head(diff: RunDiff) -> Iterator[str]:
    for side, run in (("A", diff.a), ("B", diff.b)):
        sorted_ = "" if run.items_total is None else f", {run.items_sorted} of {run.items_total} items sorted"
        yield f"{side}  {run.log}"
        yield f"   {run.status}{sorted_}, {run.end:.2f} s" + (f": {run.message}" if run.message else "")
        if run.recovered:
            yield f"   {run.recovered.removeprefix(f'{run.log}: ')}"


def _from(diff: RunDiff) -> str:
    """Return the start of the comparison; empty when it is the beginning."""
    return f"from {diff.alignment.since:.3f} " if diff.alignment.since else ""


def _verdict_lines(diff: RunDiff) -> Iterator[str]:
    if diff.alignment.since and diff.verdict != "identical":
        yield f"compared from {diff.alignment.since:.3f} s on: one log begins there"
    match diff.verdict:
        case "identical":
            end = min(diff.a.end, diff.b.end) if diff.left_out else diff.a.end
            both = " that both logs have" if diff.left_out else ""
            yield f"identical: every simulated message{both} is the same, {_from(diff)}up to {end:.2f} s"
            yield from (f"not compared  {line}" for line in diff.left_out)
            return
        case "cut":
            assert diff.first is not None
            ends = "A" if diff.first.missing == "a" else "B"
            yield f"nothing differs until the log {ends} ends, at {min(diff.a.end, diff.b.end):.2f} s"
        case "alike":
            yield "every node did the same at the same times, but values differ"
        case "apart":
            pass
    yield from (f"not compared  {line}" for line in diff.left_out)
    if diff.alignment.parting is not None:
        yield from parting_lines(diff.alignment.parting)
    if diff.first is not None and diff.verdict != "cut":
        yield from first_value_lines(diff.first)
    if diff.set_up.arithmetic and diff.verdict != "cut":
        yield diff.set_up.arithmetic


def _set_up(diff: RunDiff) -> Iterator[str]:
    settings, files, nodes = diff.set_up.settings, diff.set_up.files, diff.alignment.nodes
    if not settings and not files:
        yield "the same settings and files"
    yield from aligned([(c.name, value_text(c.a), value_text(c.b)) for c in settings])
    for change in files:
        yield from _file(change)
    for name, only in (("A", nodes.only_a), ("B", nodes.only_b)):
        if only:
            yield from _listed(f"nodes only in {name}", list(_topmost_nodes(only)))
    moved = {pair.a.path: pair.b for pair in nodes.moved}
    for path, node in moved.items():
        above = moved.get(path.rpartition("/")[0])
        if above is None or above.path != node.parent:
            yield f"node {path} of A is node {node.path} in B"
    for pair in nodes.retyped:
        yield f"{pair.a.path} is a {pair.a.id} in A, a {pair.b.id} in B"


def _file(change: FileChange) -> Iterator[str]:
    if change.how != "changed":
        yield f"{change.name}: only in {'A' if change.how == 'only_a' else 'B'}"
        return
    if not change.diff:
        yield f"{change.name}: changed (its lines are the same, or it is no text)"
        return
    if change.name == environment.SOURCES_ATTACHMENT:
        yield f"{change.name}: {'; '.join(change.diff)}"
        return
    plus, minus = (sum(line.startswith(sign) for line in change.diff) for sign in "+-")
    yield f"{change.name}: changed, {minus} lines of A, {plus} of B"
    yield from (f"  {line}" for line in change.diff[:_MAX_DIFF_LINES])
    if len(change.diff) > _MAX_DIFF_LINES:
        yield f"  … {len(change.diff) - _MAX_DIFF_LINES} lines more"


def _outcome(a: RunOutcome, b: RunOutcome) -> Iterator[str]:
    def sorted_(run: RunOutcome) -> str:
        return "unknown" if run.items_total is None else f"{run.items_sorted} of {run.items_total}"

    def known(status: str) -> str:
        return f"{status}: no result in the log" if status in ("killed", "unknown") else status

    yield from aligned(
        [
            ("", "A", "B"),
            ("result", known(a.status), known(b.status)),
            ("items sorted", sorted_(a), sorted_(b)),
            ("items done, as believed", str(a.items_done), str(b.items_done)),
            ("grasps held", f"{a.picks_held} of {a.picks_tried}", f"{b.picks_held} of {b.picks_tried}"),
            ("failures", str(sum(a.failures.values())), str(sum(b.failures.values()))),
            ("handler runs", str(a.recoveries), str(b.recoveries)),
            ("simulated", f"{a.end:.2f} s", f"{b.end:.2f} s"),
        ]
    )  # fmt: skip


def _times(changes: Iterable[TimeChange], names: Mapping[str, str]) -> Iterator[str]:
    moved = [
        change
        for change in changes
        if abs(change.change) >= _MIN_TIME_CHANGE or change.a.count != change.b.count
    ]
    if not moved:
        return
    rows = [("", "A: times", "sum", "median", "B: times", "sum", "median", "change")]
    for change in moved[:MAX_TABLE_ROWS]:
        name = names.get(change.name, change.name)
        rows.append((name, *_duration_cells(change.a), *_duration_cells(change.b), f"{change.change:+.2f}"))
    yield from aligned(rows, right=True)
    if len(moved) > MAX_TABLE_ROWS:
        yield f"… {len(moved) - MAX_TABLE_ROWS} more with smaller changes"


def _without_repeated_parents(diff: RunDiff) -> Iterator[TimeChange]:
    """Yield the nodes except those whose parent has the same times and counts."""
    above = _parent_paths(diff)
    known = {change.name: (change.a, change.b) for change in diff.time.by_node}
    for change in diff.time.by_node:
        if known.get(above[change.name]) != (change.a, change.b):
            yield change


def _parent_paths(diff: RunDiff) -> Mapping[str, str]:
    """Return the path of each node's parent as in A; as in B for nodes that only B has."""
    nodes, path_in_a = diff.alignment.nodes, diff.alignment.nodes.a_by_b
    return {
        **{node.path: path_in_a.get(node.parent, node.parent) for node in nodes.only_b},
        **{node.path: node.parent for node in (*(pair.a for pair in nodes.pairs), *nodes.only_a)},
    }


def _duration_cells(spent: TimeUse) -> tuple[str, str, str]:
    if spent.median is None:
        return "–", "–", "–"
    return str(spent.count), f"{spent.total:.2f}", f"{spent.median:.2f}"


def _counts(diff: RunDiff) -> Iterator[str]:
    if diff.causes:
        yield from aligned([("", "A", "B"), *((c.name, str(c.a), str(c.b)) for c in diff.causes)], right=True)


def _ending_rows(diff: RunDiff, names: Mapping[str, str]) -> Iterator[str]:
    above = _parent_paths(diff)
    ended: dict[str, tuple[str, str]] = {}
    for path in dict.fromkeys(way.path for way in diff.ways):
        ones = [way for way in diff.ways if way.path == path]
        ended[path] = _endings((w.a, w.outcome) for w in ones), _endings((w.b, w.outcome) for w in ones)
    rows = [(names.get(path, path), *both) for path, both in ended.items() if ended.get(above[path]) != both]
    if rows:
        yield from aligned([("", "A", "B"), *rows[: 3 * MAX_TABLE_ROWS]])
    if len(rows) > 3 * MAX_TABLE_ROWS:
        yield f"… {len(rows) - 3 * MAX_TABLE_ROWS} more"


def _endings(counts: Iterable[tuple[int, str]]) -> str:
    return ", ".join(f"{count} {outcome}" for count, outcome in counts if count) or "–"


def _items(diff: RunDiff) -> Iterator[str]:
    if not diff.items:
        return
    if any(change.basis == "order" for change in diff.items):
        yield "~ paired by kind, colour and number, not by place, because the kind has at most two items"
    rows = [("", "A: ended", "at", "grasps", "busy", "B: ended", "at", "grasps", "busy")]
    yield from aligned(rows + [_item(change) for change in diff.items])


def _item(change: ItemChange) -> tuple[str, ...]:
    a, b = change.a, change.b
    name = a.id if a else b.id if b else ""
    if a and b and a.id != b.id:
        name = f"{a.id} = {b.id} in B"
    mark = "≠ " if change.differs else "  "
    about = " ~" if change.basis == "order" else ""
    return (f"{mark}{name}{about}", *_ended(a), *_ended(b))


def _ended(end: ItemEnd | None) -> tuple[str, str, str, str]:
    if end is None:
        return "not known", "", "", ""
    state = f"{end.state}, {end.place}" if end.place else end.state
    return state, "" if end.done is None else f"{end.done:.2f}", str(end.grasps), f"{end.busy:.2f}"


def _listed(title: str, names: list[str]) -> Iterator[str]:
    yield f"{title}:"
    yield from (f"  {name}" for name in names[:MAX_TABLE_ROWS])
    if len(names) > MAX_TABLE_ROWS:
        yield f"  … {len(names) - MAX_TABLE_ROWS} more"


def _topmost_nodes(nodes: Sequence[TreeNode]) -> Iterator[str]:
    """Yield the nodes that are below none of the others, with the number of the others below each."""
    paths = [node.path for node in nodes]
    for path in paths:
        if not any(path.startswith(f"{other}/") for other in paths):
            below = sum(other.startswith(f"{path}/") for other in paths)
            yield path + (f" and {below} below it" if below else "")
