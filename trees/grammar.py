"""The grammar of nodes: from the values under `trees:` to NodeSpecs, with all faults and their places.

A node is a mapping with one key, `NodeID: {port: value, …}`, or the bare ID. Children are a list under the
node, or `do:` where it has ports of its own; other slots have names. Where one child is wanted, a list is a
Sequence.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from ..world.files.document import Document, Location, Mark, Value
from .controls import Sequence
from .declaration import COMMON_KEYS, IDENTIFIER, NodeDeclaration
from .faults import Faults
from .given import Given
from .mission import NodeSpec
from .node import Node
from .pointer import Pointer
from .ports import PortDeclaration
from .references import Binding, Constant
from .registry import Registry
from .slots import SlotDeclaration
from .types import show
from .wires import Wires

_NAME = re.compile(r"[^/#\x00-\x1f]{1,60}")
_Filled = tuple[tuple[str, NodeSpec], ...]


@dataclass(slots=True)
class Names:
    """Gives each child of a node a name of its own: the second `Observe` is `Observe#2`."""

    _counts: dict[str, int] = field(default_factory=dict[str, int])

    def take(self, name: str) -> str:
        count = self._counts[name] = self._counts.get(name, 0) + 1
        return name if count == 1 else f"{name}#{count}"


def _labels(slot: SlotDeclaration, value: Value) -> tuple[str, ...]:
    """One entry for each child under a slot: its name in a table, else empty."""
    if slot.arity == "table":
        return tuple(value) if isinstance(value, dict) else ()
    return ("",) * len(value) if isinstance(value, list) else ("",)


@dataclass(frozen=True, slots=True)
class _Site:
    """Where a node stands: `loc` of what is under its ID, `start` of the whole, and its path in the tree."""

    loc: Location
    start: Location
    trail: str

    @property
    def keyed(self) -> bool:
        """Whether the ID is the key of a mapping, and not a bare text."""
        return self.loc != self.start


class Grammar:
    """Reads the nodes of one document."""

    def __init__(
        self,
        document: Document,
        registry: Registry,
        trees: Mapping[str, tuple[PortDeclaration, ...]],
        faults: Faults,
        pointer: Pointer,
        *,
        lacking: bool = False,
    ) -> None:
        """lacking: a file with more trees could not be read, so that no name is missed."""
        self._lacking = lacking
        self._document = document
        self._registry = registry
        self._trees = trees
        self._faults = faults
        self._wires = Wires(document, faults, pointer)

    def _fault(
        self,
        loc: Location,
        trail: str,
        message: str,
        hint: str = "",
        *,
        code: str,
        key: bool = False,
        detail: str = "",
    ) -> None:
        self._faults.at(self._document, loc, trail, message, hint, code=code, key=key, detail=detail)

    def node(self, value: Value, loc: Location, above: str, names: Names) -> NodeSpec | None:
        """One node and all below it; None when it cannot be read at all."""
        if not self._faults.has_room(self._document, loc):
            return None
        match value:
            case str():
                return self._known(value, None, loc, loc, above, names)
            case dict() if len(value) == 1:
                ((identity, body),) = value.items()
                return self._known(identity, body, (*loc, identity), loc, above, names)
            case dict() if value:
                keys = list(value)
                shown = ", ".join(map(show, keys[:4])) + (", …" if len(keys) > 4 else "")
                message = f"a node is a mapping with one key, its ID; here are {len(keys)}: {shown}"
                hint = f"what belongs to {show(keys[0])} is indented under it"
                self._fault(loc, above, message, hint, code="P215")
            case _:
                hint = "as 'Grasp: {object: \"{item}\"}' or a bare ID"
                self._fault(loc, above, "here a node must stand", hint, code="P216")
        return None

    def _known(
        self, identity: str, body: Value, loc: Location, start: Location, above: str, names: Names
    ) -> NodeSpec | None:
        given = body.get("name") if isinstance(body, dict) else None
        named = isinstance(given, str) and _NAME.fullmatch(given) is not None
        name = names.take(given if named and isinstance(given, str) else identity[:60])
        site = _Site(loc, start, f"{above}/{name}")
        if given is not None and not named:
            message = "a name is a text without '/' and '#', 60 characters at most"
            self._fault((*loc, "name"), site.trail, message, code="P217")
        if identity in self._trees:
            return self._subtree(identity, name, body, site)
        node = self._registry.find(identity)
        if node is None:
            self._unknown(identity, body, above, site)
            return None
        return self._node(node, name, body, site)

    def _unknown(self, identity: str, body: Value, above: str, site: _Site) -> None:
        loc = site.loc
        key = bool(loc) and loc[-1] == identity
        if IDENTIFIER.fullmatch(identity):
            hint = self._faults.nearest(identity, (*self._trees, *self._registry.ids()))
            detail, near = "", hint.startswith("did you mean")
            if not near:
                hint = "`picktree nodes` lists those that there are"
            if not near and self._registry.problems:
                # The name may be right, and its plug-in installed but broken.
                hint = "; ".join(problem.message for problem in self._registry.problems)
                detail = "\n".join(filter(None, (problem.traceback for problem in self._registry.problems)))
            if near or not self._lacking:
                message = f"unknown node {show(identity)}"
                self._fault(loc, above, message, hint, code="P207", key=key, detail=detail)
        else:
            hint = "a letter or '_', then letters, digits and '_'"
            self._fault(loc, above, f"{show(identity)} is not an ID", hint, code="P208", key=key)
        # What stands below is still looked at: all faults are reported at once.
        inner, at = (body.get("do"), (*loc, "do")) if isinstance(body, dict) else (body, loc)
        if isinstance(inner, list):
            self._list(inner, at, site.trail, Names())
        elif inner is not None and at != loc:
            self.node(inner, at, site.trail, Names())

    # A sub-tree.

    def _subtree(self, identity: str, name: str, body: Value, site: _Site) -> NodeSpec | None:
        ports = {port.key: port for port in self._trees[identity]}
        given = self._mapping(identity, body, site)
        bindings: dict[str, Binding] = {}
        for key, value in given.items():
            port, loc = ports.get(key), (*site.loc, key)
            if port is not None:
                bound = self._wires.binding(port, value, loc, site.trail)
                if bound is not None:
                    bindings[key] = bound
            elif key not in COMMON_KEYS:
                self._unknown_key(identity, key, (*ports, *COMMON_KEYS), loc, site.trail)
        self._wires.missing(ports.values(), given, site.loc, site.trail, key=site.keyed)
        places = {key: self._document.mark((*site.loc, key)) for key in given}
        return self._spec(identity, name, None, site, given, bindings, {}, places)

    # A node of a class.

    def _node(self, node: type[Node], name: str, body: Value, site: _Site) -> NodeSpec:
        declaration = node.declaration
        given, locations = self._body(declaration, body, site)
        bindings: dict[str, Binding] = {}
        slots: dict[str, _Filled] = {}
        places: dict[str, Mark] = {}
        names = Names()
        for key, value in given.items():
            port, slot, at = declaration.port(key), declaration.slot(key), locations[key]
            places[key] = self._document.mark(at)
            if port is not None:
                bound = self._wires.binding(port, value, at, site.trail)
                if bound is not None:
                    bindings[key] = bound
            elif slot is not None:
                slots[key] = self._slot(declaration, slot, value, at, site.trail, names)
                for label, _ in slots[key]:
                    if label:
                        places[f"{key}/{label}"] = self._document.key_mark((*at, label))
            elif key not in COMMON_KEYS:
                self._unknown_key(declaration.id, key, declaration.keys, at, site.trail)
        self._wires.missing(declaration.ports, given, site.loc, site.trail, key=site.keyed)
        for slot in declaration.slots:
            if slot.required and slot.key not in given:
                what = "its children are" if slot.arity == "many" else "its child is"
                what = what if slot.key == "do" else f"{slot.key!r} is"
                message = f"{what} missing: {slot.doc}"
                self._fault(site.loc, site.trail, message, code="P228", key=site.keyed)
        self._rules(node, given, bindings, locations, site)
        ordered = {slot.key: slots[slot.key] for slot in declaration.slots if slot.key in slots}
        return self._spec(declaration.id, name, node, site, given, bindings, ordered, places)

    def _rules(
        self,
        node: type[Node],
        given: Mapping[str, Value],
        bindings: Mapping[str, Binding],
        locations: Mapping[str, Location],
        site: _Site,
    ) -> None:
        """What the class itself finds wrong."""
        constants = {key: bound.value for key, bound in bindings.items() if isinstance(bound, Constant)}
        slots = [slot for slot in node.declaration.slots if slot.key in given]
        labels = {slot.key: _labels(slot, given[slot.key]) for slot in slots}
        for wrong in node.check_ports(Given(frozenset(given), constants, labels)):
            if isinstance(wrong, str):
                self._fault(site.loc, site.trail, wrong, code="P234", key=site.keyed)
                continue
            key, _, label = wrong.key.partition("/")
            at = locations.get(key, site.loc)
            message = f"port {key!r}: {wrong.message}" if not label else wrong.message
            self._fault(
                (*at, label) if label else at, site.trail, message, wrong.hint, code="P234", key=bool(label)
            )

    def _spec(
        self,
        identity: str,
        name: str,
        node: type[Node] | None,
        site: _Site,
        given: Mapping[str, Value],
        bindings: Mapping[str, Binding],
        slots: Mapping[str, _Filled],
        places: Mapping[str, Mark],
    ) -> NodeSpec:
        """The node with what may stand under every node."""
        loc, trail = site.loc, site.trail
        return NodeSpec(
            identity,
            name,
            self._document.key_mark(loc) if site.keyed else self._document.mark(loc),
            node,
            bindings,
            slots,
            self._wires.preconditions(given, loc, trail),
            self._wires.postconditions(given, loc, trail),
            self._wires.breakpoint(given, loc, trail),
            places,
        )

    def _body(
        self, declaration: NodeDeclaration, body: Value, site: _Site
    ) -> tuple[dict[str, Value], dict[str, Location]]:
        """The node's keys with their values, and where each value stands."""
        main, loc = declaration.slot("do"), site.loc
        if main is not None and isinstance(body, str | list):
            return {"do": body}, {"do": loc}
        given = dict(self._mapping(declaration.id, body, site))
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

    def _mapping(self, identity: str, body: Value, site: _Site) -> dict[str, Value]:
        match body:
            case None:
                return {}
            case dict():
                return body
            case list():
                self._fault(site.loc, site.trail, f"{identity} has no children", code="P230")
            case _:
                message = f"the ports of {identity} are a mapping"
                self._fault(site.loc, site.trail, message, "as '{port: value}'", code="P230")
        return {}

    def _slot(
        self,
        declaration: NodeDeclaration,
        slot: SlotDeclaration,
        value: Value,
        loc: Location,
        trail: str,
        names: Names,
    ) -> _Filled:
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
            message = "the list is empty; at least one node must stand here"
            self._fault(loc, trail, message, code="P231")
            return None
        name = names.take(label or Sequence.declaration.id)
        parts = self._list(value, loc, f"{trail}/{name}", Names())
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
        names: Names,
    ) -> _Filled:
        if not isinstance(value, list):
            found = self.node(value, loc, trail, names)
            count, parts = 1, (("", found),) if found else ()
        else:
            count, parts = len(value), self._list(value, loc, trail, names)
        if count < slot.least or (slot.most is not None and count > slot.most):
            limit = f"at least {slot.least}" if slot.most is None else f"{slot.least} to {slot.most}"
            message = f"{declaration.id} has {count} children; it takes {limit}"
            self._fault(loc, trail, message, code="P229")
        return parts

    def _list(self, value: list[Value], loc: Location, trail: str, names: Names) -> _Filled:
        found = (self.node(item, (*loc, index), trail, names) for index, item in enumerate(value))
        return tuple(("", node) for node in found if node is not None)

    def _table(self, slot: SlotDeclaration, value: Value, loc: Location, trail: str, names: Names) -> _Filled:
        if not isinstance(value, dict) or not value:
            self._fault(loc, trail, f"{slot.key!r} is a mapping: {slot.doc}", code="P232")
            return ()
        found: list[tuple[str, NodeSpec]] = []
        for key, body in value.items():
            if slot.of == "cause":
                self._check_pattern(key, (*loc, key), trail)
            elif not _NAME.fullmatch(key):
                self._fault((*loc, key), trail, f"{show(key)} cannot name a case", code="P232", key=True)
            node = self._one(body, (*loc, key), trail, names, key)
            if node is not None:
                found.append((key, node))
        return tuple(found)

    def _check_pattern(self, pattern: str, loc: Location, trail: str) -> None:
        patterns = self._registry.patterns
        if pattern not in patterns:
            hint = self._faults.nearest(pattern, patterns)
            self._fault(loc, trail, f"no cause is called {show(pattern)}", hint, code="P233", key=True)

    def _unknown_key(self, identity: str, key: str, known: Iterable[str], loc: Location, trail: str) -> None:
        # Conditions are known to those who want them; in a hint they would only be noise.
        names = [name for name in known if not name.startswith("_") or key.startswith("_")]
        hint = self._faults.nearest(key, names)
        self._fault(loc, trail, f"{identity} has no port {show(key)}", hint, code="P218", key=True)
