"""Parquet file (zstd) of a table: typed columns, each with its unit and its meaning in the field's
metadata."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

import pyarrow as pa
from pyarrow import parquet

from .row_types import Column, TableSpec, cells

R = TypeVar("R")

_ROW_GROUP_SIZE = 100_000
"""Maximum number of rows in memory: a run may last for hours."""
ARROW_TYPES = {"int": pa.int64(), "float": pa.float64(), "bool": pa.bool_(), "text": pa.string()}


def write_parquet(path: Path, table: TableSpec[R], rows: Iterable[R]) -> int:
    """Write the rows and return their number. Raises OSError when the disk refuses."""
    schema = pa.schema(
        [field_of(column) for column in table.columns],
        metadata={"picktree.table": table.name, "picktree.row": table.meaning},
    )
    count = 0
    waiting = iter(rows)
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        while taken := [cells(row) for row in itertools.islice(waiting, _ROW_GROUP_SIZE)]:
            arrays = [
                pa.array([row[k] for row in taken], type=ARROW_TYPES[column.kind])
                for k, column in enumerate(table.columns)
            ]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
            count += len(taken)
    return count


def read_parquet(path: Path, table: TableSpec[R]) -> tuple[R, ...]:
    """Read a file of `write_parquet`. Raises ValueError for another file."""
    read = parquet.read_table(path)
    if read.schema.names != [column.name for column in table.columns]:
        raise ValueError(f"{path}: the columns are {', '.join(read.schema.names)}")
    return tuple(table.row(**row) for row in read.to_pylist())


def field_of(column: Column) -> pa.Field:
    metadata = {"unit": column.unit, "meaning": column.meaning}
    return pa.field(column.name, ARROW_TYPES[column.kind], nullable=column.optional, metadata=metadata)
