"""Typed inputs and outputs of a node, declared once in its class body."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Generic, Literal, Self, TypeAlias, TypeVar, cast, overload

from ..world.journal import Plain
from .values.port_types import ANY_NUMBER, PortType, Range

if TYPE_CHECKING:
    from .node import Node

T = TypeVar("T")


NameKind: TypeAlias = Literal["camera", "pose", "bin", "hole", "fixture", "kind", "colour"]
"""What a text may name: a camera, bin, hole (or a fixture with holes), fixture, kind of item or colour of the
scene, a named pose of the robot. Where scene and robot are known, only their names are valid."""


class Required:
    """The default of a port that has none."""

    def __repr__(self) -> str:
        return "required"


REQUIRED: Final = Required()


@dataclass(frozen=True, slots=True)
class PortDeclaration:
    """What the schema, the loader and the reference know of one port."""

    key: str
    """Its name in the mission file."""
    attribute: str
    """Its name in the class."""
    direction: Literal["in", "out"]
    type: PortType
    doc: str
    unit: str | None = None
    default: object = REQUIRED
    choices: tuple[Plain, ...] | None = None
    names: NameKind | None = None
    within: Range = ANY_NUMBER
    like: str | None = None
    """Of an output: the input whose value it passes on."""
    each_of: str | None = None
    """Of an output: the input whose elements it takes, one after the other."""

    @property
    def required(self) -> bool:
        return self.direction == "in" and isinstance(self.default, Required)


@dataclass(frozen=True, slots=True)
class PortSpec:
    """What `port(...)` wrote down; the class makes a descriptor of it."""

    doc: str
    unit: str | None
    default: object
    choices: tuple[Plain, ...] | None
    key: str | None
    names: NameKind | None
    within: Range
    like: str | None
    each_of: str | None


class In(Generic[T]):
    """An input: read once when the node starts, so that it does not change under a running skill."""

    def __init__(self, declaration: PortDeclaration) -> None:
        self.declaration = declaration

    @overload
    def __get__(self, instance: None, owner: type[Node]) -> Self: ...
    @overload
    def __get__(self, instance: Node, owner: type[Node]) -> T: ...
    def __get__(self, instance: Node | None, owner: type[Node]) -> Self | T:
        if instance is None:
            return self
        return cast("T", instance.input(self.declaration.key))


class Out(Generic[T]):
    """An output: assigning to it writes the blackboard at once, and checks the type."""

    def __init__(self, declaration: PortDeclaration) -> None:
        self.declaration = declaration

    @overload
    def __get__(self, instance: None, owner: type[Node]) -> Self: ...
    @overload
    def __get__(self, instance: Node, owner: type[Node]) -> T: ...
    def __get__(self, instance: Node | None, owner: type[Node]) -> Self | T:
        if instance is None:
            return self
        return cast("T", instance.written(self.declaration.key))

    def __set__(self, instance: Node, value: T) -> None:
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

    unit: of a number; literals may then be written with a unit. choices: the only values allowed.
    key: the name in the file where it cannot be the attribute's (`in`, `while`).
    names: what in scene or robot the text names. least, most, above: bounds of a number, in its unit.
    like, each_of: the key of the input whose value an output passes on, or whose elements it takes.
    """
    allowed = tuple(choices) if choices is not None else None
    return PortSpec(doc, unit, default, allowed, key, names, Range(least, most, above), like, each_of)
