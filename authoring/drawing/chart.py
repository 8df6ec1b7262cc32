"""Chart of a mission, the content of a drawing as plain values: trees of nodes with ports and labelled
branches.

The texts are as in the mission file. The appearance of the drawing is defined elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, TypeAlias

from ...trees.declaration import Kind, NodeDeclaration

PortRole: TypeAlias = Literal["literal", "reference", "output"]
"""Role of a port: a value, a key of the blackboard that is read, or a key that is written."""

BranchRole: TypeAlias = Literal["child", "choice", "cure"]
"""Role of a branch: a plain child, one of several selected by its label, or the handler of a failure."""

Symbol: TypeAlias = Literal[
    "action", "branch", "clock", "condition", "control", "decorator", "fallback", "force", "loop", "not",
    "parallel", "recover", "sequence", "subtree",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class ChartPort:
    """Port of a node with its value in the file, or port of a tree with its type."""

    key: str
    value: str
    role: PortRole
    doc: str = ""


@dataclass(frozen=True, slots=True)
class Rule:
    """Precondition or postcondition: its key, as `_skipIf`, and its expression."""

    key: str
    text: str


@dataclass(frozen=True, slots=True)
class ChartNode:
    """One node. `calls` names the tree of a sub-tree node; the branches are in that tree, and `doc` names its
    file."""

    id: str
    name: str
    """Last part of the node's path: `Observe#2`."""
    kind: Kind
    symbol: Symbol
    place: str = ""
    """File and line."""
    doc: str = ""
    calls: str = ""
    written_as_list: bool = False
    """Whether the node is a Sequence that the file writes as a bare list, named after its slot."""
    ports: tuple[ChartPort, ...] = ()
    defaults: tuple[ChartPort, ...] = ()
    """Inputs without a value in the file."""
    before: tuple[Rule, ...] = ()
    after: tuple[Rule, ...] = ()
    breakpoint: Literal["before", "after"] | None = None
    causes: tuple[str, ...] = ()
    uses: tuple[str, ...] = ()
    branches: tuple[Branch, ...] = ()

    @property
    def given_name(self) -> str:
        """Name, where it differs from the ID: the author's, or the number among equal siblings; else
        empty."""
        if self.written_as_list or self.name == self.id:
            return ""
        return self.name.removeprefix(self.id) if self.name.startswith(f"{self.id}#") else self.name

    def iterate(self) -> Iterator[ChartNode]:
        """Yield this node and its descendants in the same tree, parents first."""
        yield self
        for branch in self.branches:
            yield from branch.node.iterate()


@dataclass(frozen=True, slots=True)
class Branch:
    """Child with its label: `when grasp.missed`, `otherwise`, `else`; empty for a plain child."""

    label: str
    role: BranchRole
    node: ChartNode


@dataclass(frozen=True, slots=True)
class ChartTree:
    """One tree of the mission with its ports."""

    name: str
    place: str
    ports: tuple[ChartPort, ...]
    root: ChartNode
    doc: str = ""


@dataclass(frozen=True, slots=True)
class Chart:
    """All trees of a mission: `Main` first, then the others in the order of their calls."""

    title: str
    file: str
    scene: str = ""
    goal: str = ""
    trees: tuple[ChartTree, ...] = field(default=())

    def tree(self, name: str) -> ChartTree:
        return next(tree for tree in self.trees if tree.name == name)

    @property
    def size(self) -> int:
        """Number of nodes written in all trees."""
        return sum(1 for tree in self.trees for _ in tree.root.iterate())


RECOVERY: Final = "recovery"
"""Label of a child that runs after a failure."""
_WORDS: Final[tuple[tuple[str, Symbol], ...]] = (
    ("Parallel", "parallel"),
    ("Fallback", "fallback"),
    ("Selector", "fallback"),
    ("Sequence", "sequence"),
    ("Repeat", "loop"),
    ("Retry", "loop"),
    ("ForEach", "loop"),
    ("Keep", "loop"),
    ("Loop", "loop"),
    ("Timeout", "clock"),
    ("Delay", "clock"),
    ("Rate", "clock"),
    ("Inverter", "not"),
    ("Force", "force"),
)
"""Symbols by parts of names that are common to behaviour trees; the first match counts."""

CHARACTERS: Final[Mapping[Symbol, str]] = {
    "action": "□", "branch": "◇", "clock": "◷", "condition": "○", "control": "■", "decorator": "δ",
    "fallback": "?", "force": "!", "loop": "↻", "not": "¬", "parallel": "⇉", "recover": "✚",
    "sequence": "→", "subtree": "▣",
}  # fmt: skip
"""One character for each symbol, as in the literature where one is usual."""

MEANINGS: Final[Mapping[Symbol, str]] = {
    "action": "action", "branch": "one branch by a value", "clock": "decorator of time",
    "condition": "condition", "control": "control node", "decorator": "decorator", "fallback": "fallback",
    "force": "decorator of the result", "loop": "loop", "not": "inverter", "parallel": "parallel",
    "recover": "recovery by cause", "sequence": "sequence", "subtree": "sub-tree",
}  # fmt: skip


def symbol_of(declaration: NodeDeclaration) -> Symbol:
    """
    >>> from ...trees.controls import Sequence
    >>> symbol_of(Sequence.declaration)
    'sequence'
    """
    match declaration.kind:
        case "action" | "condition" | "subtree" as kind:
            return kind
        case _:
            pass
    if any(slot.of == "cause" or RECOVERY in slot.labels for slot in declaration.slots):
        return "recover"
    for word, symbol in _WORDS:
        if word in declaration.id:
            return symbol
    if any(slot.arity == "table" or slot.labels for slot in declaration.slots):
        return "branch"
    return "decorator" if declaration.kind == "decorator" else "control"
