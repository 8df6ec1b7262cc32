"""Reader of a node's children: lists, tables and single nodes, each with a unique name."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias

from ...files.marks import Location
from ...files.yaml.document import Document
from ...files.yaml.reader import Value
from ...world.causes import OUR_PREFIXES
from ..controls import Sequence
from ..declaration import NodeDeclaration
from ..fault_collector import MissionDiagnostics
from ..mission import NodeSpec
from ..port_types import show
from ..ports import SlotDeclaration
from .registry import NodeRegistry

NAME_PATTERN = re.compile(r"[^/#\x00-\x1f]{1,60}")
"""Valid name of a node, or of a case."""
Filled: TypeAlias = tuple[tuple[str, NodeSpec], ...]
"""Children of a slot as (label, node); the label is the name in a table, else empty."""


@dataclass(slots=True)
class ChildNames:
    """Allocator of unique names among siblings: the second `Observe` is `Observe#2`."""

    _counts: dict[str, int] = field(default_factory=dict[str, int])

    def take(self, name: str) -> str:
        count = self._counts[name] = self._counts.get(name, 0) + 1
        return name if count == 1 else f"{name}#{count}"


class ChildReader:
    """Reader of the slots of nodes. `node` reads a single node."""

    def __init__(
        self,
        document: Document,
        registry: NodeRegistry,
        faults: MissionDiagnostics,
        node: Callable[[Value, Location, str, ChildNames], NodeSpec | None],
    ) -> None:
        self._document = document
        self._registry = registry
        self._faults = faults
        self._node = node

    def read(
        self,
        declaration: NodeDeclaration,
        slot: SlotDeclaration,
        value: Value,
        loc: Location,
        trail: str,
        names: ChildNames,
    ) -> Filled:
        match slot.arity:
            case "one":
                label = "" if slot.key == "do" else slot.key
                found = self._one(value, loc, trail, names, label)
                return (("", found),) if found else ()
            case "many":
                return self._many(declaration, slot, value, loc, trail, names)
            case "table":
                return self._table(slot, value, loc, trail, names)

    def _one(self, value: Value, loc: Location, trail: str, names: ChildNames, label: str) -> NodeSpec | None:
        """Read one node. A list is a Sequence, named so under `do` and after its slot elsewhere."""
        if not isinstance(value, list):
            return self._node(value, loc, trail, names)
        if not value:
            message = "the list is empty; at least one node must stand here"
            self._fault(loc, trail, message, code="P231")
            return None
        name = names.take(label or Sequence.declaration.id)
        parts = self.listed(value, loc, f"{trail}/{name}", ChildNames())
        mark = self._document.mark(loc)
        slots = {"do": parts}
        return NodeSpec(Sequence.declaration.id, name, mark, Sequence, slots=slots, places={"do": mark})

    def _many(
        self,
        declaration: NodeDeclaration,
        slot: SlotDeclaration,
        value: Value,
        loc: Location,
        trail: str,
        names: ChildNames,
    ) -> Filled:
        if not isinstance(value, list):
            found = self._node(value, loc, trail, names)
            count, parts = 1, (("", found),) if found else ()
        else:
            count, parts = len(value), self.listed(value, loc, trail, names)
        if count < slot.least or (slot.most is not None and count > slot.most):
            limit = f"at least {slot.least}" if slot.most is None else f"{slot.least} to {slot.most}"
            limit = f"{slot.least}" if slot.least == slot.most else limit
            message = (
                f"{declaration.id} has {count} {'child' if count == 1 else 'children'}; it takes {limit}"
            )
            self._fault(loc, trail, message, code="P229")
        return parts

    def listed(self, value: list[Value], loc: Location, trail: str, names: ChildNames) -> Filled:
        found = (self._node(item, (*loc, index), trail, names) for index, item in enumerate(value))
        return tuple(("", node) for node in found if node is not None)

    def _table(
        self, slot: SlotDeclaration, value: Value, loc: Location, trail: str, names: ChildNames
    ) -> Filled:
        if not isinstance(value, dict) or not value:
            self._fault(loc, trail, f"{slot.key!r} is a mapping: {slot.doc}", code="P232")
            return ()
        found: list[tuple[str, NodeSpec]] = []
        for key, body in value.items():
            if slot.of == "cause":
                self._check_pattern(key, (*loc, key), trail)
            elif not NAME_PATTERN.fullmatch(key):
                self._fault((*loc, key), trail, f"{show(key)} cannot name a case", code="P232", key=True)
            node = self._one(body, (*loc, key), trail, names, key)
            if node is not None:
                found.append((key, node))
        return tuple(found)

    def _check_pattern(self, pattern: str, loc: Location, trail: str) -> None:
        patterns = self._registry.patterns
        ours = pattern.partition(".")[0] in OUR_PREFIXES
        if pattern not in patterns and not self._registry.is_lost(pattern, near=ours):
            plugin = self._registry.registers(pattern)
            if plugin:
                message = f"{show(pattern)} is registered by {plugin}, but no node declares it"
                hint = f"add it to the 'causes' of the skill in {plugin} that fails with it"
            else:
                message = f"no cause is called {show(pattern)}"
                hint = self._faults.nearest(pattern, patterns)
            self._fault(loc, trail, message, hint, code="P233", key=True)

    def _fault(
        self, loc: Location, trail: str, message: str, hint: str = "", *, code: str, key: bool = False
    ) -> None:
        self._faults.at(self._document, loc, trail, message, hint, code=code, key=key)


def labels_of(slot: SlotDeclaration, value: Value) -> tuple[str, ...]:
    """Return one label for each child under a slot: its name in a table, else empty."""
    if slot.arity == "table":
        return tuple(value) if isinstance(value, dict) else ()
    return ("",) * len(value) if isinstance(value, list) else ("",)
