"""Mission as values: the content of a mission file, checked and converted, before a tree is built.
Errors are collected with their places.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Final, Literal

from picktree.files import Diagnostic, Expression, Mark
from picktree.files.yaml import Document

from .mission_files import name_of
from .node import Node
from .ports import PortDeclaration
from .references import Assignment, Binding

MAX_NODES: Final = 10_000
"""Maximum number of nodes of a mission, with sub-trees expanded."""


MAIN = "Main"


@dataclass(frozen=True, slots=True)
class Plugin:
    """A plug-in that was loaded."""

    name: str
    """Name in `plugins:`; for an installed plug-in its module."""
    nodes: tuple[type[Node], ...]
    file: Path | None = None
    """Source file; None without one, as for a compiled module."""
    source: bytes = b""
    """Source code that was run, for the record."""
    distribution: str = ""
    """Name and version of the distribution of an installed plug-in; else empty."""


@dataclass(frozen=True, slots=True)
class NodeSpec:
    """One node of the mission text. `node` is its class; None: an instance of the sub-tree `id`."""

    id: str
    name: str
    mark: Mark
    node: type[Node] | None
    ports: Mapping[str, Binding] = field(default_factory=dict[str, Binding])
    slots: Mapping[str, tuple[tuple[str, NodeSpec], ...]] = field(
        default_factory=dict[str, "tuple[tuple[str, NodeSpec], ...]"]
    )
    """Children by slot as (label, node); the label is a table's key, else empty."""
    preconditions: Mapping[str, Expression] = field(default_factory=dict[str, Expression])
    postconditions: Mapping[str, tuple[Assignment, ...]] = field(
        default_factory=dict[str, "tuple[Assignment, ...]"]
    )
    breakpoint: Literal["before", "after"] | None = None
    places: Mapping[str, Mark] = field(default_factory=dict[str, Mark])
    """Places of the values of ports, conditions and slots, by key."""
    autoremap: frozenset[str] | None = None
    """Ports of a sub-tree that `_autoremap` wires to the caller's keys of that name; None: without it."""

    @property
    def children(self) -> tuple[NodeSpec, ...]:
        return tuple(node for filled in self.slots.values() for _, node in filled)

    def mark_at(self, key: str) -> Mark:
        """Return the place of the value of one of its keys; for a missing key the place of the node."""
        return self.places.get(key, self.mark)

    def iterate(self) -> Iterator[NodeSpec]:
        """Yield this node and its descendants in the same tree, parents first."""
        todo: list[NodeSpec] = [self]
        while todo:
            node = todo.pop()
            yield node
            todo += reversed(node.children)


@dataclass(frozen=True, slots=True)
class TreeSpec:
    """One tree of a mission: its ports (for `Main` the mission's parameters) and its root."""

    name: str
    mark: Mark
    ports: tuple[PortDeclaration, ...]
    root: NodeSpec
    places: Mapping[str, Mark] = field(default_factory=dict[str, Mark])
    """Places of the port declarations, by key."""
    doc: str = ""
    """The tree in a sentence or two, for people."""


@dataclass(frozen=True, slots=True)
class Mission:
    """A mission file, read and checked."""

    name: str
    trees: Mapping[str, TreeSpec]
    document: Document
    scene: str | None = None
    """Shipped scene, or a file relative to the mission; None when the mission names none."""
    goal: Expression | None = None
    plugins: tuple[str, ...] = ()
    included: tuple[Document, ...] = ()
    """Included files, each once."""
    library: bool = False
    """Whether the file only holds sub-trees for other missions: no `Main`, no scene, no goal."""
    sources: tuple[Plugin, ...] = ()
    """Plug-ins that the mission names, and installed ones whose nodes it uses."""

    @property
    def main(self) -> TreeSpec:
        return self.trees[MAIN]

    @property
    def parameters(self) -> tuple[PortDeclaration, ...]:
        return self.main.ports

    @property
    def text(self) -> str:
        return self.document.text

    @property
    def files(self) -> dict[str, str]:
        """Return the texts of the included files by the names under which they are included."""
        folder = self.document.path.parent
        return {name_of(document.path, folder): document.text for document in self.included}


MAX_MISSION_DEPTH: Final = 120
"""Maximum depth of a mission in nodes, with sub-trees expanded."""


def called_by(tree: TreeSpec) -> tuple[str, ...]:
    """Return the sub-trees that the tree calls, each once."""
    return tuple(dict.fromkeys(node.id for node in tree.root.iterate() if node.node is None))


def reachable(trees: Mapping[str, TreeSpec]) -> frozenset[str]:
    """Return the names of the trees that a run can reach from `Main`."""
    found: set[str] = set()
    todo = [MAIN]
    while todo:
        name = todo.pop()
        if name in trees and name not in found:
            found.add(name)
            todo += called_by(trees[name])
    return frozenset(found)


def bottom_up(trees: Mapping[str, TreeSpec]) -> tuple[str, ...]:
    """Return the names of the trees, each after those that it calls. Raises CycleError."""
    calls = {name: [c for c in called_by(tree) if c in trees] for name, tree in trees.items()}
    return tuple(TopologicalSorter(calls).static_order())


def check_calls(trees: Mapping[str, TreeSpec]) -> Iterable[Diagnostic]:
    """Yield an error for a circle of calls, and for a mission too large to be built."""
    try:
        order = bottom_up(trees)
    except CycleError as error:
        circle: list[str] = list(reversed(error.args[1]))
        name, called = circle[0], circle[1]
        mark = next(n.mark for n in trees[name].root.iterate() if n.node is None and n.id == called)
        shown = circle if len(circle) <= 12 else [*circle[:6], "…", *circle[-5:]]
        message = f"the sub-trees call each other in a circle: {' → '.join(shown)}"
        yield Diagnostic(mark, f"trees.{name}", message, "a loop is Repeat or ForEach", "P235")
        return
    sizes: dict[str, tuple[int, int]] = {}
    for name in order:
        sizes[name] = _size(trees[name].root, sizes)
    count, depth = sizes.get(MAIN, (0, 0))
    if count > MAX_NODES or depth > MAX_MISSION_DEPTH:
        message = f"with its sub-trees written out the mission has {count} nodes, {depth} deep"
        hint = f"at most {MAX_NODES} nodes, {MAX_MISSION_DEPTH} deep"
        yield Diagnostic(trees[MAIN].mark, f"trees.{MAIN}", message, hint, "P236")


def _size(spec: NodeSpec, sizes: Mapping[str, tuple[int, int]]) -> tuple[int, int]:
    """Return number and depth of the nodes with sub-trees expanded; `sizes` holds those of called trees."""
    below = [_size(child, sizes) for child in spec.children]
    if spec.node is None and spec.id in sizes:
        below = [sizes[spec.id]]
    return 1 + sum(count for count, _ in below), 1 + max((depth for _, depth in below), default=0)
