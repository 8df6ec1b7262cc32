"""Builder of charts: converts a mission to its chart."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import cast

from ...files.marks import FileError, Mark
from ...files.yaml.document import read_document
from ...trees.loading.loader import examine
from ...trees.mission import MAIN, Mission, NodeSpec, TreeSpec, name_of
from ...trees.ports import PortDeclaration, SlotDeclaration
from ...trees.references import Binding, Constant
from ...world.journal import Plain
from .chart import (
    RECOVERY,
    Branch,
    BranchRole,
    Chart,
    ChartNode,
    ChartPort,
    ChartTree,
    PortRole,
    Rule,
    symbol_of,
)


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
                waiting += _calls(mission.trees[name])
    return order


def _calls(tree: TreeSpec) -> Iterator[str]:
    return (node.id for node in tree.root.iterate() if node.node is None)


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
        return ChartNode(
            id=spec.id,
            name=spec.name,
            kind=declaration.kind,
            symbol=symbol_of(declaration),
            place=self._place(spec.mark),
            doc=declaration.doc,
            written_as_list=_written_as_list(spec, label),
            ports=_bound(spec, declaration.ports),
            defaults=_defaults(spec, declaration.inputs),
            before=_before(spec),
            after=_after(spec),
            breakpoint=spec.breakpoint,
            causes=tuple(str(cause) for cause in declaration.causes),
            uses=tuple(str(resource) for resource in declaration.uses),
            branches=branches,
        )

    def _call(self, spec: NodeSpec) -> ChartNode:
        called = self._mission.trees[spec.id]
        ports = called.ports
        return ChartNode(
            id=spec.id,
            name=spec.name,
            kind="subtree",
            symbol="subtree",
            place=self._place(spec.mark),
            doc=f"{_in_a_line(called.doc)} Defined at {self._place(called.mark)}.".lstrip(),
            calls=spec.id,
            ports=_bound(spec, ports),
            defaults=_defaults(spec, tuple(port for port in ports if port.direction == "in")),
            before=_before(spec),
            after=_after(spec),
            breakpoint=spec.breakpoint,
        )

    def _branch(
        self, slot: SlotDeclaration, index: int, label: str, child: NodeSpec, *, cures: bool
    ) -> Branch:
        """Return a child's branch. `label`: key in a table. A Sequence with the slot's name was written as a
        list."""
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


def _written_as_list(spec: NodeSpec, label: str) -> bool:
    return bool(label) and spec.id == "Sequence" and spec.name.partition("#")[0] == label


def _bound(spec: NodeSpec, ports: tuple[PortDeclaration, ...]) -> tuple[ChartPort, ...]:
    return tuple(
        ChartPort(port.key, _value(bound), _role(port, bound), _about(port))
        for port in ports
        if (bound := spec.ports.get(port.key)) is not None
    )


def _defaults(spec: NodeSpec, ports: tuple[PortDeclaration, ...]) -> tuple[ChartPort, ...]:
    return tuple(
        ChartPort(port.key, _text(cast("Plain", port.default)), "literal", _about(port))
        for port in ports
        if port.key not in spec.ports and not port.required
    )


def _role(port: PortDeclaration, bound: Binding) -> PortRole:
    if port.direction == "out":
        return "output"
    return "literal" if isinstance(bound, Constant) else "reference"


def _value(bound: Binding) -> str:
    return _text(bound.text) if isinstance(bound, Constant) else str(bound)


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


def _about(port: PortDeclaration) -> str:
    kind = f"{port.type}, {port.unit}" if port.unit else str(port.type)
    return f"{port.doc} ({kind})" if port.doc else kind


def _tree_port(port: PortDeclaration) -> ChartPort:
    kind = str(port.type) if port.unit is None else f"{port.type}, {port.unit}"
    if port.direction == "in" and not port.required:
        kind = f"{kind} = {_text(port.default)}"
    role: PortRole = "output" if port.direction == "out" else "literal"
    return ChartPort(port.key, kind, role, port.doc)


def _before(spec: NodeSpec) -> tuple[Rule, ...]:
    return tuple(Rule(key, str(expression)) for key, expression in spec.preconditions.items())


def _after(spec: NodeSpec) -> tuple[Rule, ...]:
    return tuple(
        Rule(
            key,
            "; ".join(f"{part.key} {':=' if part.new else '='} {str(part.value).strip()}" for part in parts),
        )
        for key, parts in spec.postconditions.items()
    )
