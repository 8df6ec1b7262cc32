"""Ports: typed inputs and outputs of a node, declared once in its class body."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Generic, Literal, Protocol, Self, TypeAlias, TypeVar, cast, overload

from picktree.world import Plain

from .port_types import ANY_NUMBER, PortType, Range

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
    """Descriptor of an output: an assignment checks the type and writes the blackboard immediately."""

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
