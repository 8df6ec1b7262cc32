"""Choice of the nodes that get a lane of their own, and the labels of the lanes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from ...logs.schema.records import Tree, TreeNode
from ..run import Run

MAX_LEAF_LANES = 12
"""Maximum number of lanes of leaves."""
MAX_INNER_LANES = 5
"""Maximum number of lanes of nodes with children, besides the root."""


@dataclass(frozen=True, slots=True)
class Lane:
    """Lane of a node; `label` is the shortest end of the path that no other lane has."""

    path: str
    label: str


@dataclass(frozen=True, slots=True)
class _Activity:
    """Activity of the nodes over a run."""

    ticks: Mapping[str, int]
    """Number of ticks in which a node was busy: reached, and not idle."""
    failed: frozenset[str]
    """Nodes that failed with a cause."""
    began: Mapping[str, int]
    """Number of times that a node became busy."""
    leaves: frozenset[str]


def lanes(run: Run) -> tuple[Lane, ...]:
    """Return the root, the busiest leaves (failed ones first) and the busiest sub-trees, in the tree's order.

    Of nodes that wrap each other and are always busy together, one has a lane: the outermost, or the leaf.
    """
    nodes = _nodes(tree.record for tree in run.trees)
    if not nodes:
        return ()
    activity = _activity(run, frozenset(node.path for node in nodes if not node.children))
    root = nodes[0].path
    busy = [node for node in nodes if activity.ticks.get(node.path) and node.path != root]
    leaves = [node for node in busy if not node.children]
    inner = [node for node in busy if node.children and not _wraps_or_wrapped(node, activity)]

    def rank(node: TreeNode) -> tuple[bool, int]:
        return (node.path not in activity.failed, -activity.ticks[node.path])

    chosen = {root}
    chosen.update(node.path for node in sorted(leaves, key=rank)[:MAX_LEAF_LANES])
    chosen.update(
        node.path for node in sorted(inner, key=lambda n: -activity.ticks[n.path])[:MAX_INNER_LANES]
    )
    paths = [node.path for node in nodes if node.path in chosen]
    return tuple(Lane(path, label) for path, label in zip(paths, labels(paths), strict=True))


def labels(paths: Sequence[str]) -> tuple[str, ...]:
    """Return for each path its shortest end that no other path has.

    >>> labels(["Main", "Main/A/Grasp", "Main/B/Grasp"])
    ('Main', 'A/Grasp', 'B/Grasp')
    """
    ends = Counter(end for path in paths for end in _ends(path))
    return tuple(next((end for end in _ends(path) if ends[end] == 1), path) for path in paths)


def _ends(path: str) -> tuple[str, ...]:
    """Return the ends of the path, the shortest first, the whole path last."""
    parts = path.split("/")
    return tuple("/".join(parts[k:]) for k in range(len(parts) - 1, -1, -1))


def _nodes(trees: Iterable[Tree]) -> tuple[TreeNode, ...]:
    """Return the nodes of all trees of the run, each once, in its first form."""
    found: dict[str, TreeNode] = {}
    for tree in trees:
        for node in tree.nodes:
            found.setdefault(node.path, node)
    return tuple(found.values())


def _wraps_or_wrapped(node: TreeNode, activity: _Activity) -> bool:
    """Whether the node's parent, or a leaf below it, was busy at exactly the same times."""
    return any(
        activity.ticks[node.path] == activity.ticks.get(other)
        and activity.began[node.path] == activity.began[other]
        for other in (node.parent, *node.children)
        if other == node.parent or other in activity.leaves
    )


def _activity(run: Run, leaves: frozenset[str]) -> _Activity:
    """Return the activity from the ticks alone, which logs of every format have."""
    ticks, began = Counter[str](), Counter[str]()
    failed: set[str] = set()
    before: frozenset[str] = frozenset()
    for tick in run.ticks:
        busy = frozenset(n.path for n in tick.record.nodes if n.ticked and n.status != "IDLE")
        ticks.update(busy)
        began.update(busy - before)
        before = frozenset(n.path for n in tick.record.nodes if n.status == "RUNNING")
        failed.update(n.path for n in tick.record.nodes if n.ticked and n.status == "FAILURE" and n.cause)
    return _Activity(ticks, frozenset(failed), began, leaves)
