"""Which node of one mission is which node of another.

The same path is the same node. What is left (a node that was renamed around, or wrapped into another, as in
a new `Recover`) is paired below the nearest pair above it: nodes of the same type and name in the same order.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import SequenceMatcher

from ...logs.schema.records import TreeNode
from ..run import Run


@dataclass(frozen=True, slots=True)
class PortChange:
    """A port that is written otherwise in the two missions; empty where it is not written."""

    path: str
    """Of the node in A."""
    port: str
    a: str
    b: str


@dataclass(frozen=True, slots=True)
class NodePair:
    a: TreeNode
    b: TreeNode


@dataclass(frozen=True, slots=True)
class NodeMatch:
    """The nodes of two runs. Of a mission that was edited under the run, all its trees count."""

    pairs: tuple[NodePair, ...]
    only_a: tuple[TreeNode, ...]
    only_b: tuple[TreeNode, ...]

    @property
    def a_by_b(self) -> Mapping[str, str]:
        """The path in A of a node of B."""
        return {pair.b.path: pair.a.path for pair in self.pairs}

    @property
    def moved(self) -> tuple[NodePair, ...]:
        """Pairs with another path."""
        return tuple(pair for pair in self.pairs if pair.a.path != pair.b.path)

    @property
    def retyped(self) -> tuple[NodePair, ...]:
        """Pairs of the same path, but of another type."""
        return tuple(pair for pair in self.pairs if pair.a.id != pair.b.id)

    @property
    def rewired(self) -> tuple[PortChange, ...]:
        return tuple(
            PortChange(pair.a.path, port, pair.a.ports.get(port, ""), pair.b.ports.get(port, ""))
            for pair in self.pairs
            for port in dict.fromkeys((*pair.a.ports, *pair.b.ports))
            if pair.a.ports.get(port, "") != pair.b.ports.get(port, "")
        )


def match_nodes(a: Run, b: Run) -> NodeMatch:
    return match_trees(nodes_of(a), nodes_of(b))


def nodes_of(run: Run) -> tuple[TreeNode, ...]:
    """All nodes that the run's trees have, each as it stood first, parents before their children."""
    found: dict[str, TreeNode] = {}
    for at in run.trees:
        for node in at.record.nodes:
            found.setdefault(node.path, node)
    return tuple(found.values())


def match_trees(a: Iterable[TreeNode], b: Iterable[TreeNode]) -> NodeMatch:
    in_a, in_b = {node.path: node for node in a}, {node.path: node for node in b}
    b_of = {path: path for path in in_a if path in in_b}
    same_in_b = {path: path for path in b_of}
    left_a, left_b = _below(in_a, b_of), _below(in_b, same_in_b)
    for top, ones in left_a.items():
        others = left_b.get(top, [])
        matcher = SequenceMatcher(None, [_kind(n) for n in ones], [_kind(n) for n in others], autojunk=False)
        for block in matcher.get_matching_blocks():
            for k in range(block.size):
                b_of[ones[block.a + k].path] = others[block.b + k].path
    taken = set(b_of.values())
    return NodeMatch(
        tuple(NodePair(node, in_b[b_of[path]]) for path, node in in_a.items() if path in b_of),
        tuple(node for path, node in in_a.items() if path not in b_of),
        tuple(node for path, node in in_b.items() if path not in taken),
    )


def _below(nodes: Mapping[str, TreeNode], paired: Mapping[str, str]) -> dict[str, list[TreeNode]]:
    """The unpaired nodes in the order of the tree, by the nearest paired node above them."""
    below: dict[str, list[TreeNode]] = {}
    for node in nodes.values():
        if node.path in paired:
            continue
        above = node.parent
        while above and above not in paired and above in nodes:
            above = nodes[above].parent
        below.setdefault(above, []).append(node)
    return below


def _kind(node: TreeNode) -> tuple[str, str]:
    """What makes two nodes alike: type, and name without the number that tells siblings apart."""
    return node.id, node.name.split("#")[0]
