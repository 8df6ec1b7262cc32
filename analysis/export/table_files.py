"""Tables as files: the declaration of their columns, and their form in CSV and Parquet.

CSV: RFC 4180, UTF-8, a first line with the columns' names, CRLF, text quoted where needed. An empty cell is a
missing value or an empty text. Numbers are written so that they read back unchanged. Parquet: zstd, typed
columns, each with its unit and its meaning in the field's metadata.
"""

from __future__ import annotations

import csv
import dataclasses
import itertools
import re
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Protocol, TypeAlias, TypeVar, Union, get_args, get_origin
from typing import get_type_hints as hints

from picktree.files import PicktreeError, file_system
from picktree.logs import optional_import
from picktree.world import record_fields

R = TypeVar("R")
Cell: TypeAlias = int | float | bool | str | None
Kind: TypeAlias = Literal["int", "float", "bool", "text"]
TableForm: TypeAlias = Literal["csv", "parquet"]

_COLUMN_KINDS: Final[dict[type, Kind]] = {int: "int", float: "float", bool: "bool", str: "text"}
_ROW_GROUP_SIZE = 100_000
"""Maximum number of rows in memory: a run may last for hours."""
_FORMULA_START = re.compile(r"'*[=+\-@\t\r]")
"""Beginnings of text that a spreadsheet takes as a formula, which could run a program, unless ' precedes."""


@dataclass(frozen=True, slots=True)
class ColumnDoc:
    """Description of a column for people; `unit` is empty for a column without one."""

    meaning: str
    unit: str = ""


_TIME: Final = Annotated[float, ColumnDoc("simulated time", "s")]


@dataclass(frozen=True, slots=True)
class Column:
    name: str
    kind: Kind
    optional: bool
    """Whether a cell may be empty (None). A missing text is the empty text instead."""
    unit: str
    meaning: str


class Table(Protocol):
    """Name, meaning of a row, and columns."""

    @property
    def name(self) -> str: ...
    @property
    def meaning(self) -> str: ...
    @property
    def columns(self) -> tuple[Column, ...]: ...


@cache
def columns(row: type) -> tuple[Column, ...]:
    """Return the columns in the order of the fields: `Annotated[int | float | bool | str, ColumnDoc(…)]`.

    Raises TypeError for a field that is no column.
    """
    annotations = hints(row, include_extras=True)
    return tuple(_column(field.name, annotations[field.name]) for field in dataclasses.fields(row))


def row_type(record: type, names: str, **others: Any) -> type[Any]:
    """Return a row type whose columns are the `names`, in their order: fields of a record, or of `others`.

    A field has the type, meaning and unit of its declaration. `time` is simulated seconds where the record
    has no field of that name.
    """
    declared = {
        each.name: Annotated[each.hint, ColumnDoc(each.meaning, each.unit)] for each in record_fields(record)
    }
    declared = {"time": _TIME, **declared, **others}
    return dataclasses.make_dataclass(
        f"{record.__name__}Row", [(name, declared[name]) for name in names.split()], frozen=True, slots=True
    )


def cells(row: object) -> tuple[Cell, ...]:
    """Return the row's values in the order of its columns."""
    return _cells_of(type(row))(row)


@cache
def _cells_of(row: type) -> Callable[[Any], Any]:
    names = [column.name for column in columns(row)]
    return attrgetter(*names) if len(names) > 1 else lambda one: (getattr(one, names[0]),)


def row_of(row: type[R], record: object, **others: Cell) -> R:
    """Return a row with the record's values of the same names, and `others`."""
    names = (column.name for column in columns(row))
    return row(**{name: others[name] if name in others else getattr(record, name) for name in names})


def _column(name: str, annotation: Any) -> Column:
    if get_origin(annotation) is not Annotated:
        raise TypeError(f"{name}: a column says what it holds")
    kind, doc = get_args(annotation)
    options = get_args(kind) if get_origin(kind) in (types.UnionType, Union) else (kind,)
    only = next(option for option in options if option is not types.NoneType)
    column_kind = "text" if get_origin(only) is Literal else _COLUMN_KINDS[only]
    return Column(name, column_kind, types.NoneType in options, doc.unit, doc.meaning)


def write_tables(
    form: TableForm, output: Path, tables: Sequence[Table], rows: Callable[[Any], Iterable[tuple[Cell, ...]]]
) -> dict[Path, int]:
    """Write each table with its rows to the folder `output`, all or none; return the numbers of rows.

    Raises PicktreeError when they cannot be written or a library is missing.
    """
    write = write_csv if form == "csv" else write_parquet
    if form == "parquet":
        with optional_import("parquet", "pyarrow", "An export to Parquet"):
            import_module("pyarrow")
    paths = [output / f"{table.name}.{form}" for table in tables]
    for path in paths:
        if path.is_dir():
            raise PicktreeError(f"{path} cannot be written: it is a folder")
    with file_system.whole(paths, output) as beside:
        output.mkdir(parents=True, exist_ok=True)
        counts = [write(path, table, rows(table)) for path, table in zip(beside, tables, strict=True)]
    return dict(zip(paths, counts, strict=True))


def counts_text(counts: Mapping[Path, int], digits: int) -> str:
    """Return a line for each file with its number of rows, without a trailing newline."""
    width = max(len(str(path)) for path in counts)
    return "\n".join(f"{path!s:<{width}}  {count:>{digits}} rows" for path, count in counts.items())


def write_csv(path: Path, table: Table, rows: Iterable[tuple[Cell, ...]]) -> int:
    """Write the rows and return their number. Raises OSError when the disk refuses."""
    count = 0
    words = [k for k, column in enumerate(table.columns) if column.kind in ("bool", "text")]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\r\n")
        writer.writerow([column.name for column in table.columns])
        for row in rows:
            line = list(row)
            for k in words:
                line[k] = _cell_text(line[k])
            writer.writerow(line)
            count += 1
    return count


def _cell_text(cell: Cell) -> str | None:
    if isinstance(cell, str):
        return f"'{cell}" if _FORMULA_START.match(cell) else cell
    return None if cell is None else "true" if cell else "false"


def write_parquet(path: Path, table: Table, rows: Iterable[tuple[Cell, ...]]) -> int:
    """Write the rows and return their number. Raises OSError when the disk refuses."""
    import pyarrow as pa
    from pyarrow import parquet

    kinds = {"int": pa.int64(), "float": pa.float64(), "bool": pa.bool_(), "text": pa.string()}
    schema = pa.schema(
        [
            pa.field(
                column.name,
                kinds[column.kind],
                nullable=column.optional,
                metadata={"unit": column.unit, "meaning": column.meaning},
            )
            for column in table.columns
        ],
        metadata={"picktree.table": table.name, "picktree.row": table.meaning},
    )
    count = 0
    waiting = iter(rows)
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        while taken := list(itertools.islice(waiting, _ROW_GROUP_SIZE)):
            arrays = [
                pa.array([row[k] for row in taken], type=kinds[column.kind])
                for k, column in enumerate(table.columns)
            ]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
            count += len(taken)
    return count
