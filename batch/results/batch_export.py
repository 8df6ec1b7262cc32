"""Export of a batch's tables as CSV or Parquet files, one per table, for pandas, DuckDB, polars, R."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from ...analysis.export.tables.csv_file import cell_text
from ...analysis.export.tables.row_types import Cell
from ...errors import PicktreeError
from ...files.atomic_write import whole
from ...logs.optional_libraries import optional_import
from .store import Store
from .tables import TABLES, TableOf

Form: TypeAlias = Literal["csv", "parquet"]
Rows: TypeAlias = Iterator[tuple[Cell, ...]]
_Write: TypeAlias = Callable[[Path, TableOf, Rows], int]


@dataclass(frozen=True, slots=True)
class ExportedTables:
    """Written files with their number of rows."""

    form: Form
    output: Path
    rows: Mapping[Path, int]

    def to_text(self) -> str:
        """Return a text for a terminal, without a trailing newline."""
        width = max(len(str(path)) for path in self.rows)
        return "\n".join(f"{path!s:<{width}}  {count:>8} rows" for path, count in self.rows.items())

    def to_json_text(self) -> str:
        tables = {path.stem: count for path, count in self.rows.items()}
        said = {"to": self.form, "output": str(self.output.absolute()), "tables": tables}
        return json.dumps(said, ensure_ascii=False, indent=2) + "\n"


def export(store: Store, form: Form, output: Path) -> ExportedTables:
    """Write every table to the folder `output`, either all or none.

    Raises PicktreeError when it cannot be written or a library is missing.
    """
    write = _writer(form)
    paths = [output / f"{table.name}.{form}" for table in TABLES]
    for path in paths:
        if path.is_dir():
            raise PicktreeError(f"{path} cannot be written: it is a folder")
    with whole(paths, output) as beside:
        output.mkdir(parents=True, exist_ok=True)
        with store.reading() as rows:
            counts = [write(path, table, rows(table)) for path, table in zip(beside, TABLES, strict=True)]
    return ExportedTables(form, output, dict(zip(paths, counts, strict=True)))


def _writer(form: Form) -> _Write:
    if form == "csv":
        return _write_csv
    with optional_import("parquet", "pyarrow", "An export to Parquet"):
        from .parquet_tables import write_parquet
    return write_parquet


def _write_csv(path: Path, table: TableOf, rows: Rows) -> int:
    """Write a table as CSV, in the form of `csv_file` for a run; return the number of rows."""
    count = 0
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\r\n")
        writer.writerow([column.name for column in table.columns])
        for row in rows:
            writer.writerow([cell_text(cell) for cell in row])
            count += 1
    return count
