"""Where the children of a control node stand in the file, declared once in its class body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Self, TypeAlias, overload

if TYPE_CHECKING:
    from .node import Node

Arity: TypeAlias = Literal["one", "many", "table"]


@dataclass(frozen=True, slots=True)
class SlotDeclaration:
    """one: a node, or a list that is run as a Sequence. many: a list. table: a mapping name → as `one`."""

    key: str
    arity: Arity
    doc: str
    required: bool = True
    least: int = 1
    most: int | None = None
    """Of `many`: how many children it takes."""
    of: Literal["cause", "value"] = "value"
    """Of `table`: whether its keys are patterns of causes."""
    labels: tuple[str, ...] = ()
    """Of `many`, where places differ in meaning: what each child is, for pictures ("then", "else"; "recovery"
    is one that runs after a failure)."""
    matches: str | None = None
    """Of `table`: the input whose value its keys are compared with."""


class Slot:
    """What all slots share: their declaration, under the attribute's name unless told otherwise."""

    def __init__(self, declaration: SlotDeclaration) -> None:
        self.declaration = declaration


class OneSlot(Slot):
    @overload
    def __get__(self, instance: None, owner: type[Node]) -> Self: ...
    @overload
    def __get__(self, instance: Node, owner: type[Node]) -> Node: ...
    def __get__(self, instance: Node | None, owner: type[Node]) -> Self | Node:
        return self if instance is None else instance.slot(self.declaration.key)[0][1]


class OptionalSlot(Slot):
    @overload
    def __get__(self, instance: None, owner: type[Node]) -> Self: ...
    @overload
    def __get__(self, instance: Node, owner: type[Node]) -> Node | None: ...
    def __get__(self, instance: Node | None, owner: type[Node]) -> Self | Node | None:
        if instance is None:
            return self
        filled = instance.slot(self.declaration.key)
        return filled[0][1] if filled else None


class ManySlot(Slot):
    @overload
    def __get__(self, instance: None, owner: type[Node]) -> Self: ...
    @overload
    def __get__(self, instance: Node, owner: type[Node]) -> tuple[Node, ...]: ...
    def __get__(self, instance: Node | None, owner: type[Node]) -> Self | tuple[Node, ...]:
        if instance is None:
            return self
        return tuple(node for _, node in instance.slot(self.declaration.key))


class TableSlot(Slot):
    @overload
    def __get__(self, instance: None, owner: type[Node]) -> Self: ...
    @overload
    def __get__(self, instance: Node, owner: type[Node]) -> Mapping[str, Node]: ...
    def __get__(self, instance: Node | None, owner: type[Node]) -> Self | Mapping[str, Node]:
        return self if instance is None else dict(instance.slot(self.declaration.key))


def child(doc: str, *, key: str = "do") -> OneSlot:
    """Exactly one child."""
    return OneSlot(SlotDeclaration(key, "one", doc))


def optional_child(doc: str, *, key: str) -> OptionalSlot:
    """One child or none."""
    return OptionalSlot(SlotDeclaration(key, "one", doc, required=False))


def children(
    doc: str, *, key: str = "do", least: int = 1, most: int | None = None, labels: tuple[str, ...] = ()
) -> ManySlot:
    """A list of children; `labels` say what each is where the place in the list gives it a meaning."""
    return ManySlot(SlotDeclaration(key, "many", doc, least=least, most=most, labels=labels))


def table(
    doc: str,
    *,
    key: str,
    of: Literal["cause", "value"] = "value",
    required: bool = False,
    matches: str | None = None,
) -> TableSlot:
    """Children by name, in the order of the file; with `of="cause"` the names are patterns of causes.

    matches: the key of the input whose value the names are compared with.
    """
    return TableSlot(SlotDeclaration(key, "table", doc, required=required, of=of, matches=matches))
