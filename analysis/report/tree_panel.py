"""Tree panel: the drawn behaviour tree, and the status of each node at each tick."""

from __future__ import annotations

from pathlib import Path
from typing import Final, cast

from ...authoring.drawing.chart import Branch, Chart, ChartNode, ChartPort, ChartTree, symbol_of
from ...authoring.drawing.chart_builder import chart
from ...authoring.drawing.formats.html import chart_json
from ...errors import PicktreeError
from ...logs.schema.records import Tree, TreeNode
from ...trees.loading.loader import parse_mission
from ...trees.loading.registry import NodeRegistry
from ...trees.mission import RecordedFiles
from ..run import Run
from .packing import Packable, Section
from .tick_table import STATUSES, tick_table

_MISSING_MISSION_PATH: Final = Path("/nonexistent/picktree/mission.yaml")
"""Path that replaces the mission's own, so that a report runs no code from beside it."""


def charts_of(run: Run) -> tuple[Chart, ...]:
    """Return one chart for each of `run.trees`, in their order."""
    return tuple(_chart(run, place, at.record) for place, at in enumerate(run.trees))


def _chart(run: Run, place: int, tree: Tree) -> Chart:
    try:
        drawn = _of_mission(run, f"edit-{place:04d}/" if place else "")
    except PicktreeError:  # a plug-in that is not installed here, a mission of another version
        return _of_tree(run, tree)
    return drawn if _paths(drawn) == {node.path for node in tree.nodes} else _of_tree(run, tree)


def _of_mission(run: Run, folder: str) -> Chart:
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


def _paths(drawn: Chart) -> set[str]:
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


def _of_tree(run: Run, tree: Tree) -> Chart:
    """Return a chart from the log's record of the tree: nodes and ports, no labels of branches."""
    nodes = {node.path: node for node in tree.nodes}
    registry = NodeRegistry()

    def drawn(node: TreeNode) -> ChartNode:
        known = registry.find(node.id)
        return ChartNode(
            id=node.id,
            name=node.name,
            kind=known.declaration.kind if known else "control" if node.children else "action",
            symbol=symbol_of(known.declaration) if known else "control" if node.children else "action",
            doc=known.declaration.doc if known else "",
            ports=tuple(
                ChartPort(key, text, "reference" if text.startswith("{") else "literal")
                for key, text in node.ports.items()
            ),
            branches=tuple(Branch("", "child", drawn(nodes[path])) for path in node.children),
        )

    root = tree.nodes[0]
    inner = [drawn(nodes[path]) for path in root.children]
    # The root is the frame of the whole. Unless it has exactly one child, it also appears inside the frame.
    top = inner[0] if len(inner) == 1 else drawn(root)
    return Chart(run.info.mission, "", trees=(ChartTree(root.name, "", (), top),))


def pack_tree(run: Run) -> Section:
    table = tick_table(run)
    if not table.nodes:
        return Section("tree", {"empty": "The log holds no tree."})
    charts = charts_of(run)
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
