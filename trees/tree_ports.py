"""The `ports:` of a tree: its parameters, declared in the file with type, unit, default and choices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

from ..world.files.document import Document, Location, Value
from .declaration import IDENTIFIER
from .faults import Faults
from .ports import REQUIRED, PortDeclaration
from .types import NAMES_IN_FILES, PortType, convert, show

_KEYS = ("type", "default", "doc", "unit", "choices", "direction")


class TreePorts:
    """Reads the ports of the trees of one document."""

    def __init__(self, document: Document, faults: Faults) -> None:
        self._document = document
        self._faults = faults

    def of(self, tree: str, body: Value) -> tuple[PortDeclaration, ...]:
        """The ports of the tree whose whole body is given."""
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
        if not IDENTIFIER.fullmatch(name) or name.startswith("_") or name == "name":
            self._fault(loc, f"{name!r} cannot be the name of a port", code="P214", key=True)
            return None
        entry = {"type": value} if isinstance(value, str) else value
        if not isinstance(entry, dict):
            self._fault(loc, "a port is a mapping", "as '{type: object}'", code="P211")
            return None
        for key in entry:
            if key not in _KEYS:
                hint = self._faults.nearest(key, _KEYS)
                self._fault((*loc, key), f"a port has no key {key!r}", hint, code="P211", key=True)
        given = entry.get("type", "any")
        try:
            kind = PortType.parse(str(given))
        except ValueError as error:
            known = (*NAMES_IN_FILES, *(f"list of {known}" for known in NAMES_IN_FILES))
            hint = self._faults.nearest(str(given), known)
            self._fault((*loc, "type"), str(error), hint, code="P212")
            return None
        direction = entry.get("direction", "in")
        if direction not in ("in", "out"):
            message = f"the direction is 'in' or 'out', not {show(direction)}"
            self._fault((*loc, "direction"), message, code="P211")
        side: Literal["in", "out"] = "out" if direction == "out" else "in"
        unit, choices = entry.get("unit"), entry.get("choices")
        port = PortDeclaration(
            name,
            name,
            side,
            kind,
            str(entry.get("doc", "")),
            unit if isinstance(unit, str) else None,
            REQUIRED,
            tuple(choices) if isinstance(choices, list) else None,
        )
        return self._with_default(port, entry, loc)

    def _with_default(
        self, port: PortDeclaration, entry: Mapping[str, Value], loc: Location
    ) -> PortDeclaration:
        if "default" not in entry:
            return port
        try:
            default = convert(entry["default"], port.type, port.unit, port.choices)
        except ValueError as error:
            self._fault((*loc, "default"), f"the default: {error}", code="P213")
            return port
        return replace(port, default=default)

    def _fault(self, loc: Location, message: str, hint: str = "", *, code: str, key: bool = False) -> None:
        fault = self._document.fault(loc, message, hint, code=code, key=key)
        self._faults.add(fault)
