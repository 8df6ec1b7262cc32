"""Ports: typed inputs and outputs of a node, declared once in its class body. Their types say which
values a literal may have, and which may flow from an output to an input.
"""

from __future__ import annotations

import math
import types
import typing
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Generic, Literal, Protocol, Self, TypeAlias, TypeVar, cast, overload

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
        """Return the number given as a literal; None when there is none."""
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
        raise ValueError(
            f"{show(converted)} is none of the choices; {suggest_name(str(value), map(str, choices))}"
        )
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
Arity: TypeAlias = Literal["one", "many", "table"]


@dataclass(frozen=True, slots=True)
class SlotDeclaration:
    """Declaration of a slot.

    one: a node, or a list that runs as a Sequence. many: a list. table: a mapping from names to entries as in
    `one`.
    """

    key: str
    arity: Arity
    doc: str
    required: bool = True
    least: int = 1
    most: int | None = None
    """Maximum number of children of a `many` slot; None: no limit."""
    of: Literal["cause", "value"] = "value"
    """Kind of the keys of a `table`: patterns of causes, or values."""
    labels: tuple[str, ...] = ()
    """Roles of the children of a `many` slot by place, for pictures ("then", "else"; "recovery" runs after a
    failure)."""
    matches: str | None = None
    """Key of the input that a `table`'s keys are compared with; None: none."""


N = TypeVar("N", covariant=True)


class SlotHolder(Protocol[N]):
    """Node as far as its slots need it."""

    def slot(self, key: str) -> tuple[tuple[str, N], ...]: ...


class Slot:
    """Base class of slots: a declaration, stored under the attribute's name by default."""

    def __init__(self, declaration: SlotDeclaration) -> None:
        self.declaration = declaration


class OneSlot(Slot):
    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: SlotHolder[N], owner: type) -> N: ...
    def __get__(self, instance: SlotHolder[N] | None, owner: type) -> Self | N:
        return self if instance is None else instance.slot(self.declaration.key)[0][1]


class OptionalSlot(Slot):
    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: SlotHolder[N], owner: type) -> N | None: ...
    def __get__(self, instance: SlotHolder[N] | None, owner: type) -> Self | N | None:
        if instance is None:
            return self
        filled = instance.slot(self.declaration.key)
        return filled[0][1] if filled else None


class ManySlot(Slot):
    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: SlotHolder[N], owner: type) -> tuple[N, ...]: ...
    def __get__(self, instance: SlotHolder[N] | None, owner: type) -> Self | tuple[N, ...]:
        if instance is None:
            return self
        return tuple(node for _, node in instance.slot(self.declaration.key))


class TableSlot(Slot):
    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: SlotHolder[N], owner: type) -> Mapping[str, N]: ...
    def __get__(self, instance: SlotHolder[N] | None, owner: type) -> Self | Mapping[str, N]:
        return self if instance is None else dict(instance.slot(self.declaration.key))


def child(doc: str, *, key: str = "do") -> OneSlot:
    """Declare exactly one child."""
    return OneSlot(SlotDeclaration(key, "one", doc))


def optional_child(doc: str, *, key: str) -> OptionalSlot:
    """Declare an optional child."""
    return OptionalSlot(SlotDeclaration(key, "one", doc, required=False))


def children(
    doc: str, *, key: str = "do", least: int = 1, most: int | None = None, labels: tuple[str, ...] = ()
) -> ManySlot:
    """Declare a list of children; `labels` give the roles by place."""
    return ManySlot(SlotDeclaration(key, "many", doc, least=least, most=most, labels=labels))


def table(
    doc: str,
    *,
    key: str,
    of: Literal["cause", "value"] = "value",
    required: bool = False,
    matches: str | None = None,
) -> TableSlot:
    """Declare a table of children by name, in the order of the file.

    of: "cause" makes the names patterns of causes. matches: key of the input that the names are compared
    with.
    """
    return TableSlot(SlotDeclaration(key, "table", doc, required=required, of=of, matches=matches))


T = TypeVar("T")
NameKind: TypeAlias = Literal[
    "camera", "pose", "bin", "tote", "hole", "fixture", "kind", "colour", "planner"
]  # fmt: skip
"""Kind of name that a text port accepts: camera, bin, tote, hole (or fixture with holes), fixture, kind or
colour of items, named pose, planner.

Where scene and robot are known, only their names are valid.
"""
Takes: TypeAlias = Literal["value", "template", "key", "assignments"]


class Required:
    """Default of a port without one: the file must give a value."""

    def __repr__(self) -> str:
        return "required"


REQUIRED: Final = Required()


@dataclass(frozen=True, slots=True)
class PortDeclaration:
    """Declaration of one port, for schema, loader and reference."""

    key: str
    """Name in the mission file."""
    attribute: str
    """Name of the attribute in the class."""
    direction: Literal["in", "out"]
    type: PortType
    doc: str
    unit: str | None = None
    default: object = REQUIRED
    choices: tuple[Plain, ...] | None = None
    names: NameKind | None = None
    within: Range = ANY_NUMBER
    like: str | None = None
    """Key of the input whose value an output passes on; None: none."""
    each_of: str | None = None
    """Key of the input whose elements an output takes one after the other; None: none."""
    takes: Takes = "value"
    """Content of an input: a value, a template, a key whose value is not read, or assignments as a text.
    The node fills in the references of a template."""
    remapped: bool = False
    """Whether it is a key of a tree that calls with `_autoremap` share with their tree."""

    @property
    def required(self) -> bool:
        return self.direction == "in" and isinstance(self.default, Required)


class PortHolder(Protocol):
    """Node as far as its ports need it."""

    def input(self, key: str) -> object: ...
    def written(self, key: str) -> object: ...
    def output(self, key: str, value: object) -> None: ...


class In(Generic[T]):
    """Descriptor of an input: read once at the node's start, so that it is constant while a skill runs."""

    def __init__(self, declaration: PortDeclaration) -> None:
        self.declaration = declaration

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: PortHolder, owner: type) -> T: ...
    def __get__(self, instance: PortHolder | None, owner: type) -> Self | T:
        if instance is None:
            return self
        return cast("T", instance.input(self.declaration.key))


class Out(Generic[T]):
    """Descriptor of an output: an assignment checks the type and writes the blackboard at once."""

    def __init__(self, declaration: PortDeclaration) -> None:
        self.declaration = declaration

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: PortHolder, owner: type) -> T: ...
    def __get__(self, instance: PortHolder | None, owner: type) -> Self | T:
        if instance is None:
            return self
        return cast("T", instance.written(self.declaration.key))

    def __set__(self, instance: PortHolder, value: T) -> None:
        instance.output(self.declaration.key, value)


def port(
    doc: str,
    *,
    unit: str | None = None,
    default: object = REQUIRED,
    choices: Iterable[Plain] | None = None,
    key: str | None = None,
    names: NameKind | None = None,
    least: float | None = None,
    most: float | None = None,
    above: float | None = None,
    like: str | None = None,
    each_of: str | None = None,
    takes: Takes = "value",
) -> Any:
    """Declare a port: `object: In[ObjectId] = port("what to grasp")`. The class of the node completes it.

    The name in the file is `key` where it cannot be the attribute's (`in`, `while`). A number has a `unit`,
    in which literals may be written, and the bounds `least`, `most`, `above` in that unit. A text may be
    limited to `choices`, or to `names`, a kind of name in scene or robot. An output passes on the value of
    the input `like`, or takes the elements of the input `each_of` in turn. An input may take a
    key instead of its value, assignments, or a template: a text in which the node fills in references.
    """
    allowed, within = tuple(choices) if choices is not None else None, Range(least, most, above)
    named = (key or "", "", "in", PortType("any"))
    return PortDeclaration(*named, doc, unit, default, allowed, names, within, like, each_of, takes)
