"""Destinations of items: the rules of a scene file, for believed objects and the scorer's true items."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

from picktree.files import FLOAT, Expression, ValueType, expression_syntax
from picktree.world import ITEM_COLOURS, ObjectId

from .description import Destination
from .scene_schema import FORMS


class Sortable(Protocol):
    """Object of the belief or true item, as rules see it. None: not known."""

    @property
    def colour(self) -> str: ...
    @property
    def form(self) -> str: ...
    @property
    def kind(self) -> str: ...
    @property
    def mass(self) -> float | None:
        """Mass, kg; for an object of the belief the weighed one."""
        ...

    @property
    def size(self) -> float | None:
        """Greatest distance of two of its points, m."""
        ...

    @property
    def tag(self) -> int | None:
        """Number of the ArUco tag on it."""
        ...


@dataclass(frozen=True, slots=True)
class ItemTraits:
    """Traits of an item that rules may use."""

    colour: str
    form: str
    kind: str
    mass: float | None = None
    """Mass, kg; None: not known."""
    size: float | None = None
    """Greatest distance of two of its points, m; None: not known."""
    tag: int | None = None
    """Number of the ArUco tag on it; None: not known."""


def rule_holds(rule: Expression, item: Sortable) -> bool:
    """Return whether a rule holds for an item. A rule with an unknown trait does not hold."""
    names = {name: getattr(item, name) for name in rule.names}
    return all(value is not None for value in names.values()) and bool(rule.evaluate(names))


def unknown_traits(destinations: Iterable[Destination], item: Sortable) -> tuple[str, ...]:
    """Return the unknown traits of an item in the rules up to the first one that holds.

    Without unknown traits the destination of the item is final.
    """
    found: dict[str, None] = {}
    for rule in (Expression.parse(each.where) for each in destinations):
        traits = {name: getattr(item, name) for name in sorted(rule.names)}
        missing = [name for name, value in traits.items() if value is None]
        missing += ["colour"] if "colour" in traits and item.colour not in ITEM_COLOURS else []
        found.update(dict.fromkeys(missing))
        if not missing and rule.evaluate(traits):
            break
    return tuple(found)


def asks_for(destinations: Iterable[Destination], name: str) -> bool:
    """Return whether the expression of any rule uses this name."""
    return any(name in Expression.parse(each.where).names for each in destinations)


def destination_rule(destinations: Iterable[Destination]) -> Callable[[Sortable], ObjectId | None]:
    """Return a function from an item to the bin, fixture with holes or hole of the first rule that holds for
    it, or None. The expressions were checked on reading."""
    rules = [(Expression.parse(d.where), d.to) for d in destinations]
    return lambda item: next((to for rule, to in rules if rule_holds(rule, item)), None)


def colours_of_destinations(
    destinations: Iterable[Destination], kinds: Iterable[tuple[str, str]]
) -> dict[str, str]:
    """Return the colour of the items that belong there, by destination, where all have the same one.

    `kinds`: the catalogue's kinds, each with its form.
    """
    rule, found = destination_rule(destinations), dict[str, set[str]]()
    for colour, (kind, form) in itertools.product(ITEM_COLOURS, kinds):
        to = rule(ItemTraits(colour, form, kind))
        if to is not None:
            found.setdefault(to, set()).add(colour)
    return {to: colours.pop() for to, colours in found.items() if len(colours) == 1}


def is_at(place: str, destination: str) -> bool:
    """Whether an object at `place`, a bin or a hole, is at its destination: that place, or any hole of it.

    >>> is_at("board/left", "board"), is_at("board/left", "board/right"), is_at("red_bin", "red_bin")
    (True, False, True)
    """
    return place == destination or place.startswith(f"{destination}/")


def rule_names(kinds: Iterable[str]) -> Mapping[str, ValueType]:
    """Return the names that a rule may use about an item, with all their possible texts."""
    return {
        "colour": ValueType("word", choices=tuple(ITEM_COLOURS)),
        "form": ValueType("word", choices=FORMS),
        "kind": ValueType("word", choices=(*kinds, "unknown")),
        **dict.fromkeys(MEASURES, FLOAT),
    }


MEASURES = {"mass": 5.0, "size": 1.5, "tag": 49.0}
"""Numeric traits that a rule may use, with their greatest value: kg, m, a tag."""


def can_hold(rule: Expression, names: Mapping[str, ValueType], *, most: int) -> bool:
    """Whether a rule holds for any item; True also when `most` trials give no result.

    Measures are tried at the rule's own numbers and on both sides of them.
    """
    # Traits that the rule does not use need not be varied.
    varied = [
        (_measures(rule, MEASURES[name]) if name in MEASURES else known.choices)
        if name in rule.names
        else (None,)
        for name, known in names.items()
    ]
    items = itertools.product(*varied)
    trials = (dict(zip(names, item, strict=True)) for item in itertools.islice(items, most))
    return any(rule.evaluate(item) for item in trials) or next(items, None) is not None


def _measures(rule: Expression, greatest: float) -> tuple[float, ...]:
    """Return measures to try, up to the greatest one of an item."""
    numbers = {
        float(part.value)
        for part in expression_syntax.walk(rule.root)
        if isinstance(part, expression_syntax.LiteralValue) and isinstance(part.value, int | float)
    }
    tried = {0.5 * greatest, *(number * factor for number in numbers for factor in (0.99, 1.0, 1.01))}
    return tuple(sorted(number for number in tried if 0.0 <= number <= greatest))
