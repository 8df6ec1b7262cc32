"""A mission as values: what a mission file says, checked and converted, before anything is built."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from ..files.expressions.expression import Expression
from ..files.yaml.document import Document, Mark
from .mission_files import name_of
from .node import Node
from .ports import PortDeclaration
from .values.references import Binding

MAIN = "Main"


@dataclass(frozen=True, slots=True)
class Plugin:
    """A plug-in that was taken in."""

    name: str
    """As `plugins:` names it; of an installed one its module."""
    nodes: tuple[type[Node], ...]
    file: Path | None = None
    """Where its source is; None when it has none, as a compiled module."""
    source: bytes = b""
    """What was run, for the record."""
    distribution: str = ""
    """Of an installed one: name and version of its distribution."""


@dataclass(frozen=True, slots=True)
class Assignment:
    """`key := expression` of a postcondition; not `new`: `key = expression`, for a key that is there."""

    key: str
    value: Expression
    new: bool = True
    at: int = 0
    """The character (from 0) of the postcondition's text at which the value begins."""


@dataclass(frozen=True, slots=True)
class NodeSpec:
    """One node of the text. `node` is its class; None: it is an instance of the sub-tree `id`."""

    id: str
    name: str
    mark: Mark
    node: type[Node] | None
    ports: Mapping[str, Binding] = field(default_factory=dict[str, Binding])
    slots: Mapping[str, tuple[tuple[str, NodeSpec], ...]] = field(
        default_factory=dict[str, "tuple[tuple[str, NodeSpec], ...]"]
    )
    """Children by slot: (label, node); the label is a table's key, else empty."""
    preconditions: Mapping[str, Expression] = field(default_factory=dict[str, Expression])
    postconditions: Mapping[str, tuple[Assignment, ...]] = field(
        default_factory=dict[str, "tuple[Assignment, ...]"]
    )
    breakpoint: Literal["before", "after"] | None = None
    places: Mapping[str, Mark] = field(default_factory=dict[str, Mark])
    """Where the values of its ports, conditions and slots stand, by key."""

    @property
    def children(self) -> tuple[NodeSpec, ...]:
        return tuple(node for filled in self.slots.values() for _, node in filled)

    def iterate(self) -> Iterator[NodeSpec]:
        """This node and all below it in the same tree, parents first."""
        todo: list[NodeSpec] = [self]
        while todo:
            node = todo.pop()
            yield node
            todo += reversed(node.children)


@dataclass(frozen=True, slots=True)
class TreeSpec:
    """One tree of a mission: its ports (for `Main`: the mission's parameters) and its root."""

    name: str
    mark: Mark
    ports: tuple[PortDeclaration, ...]
    root: NodeSpec
    places: Mapping[str, Mark] = field(default_factory=dict[str, Mark])
    """Where its ports are declared, by key."""


@dataclass(frozen=True, slots=True)
class Mission:
    """A mission file, read and checked."""

    name: str
    trees: Mapping[str, TreeSpec]
    document: Document
    scene: str | None = None
    """A shipped scene, or a file beside the mission."""
    goal: Expression | None = None
    plugins: tuple[str, ...] = ()
    included: tuple[Document, ...] = ()
    """Files whose trees this mission took in, each once."""
    library: bool = False
    """It holds sub-trees for other missions only: no `Main`, no scene, no goal."""
    sources: tuple[Plugin, ...] = ()
    """The plug-ins that it names, and the installed ones whose nodes it uses."""

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
        """The texts of the included files by the names under which they were included."""
        folder = self.document.path.parent
        return {name_of(document.path, folder): document.text for document in self.included}
