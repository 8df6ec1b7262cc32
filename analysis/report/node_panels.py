"""Lanes panel and tree panel: nodes over time, and the drawn tree, both from one tick table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import compress
from operator import is_not
from pathlib import Path
from typing import Final, cast
from weakref import WeakKeyDictionary

import numpy as np
import orjson
from numpy.typing import NDArray

from picktree.analysis import Run
from picktree.authoring import chart, drawing, mission_chart
from picktree.files import PicktreeError
from picktree.logs import BeliefEvent, log_records, node_visits
from picktree.trees import RecordedFiles
from picktree.trees.loading import NodeRegistry, parse_mission

from .packing import Packable, Section, StringTable


@dataclass(frozen=True, slots=True)
class RunNode:
    """Node of any of the run's trees."""

    path: str
    id: str
    name: str
    parent: int
    """Number of the parent; -1 for a root."""
    leaf: bool


def nodes_of(trees: Iterable[log_records.Tree]) -> tuple[RunNode, ...]:
    """Return all nodes, parents before their children, siblings in the order of their trees.

    A node's number is its place in the result. Nodes that an edit has added come after their older siblings.
    """
    known: dict[str, log_records.TreeNode] = {}
    children: dict[str, dict[str, None]] = {}
    for tree in trees:
        for node in tree.nodes:
            known[node.path] = node
            children.setdefault(node.parent, {})[node.path] = None
    numbers: dict[str, int] = {}
    found: list[RunNode] = []
    for path in _below("", children):
        node = known[path]
        numbers[path] = len(found)
        parent = numbers.get(node.parent, -1)
        found.append(RunNode(path, node.id, node.name, parent, path not in children))
    return tuple(found)


def _below(path: str, children: dict[str, dict[str, None]]) -> Iterator[str]:
    waiting = list(reversed(children.get(path, {})))
    while waiting:
        path = waiting.pop()
        yield path
        waiting += reversed(children.get(path, {}))


STATUSES: Final = ("IDLE", "RUNNING", "SUCCESS", "FAILURE", "SKIPPED")
"""Statuses by code."""
ABSENT: Final = 255
"""Code of a node that is not in the tree of that tick."""
TICKED: Final = 8
"""Addend of the code where the tick reached the node."""
_CODES: Final = {status: code for code, status in enumerate(STATUSES)}


@dataclass(frozen=True, slots=True)
class TickWrite:
    """Write to the blackboard, with the number of its tick."""

    tick: int
    write: log_records.WriteRecord


@dataclass(frozen=True, slots=True, eq=False)
class TickTable:
    nodes: tuple[RunNode, ...]
    times: NDArray[np.float64]
    """Times of the ticks, (ticks,), simulated s."""
    codes: NDArray[np.uint8]
    """Status codes, (nodes, ticks), with `TICKED` added; or `ABSENT`."""
    writes: tuple[TickWrite, ...]

    @property
    def statuses(self) -> NDArray[np.uint8]:
        """Status codes without `TICKED`, (nodes, ticks)."""
        return np.where(self.codes == ABSENT, ABSENT, self.codes % TICKED).astype(np.uint8)


_TABLES: WeakKeyDictionary[Run, TickTable] = WeakKeyDictionary()


def tick_table(run: Run) -> TickTable:
    """Return the table, read once for each run. Raises PicktreeError where the log is damaged."""
    table = _TABLES.get(run)
    if table is None:
        table = _TABLES[run] = _read(run)
    return table


def _read(run: Run) -> TickTable:
    nodes = nodes_of(at.record for at in run.trees)
    numbers = {node.path: number for number, node in enumerate(nodes)}
    times: list[float] = []
    writes: list[TickWrite] = []
    columns: list[NDArray[np.uint8]] = []
    column = np.full(len(nodes), ABSENT, dtype=np.uint8)
    before: tuple[log_records.NodeStatusRecord, ...] = ()
    for number, at in enumerate(run.log.ticks()):
        now = at.record.nodes
        changed: Iterable[log_records.NodeStatusRecord] = now
        if len(now) == len(before):  # the decoder keeps the records of nodes that report the same
            changed, column = compress(now, map(is_not, now, before)), column.copy()
        else:
            column = np.full(len(nodes), ABSENT, dtype=np.uint8)
        for node in changed:
            row = numbers.get(node.path)
            if row is not None:
                column[row] = _CODES.get(node.status, 0) + (TICKED if node.ticked else 0)
        before = now
        times.append(at.time)
        columns.append(column)
        writes += [TickWrite(number, write) for write in at.record.writes]
    codes = np.array(columns, dtype=np.uint8).reshape(len(times), len(nodes)).T
    return TickTable(nodes, np.array(times), np.ascontiguousarray(codes), tuple(writes))


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
    whole = run.log.format >= 2
    visits = run.account.visits
    colours = _colours(run)
    return Section(
        "lanes",
        {
            "nodes": [asdict(node) for node in table.nodes],
            "outcomes": list(OUTCOMES),
            "visits": _visits(visits, table),
            "items": [{**asdict(span), "colour": colours.get(span.item, "")} for span in item_spans(visits)],
            "marks": [
                {"time": at.time, **{name: getattr(at.record, name) for name in ("kind", "message", "node")}}
                for at in run.events
                if at.record.kind in _MARKED_KINDS
            ],
            "note": ""
            if whole
            else "This log is of format 1: beginnings and ends are told from the statuses of the ticks, "
            "without inputs and items.",
        },
    )


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


def _chart(run: Run, place: int, tree: log_records.Tree) -> mission_chart.Chart:
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


def _of_tree(run: Run, tree: log_records.Tree) -> mission_chart.Chart:
    """Return a chart from the log's record of the tree: nodes and ports, no labels of branches."""
    nodes = {node.path: node for node in tree.nodes}
    registry = NodeRegistry()

    def drawn(node: log_records.TreeNode) -> mission_chart.ChartNode:
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
                {"since": at.time, "chart": cast(Packable, drawing.chart_json(chart))}
                for at, chart in zip(run.trees, charts, strict=True)
            ],
            "paths": [node.path for node in table.nodes],
            "words": list(STATUSES),
            "statuses": table.statuses,
        },
    )
