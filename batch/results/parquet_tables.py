"""Parquet form (zstd) of a batch's table: typed columns, each with unit and meaning as metadata."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from ...analysis.export.tables.parquet_file import ARROW_TYPES, field_of
from ...analysis.export.tables.row_types import Cell
from .tables import TableOf

_ROWS_PER_GROUP = 100_000
"""Number of rows held at a time."""


def write_parquet(path: Path, table: TableOf, rows: Iterator[tuple[Cell, ...]]) -> int:
    """Write the table; return the number of rows. Raises OSError when the disk refuses."""
    schema = pa.schema(
        [field_of(column) for column in table.columns],
        metadata={"picktree.table": table.name, "picktree.row": table.meaning},
    )
    count = 0
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        while taken := list(itertools.islice(rows, _ROWS_PER_GROUP)):
            arrays = [
                pa.array([row[k] for row in taken], type=ARROW_TYPES[column.kind])
                for k, column in enumerate(table.columns)
            ]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
            count += len(taken)
    return count
