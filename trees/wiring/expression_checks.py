"""Expressions in a mission, checked against the types of the keys and facts that they name."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from ...files.expressions.expression import Expression, ExpressionError
from ...files.expressions.type_inference import UnknownName, check_types
from ...files.yaml.document import Diagnostic
from ..values.references import ATTRIBUTE_TYPES, Constant, ExpressionLocator
from .circuit import ValueFlow
from .key_writers import PlacedNode


@dataclass(frozen=True, slots=True)
class MissionExpression:
    """An expression in a mission, and under which key of its node it stands."""

    placed: PlacedNode
    key: str
    what: str
    expression: Expression
    before: int = 0
    """Characters of the text before it."""

    def fault(self, error: ExpressionError, pointer: ExpressionLocator, code: str) -> Diagnostic:
        """What is wrong with it."""
        start = self.placed.mark(self.key)
        mark, message = pointer.told(start, self.expression.text, error, self.before)
        return Diagnostic(mark, self.placed.path, f"{self.what}: {message}", "", code)


def expressions_of(placed: PlacedNode) -> Iterator[MissionExpression]:
    """All expressions of one node."""
    for name, expression in placed.spec.preconditions.items():
        yield MissionExpression(placed, name, name, expression)
    for key, bound in placed.spec.ports.items():
        if isinstance(bound, Constant) and isinstance(bound.value, Expression):
            yield MissionExpression(placed, key, f"port {key!r}", bound.value)
    for name, assignments in placed.spec.postconditions.items():
        for assignment in assignments:
            yield MissionExpression(
                placed, name, f"{name}: {assignment.key!r}", assignment.value, assignment.at
            )


def expression_faults(
    circuit: ValueFlow, pointer: ExpressionLocator, unfinished: Collection[str] = ()
) -> Iterator[Diagnostic]:
    """A fault for each expression that can have no value.

    `unfinished`: trees of which not all could be read, so that a name may be written where nobody sees it.
    """
    for name, keys in circuit.keys.items():
        for placed in keys.nodes:
            for asked in expressions_of(placed):
                try:
                    check_types(asked.expression, keys, ATTRIBUTE_TYPES)
                except UnknownName as error:
                    if name not in unfinished:
                        yield asked.fault(error, pointer, "P227")
                except ExpressionError as error:
                    yield asked.fault(error, pointer, "P226")
