"""Lanes panel and tree panel: nodes over time, and the drawn tree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, cast

import numpy as np
import orjson

from picktree.analysis import Run
from picktree.authoring import chart, chart_json, mission_chart
from picktree.files import PicktreeError
from picktree.logs import BeliefEvent, node_visits
from picktree.trees import RecordedFiles
from picktree.trees.loading import NodeRegistry, parse_mission
from picktree.world import Tree, TreeNode

from .packing import Packable, Section, StringTable
from .tick_table import STATUSES, TickTable, tick_table

OUTCOMES: Final = ("RUNNING", "SUCCESS", "FAILURE", "SKIPPED", node_visits.HALTED)
"""Outcomes by code."""


_MARKED_KINDS: Final = frozenset(
    {"recovery", "fault", "item_done", "safety_stop", "mission_edited", "blackboard_set"}
)
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
    visits = run.account.visits
    colours = _colours(run)
    return Section(
        "lanes",
        {
            "nodes": [asdict(node) for node in table.nodes],
            "outcomes": list(OUTCOMES),
            "visits": _visits(visits, table),
            "steps": _steps(run, table),
            "items": [{**asdict(span), "colour": colours.get(span.item, "")} for span in item_spans(visits)],
            "marks": [
                {"time": at.time, **{name: getattr(at.record, name) for name in ("kind", "message", "node")}}
                for at in run.events
                if at.record.kind in _MARKED_KINDS
            ],
        },
    )


def _steps(run: Run, table: TickTable) -> dict[str, Packable]:
    """Pack the steps of skills as (name, start, end, outcome), by the place of their visit."""
    numbers = {node.path for node in table.nodes}
    places = {
        visit.number: place
        for place, visit in enumerate(visit for visit in run.account.visits if visit.path in numbers)
    }
    steps: dict[str, Packable] = {}
    for step in run.steps:
        if step.visit in places:
            packed: list[Packable] = [step.name, step.start, step.end, step.outcome]
            cast("list[Packable]", steps.setdefault(str(places[step.visit]), [])).append(packed)
    return steps


def item_spans(visits: Sequence[node_visits.Visit]) -> tuple[ItemSpan, ...]:
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


def _visits(visits: Sequence[node_visits.Visit], table: TickTable) -> Packable:
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
        **{
            name: words.numbers([getattr(visit, name) for visit in known])
            for name in ("item", "cause", "origin", "message")
        },
        **{
            name: words.numbers([_json(getattr(visit, name)) for visit in known])
            for name in ("inputs", "evidence")
        },
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


_MISSING_MISSION_PATH: Final = Path("/nonexistent/picktree/mission.yaml")
"""Path that replaces the mission's own, so that a report runs no code from beside it."""


def _chart(run: Run, place: int, tree: Tree) -> mission_chart.Chart:
    try:
        drawn = _of_mission(run, f"edit-{place:04d}/" if place else "")
    except PicktreeError:  # a plug-in that is not installed here, a mission of another version
        return _of_tree(run, tree)
    return drawn if _paths(drawn) == {node.path for node in tree.nodes} else _of_tree(run, tree)


def _of_mission(run: Run, folder: str) -> mission_chart.Chart:
    log = run.log
    texts = {
        name.removeprefix(f"{folder}include/"): log.attachment(name).decode("utf-8", "replace")
        for name in log.attachments
        if name.startswith(f"{folder}include/")
    }
    text = log.attachment(f"{folder}mission.yaml").decode("utf-8", "replace")
    return chart(
        parse_mission(text, _MISSING_MISSION_PATH, files=RecordedFiles(texts, _MISSING_MISSION_PATH.parent))
    )


def _paths(drawn: mission_chart.Chart) -> set[str]:
    """Return the paths of all nodes of the running tree, sub-trees expanded."""
    trees = {tree.name: tree for tree in drawn.trees}
    top = drawn.trees[0]
    found = {top.name}
    waiting = [(top.root, f"{top.name}/{top.root.name}")]
    while waiting:
        node, path = waiting.pop()
        found.add(path)
        below = [branch.node for branch in node.branches]
        if node.calls:
            below = [trees[node.calls].root]
        waiting += [(child, f"{path}/{child.name}") for child in below]
    return found


def _of_tree(run: Run, tree: Tree) -> mission_chart.Chart:
    """Return a chart from the log's record of the tree: nodes and ports, no labels of branches."""
    nodes = {node.path: node for node in tree.nodes}
    registry = NodeRegistry()

    def drawn(node: TreeNode) -> mission_chart.ChartNode:
        known = registry.find(node.id)
        kind = "control" if node.children else "action"
        return mission_chart.ChartNode(
            id=node.id,
            name=node.name,
            kind=known.declaration.kind if known else kind,
            symbol=mission_chart.symbol_of(known.declaration) if known else kind,
            doc=known.declaration.doc if known else "",
            ports=tuple(
                mission_chart.ChartPort(key, text, "reference" if text.startswith("{") else "literal")
                for key, text in node.ports.items()
            ),
            branches=tuple(mission_chart.Branch("", "child", drawn(nodes[path])) for path in node.children),
        )

    root = tree.nodes[0]
    inner = [drawn(nodes[path]) for path in root.children]
    # The root is the frame of the whole. Unless it has exactly one child, it also appears inside the frame.
    top = inner[0] if len(inner) == 1 else drawn(root)
    return mission_chart.Chart(run.info.mission, "", trees=(mission_chart.ChartTree(root.name, "", (), top),))


def pack_tree(run: Run) -> Section:
    table = tick_table(run)
    if not table.nodes:
        return Section("tree", {"empty": "The log holds no tree."})
    charts = [_chart(run, place, at.record) for place, at in enumerate(run.trees)]
    return Section(
        "tree",
        {
            "charts": [
                {"since": at.time, "chart": cast(Packable, chart_json(chart))}
                for at, chart in zip(run.trees, charts, strict=True)
            ],
            "paths": [node.path for node in table.nodes],
            "words": list(STATUSES),
            "statuses": table.statuses,
        },
    )
