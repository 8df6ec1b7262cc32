"""Comparison of two runs, as text for a terminal with the most important facts first, and as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from ...files.node_patterns import short_names
from ...logs.schema.records import TreeNode
from ...logs.visits import Visit
from ...session.environment import SOURCES_ATTACHMENT
from .diff import FileChange, RunDiff, value_changes
from .divergence import Divergence
from .divergence_text import aligned, first_value_lines, parting_lines
from .message_fields import value_text
from .run_outcome import ItemChange, ItemEnd, RunOutcome, TimeChange, TimeUse


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
        "derived": diff.alignment.derived,
        "left_out": list(diff.left_out),
        "parting": None if diff.alignment.parting is None else _parting(diff.alignment.parting),
        "time": {
            "by_type": [_time(change) for change in diff.time.by_type],
            "by_node": [_time(change) for change in diff.time.by_node],
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
    return {
        "time": parting.time,
        "how": parting.how,
        "also": list(parting.also),
        "a": _visit(parting.a),
        "b": _visit(parting.b),
        "evidence": [asdict(change) for change in evidence],
        "next_a": _visit(parting.next_a),
        "next_b": _visit(parting.next_b),
    }


def _visit(visit: Visit | None) -> dict[str, Any] | None:
    return None if visit is None else asdict(visit)


def _time(change: TimeChange) -> dict[str, Any]:
    return {**asdict(change), "change": change.change}


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
    yield from _verdict(diff)
    if diff.verdict == "identical":
        return
    names = short_names(_parent_paths(diff))
    for title, lines in (
        ("what they were started with", _set_up(diff)),
        ("outcome", _outcome(diff.a, diff.b)),
        ("time, by type of leaf (simulated s)", _times(diff.time.by_type, {})),
        (
            "time, by node (simulated s; with the nodes below it)",
            _times(_without_repeated_parents(diff), names),
        ),
        ("failures by cause", _counts(diff)),
        ("ways through the tree that were not taken as often", _ending_rows(diff, names)),
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


def _verdict(diff: RunDiff) -> Iterator[str]:
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
    if diff.alignment.derived:
        yield "a log of format 1: beginnings and ends are derived from the statuses after each tick"
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
            yield f"{path} of A is {node.path} in B"
    for pair in nodes.retyped:
        yield f"{pair.a.path} is a {pair.a.id} in A, a {pair.b.id} in B"


def _file(change: FileChange) -> Iterator[str]:
    if change.how != "changed":
        yield f"{change.name}: only in {'A' if change.how == 'only_a' else 'B'}"
        return
    if not change.diff:
        yield f"{change.name}: changed (its lines are the same, or it is no text)"
        return
    if change.name == SOURCES_ATTACHMENT:
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
        yield "~ no more than two of a kind: paired by kind, colour and number, not by the place"
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
