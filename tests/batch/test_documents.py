"""docs/batches.md tells of every table and view, and of all their columns."""

from __future__ import annotations

import re
import sqlite3
from pathlib import Path

import pytest

from picktree.apps.batch.tables import TABLES, VIEWS, SqlView, TableOf, schema

PAGE = (Path(__file__).parents[2] / "docs" / "batches.md").read_text()
ROWS = {row[1]: re.findall(r"`(\w+)`", row[2]) for row in re.finditer(r"^\| `(\w+)` \| (.*) \|$", PAGE, re.M)}


def columns(name: str) -> list[str]:
    """As a database of today has them."""
    with sqlite3.connect(":memory:") as connection:
        connection.executescript(schema())
        return [column[0] for column in connection.execute(f"SELECT * FROM {name}").description]


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.name)
def test_a_table_has_the_columns_that_are_declared_and_told_of(table: TableOf) -> None:
    assert columns(table.name) == [column.name for column in table.columns]
    told = ROWS[table.name] if table.name == "jobs" else ["job", *ROWS[table.name]]
    assert told == columns(table.name)
    assert f"| `{table.name}` | {table.meaning}: " in PAGE


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.name)
def test_a_view_has_the_columns_that_are_told_of(view: SqlView) -> None:
    assert ROWS[view.name] == columns(view.name)
    assert f"| `{view.name}` | {view.question[0].upper()}{view.question[1:]} " in PAGE


def test_the_page_tells_of_nothing_else() -> None:
    assert set(ROWS) == {*(table.name for table in TABLES), *(view.name for view in VIEWS)}


def test_its_pictures_are_there() -> None:
    for name in re.findall(r"\]\(([\w-]+\.png)\)", PAGE):
        assert (Path(__file__).parents[2] / "docs" / name).is_file(), name
