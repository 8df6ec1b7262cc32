"""Expressions of a scene file that are true or false: rules of destinations, and the goal."""

from __future__ import annotations

from collections.abc import Mapping

from ..files.checked import Checker
from ..files.document import Location
from ..files.expression_types import ValueType, check_types
from ..files.expressions import Expression, ExpressionError


def condition(
    check: Checker, loc: Location, text: str, names: Mapping[str, ValueType], *, code: str
) -> Expression | None:
    """The expression; None when it cannot be read or cannot be answered, with the fault at its character."""
    try:
        expression = Expression.parse(text)
        kind = check_types(expression, names, {})
        if kind.kind not in ("bool", "any"):
            raise ExpressionError(f"true or false is wanted, not {kind.words()}")
    except ExpressionError as error:
        message, _, hint = str(error).partition("; ")
        check.fault(loc, message, hint, code=code, character=error.offset)
        return None
    return expression
