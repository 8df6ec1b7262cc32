"""The nodes of a run in one order, those of edited missions among them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from ....logs.schema.records import Tree, TreeNode


@dataclass(frozen=True, slots=True)
class RunNode:
    """A node of any of the run's trees."""

    path: str
    id: str
    name: str
    parent: int
    """Number of the parent; -1 for a root."""
    leaf: bool


def nodes_of(trees: Iterable[Tree]) -> tuple[RunNode, ...]:
    """All nodes, parents before their children, siblings in the order of their trees. A node's number is its
    place here. What an edit brought in comes after its older siblings."""
    known: dict[str, TreeNode] = {}
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
