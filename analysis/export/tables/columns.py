"""Columns of a table, from the row's dataclass: the one definition that every form of the table follows."""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Final, Generic, Literal, TypeAlias, TypeVar, get_args, get_origin
from typing import get_type_hints as hints

from ...run import Run

R = TypeVar("R")

Cell: TypeAlias = int | float | bool | str | None
Kind: TypeAlias = Literal["int", "float", "bool", "text"]

_KINDS: Final[dict[type, Kind]] = {int: "int", float: "float", bool: "bool", str: "text"}


@dataclass(frozen=True, slots=True)
class ColumnDoc:
    """What a column holds, for people; `unit` is empty for what has none."""

    meaning: str
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Column:
    name: str
    kind: Kind
    optional: bool
    """Whether a cell may be empty (None). A text that is missing is the empty text instead."""
    unit: str
    meaning: str


@dataclass(frozen=True, slots=True)
class TableSpec(Generic[R]):
    """`row` is a dataclass whose fields are `Annotated[int | float | bool | str, Says(…)]`."""

    name: str
    meaning: str
    """What a row is."""
    row: type[R]
    rows: Callable[[Run], Iterable[R]]

    @property
    def columns(self) -> tuple[Column, ...]:
        return columns(self.row)


@cache
def columns(row: type) -> tuple[Column, ...]:
    """In the order of the fields. Raises TypeError for a field that is no column."""
    said = hints(row, include_extras=True)
    return tuple(_column(field.name, said[field.name]) for field in dataclasses.fields(row))


def cells(row: object) -> tuple[Cell, ...]:
    """The row's values in the order of its columns."""
    return tuple(getattr(row, column.name) for column in columns(type(row)))


def _column(name: str, said: Any) -> Column:
    if get_origin(said) is not Annotated:
        raise TypeError(f"{name}: a column says what it holds")
    kind, says = get_args(said)
    options = get_args(kind) if get_origin(kind) is types.UnionType else (kind,)
    (only,) = (option for option in options if option is not types.NoneType)
    return Column(name, _KINDS[only], len(options) > 1, says.unit, says.meaning)
