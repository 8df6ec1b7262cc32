"""Sub-trees that call sub-trees: no circle, and a bound on what comes out when all are written out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from graphlib import CycleError, TopologicalSorter
from typing import Final

from ..files.yaml.document import Fault
from .mission import MAIN, NodeSpec, TreeSpec
from .values.fault_collector import MAX_NODES

MAX_DEPTH: Final = 120
"""Nodes above one another, sub-trees written out."""


def called_by(tree: TreeSpec) -> tuple[str, ...]:
    """The sub-trees that the tree uses, each once."""
    return tuple(dict.fromkeys(node.id for node in tree.root.iterate() if node.node is None))


def reachable(trees: Mapping[str, TreeSpec]) -> frozenset[str]:
    """The trees that a run may come to."""
    found: set[str] = set()
    todo = [MAIN]
    while todo:
        name = todo.pop()
        if name in trees and name not in found:
            found.add(name)
            todo += called_by(trees[name])
    return frozenset(found)


def bottom_up(trees: Mapping[str, TreeSpec]) -> tuple[str, ...]:
    """The trees, each after those that it uses. Raises CycleError."""
    calls = {name: [c for c in called_by(tree) if c in trees] for name, tree in trees.items()}
    return tuple(TopologicalSorter(calls).static_order())


def check_calls(trees: Mapping[str, TreeSpec]) -> Iterable[Fault]:
    """A fault for a circle, and for a mission too large to be built."""
    try:
        order = bottom_up(trees)
    except CycleError as error:
        circle: list[str] = list(reversed(error.args[1]))
        name, called = circle[0], circle[1]
        mark = next(n.mark for n in trees[name].root.iterate() if n.node is None and n.id == called)
        shown = circle if len(circle) <= 12 else [*circle[:6], "…", *circle[-5:]]
        message = f"the sub-trees call each other in a circle: {' → '.join(shown)}"
        yield Fault(mark, f"trees.{name}", message, "a loop is Repeat or ForEach", "P235")
        return
    sizes: dict[str, tuple[int, int]] = {}
    for name in order:
        sizes[name] = _size(trees[name].root, sizes)
    count, depth = sizes.get(MAIN, (0, 0))
    if count > MAX_NODES or depth > MAX_DEPTH:
        message = f"with its sub-trees written out the mission has {count} nodes, {depth} deep"
        hint = f"at most {MAX_NODES} nodes, {MAX_DEPTH} deep"
        yield Fault(trees[MAIN].mark, f"trees.{MAIN}", message, hint, "P236")


def _size(spec: NodeSpec, sizes: Mapping[str, tuple[int, int]]) -> tuple[int, int]:
    """Number and depth of the nodes with sub-trees written out; those are in `sizes` already."""
    below = [_size(child, sizes) for child in spec.children]
    if spec.node is None and spec.id in sizes:
        below = [sizes[spec.id]]
    return 1 + sum(count for count, _ in below), 1 + max((depth for _, depth in below), default=0)
