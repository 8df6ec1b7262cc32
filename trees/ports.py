"""Typed inputs and outputs of a node, declared once in its class body."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, Generic, Literal, Protocol, Self, TypeAlias, TypeVar, cast, overload

from ..world.journal import Plain
from .values.port_types import ANY_NUMBER, PortType, Range

T = TypeVar("T")


NameKind: TypeAlias = Literal["camera", "pose", "bin", "hole", "fixture", "kind", "colour"]
"""Kind of name that a text port accepts: camera, bin, hole (or a fixture with holes), fixture, kind or colour
of items, or named pose.

Where scene and robot are known, only their names are valid.
"""


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

    @property
    def required(self) -> bool:
        return self.direction == "in" and isinstance(self.default, Required)


@dataclass(frozen=True, slots=True)
class PortSpec:
    """Arguments of `port(...)`; `declare` replaces them with a descriptor."""

    doc: str
    unit: str | None
    default: object
    choices: tuple[Plain, ...] | None
    key: str | None
    names: NameKind | None
    within: Range
    like: str | None
    each_of: str | None


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
) -> Any:
    """Declare a port: `object: In[ObjectId] = port("what to grasp")`.

    The name in the file is `key` where it cannot be the attribute's (`in`, `while`). A number has a `unit`,
    in which literals may be written, and the bounds `least`, `most`, `above` in that unit. A text may be
    limited to `choices`, or to `names`, a kind of name in scene or robot. An output passes on the value of
    the input `like`, or takes the elements of the input `each_of` in turn.
    """
    allowed = tuple(choices) if choices is not None else None
    return PortSpec(doc, unit, default, allowed, key, names, Range(least, most, above), like, each_of)
