"""Types of ports: the values that a literal may have, and those that may flow from an output to an input."""

from __future__ import annotations

import math
import types
import typing
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, TypeAlias, cast

from picktree.files import Expression, quantities, suggest_name
from picktree.world import ObjectId, Plain


@dataclass(frozen=True, slots=True)
class PortValues:
    """Keys given under a node, and the values known of them."""

    keys: frozenset[str]
    constants: Mapping[str, object] = field(default_factory=dict[str, object])
    """Values of inputs given as literals, converted. Values that come through keys are not known."""
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    """Labels of the children by slot: the name in a table, else empty."""

    def any_of(self, *keys: str) -> bool:
        """Whether at least one of these keys is given."""
        return not self.keys.isdisjoint(keys)

    def number(self, key: str) -> float | None:
        """Return the number given as a literal; None without one."""
        value = self.constants.get(key)
        return value if isinstance(value, int | float) and not isinstance(value, bool) else None


@dataclass(frozen=True, slots=True)
class PortProblem:
    """Error in the value of one key; `key` may be `slot/label`."""

    key: str
    message: str
    hint: str = ""


_LARGEST_INTEGER = 2**63 - 1
"""Largest integer: a log holds 64 bits."""


def plain_copy(value: object) -> Plain:
    """Return a deep copy. Raises TypeError for a value that is not plain, ValueError for NaN."""
    match value:
        case None | bool():
            return value
        case int():
            if not -_LARGEST_INTEGER <= value <= _LARGEST_INTEGER:
                raise ValueError("the number is too large")
            return int(value)
        case str():
            return str(value)
        case float():
            if not math.isfinite(value):
                raise ValueError(f"{value} is not a finite number")
            return float(value)
        case list() | tuple():
            return [plain_copy(item) for item in cast("list[object]", value)]
        case dict():
            entries = cast("dict[object, object]", value)
            return {str(key): plain_copy(item) for key, item in entries.items()}
        case _:
            raise TypeError(f"a {type(value).__name__} is not a plain value")


Name: TypeAlias = Literal["string", "int", "float", "bool", "object", "expression", "any"]


_NAMES: Mapping[object, Name] = {
    str: "string", int: "int", float: "float", bool: "bool", ObjectId: "object",
    Expression: "expression", object: "any",
}  # fmt: skip


_WORDS: Mapping[Name, str] = {
    "string": "a text", "int": "a whole number", "float": "a number", "bool": "true or false",
    "object": "an object's id", "expression": "an expression", "any": "a value",
}  # fmt: skip


_LIST = "list of "


@dataclass(frozen=True, slots=True)
class PortType:
    """Type of a port by its name in mission files, or a list of it; `optional`: null is a valid value,
    too."""

    name: Name
    many: bool = False
    optional: bool = False

    @classmethod
    def parse(cls, text: str) -> PortType:
        """Parse a type of a mission file: `object`, `list of object`. Raises ValueError."""
        stem = text.removeprefix(_LIST)
        for name in NAMES_IN_FILES:
            if stem == name:
                return cls(name, many=text.startswith(_LIST))
        raise ValueError(f"unknown type {text!r}")

    @classmethod
    def of(cls, annotation: object) -> tuple[PortType, tuple[Plain, ...] | None]:
        """Convert a Python annotation; return the type and the choices of a Literal. Raises TypeError."""
        origin, args = typing.get_origin(annotation), typing.get_args(annotation)
        if origin in (typing.Union, types.UnionType) and len(args) == 2 and type(None) in args:
            inner, choices = cls.of(next(a for a in args if a is not type(None)))
            return cls(inner.name, inner.many, optional=True), choices
        if origin is list and len(args) == 1:
            inner, choices = cls.of(args[0])
            if inner.many or inner.optional:
                raise TypeError(f"{annotation} cannot be the type of a port")
            return cls(inner.name, many=True), choices
        if origin is Literal and all(isinstance(a, str) for a in args):
            return cls("string"), args
        for known, name in _NAMES.items():
            if annotation is known:
                return cls(name), None
        raise TypeError(f"{annotation} cannot be the type of a port")

    def __str__(self) -> str:
        return (_LIST if self.many else "") + self.name

    def words(self) -> str:
        """Return the type in words: "a list of numbers"."""
        if self.many:
            return "a list" if self.name == "any" else f"a list, each {_WORDS[self.name]}"
        return _WORDS[self.name]


@dataclass(frozen=True, slots=True)
class Range:
    """Valid numbers of a port, in its unit: at least `least`, at most `most`, greater than `above`."""

    least: float | None = None
    most: float | None = None
    above: float | None = None

    def check(self, number: float, written: object = None, unit: str | None = None) -> None:
        """Check a number. Raises ValueError with a sentence, in the unit in which the number was `written`.

        `unit`: that of the port.
        """
        if self.least is not None and number < self.least:
            raise ValueError(_out_of(number, "less than", self.least, written, unit))
        if self.most is not None and number > self.most:
            raise ValueError(_out_of(number, "more than", self.most, written, unit))
        if self.above is not None and number <= self.above:
            raise ValueError(_out_of(number, "not more than", self.above, written, unit))

    def words(self) -> str:
        """Return the bounds in words, as `more than 0, at most 1`; empty when every number is valid."""
        bounds = (("more than", self.above), ("at least", self.least), ("at most", self.most))
        return ", ".join(f"{words} {bound:g}" for words, bound in bounds if bound is not None)


def _out_of(number: float, relation: str, bound: float, written: object, unit: str | None) -> str:
    if not isinstance(written, str) or written.rstrip()[-1:].isdigit():
        return f"{number:g} is {relation} {bound:g}"
    limit = (
        quantities.in_unit(bound / 1000, "s", written)
        if unit == "ms"
        else quantities.in_unit(bound, unit or "", written)
    )
    return f"{written.strip()} is {relation} {limit}"


ANY_NUMBER: Final = Range()


NAMES_IN_FILES: tuple[Name, ...] = ("string", "int", "float", "bool", "object", "any")


def convert_literal(
    value: object,
    kind: PortType,
    unit: str | None = None,
    choices: Collection[Plain] | None = None,
    within: Range = ANY_NUMBER,
) -> object:
    """Convert a literal of a file to the port's type. Raises ValueError with a sentence."""
    if value is None and kind.optional:
        return None
    if kind.many:
        if not isinstance(value, list):
            raise ValueError(f"{show(value)} is not {kind.words()}")
        one = PortType(kind.name)
        return [convert_literal(item, one, unit, choices, within) for item in cast("list[object]", value)]
    converted = _CONVERTERS[kind.name](value, unit)
    if choices is not None and converted not in choices:
        raise ValueError(f"{show(converted)} is not a choice; {suggest_name(str(value), map(str, choices))}")
    if kind.name in ("int", "float"):
        within.check(cast("float", converted), value, unit)
    return converted


def accept_value(
    value: object,
    kind: PortType,
    choices: Collection[Plain] | None = None,
    within: Range = ANY_NUMBER,
) -> object:
    """Convert a value from the blackboard or a skill. Raises ValueError with a sentence.

    Unlike in a literal, a text is never read as a number.
    """
    if isinstance(value, str) and kind.name in ("float", "int") and not kind.many:
        raise ValueError(f"{show(value)} is not {kind.words()}")
    return convert_literal(value, kind, None, choices, within)


def show(value: object) -> str:
    """Return a value as messages show it."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    # Only the part that is shown is converted: a value may be as large as a file.
    text = repr(
        cast("list[object] | str", value)[:_MAX_SHOWN_LENGTH] if isinstance(value, str | list) else value
    )
    return text if len(text) <= _MAX_SHOWN_LENGTH else text[: _MAX_SHOWN_LENGTH - 3] + "..."


_MAX_SHOWN_LENGTH = 60


def _string(value: object, _: str | None) -> str:
    if isinstance(value, str):
        return value
    hint = "; write it in quotes" if isinstance(value, int | float) else ""
    raise ValueError(f"{show(value)} is not a text{hint}")


def _int(value: object, _: str | None) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f"{show(value)} is not a whole number")
    plain_copy(value)
    return value


def _float(value: object, unit: str | None) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"{show(value)} is not a number")
    if unit == "ms":
        return _milliseconds(value)
    if unit is None and isinstance(value, str) and not value.rstrip().endswith("%"):
        raise ValueError(f"{show(value)} is not a number")
    return quantities.parse_quantity(value, unit or "")


def _milliseconds(value: str | int | float) -> float:
    # BT.CPP's ports `msec` and `delay_msec` take bare numbers in ms; here, too.
    number = quantities.bare_number(value) if isinstance(value, str) else value
    if number is not None:
        return quantities.parse_quantity(number, "s")
    return round(quantities.parse_quantity(value, "s") * 1000.0, 9)


def _bool(value: object, _: str | None) -> bool:
    if isinstance(value, bool):
        return value
    raise ValueError(f"{show(value)} is neither true nor false")


def _object(value: object, _: str | None) -> str:
    if isinstance(value, str):
        return value
    raise ValueError(f"{show(value)} is not an object's id")


def _expression(value: object, _: str | None) -> Expression:
    if isinstance(value, Expression):
        return value
    if isinstance(value, bool | int | float):
        return Expression.parse(str(value).lower())
    if isinstance(value, str):
        return Expression.parse(value)
    raise ValueError(f"{show(value)} is not an expression")


def _any(value: object, _: str | None) -> object:
    return plain_copy(value)


_CONVERTERS: Mapping[Name, Callable[[object, str | None], object]] = {
    "string": _string, "int": _int, "float": _float, "bool": _bool, "object": _object,
    "expression": _expression, "any": _any,
}  # fmt: skip
