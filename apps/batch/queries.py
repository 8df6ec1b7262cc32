"""Queries on a batch's results, also while the batch runs: SQL results, and whole tables."""

from __future__ import annotations

import csv
import io
import json
import math
import sqlite3
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from ...analysis.export.table_files import Cell
from ...files.errors import PicktreeError
from ...files.value_wording import suggest_name
from ...logs.data_frames import PandasTable
from .tables import TABLES, TableOf
from .views import VIEWS

Read: TypeAlias = Callable[[TableOf], Iterator[tuple[Cell, ...]]]


@dataclass(frozen=True, slots=True)
class QueryResult(PandasTable):
    """Result of a query. Its rows are mappings by column for a loop and for `pandas.DataFrame`."""

    columns: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]

    def columns_by_name(self) -> Mapping[str, Sequence[object]]:
        return {name: [row[n] for row in self.rows] for n, name in enumerate(self.columns)}

    def to_text(self) -> str:
        """Return the columns side by side, numbers aligned right."""
        cells = [[_cell(value) for value in row] for row in self.rows]
        widths = [
            max([len(column), *(len(row[n]) for row in cells)]) for n, column in enumerate(self.columns)
        ]
        right = [any(isinstance(row[n], int | float) for row in self.rows) for n in range(len(self.columns))]
        lines = [list(self.columns), ["─" * width for width in widths], *cells]
        return "\n".join(
            "  ".join(
                text.rjust(width) if aside else text.ljust(width)
                for text, width, aside in zip(line, widths, right, strict=True)
            ).rstrip()
            for line in lines
        )

    def to_csv(self) -> str:
        """Return CSV by RFC 4180, with a line of column names."""
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        writer.writerow(self.columns)
        writer.writerows(self.rows)
        return text.getvalue()

    def to_json_text(self) -> str:
        """Return JSON with `columns` and `rows`; values without a JSON form become text."""
        rows = [[_plain(value) for value in row] for row in self.rows]
        return json.dumps({"columns": self.columns, "rows": rows}, ensure_ascii=False) + "\n"


def run_query(path: Path, sql: str) -> QueryResult:
    """Run a SELECT. Raises PicktreeError for invalid SQL, and for statements that would change the
    results."""
    try:
        with closing(_connection(path)) as connection:
            cursor = connection.execute(sql)
            if cursor.description is None:
                raise PicktreeError("the query cannot be answered: it is no SELECT")
            return QueryResult(tuple(column[0] for column in cursor.description), tuple(cursor.fetchall()))
    except (sqlite3.Error, sqlite3.Warning) as error:
        raise PicktreeError(f"the query cannot be answered: {_error_words(error)}") from None


@contextmanager
def read_tables(path: Path) -> Generator[Read]:
    """Yield a reader of tables at one moment: rows in the order of the jobs, within a job as recorded.

    Raises PicktreeError when they cannot be read.
    """
    with closing(_connection(path)) as connection:
        connection.execute("BEGIN")

        def rows(table: TableOf) -> Iterator[tuple[Cell, ...]]:
            names = ", ".join(f"t.{column.name}" for column in table.columns)
            found = connection.execute(
                f"SELECT {names} FROM {table.name} AS t JOIN jobs USING (job) ORDER BY jobs.number, t.rowid"
            )
            flags = [column.kind == "bool" for column in table.columns]
            if not any(flags):
                return iter(found)
            return (
                tuple(bool(cell) if flag else cell for cell, flag in zip(row, flags, strict=True))
                for row in found
            )

        try:
            yield rows
        except sqlite3.Error as error:
            raise PicktreeError(f"{path}: the results cannot be read: {error}") from None


def _connection(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)


def _error_words(error: Exception) -> str:
    """Return the error's text, with the nearest valid name for an unknown table or column."""
    said = str(error)
    missing, _, name = said.partition(": ")
    match missing:
        case "no such table":
            known = [*(table.name for table in TABLES), *(view.name for view in VIEWS)]
            return f"{said} ({suggest_name(name, known)})"
        case "no such column":
            columns = sorted({column.name for table in TABLES for column in table.columns})
            hint = suggest_name(name.rpartition(".")[2], columns)
            return f"{said} ({hint})" if hint.startswith("did") else said  # there are too many to list
        case "attempt to write a readonly database":
            return "it would change the results; a query only reads them"
        case _:
            return said


def _plain(value: object) -> object:
    if isinstance(value, bytes) or (isinstance(value, float) and not math.isfinite(value)):
        return str(value)
    return value


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
