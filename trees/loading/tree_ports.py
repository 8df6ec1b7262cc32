"""Reader of a tree's `ports:`: parameters declared in the file with type, unit, default and choices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, cast

from ...files.marks import Location
from ...files.quantities import UNITS
from ...files.quantity_hints import suggested
from ...files.value_wording import suggest_name
from ...files.yaml.document import Document
from ...files.yaml.reader import Value
from ...world.journal import Plain
from ..declaration import COMMON_KEYS, IDENTIFIER
from ..fault_collector import MissionDiagnostics
from ..port_types import NAMES_IN_FILES, PortType, convert_literal, show
from ..ports import PortDeclaration

_PORT_KEYS = ("type", "default", "doc", "unit", "choices", "direction")


@dataclass(frozen=True, slots=True)
class _Given:
    """Declaration of one port, and its place."""

    entry: Mapping[str, Value]
    loc: Location

    def at(self, key: str) -> Location:
        return (*self.loc, key)


class TreePorts:
    """Reader of the ports of the trees of one document."""

    def __init__(self, document: Document, faults: MissionDiagnostics) -> None:
        self._document = document
        self._faults = faults

    def doc(self, tree: str, body: Value) -> str:
        """Return what a tree says of itself under `doc`; "" for nothing."""
        value = body.get("doc") if isinstance(body, dict) else None
        if value is None or isinstance(value, str):
            return (value or "").strip()
        self._fault(
            ("trees", tree, "doc"), "'doc' is a text", "a sentence that says what the tree does", code="P211"
        )
        return ""

    def of(self, tree: str, body: Value) -> tuple[PortDeclaration, ...]:
        """Return the ports of a tree, given the tree's whole body."""
        loc: Location = ("trees", tree, "ports")
        value = body.get("ports") if isinstance(body, dict) else None
        if value is None:
            return ()
        if not isinstance(value, dict):
            self._fault(loc, "'ports' is a mapping", "as '{item: {type: object}}'", code="P211")
            return ()
        found = (self._port(name, entry, (*loc, name)) for name, entry in value.items())
        return tuple(port for port in found if port is not None)

    def _port(self, name: str, value: Value, loc: Location) -> PortDeclaration | None:
        """Return the port; with a faulty declaration, one that accepts anything. None for an invalid name."""
        if not IDENTIFIER.fullmatch(name) or name.startswith("_") or name in COMMON_KEYS:
            self._fault(loc, f"{name!r} cannot be the name of a port", code="P214", key=True)
            return None
        entry = {"type": value} if isinstance(value, str) else value
        if not isinstance(entry, dict):
            self._fault(loc, "a port is a mapping", "as '{type: object}'", code="P211")
            return PortDeclaration(name, name, "in", PortType("any"), "", default="")
        for key in entry:
            if key not in _PORT_KEYS:
                hint = self._faults.nearest(key, _PORT_KEYS)
                self._fault((*loc, key), f"a port has no key {key!r}", hint, code="P211", key=True)
        kind, given = self._type(entry, loc), _Given(entry, loc)
        port = PortDeclaration(
            name,
            name,
            self._direction(given),
            kind or PortType("any"),
            self._text(given, "doc"),
            self._unit(given, kind),
        )
        if kind is None:
            return replace(port, default="")
        return self._with_default(given, replace(port, choices=self._choices(given, port)))

    def _type(self, entry: Mapping[str, Value], loc: Location) -> PortType | None:
        given = entry.get("type", "any")
        try:
            return PortType.parse(given if isinstance(given, str) else show(given))
        except ValueError as error:
            known = (*NAMES_IN_FILES, *(f"list of {known}" for known in NAMES_IN_FILES))
            self._fault((*loc, "type"), str(error), self._faults.nearest(str(given), known), code="P212")
            return None

    def _direction(self, given: _Given) -> Literal["in", "out"]:
        match given.entry.get("direction", "in"):
            case "in" | "out" as direction:
                return direction
            case other:
                message = f"the direction is 'in' or 'out', not {show(other)}"
                self._fault(given.at("direction"), message, code="P211")
                return "in"

    def _text(self, given: _Given, key: str) -> str:
        value = given.entry.get(key, "")
        if isinstance(value, str):
            return value
        self._fault(given.at(key), f"{key!r} is a text, not {show(value)}", code="P211")
        return ""

    def _unit(self, given: _Given, kind: PortType | None) -> str | None:
        unit = self._text(given, "unit")
        if not unit:
            return None
        if unit not in UNITS:
            self._fault(
                given.at("unit"), f"unknown unit {show(unit)}", suggest_name(unit, UNITS), code="P211"
            )
            return None
        if kind is not None and kind.name not in ("float", "any"):
            hint = "it is for 'float'"
            self._fault(given.at("unit"), f"{show(str(kind))} has no unit", hint, code="P211")
            return None
        return unit

    def _choices(self, given: _Given, port: PortDeclaration) -> tuple[Plain, ...] | None:
        value = given.entry.get("choices")
        if value is None:
            return None
        if not isinstance(value, list) or not value:
            self._fault(given.at("choices"), "'choices' is a list", "as '[left, right]'", code="P211")
            return None
        found: list[Plain] = []
        for index, choice in enumerate(value):
            try:
                one = PortType(port.type.name)
                found.append(cast("Plain", convert_literal(choice, one, port.unit)))
            except ValueError as error:
                self._fault((*given.at("choices"), index), f"the choice: {error}", code="P211")
        return tuple(found) or None

    def _with_default(self, given: _Given, port: PortDeclaration) -> PortDeclaration:
        if "default" not in given.entry:
            return port
        if port.direction == "out":
            message = "an output has no default: the nodes inside write it"
            self._fault(given.at("default"), message, code="P211", key=True)
            return port
        try:
            default = convert_literal(given.entry["default"], port.type, port.unit, port.choices)
        except ValueError as error:
            text = given.entry["default"]
            hint = suggested(text, port.unit) if isinstance(text, str) and port.unit else ""
            self._fault(given.at("default"), f"the default: {error}", hint, code="P213")
            return replace(port, default="")
        return replace(port, default=default)

    def _fault(self, loc: Location, message: str, hint: str = "", *, code: str, key: bool = False) -> None:
        fault = self._document.fault(loc, message, hint, code=code, key=key)
        self._faults.add(fault)
