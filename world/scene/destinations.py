"""Where an item belongs: the rules of a scene file, for the belief as for the scorer's true items."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from typing import Protocol

from ..files.expressions import Expression, ExpressionError
from ..values import ObjectId
from .description import Destination

NAMES = ("colour", "form", "kind")
"""What a rule may ask about an item."""


class Sortable(Protocol):
    """What rules look at: an object of the belief, or a true one."""

    @property
    def colour(self) -> str: ...
    @property
    def form(self) -> str: ...
    @property
    def kind(self) -> str: ...


def destination_rule(destinations: Iterable[Destination]) -> Callable[[Sortable], ObjectId | None]:
    """The bin of the first rule that holds for the item, or None. The expressions were checked on reading."""
    rules = [(Expression.parse(d.where), d.to) for d in destinations]

    def destination(item: Sortable) -> ObjectId | None:
        names = {"colour": item.colour, "form": item.form, "kind": item.kind}
        return next((to for rule, to in rules if rule.evaluate(names)), None)

    return destination


def can_hold(
    where: str, colours: Iterable[str], forms: Iterable[str], kinds: Iterable[str], *, most: int
) -> bool:
    """Whether a rule holds for any item; True also when `most` trials do not tell.

    Raises ExpressionError when the rule cannot be read, or asks for what no item has.
    """
    expression = Expression.parse(where)
    unknown = sorted(expression.names - set(NAMES))
    if unknown:
        raise ExpressionError(f"unknown name {unknown[0]!r}; known: {', '.join(NAMES)}")
    known = (tuple(colours), tuple(forms), tuple(kinds) or ("unknown",))
    # What the rule does not ask for need not be varied.
    varied = [
        names if name in expression.names else names[:1] for name, names in zip(NAMES, known, strict=True)
    ]
    items = itertools.product(*varied)
    held = [
        expression.evaluate(dict(zip(NAMES, item, strict=True))) for item in itertools.islice(items, most)
    ]
    return any(held) or not held or next(items, None) is not None
