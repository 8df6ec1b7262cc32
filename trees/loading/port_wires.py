"""Reader of a node's ports and conditions: references, literals, expressions and postcondition assignments.

Assignments are `key := expression` or `key = expression`, separated by `;`. `:=` always writes the key; `=`
only changes an existing key, as in BehaviorTree.CPP.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Final, Literal, cast

from ...files.expressions.expression import Expression, ExpressionError
from ...files.marks import Diagnostic, Location
from ...files.value_wording import suggest_number
from ...files.yaml.document import Document
from ...files.yaml.reader import Value
from ...world.journal import Plain
from ..declaration import BREAKPOINT, IDENTIFIER, POSTCONDITIONS, PRECONDITIONS
from ..ports import PortDeclaration
from ..values.fault_collector import MissionDiagnostics
from ..values.port_types import convert_literal, show
from ..values.references import ATTRIBUTES, Assignment, Binding, Constant, ExpressionLocator, Reference

MAX_ASSIGNMENTS: Final = 20
MAX_ASSIGNMENTS_LENGTH: Final = 4000
_PIECE = re.compile(r"""'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*"|;|[^;'"]+|['"]""", re.DOTALL)
_ASSIGNMENT = re.compile(r"\s*([A-Za-z_]\w{0,59})\s*(:?=)(?!=)", re.ASCII)
_CHANGE = re.compile(r"\s*([A-Za-z_]\w{0,59})\s*([-+*/])=", re.ASCII)


def parse_assignments(text: str) -> tuple[Assignment, ...]:
    """Parse assignments. Raises ExpressionError with the index of the wrong character."""
    if len(text) > MAX_ASSIGNMENTS_LENGTH:
        raise ExpressionError(f"the assignments are longer than {MAX_ASSIGNMENTS_LENGTH} characters")
    found: list[Assignment] = []
    for at, part in _parts(text):
        if not part.strip():
            continue
        if len(found) == MAX_ASSIGNMENTS:
            raise ExpressionError(f"more than {MAX_ASSIGNMENTS} assignments", at)
        found.append(_assignment(part, at))
    if not found:
        raise ExpressionError("there is no assignment; as 'key := expression'")
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


def _assignment(part: str, at: int) -> Assignment:
    first = at + len(part) - len(part.lstrip())
    match = _ASSIGNMENT.match(part)
    if match is None:
        change = _CHANGE.match(part)
        if change is not None:
            key, symbol = change[1], change[2]
            raise ExpressionError(f"write '{key} = {key} {symbol} …'", at + change.start(2))
        raise ExpressionError("an assignment is 'key := expression'", first)
    text = part[match.end() :]
    if not text.strip():
        raise ExpressionError(f"a value is missing after {match[2]!r}", at + match.start(2))
    begins = at + len(part) - len(text.lstrip())
    try:
        value = Expression.parse(text.strip())
    except ExpressionError as error:
        raise ExpressionError(str(error), begins + error.offset) from None
    return Assignment(match[1], value, match[2] == ":=", begins)


class PortReader:
    """Reader of the values under the nodes of one document."""

    def __init__(self, document: Document, faults: MissionDiagnostics, pointer: ExpressionLocator) -> None:
        self._document = document
        self._faults = faults
        self._pointer = pointer

    def binding(self, port: PortDeclaration, value: Value, loc: Location, trail: str) -> Binding | None:
        """Return the reference or constant of a port; None (with an error reported) when the value does not
        fit."""
        what = f"port {port.key!r}"
        if isinstance(value, str) and port.type.name != "expression":
            try:
                reference = Reference.parse(value)
            except ValueError as error:
                hint = 'a reference is "{key}" or "{key.attribute}"'
                self._fault(loc, trail, f"{what}: {error}", hint, code="P221")
                return None
            if reference is not None:
                return self._reference(port, reference, loc, trail)
        if port.direction == "out":
            hint = f'write "{{{value}}}"' if isinstance(value, str) and IDENTIFIER.fullmatch(value) else ""
            message = f"{what} is an output: it needs a key to write to"
            self._fault(loc, trail, message, hint or 'as "{key}"', code="P223")
            return None
        try:
            literal = convert_literal(value, port.type, port.unit, port.choices, port.within)
            return Constant(literal, cast("Plain", value))
        except ExpressionError as error:
            self._expression_fault(error, value, loc, trail, what)
        except ValueError as error:
            number = port.type.name in ("int", "float") and not port.type.many
            hint = (suggest_number(value) if number else "") or port.doc
            self._fault(loc, trail, f"{what}: {error}", hint, code="P220")
        return None

    def _reference(
        self, port: PortDeclaration, reference: Reference, loc: Location, trail: str
    ) -> Binding | None:
        if port.direction == "out" and reference.attributes:
            message = f"port {port.key!r} is an output: {reference} cannot be written"
            self._fault(loc, trail, message, code="P223")
            return None
        for name in reference.attributes:
            if name not in ATTRIBUTES:
                message = f"port {port.key!r}: {reference}: an object has no attribute {name!r}"
                self._fault(loc, trail, message, self._faults.nearest(name, ATTRIBUTES), code="P222")
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
                    raise ExpressionError(f"{show(value)} is not an expression")
                found[name] = Expression.parse(value if isinstance(value, str) else str(value).lower())
            except ExpressionError as error:
                self._expression_fault(error, value, (*loc, name), trail, name)
        return found

    def postconditions(
        self, given: Mapping[str, Value], loc: Location, trail: str
    ) -> dict[str, tuple[Assignment, ...]]:
        found: dict[str, tuple[Assignment, ...]] = {}
        for name in POSTCONDITIONS:
            if name not in given:
                continue
            value = given[name]
            if not isinstance(value, str):
                message = f"{name}: {show(value)} is no assignment"
                self._fault((*loc, name), trail, message, "as 'tries := tries + 1'", code="P249")
                continue
            try:
                found[name] = parse_assignments(value)
            except ExpressionError as error:
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
        self, error: ExpressionError, value: Value, loc: Location, trail: str, what: str
    ) -> None:
        if self._faults.full or not isinstance(value, str):
            self._fault(loc, trail, f"{what}: {error}", code="P225")
            return
        mark, message = self._pointer.told(self._document.mark(loc), value, error)
        self._faults.add(Diagnostic(mark, trail, f"{what}: {message}", "", "P225"))

    def _fault(
        self, loc: Location, trail: str, message: str, hint: str = "", *, code: str, key: bool = False
    ) -> None:
        self._faults.at(self._document, loc, trail, message, hint, code=code, key=key)
