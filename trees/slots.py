"""Slots: places for the children of a control node in the file, declared once in the class body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, Self, TypeAlias, TypeVar, overload

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
