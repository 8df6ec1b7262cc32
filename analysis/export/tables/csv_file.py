"""CSV file of a table: RFC 4180, UTF-8, a first line with the columns' names, CRLF, text quoted where needed.

An empty cell is a missing value or an empty text. Numbers are written so that they read back unchanged.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

from .row_types import Cell, TableSpec, cells

R = TypeVar("R")

_FORMULA_START = re.compile(r"'*[=+\-@\t\r]")
"""Beginnings of text that a spreadsheet takes as a formula, which could run a program, unless ' precedes."""


def write_csv(path: Path, table: TableSpec[R], rows: Iterable[R]) -> int:
    """Write the rows and return their number. Raises OSError when the disk refuses."""
    count = 0
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\r\n")
        writer.writerow([column.name for column in table.columns])
        for row in rows:
            writer.writerow([cell_text(cell) for cell in cells(row)])
            count += 1
    return count


def read_csv(path: Path, table: TableSpec[R]) -> tuple[R, ...]:
    """Read a file of `write_csv`. Raises ValueError for another file."""
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.reader(file, strict=True)
        names = next(reader, list[str]())
        if names != [column.name for column in table.columns]:
            raise ValueError(f"{path}: the columns are {', '.join(names)}")
        kinds = [(column.kind, column.optional) for column in table.columns]
        return tuple(
            table.row(
                *(_read(text, kind, optional) for text, (kind, optional) in zip(line, kinds, strict=True))
            )
            for line in reader
        )


def cell_text(cell: Cell) -> str:
    match cell:
        case None:
            return ""
        case bool():
            return "true" if cell else "false"
        case str():
            return f"'{cell}" if _FORMULA_START.match(cell) else cell
        case _:
            return repr(cell)


def _read(text: str, kind: str, optional: bool) -> Cell:
    if text == "" and optional:
        return None
    match kind:
        case "int":
            return int(text)
        case "float":
            return float(text)
        case "bool":
            return {"true": True, "false": False}[text]
        case _:
            return text[1:] if text.startswith("'") and _FORMULA_START.match(text) else text
