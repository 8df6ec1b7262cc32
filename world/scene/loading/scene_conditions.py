"""Expressions of a scene file that are true or false: rules of destinations, and the goal."""

from __future__ import annotations

from collections.abc import Mapping

from ....files.expressions.expression import Expression, ExpressionError
from ....files.expressions.type_inference import ValueType, check_types
from ....files.models.validation import Checker
from ....files.yaml.document import Location


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
