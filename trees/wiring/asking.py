"""Expressions in a mission, checked against the types of the keys and facts that they name."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

from ...world.files.document import Fault
from ...world.files.expression_types import UnknownName, ValueType, check_types
from ...world.files.expressions import Expression, ExpressionError
from ..references import Constant
from .circuit import Circuit
from .keys import Keys, Placed


@dataclass(frozen=True, slots=True)
class Asked:
    """An expression in a mission, and under which key of its node it stands."""

    placed: Placed
    key: str
    what: str
    expression: Expression


def expressions_of(placed: Placed) -> Iterator[Asked]:
    """All expressions of one node."""
    for name, expression in placed.spec.preconditions.items():
        yield Asked(placed, name, name, expression)
    for key, bound in placed.spec.ports.items():
        if isinstance(bound, Constant) and isinstance(bound.value, Expression):
            yield Asked(placed, key, f"port {key!r}", bound.value)
    for name, assignments in placed.spec.postconditions.items():
        for assignment in assignments:
            yield Asked(placed, name, f"{name}: {assignment.key!r}", assignment.value)


def unanswerable(
    circuit: Circuit, attributes: Mapping[str, ValueType], unfinished: Collection[str] = ()
) -> Iterator[Fault]:
    """A fault for each expression that can have no value.

    `unfinished`: trees of which not all could be read, so that a name may be written where nobody sees it.
    """
    for name, keys in circuit.keys.items():
        for placed in keys.nodes:
            for asked in expressions_of(placed):
                yield from _checked(asked, keys, attributes, quiet=name in unfinished)


def _checked(
    asked: Asked, keys: Keys, attributes: Mapping[str, ValueType], *, quiet: bool
) -> Iterator[Fault]:
    try:
        check_types(asked.expression, keys, attributes)
    except ExpressionError as error:
        unknown = isinstance(error, UnknownName)
        if not (unknown and quiet):
            message = f"{asked.what}: {error.told(asked.expression.text)}"
            mark, path = asked.placed.mark(asked.key), asked.placed.path
            yield Fault(mark, path, message, "", "P227" if unknown else "P226")
