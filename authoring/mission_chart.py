"""Chart of a mission, the content of a drawing as plain values, and its builder: trees of nodes with ports
and labelled branches.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal, TypeAlias, cast

from picktree.files import FileError, Mark
from picktree.files.yaml import read_document
from picktree.trees import (
    MAIN,
    Kind,
    Mission,
    NodeDeclaration,
    NodeSpec,
    PortDeclaration,
    SlotDeclaration,
    TreeSpec,
    name_of,
    references,
)
from picktree.trees.loading import examine
from picktree.world import Plain

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
    """Node of a chart. `calls` names the tree of a sub-tree node, which has the branches; `doc` names its
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
        """Name, where it differs from the ID: the author's, or the number among equal siblings."""
        if self.written_as_list or self.name == self.id:
            return ""
        return self.name.removeprefix(self.id) if self.name.startswith(f"{self.id}#") else self.name

    @property
    def title(self) -> str:
        """ID, with the author's name or the number behind it."""
        return f"{self.id}{'' if self.given_name[:1] in ('', '#') else ' '}{self.given_name}"

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
    """Tree of the mission with its ports."""

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
        """Number of written nodes in all trees."""
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
"""Character for each symbol, as usual in the literature."""
MEANINGS: Final[Mapping[Symbol, str]] = {
    "action": "action", "branch": "one branch by a value", "clock": "decorator of time",
    "condition": "condition", "control": "control node", "decorator": "decorator", "fallback": "fallback",
    "force": "decorator of the result", "loop": "loop", "not": "inverter", "parallel": "parallel",
    "recover": "recovery by cause", "sequence": "sequence", "subtree": "sub-tree",
}  # fmt: skip


def symbol_of(declaration: NodeDeclaration) -> Symbol:
    """
    >>> from picktree.trees import Sequence
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


def chart_of_file(path: Path) -> Chart:
    """Return the chart of a mission or library file. Raises FileError with all its errors."""
    reading = examine(read_document(path, "mission"))
    if reading.faults:
        raise FileError(reading.faults)
    return chart(reading.mission)


def chart(mission: Mission) -> Chart:
    """Return the chart of a mission. Trees of included files are drawn where they are used."""
    charting = _Charting(mission)
    return Chart(
        mission.name,
        mission.document.path.name,
        mission.scene or "",
        str(mission.goal) if mission.goal is not None else "",
        tuple(charting.tree(mission.trees[name]) for name in _shown(mission)),
    )


def _shown(mission: Mission) -> list[str]:
    """Return the names of Main, the trees it calls, their calls, then the mission's own uncalled trees."""
    file = str(mission.document.path)
    own = [name for name, tree in mission.trees.items() if tree.mark.file == file]
    order: list[str] = []
    for start in (MAIN, *own):
        waiting = [start] if start in mission.trees else []
        while waiting:
            name = waiting.pop(0)
            if name not in order:
                order.append(name)
                waiting += (node.id for node in mission.trees[name].root.iterate() if node.node is None)
    return order


class _Charting:
    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._folder = mission.document.path.parent

    def tree(self, tree: TreeSpec) -> ChartTree:
        ports = tuple(_tree_port(port) for port in tree.ports)
        return ChartTree(
            tree.name, self._place(tree.mark), ports, self._node(tree.root), _in_a_line(tree.doc)
        )

    def _node(self, spec: NodeSpec, label: str = "") -> ChartNode:
        if spec.node is None:
            return self._call(spec)
        declaration = spec.node.declaration
        cures = any(slot.of == "cause" for slot in declaration.slots)
        branches = tuple(
            self._branch(slot, index, label, child, cures=cures)
            for slot in declaration.slots
            for index, (label, child) in enumerate(spec.slots.get(slot.key, ()))
        )
        return replace(
            self._written(spec, declaration.kind, symbol_of(declaration), declaration.ports),
            doc=declaration.doc,
            written_as_list=bool(label) and spec.id == "Sequence" and spec.name.partition("#")[0] == label,
            causes=tuple(str(cause) for cause in declaration.causes),
            uses=tuple(str(resource) for resource in declaration.uses),
            branches=branches,
        )

    def _call(self, spec: NodeSpec) -> ChartNode:
        called = self._mission.trees[spec.id]
        return replace(
            self._written(spec, "subtree", "subtree", called.ports),
            doc=f"{_in_a_line(called.doc)} Defined at {self._place(called.mark)}.".lstrip(),
            calls=spec.id,
        )

    def _written(
        self, spec: NodeSpec, kind: Kind, symbol: Symbol, ports: tuple[PortDeclaration, ...]
    ) -> ChartNode:
        """Return a node with its content in the file's text."""
        bound = ((port, spec.ports[port.key]) for port in ports if port.key in spec.ports)
        left_out = (port for port in ports if port.direction == "in" and port.key not in spec.ports)
        return ChartNode(
            id=spec.id,
            name=spec.name,
            kind=kind,
            symbol=symbol,
            place=self._place(spec.mark),
            ports=tuple(ChartPort(p.key, _value(value), _role(p, value), _about(p)) for p, value in bound),
            defaults=tuple(
                ChartPort(port.key, _text(cast("Plain", port.default)), "literal", _about(port))
                for port in left_out
                if not port.required
            ),
            before=tuple(Rule(key, str(condition)) for key, condition in spec.preconditions.items()),
            after=tuple(
                Rule(
                    key, "; ".join(f"{p.key} {':=' if p.new else '='} {str(p.value).strip()}" for p in parts)
                )
                for key, parts in spec.postconditions.items()
                if key not in spec.ports  # a Script's `code` is a port, and its assignments, too
            ),
            breakpoint=spec.breakpoint,
        )

    def _branch(
        self, slot: SlotDeclaration, index: int, label: str, child: NodeSpec, *, cures: bool
    ) -> Branch:
        """Return a child's branch. `label`: key in a table. A Sequence named as the slot was a list."""
        shown, called = label, label
        match slot.arity:
            case "one" if slot.key != "do":
                shown = called = slot.key
            case "many" if index < len(slot.labels):
                shown = slot.labels[index]
            case "table" if slot.of == "cause":
                shown = f"{slot.key} {label}"
            case _:
                pass
        cure = cures or shown == RECOVERY
        role: BranchRole = "child" if not shown else "cure" if cure else "choice"
        return Branch(shown, role, self._node(child, called))

    def _place(self, mark: Mark) -> str:
        """Return file and line of a place; the file relative to the mission's folder where possible."""
        try:
            name = name_of(Path(mark.file), self._folder)
        except ValueError:
            name = Path(mark.file).name
        return f"{name}:{mark.line}"


def _in_a_line(text: str) -> str:
    return " ".join(text.split())


def _role(port: PortDeclaration, bound: references.Binding) -> PortRole:
    if port.direction == "out":
        return "output"
    return "literal" if isinstance(bound, references.Constant) else "reference"


def _value(bound: references.Binding) -> str:
    return _text(bound.text) if isinstance(bound, references.Constant) else str(bound)


def _text(value: object) -> str:
    """Return a value in one line, similar to YAML."""
    match value:
        case None:
            return "null"
        case bool():
            return str(value).lower()
        case float() if value.is_integer() and math.fabs(value) < 1e15:
            return str(int(value))
        case str() if not value or value != value.strip():
            return f'"{_printable(value)}"'
        case list():
            return f"[{', '.join(map(_text, cast('list[object]', value)))}]"
        case dict():
            entries = cast("dict[object, object]", value)
            return "{" + ", ".join(f"{key}: {_text(item)}" for key, item in entries.items()) + "}"
        case _:
            return _printable(str(value))


def _printable(text: str) -> str:
    """Return the text with line breaks and control characters escaped."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def _kind(port: PortDeclaration) -> str:
    return f"{port.type}, {port.unit}" if port.unit else str(port.type)


def _about(port: PortDeclaration) -> str:
    kind = _kind(port)
    return f"{port.doc} ({kind})" if port.doc else kind


def _tree_port(port: PortDeclaration) -> ChartPort:
    kind = _kind(port)
    if port.direction == "in" and not port.required:
        kind = f"{kind} = {_text(port.default)}"
    role: PortRole = "output" if port.direction == "out" else "literal"
    return ChartPort(port.key, kind, role, port.doc)
