"""The grammar of nodes: from the values under `trees:` to NodeSpecs, with all faults and their places.

A node is a mapping with one key, `NodeID: {port: value, …}`, or the bare ID. Children are a list under the
node, or `do:` where it has ports of its own; other slots have names. Where one child is wanted, a list is a
Sequence.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import cast

from ..world.causes import all_causes
from ..world.files.document import Document, Fault, Location, Value, nearest
from ..world.files.expressions import Expression, ExpressionError
from ..world.journal import Plain
from .controls import Sequence
from .declaration import IDENTIFIER, PRECONDITIONS, NodeDeclaration
from .mission import NodeSpec
from .node import Node
from .ports import PortDeclaration
from .references import ATTRIBUTES, Binding, Constant, Reference
from .registry import Registry
from .slots import SlotDeclaration
from .types import convert

_NAME = re.compile(r"[^/#\x00-\x1f]{1,60}")
_NO_PORTS = ("name", *PRECONDITIONS)


@dataclass(slots=True)
class Names:
    """Gives each child of a node a name of its own: the second `Observe` is `Observe#2`."""

    _counts: dict[str, int] = field(default_factory=dict[str, int])

    def take(self, name: str) -> str:
        count = self._counts[name] = self._counts.get(name, 0) + 1
        return name if count == 1 else f"{name}#{count}"


class Grammar:
    """Reads the nodes of one document; `faults` gathers what is wrong."""

    def __init__(
        self, document: Document, registry: Registry, trees: Mapping[str, tuple[PortDeclaration, ...]]
    ) -> None:
        self.faults: list[Fault] = []
        self._document = document
        self._registry = registry
        self._trees = trees

    @property
    def _excuse(self) -> str:
        """Why a node may be unknown although its name is right."""
        return "; ".join(problem.message for problem in self._registry.problems)

    def fault(self, loc: Location, trail: str, message: str, hint: str = "", *, key: bool = False) -> None:
        mark = self._document.key_mark(loc) if key else self._document.mark(loc)
        self.faults.append(Fault(mark, trail, message, hint))

    def node(self, value: Value, loc: Location, above: str, names: Names) -> NodeSpec | None:
        """One node and all below it; None when it cannot be read at all."""
        match value:
            case str():
                return self._known(value, None, loc, loc, above, names)
            case dict() if len(value) == 1:
                ((identity, body),) = value.items()
                return self._known(identity, body, (*loc, identity), loc, above, names)
            case dict() if value:
                keys = list(value)
                shown = ", ".join(map(repr, keys[:4])) + (", …" if len(keys) > 4 else "")
                self.fault(
                    loc,
                    above,
                    f"a node is a mapping with one key, its ID; here are {len(keys)}: {shown}",
                    f"what belongs to {keys[0]!r} is indented under it",
                )
            case _:
                self.fault(
                    loc, above, "here a node must stand", "as 'Grasp: {object: \"{item}\"}' or a bare ID"
                )
        return None

    def _known(
        self, identity: str, body: Value, loc: Location, start: Location, above: str, names: Names
    ) -> NodeSpec | None:
        given = body.get("name") if isinstance(body, dict) else None
        named = isinstance(given, str) and _NAME.fullmatch(given) is not None
        name = names.take(given if named and isinstance(given, str) else identity)
        trail = f"{above}/{name}"
        if given is not None and not named:
            self.fault((*loc, "name"), trail, "a name is a text without '/' and '#', 60 characters at most")
        if identity in self._trees:
            return self._subtree(identity, name, body, loc, start, trail)
        node = self._registry.find(identity)
        if node is None:
            self._unknown(identity, body, loc, above, trail)
            return None
        return self._node(node, name, body, loc, start, trail)

    def _unknown(self, identity: str, body: Value, loc: Location, above: str, trail: str) -> None:
        if IDENTIFIER.fullmatch(identity):
            message = f"unknown node {identity!r}"
            hint = nearest(identity, (*self._trees, *self._registry.ids()))
            if not hint.startswith("did you mean"):
                hint = self._excuse or hint
        else:
            message, hint = f"{identity!r} is not an ID", "a letter or '_', then letters, digits and '_'"
        self.fault(loc, above, message, hint, key=bool(loc) and loc[-1] == identity)
        # What stands below is still looked at: all faults are reported at once.
        inner, at = (body.get("do"), (*loc, "do")) if isinstance(body, dict) else (body, loc)
        if isinstance(inner, list):
            self._list(inner, at, trail, Names())
        elif inner is not None and at != loc:
            self.node(inner, at, trail, Names())

    # A sub-tree.

    def _subtree(
        self, identity: str, name: str, body: Value, loc: Location, start: Location, trail: str
    ) -> NodeSpec | None:
        ports = self._trees[identity]
        given = self._mapping(identity, body, loc, trail)
        bindings: dict[str, Binding] = {}
        for key, value in given.items():
            port = next((p for p in ports if p.key == key), None)
            if port is not None:
                self._bind(bindings, port, value, (*loc, key), trail)
            elif key not in _NO_PORTS:
                self._unknown_key(identity, key, (*(p.key for p in ports), *_NO_PORTS), (*loc, key), trail)
        self._missing(ports, given, loc, trail, key=loc != start)
        return NodeSpec(
            identity,
            name,
            self._document.mark(start),
            None,
            bindings,
            preconditions=self._preconditions(given, loc, trail),
        )

    # A node of a class.

    def _node(
        self, node: type[Node], name: str, body: Value, loc: Location, start: Location, trail: str
    ) -> NodeSpec:
        declaration = node.declaration
        main = declaration.slot("do")
        given, places = self._body(declaration, main, body, loc, trail)
        bindings: dict[str, Binding] = {}
        slots: dict[str, tuple[tuple[str, NodeSpec], ...]] = {}
        names = Names()
        for key, value in given.items():
            port, slot, at = declaration.port(key), declaration.slot(key), places[key]
            if port is not None:
                self._bind(bindings, port, value, at, trail)
            elif slot is not None:
                slots[key] = self._slot(declaration, slot, value, at, trail, names)
            elif key not in _NO_PORTS:
                self._unknown_key(declaration.id, key, declaration.keys, at, trail)
        keyed = loc != start
        self._missing(declaration.ports, given, loc, trail, key=keyed)
        for slot in declaration.slots:
            if slot.required and slot.key not in given:
                what = "its children are" if slot.arity == "many" else "its child is"
                what = what if slot.key == "do" else f"{slot.key!r} is"
                self.fault(loc, trail, f"{what} missing: {slot.doc}", key=keyed)
        for sentence in node.check_ports(frozenset(given)):
            self.fault(loc, trail, sentence, key=keyed)
        ordered = {slot.key: slots[slot.key] for slot in declaration.slots if slot.key in slots}
        conditions = self._preconditions(given, loc, trail)
        return NodeSpec(declaration.id, name, self._document.mark(start), node, bindings, ordered, conditions)

    def _body(
        self,
        declaration: NodeDeclaration,
        main: SlotDeclaration | None,
        body: Value,
        loc: Location,
        trail: str,
    ) -> tuple[dict[str, Value], dict[str, Location]]:
        """The node's keys with their values, and where each value stands."""
        if main is not None and isinstance(body, str | list):
            return {"do": body}, {"do": loc}
        given = dict(self._mapping(declaration.id, body, loc, trail))
        places: dict[str, Location] = {key: (*loc, key) for key in given}
        strange = [key for key in given if key not in declaration.keys]
        if main is not None and "do" not in given and len(strange) == 1 and self._is_node(strange[0]):
            # `Inverter: {Condition: {if: holding}}`: the one key that is no port is the child.
            child = strange[0]
            given["do"] = {child: given.pop(child)}
            places["do"] = loc
        return given, places

    def _is_node(self, key: str) -> bool:
        return key in self._trees or self._registry.find(key) is not None or key[:1].isupper()

    def _mapping(self, identity: str, body: Value, loc: Location, trail: str) -> dict[str, Value]:
        match body:
            case None:
                return {}
            case dict():
                return body
            case list():
                self.fault(loc, trail, f"{identity} has no children")
            case _:
                self.fault(loc, trail, f"the ports of {identity} are a mapping", "as '{port: value}'")
        return {}

    def _slot(
        self,
        declaration: NodeDeclaration,
        slot: SlotDeclaration,
        value: Value,
        loc: Location,
        trail: str,
        names: Names,
    ) -> tuple[tuple[str, NodeSpec], ...]:
        match slot.arity:
            case "one":
                label = "" if slot.key == "do" else slot.key
                found = self._one(value, loc, trail, names, label)
                return (("", found),) if found else ()
            case "many":
                return self._many(declaration, slot, value, loc, trail, names)
            case "table":
                return self._table(slot, value, loc, trail, names)

    def _one(self, value: Value, loc: Location, trail: str, names: Names, label: str) -> NodeSpec | None:
        """One node; a list is a Sequence, which under `do` is called so and elsewhere as its slot."""
        if not isinstance(value, list):
            return self.node(value, loc, trail, names)
        if not value:
            self.fault(loc, trail, "the list is empty; at least one node must stand here")
            return None
        name = names.take(label or Sequence.declaration.id)
        parts = self._list(value, loc, f"{trail}/{name}", Names())
        return NodeSpec(
            Sequence.declaration.id, name, self._document.mark(loc), Sequence, slots={"do": parts}
        )

    def _many(
        self,
        declaration: NodeDeclaration,
        slot: SlotDeclaration,
        value: Value,
        loc: Location,
        trail: str,
        names: Names,
    ) -> tuple[tuple[str, NodeSpec], ...]:
        if not isinstance(value, list):
            found = self.node(value, loc, trail, names)
            count, parts = 1, (("", found),) if found else ()
        else:
            count, parts = len(value), self._list(value, loc, trail, names)
        if count < slot.least or (slot.most is not None and count > slot.most):
            limit = f"at least {slot.least}" if slot.most is None else f"{slot.least} to {slot.most}"
            self.fault(loc, trail, f"{declaration.id} has {count} children; it takes {limit}")
        return parts

    def _list(
        self, value: list[Value], loc: Location, trail: str, names: Names
    ) -> tuple[tuple[str, NodeSpec], ...]:
        found = (self.node(item, (*loc, index), trail, names) for index, item in enumerate(value))
        return tuple(("", node) for node in found if node is not None)

    def _table(
        self, slot: SlotDeclaration, value: Value, loc: Location, trail: str, names: Names
    ) -> tuple[tuple[str, NodeSpec], ...]:
        if not isinstance(value, dict) or not value:
            self.fault(loc, trail, f"{slot.key!r} is a mapping: {slot.doc}")
            return ()
        found: list[tuple[str, NodeSpec]] = []
        for key, body in value.items():
            if slot.of == "cause":
                self._check_pattern(key, (*loc, key), trail)
            elif not _NAME.fullmatch(key):
                self.fault((*loc, key), trail, f"{key!r} cannot name a case", key=True)
            node = self._one(body, (*loc, key), trail, names, key)
            if node is not None:
                found.append((key, node))
        return tuple(found)

    def _check_pattern(self, pattern: str, loc: Location, trail: str) -> None:
        known = [cause.name for cause in all_causes()]
        families = {name.rsplit(".", 1)[0] for name in known}
        patterns = [*known, *(f"{family}.*" for family in sorted(families)), "*"]
        if pattern not in patterns:
            self.fault(loc, trail, f"no cause is called {pattern!r}", nearest(pattern, patterns), key=True)

    # Ports and preconditions.

    def _bind(
        self, bindings: dict[str, Binding], port: PortDeclaration, value: Value, loc: Location, trail: str
    ) -> None:
        bound = self._binding(port, value, loc, trail)
        if bound is not None:
            bindings[port.key] = bound

    def _binding(self, port: PortDeclaration, value: Value, loc: Location, trail: str) -> Binding | None:
        what = f"port {port.key!r}"
        if isinstance(value, str) and port.type.name != "expression":
            try:
                reference = Reference.parse(value)
            except ValueError as error:
                self.fault(loc, trail, f"{what}: {error}", 'a reference is "{key}" or "{key.attribute}"')
                return None
            if reference is not None:
                return self._reference(port, reference, loc, trail)
        if port.direction == "out":
            hint = f'write "{{{value}}}"' if isinstance(value, str) and IDENTIFIER.fullmatch(value) else ""
            self.fault(loc, trail, f"{what} is an output: it needs a key to write to", hint or 'as "{key}"')
            return None
        try:
            return Constant(convert(value, port.type, port.unit, port.choices), cast("Plain", value))
        except ExpressionError as error:
            self.fault(loc, trail, f"{what}: {error}, at character {error.offset + 1} of {value!r}")
        except ValueError as error:
            self.fault(loc, trail, f"{what}: {error}", port.doc)
        return None

    def _reference(
        self, port: PortDeclaration, reference: Reference, loc: Location, trail: str
    ) -> Binding | None:
        if port.direction == "out" and reference.attributes:
            self.fault(loc, trail, f"port {port.key!r} is an output: {reference} cannot be written")
            return None
        for name in reference.attributes:
            if name not in ATTRIBUTES:
                self.fault(
                    loc,
                    trail,
                    f"port {port.key!r}: {reference}: an object has no attribute {name!r}",
                    nearest(name, ATTRIBUTES),
                )
                return None
        return reference

    def _preconditions(self, given: Mapping[str, Value], loc: Location, trail: str) -> dict[str, Expression]:
        found: dict[str, Expression] = {}
        for name in PRECONDITIONS:
            if name not in given:
                continue
            value = given[name]
            try:
                if not isinstance(value, str | bool):
                    raise ExpressionError(f"{value!r} is not an expression")
                found[name] = Expression.parse(value if isinstance(value, str) else str(value).lower())
            except ExpressionError as error:
                at = f", at character {error.offset + 1} of {value!r}" if isinstance(value, str) else ""
                self.fault((*loc, name), trail, f"{name}: {error}{at}")
        return found

    def _missing(
        self,
        ports: Iterable[PortDeclaration],
        given: Mapping[str, Value],
        loc: Location,
        trail: str,
        *,
        key: bool,
    ) -> None:
        for port in ports:
            if port.required and port.key not in given:
                self.fault(loc, trail, f"port {port.key!r} is missing: {port.doc}", key=key)

    def _unknown_key(self, identity: str, key: str, known: Iterable[str], loc: Location, trail: str) -> None:
        # Preconditions are known to those who want them; in a hint they would only be noise.
        names = [name for name in known if not name.startswith("_") or key.startswith("_")]
        self.fault(loc, trail, f"{identity} has no port {key!r}", nearest(key, names), key=True)
