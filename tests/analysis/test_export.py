"""Tables of a run: the same rows in CSV and in Parquet, and all of what the log says."""

from __future__ import annotations

import csv
import dataclasses
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import pytest
from pyarrow import csv as arrow_csv
from pyarrow import parquet

from picktree.analysis import Run
from picktree.analysis.export import columns, export
from picktree.analysis.export.run_tables import TABLES, TableSpec
from picktree.analysis.export.table_files import ColumnDoc, cells, write_csv, write_parquet
from picktree.files import PicktreeError
from picktree.logs import install_command


@pytest.fixture(scope="module")
def run(troubled_log: Path) -> Iterator[Run]:
    with Run(troubled_log) as opened:
        yield opened


@pytest.fixture(scope="module")
def folders(run: Run, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    out = tmp_path_factory.mktemp("tables")
    for form in ("csv", "parquet"):
        export(run, form, out / form)
    return {form: out / form for form in ("csv", "parquet")}


def read_csv(path: Path, row: type[Any]) -> tuple[Any, ...]:
    """Read the rows of a written file; ' before a formula is taken off again."""
    kinds = {"int": int, "float": float, "bool": {"true": True, "false": False}.__getitem__}
    with path.open(encoding="utf-8", newline="") as file:
        names, *lines = csv.reader(file, strict=True)
    assert names == [column.name for column in columns(row)]

    def cell(text: str, kind: str, optional: bool) -> object:
        if not text and optional:
            return None
        return kinds[kind](text) if kind in kinds else re.sub(r"^'(?='*[=+\-@\t\r])", "", text)

    return tuple(
        row(*(cell(text, c.kind, c.optional) for text, c in zip(line, columns(row), strict=True)))
        for line in lines
    )


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.name)
def test_both_forms_read_back_as_the_rows_of_the_run(
    table: TableSpec[Any], run: Run, folders: dict[str, Path]
) -> None:
    rows = tuple(table.rows(run))
    assert read_csv(folders["csv"] / f"{table.name}.csv", table.row) == rows
    written = parquet.read_table(folders["parquet"] / f"{table.name}.parquet")
    assert tuple(table.row(**row) for row in written.to_pylist()) == rows
    # pyarrow's reader of CSV guesses types, as that of pandas does.
    options = arrow_csv.ParseOptions(newlines_in_values=True)
    read = arrow_csv.read_csv(folders["csv"] / f"{table.name}.csv", parse_options=options)
    for column in table.columns:
        if column.kind in ("int", "float", "bool"):
            assert read.column(column.name).to_pylist() == written.column(column.name).to_pylist()


def test_the_tables_hold_what_the_run_holds(run: Run) -> None:
    counts = {table.name: len(tuple(table.rows(run))) for table in TABLES}
    assert run.result is not None
    assert counts["ticks"] == len(run.ticks) > 100
    assert counts["visits"] == len(run.visits) > 10
    assert counts["picks"] == run.result.picks.tried > 0
    assert counts["plans"] == len(run.plans) > 0
    assert counts["events"] == len(run.events) > 0
    assert counts["failures"] == len(run.failures) > 0
    assert counts["items"] == len(run.explanation.items)
    assert counts["joints"] == len(run.joints.times) * len(run.joints.names)
    assert counts["wrenches"] == len(run.wrenches.times)


def test_a_parquet_column_has_a_type_a_unit_and_a_meaning(folders: dict[str, Path]) -> None:
    schema = parquet.read_table(folders["parquet"] / "picks.parquet").schema
    width, held = schema.field("width"), schema.field("held")
    assert (str(width.type), width.nullable) == ("double", True)
    assert width.metadata == {b"unit": b"m", b"meaning": b"opening after closing"}
    assert (str(held.type), held.nullable) == ("bool", False)


@dataclasses.dataclass(frozen=True)
class Odd:
    text: Annotated[str, ColumnDoc("anything")]
    number: Annotated[float | None, ColumnDoc("may be missing", "m")]
    yes: Annotated[bool | None, ColumnDoc("may be missing")]


ODD = TableSpec("odd", "something odd", Odd, lambda run: ())
TEXTS = (
    "", "plain", 'a "quoted", text\nof two lines', "=1+1", "+49", "-1", "@SUM(A1)", "\tx", "'=1", "''-2",
    "'quoted'", "µm – °",
)  # fmt: skip


def test_odd_texts_survive_and_no_cell_is_a_formula(tmp_path: Path) -> None:
    rows = [
        Odd(text, None if k % 2 else 0.1 + 0.2, None if k % 3 else k % 2 == 0) for k, text in enumerate(TEXTS)
    ]
    assert write_csv(tmp_path / "odd.csv", ODD, map(cells, rows)) == len(rows)
    write_parquet(tmp_path / "odd.parquet", ODD, map(cells, rows))
    assert read_csv(tmp_path / "odd.csv", Odd) == tuple(rows)
    assert [Odd(**row) for row in parquet.read_table(tmp_path / "odd.parquet").to_pylist()] == rows
    assert (tmp_path / "odd.csv").read_bytes().endswith(b"\r\n")
    with (tmp_path / "odd.csv").open(encoding="utf-8", newline="") as file:
        texts = [line[0] for line in csv.reader(file)][1:]
    assert not [text for text in texts if text[:1] in "=+-@\t\r" and text]
    assert texts[3:6] == ["'=1+1", "'+49", "'-1"]


def test_a_log_that_was_cut_is_exported_with_a_note(run: Run, tmp_path: Path) -> None:
    data = run.path.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 3 // 4])
    with Run(tmp_path / "cut.mcap") as cut:
        written = export(cut, "csv", tmp_path / "tables")
        assert written.notes == (cut.recovered,)
    assert 0 < written.rows[tmp_path / "tables" / "ticks.csv"] < len(run.ticks)


def test_what_cannot_be_written_is_one_sentence_and_leaves_nothing(run: Run, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(PicktreeError) as raised:
        export(run, "csv", tmp_path / "file")
    assert str(raised.value) == f"{tmp_path}/file cannot be written: file exists"


def test_an_export_that_stops_half_way_leaves_the_former_files(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    export(run, "csv", tmp_path)
    before = (tmp_path / "run.csv").read_bytes()

    def full(path: Path, table: object, rows: object) -> int:
        path.write_text("half")
        if path.name.endswith("joints.csv"):
            raise OSError(28, "No space left on device")
        return 0

    monkeypatch.setattr("picktree.analysis.export.table_files.write_csv", full)
    with pytest.raises(PicktreeError) as raised:
        export(run, "csv", tmp_path)
    assert str(raised.value) == f"{tmp_path} cannot be written: no space left on device"
    assert (tmp_path / "run.csv").read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(f"{t.name}.csv" for t in TABLES)


def test_without_pyarrow_the_extra_is_named(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(PicktreeError) as raised:
        export(run, "parquet", tmp_path / "out")
    assert (
        str(raised.value) == f"An export to Parquet needs the extra 'parquet': {install_command('parquet')}"
    )
    assert not (tmp_path / "out").exists()
