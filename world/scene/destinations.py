"""Where an item belongs: the rules of a scene file, for the belief as for the scorer's true items."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

from ...files.expressions.expression import Expression
from ...files.expressions.type_inference import ValueType
from ..colours import ITEM_COLOURS
from ..values import ObjectId
from .body_schema import FORMS
from .description import Destination


class Sortable(Protocol):
    """Object of the belief or true item, as rules see it."""

    @property
    def colour(self) -> str: ...
    @property
    def form(self) -> str: ...
    @property
    def kind(self) -> str: ...


def destination_rule(destinations: Iterable[Destination]) -> Callable[[Sortable], ObjectId | None]:
    """The bin, fixture with holes or hole of the first rule that holds for the item, or None. The expressions
    were checked on reading."""
    rules = [(Expression.parse(d.where), d.to) for d in destinations]

    def destination(item: Sortable) -> ObjectId | None:
        names = {"colour": item.colour, "form": item.form, "kind": item.kind}
        return next((to for rule, to in rules if rule.evaluate(names)), None)

    return destination


def colours_of_destinations(
    destinations: Iterable[Destination], kinds: Iterable[tuple[str, str]]
) -> dict[str, str]:
    """Return the colour of the items that belong there, by destination, where all have the same one.

    `kinds`: the catalogue's kinds, each with its form.
    """
    rule, found = destination_rule(destinations), dict[str, set[str]]()
    for colour, (kind, form) in itertools.product(ITEM_COLOURS, kinds):
        to = rule(_Item(colour, form, kind))
        if to is not None:
            found.setdefault(to, set()).add(colour)
    return {to: colours.pop() for to, colours in found.items() if len(colours) == 1}


@dataclass(frozen=True, slots=True)
class _Item:
    colour: str
    form: str
    kind: str


def is_at(place: str, destination: str) -> bool:
    """Whether what is at `place`, a bin or a hole, is at its destination: that itself, or any hole of it.

    >>> is_at("board/left", "board"), is_at("board/left", "board/right"), is_at("red_bin", "red_bin")
    (True, False, True)
    """
    return place == destination or place.startswith(f"{destination}/")


def rule_names(kinds: Iterable[str]) -> Mapping[str, ValueType]:
    """Return the names that a rule may use about an item, with all their possible values."""
    return {
        "colour": ValueType("word", choices=tuple(ITEM_COLOURS)),
        "form": ValueType("word", choices=FORMS),
        "kind": ValueType("word", choices=(*kinds, "unknown")),
    }


def can_hold(rule: Expression, names: Mapping[str, ValueType], *, most: int) -> bool:
    """Whether a rule holds for any item; True also when `most` trials do not tell."""
    # What the rule does not ask for need not be varied.
    varied = [known.choices if name in rule.names else known.choices[:1] for name, known in names.items()]
    items = itertools.product(*varied)
    trials = (dict(zip(names, item, strict=True)) for item in itertools.islice(items, most))
    return any(rule.evaluate(item) for item in trials) or next(items, None) is not None
