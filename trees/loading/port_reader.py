"""Readers of ports: a node's, with references, literals, expressions and assignments, and those that a
tree declares in the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, Literal, cast

from picktree.files import (
    Diagnostic,
    Expression,
    Location,
    expression_syntax,
    quantities,
    suggest_name,
    suggest_number,
    suggested,
)
from picktree.files.yaml import Document, Value
from picktree.trees import (
    BREAKPOINT,
    COMMON_KEYS,
    IDENTIFIER,
    NAMES_IN_FILES,
    POSTCONDITIONS,
    PRECONDITIONS,
    MissionDiagnostics,
    PortDeclaration,
    PortType,
    convert_literal,
    references,
    show,
)
from picktree.world import Plain

MAX_ASSIGNMENTS: Final = 20
MAX_ASSIGNMENTS_LENGTH: Final = 4000
_PIECE = re.compile(r"""'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*"|;|[^;'"]+|['"]""", re.DOTALL)
_ASSIGNMENT = re.compile(r"\s*(@?[A-Za-z_]\w{0,59})\s*([-:+*/]?=)(?!=)", re.ASCII)


def parse_assignments(text: str) -> tuple[references.Assignment, ...]:
    """Parse assignments. Raises ExpressionError with the index of the wrong character."""
    if len(text) > MAX_ASSIGNMENTS_LENGTH:
        raise expression_syntax.ExpressionError(
            f"the assignments are longer than {MAX_ASSIGNMENTS_LENGTH} characters"
        )
    found: list[references.Assignment] = []
    for at, part in _parts(text):
        if not part.strip():
            continue
        if len(found) == MAX_ASSIGNMENTS:
            raise expression_syntax.ExpressionError(f"more than {MAX_ASSIGNMENTS} assignments", at)
        found.append(_assignment(part, at))
    if not found:
        raise expression_syntax.ExpressionError("there is no assignment; as 'key := expression'")
    return tuple(found)


def _parts(text: str) -> Iterator[tuple[int, str]]:
    """Yield the texts between the `;`, each with the index of its first character. A quoted `;` does not
    separate."""
    start = 0
    for piece in _PIECE.finditer(text):
        if piece[0] == ";":
            yield start, text[start : piece.start()]
            start = piece.end()
    yield start, text[start:]


def _assignment(part: str, at: int) -> references.Assignment:
    first = at + len(part) - len(part.lstrip())
    match = _ASSIGNMENT.match(part)
    if match is None:
        raise expression_syntax.ExpressionError("an assignment is 'key := expression'", first)
    text = part[match.end() :]
    if not text.strip():
        raise expression_syntax.ExpressionError(f"a value is missing after {match[2]!r}", at + match.start(2))
    begins = at + len(part) - len(text.lstrip())
    try:
        value = Expression.parse(text.strip())
    except expression_syntax.ExpressionError as error:
        raise expression_syntax.ExpressionError(str(error), begins + error.offset) from None
    if match[2] not in (":=", "="):
        value = Expression.parse(f"{match[1]} {match[2][0]} ({value})")
    return references.Assignment(match[1], value, match[2] == ":=", begins)


def _as_expression(text: str) -> str:
    """Return the hint for a text in braces that is no reference: without blanks, or as an expression."""
    tight = re.sub(r"(?<=\{)\s+|\s+(?=\})", "", text)
    if tight != text and references.REFERENCE_IN_TEXT.fullmatch(tight):
        return f'write "{tight}"'
    try:
        inner = Expression.parse(text[1:-1].strip())
    except expression_syntax.ExpressionError:
        inner = None
    if inner is None or isinstance(inner.root, expression_syntax.Name):
        return 'a reference is "{key}" or "{key.attribute}"'
    return f"an expression begins with '=': \"{{= {inner}}}\""


def _literal_hint(value: Value, port: PortDeclaration) -> str:
    """Return a hint for a literal that does not fit its port; "" without one."""
    if port.type.many:
        return f"write [{value}]" if isinstance(value, str | int | float) and "{" not in str(value) else ""
    if port.type.name not in ("int", "float") or not isinstance(value, str):
        return ""
    if port.type.name == "float" and port.unit is not None:
        return suggest_number(value) or suggested(value, "s" if port.unit == "ms" else port.unit)
    return suggest_number(value) or suggested(value, "")


def _inner_reference(value: Value) -> str | None:
    """Return the first reference inside a longer text or a list; None without one."""
    if isinstance(value, list):
        return next(filter(None, map(_inner_reference, value)), None)
    found = references.VALUE_IN_TEXT.search(value) if isinstance(value, str) else None
    return found[0] if found is not None else None


def _joined(text: str) -> str:
    """Return a text with references in it as one expression; empty when that has no short form.

    >>> _joined("picked {item} of {= n + 1}")
    "{= 'picked ' + item + ' of ' + (n + 1)}"
    """
    parts: list[str] = []
    end = 0
    for found in references.VALUE_IN_TEXT.finditer(text):
        between = text[end : found.start()]
        parts += [f"'{between}'"] if between or not parts else []
        inner = found[0][1:-1].removeprefix("=").strip()
        parts.append(inner if references.REFERENCE_IN_TEXT.fullmatch(f"{{{inner}}}") else f"({inner})")
        end = found.end()
    parts += [f"'{text[end:]}'"] if text[end:] else []
    if parts[0] == "''" and len(parts) > 2 and parts[2].startswith("'"):
        del parts[0]  # the text after the first value makes a text of the sum
    joined = " + ".join(parts)
    try:
        Expression.parse(joined)
    except expression_syntax.ExpressionError:
        return ""
    return "" if set(joined) & set('"\\\n') else f"{{= {joined}}}"


class PortReader:
    """Reader of the values under the nodes of one document."""

    def __init__(
        self, document: Document, faults: MissionDiagnostics, pointer: references.ExpressionLocator
    ) -> None:
        self._document = document
        self._faults = faults
        self._fault = partial(faults.at, document)
        self._pointer = pointer

    def binding(
        self, port: PortDeclaration, value: Value, loc: Location, trail: str
    ) -> references.Binding | None:
        """Return the reference or constant of a port; None (with an error reported) when the value does not
        fit."""
        what = f"port {port.key!r}"
        if port.takes == "assignments":
            return references.Constant(value, cast("Plain", value))  # read with the postconditions
        if isinstance(value, str) and port.type.name != "expression":
            try:
                computed = references.PortExpression.parse(value) if port.direction == "in" else None
                wanted = computed is None and not value.startswith("{=")
                reference = references.Reference.parse(value) if wanted else None
            except expression_syntax.ExpressionError as error:
                self._expression_fault(error, value, loc, trail, what)
                return None
            except ValueError as error:
                inner = _inner_reference(value)
                if inner is not None:
                    self._inner_reference_fault(port, value, inner, loc, trail)
                else:
                    self._fault(loc, trail, f"{what}: {error}", _as_expression(value), code="P221")
                return None
            if computed is not None:
                return computed
            if reference is not None:
                return self._reference(port, reference, loc, trail)
        inner = _inner_reference(value) if port.takes == "value" and port.type.name != "expression" else None
        if inner is not None and not (inner == value and inner.startswith("{=")):
            self._inner_reference_fault(port, value, inner, loc, trail)
            return None
        if port.direction == "out" or port.takes == "key":
            hint = f'write "{{{value}}}"' if isinstance(value, str) and IDENTIFIER.fullmatch(value) else ""
            message = f"{what} is an output: it needs a key to write to"
            message = (
                f"{what} is for a key of the blackboard, not for a value" if port.takes == "key" else message
            )
            self._fault(loc, trail, message, hint or 'as "{key}"', code="P223")
            return None
        try:
            literal = convert_literal(value, port.type, port.unit, port.choices, port.within)
            return references.Constant(literal, cast("Plain", value))
        except expression_syntax.ExpressionError as error:
            self._expression_fault(error, value, loc, trail, what)
        except ValueError as error:
            hint = _literal_hint(value, port) or port.doc
            self._fault(loc, trail, f"{what}: {error}", hint, code="P220")
        return None

    def _inner_reference_fault(
        self, port: PortDeclaration, value: Value, inner: str, loc: Location, trail: str
    ) -> None:
        """Report a reference that is not the whole value: nothing would take its place."""
        if isinstance(value, list):
            message = f"port {port.key!r}: a list cannot hold a reference such as {inner}"
            hint = (
                f'this key already holds the whole list: write "{inner}" without [ ]'
                if len(value) == 1
                else 'as "{key}", a key that holds the whole list'
            )
        else:
            message = (
                f"port {port.key!r}: {inner} is a part of the text {show(value)}, and is not replaced there"
            )
            joined = _joined(str(value)) if port.type.name in ("string", "any") else ""
            hint = f'a reference is the whole value: write "{joined or inner}"'
        self._fault(loc, trail, message, hint, code="P221")

    def _reference(
        self, port: PortDeclaration, reference: references.Reference, loc: Location, trail: str
    ) -> references.Binding | None:
        if port.direction == "out" and reference.attributes:
            message = f"port {port.key!r} is an output: {reference} cannot be written"
            self._fault(loc, trail, message, code="P223")
            return None
        if port.takes == "key" and reference.attributes:
            message = (
                f"port {port.key!r} needs a key: {reference} belongs to the belief and cannot be written"
            )
            self._fault(loc, trail, message, code="P223")
            return None
        for name in reference.attributes:
            if name not in references.ATTRIBUTES:
                message = f"port {port.key!r}: {reference}: an object has no attribute {name!r}"
                self._fault(
                    loc, trail, message, self._faults.nearest(name, references.ATTRIBUTES), code="P222"
                )
                return None
        return reference

    def missing(
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
                message = f"port {port.key!r} is missing" + (f": {port.doc}" if port.doc else "")
                self._fault(loc, trail, message, code="P219", key=key)

    # Keys that every node may have.

    def preconditions(self, given: Mapping[str, Value], loc: Location, trail: str) -> dict[str, Expression]:
        found: dict[str, Expression] = {}
        for name in PRECONDITIONS:
            if name not in given:
                continue
            value = given[name]
            try:
                if not isinstance(value, str | bool):
                    raise expression_syntax.ExpressionError(f"{show(value)} is not an expression")
                found[name] = Expression.parse(value if isinstance(value, str) else str(value).lower())
            except expression_syntax.ExpressionError as error:
                self._expression_fault(error, value, (*loc, name), trail, name)
        return found

    def postconditions(
        self, given: Mapping[str, Value], loc: Location, trail: str, scripts: tuple[str, ...] = ()
    ) -> dict[str, tuple[references.Assignment, ...]]:
        """Return the assignments by key; those of the ports `scripts` come first."""
        found: dict[str, tuple[references.Assignment, ...]] = {}
        for name in (*scripts, *POSTCONDITIONS):
            if name not in given:
                continue
            value = given[name]
            if not isinstance(value, str):
                message = f"{name}: {show(value)} is no assignment"
                self._fault((*loc, name), trail, message, "as 'tries := tries + 1'", code="P249")
                continue
            try:
                found[name] = parse_assignments(value)
            except expression_syntax.ExpressionError as error:
                self._expression_fault(error, value, (*loc, name), trail, name)
        return found

    def breakpoint(
        self, given: Mapping[str, Value], loc: Location, trail: str
    ) -> Literal["before", "after"] | None:
        if BREAKPOINT not in given:
            return None
        match given[BREAKPOINT]:
            case "before" | "after" as when:
                return when
            case other:
                message = f"{BREAKPOINT!r} is 'before' or 'after', not {show(other)}"
                self._fault((*loc, BREAKPOINT), trail, message, code="P250")
                return None

    def _expression_fault(
        self, error: expression_syntax.ExpressionError, value: Value, loc: Location, trail: str, what: str
    ) -> None:
        if self._faults.full or not isinstance(value, str):
            self._fault(loc, trail, f"{what}: {error}", code="P225")
            return
        mark, message = self._pointer.describe(self._document.mark(loc), value, error)
        self._faults.add(Diagnostic(mark, trail, f"{what}: {message}", "", "P225"))


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
        """Return the description of a tree under `doc`; "" without one."""
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
        if unit not in quantities.UNITS:
            self._fault(
                given.at("unit"),
                f"unknown unit {show(unit)}",
                suggest_name(unit, quantities.UNITS),
                code="P211",
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
