"""Expressions that remember what they came to, for the coverage of a rehearsal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields

from ....files.expressions.expression import Attributes, Expression


@dataclass(frozen=True, slots=True)
class WatchedExpression(Expression):
    """An expression as any other; `seen` are the answers that it gave, as true or false."""

    seen: set[bool] = field(default_factory=set[bool], compare=False)

    @classmethod
    def of(cls, expression: Expression) -> WatchedExpression:
        return cls(**{part.name: getattr(expression, part.name) for part in fields(expression)})

    def evaluate(self, names: Mapping[str, object], attributes: Attributes | None = None) -> object:
        # Not super(): a dataclass with slots is made anew, and the cell of super() keeps the former.
        value = Expression.evaluate(self, names, attributes)
        self.seen.add(bool(value))
        return value
