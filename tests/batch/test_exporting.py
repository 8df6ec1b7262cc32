"""Exports hold what the tables hold, typed."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from pyarrow import parquet

from picktree.apps.batch import Store, export
from picktree.apps.batch.tables import TABLES, JobPickRow, JobRows
from picktree.apps.cli import answer
from picktree.files import PicktreeError
from picktree.logs import install_command

from .test_store import ITEMS, SUCCESS, store

PICKS = (JobPickRow(1.5, "can_1", True, "Main/Grasp"), JobPickRow(0.5, "=can_2", False, "Main/Grasp"))


@pytest.fixture
def results(tmp_path: Path) -> Store:
    """One job of ten was run."""
    made = store(tmp_path / "b", {})
    made.record(f"{3:016x}", JobRows(SUCCESS, items=ITEMS, picks=PICKS, versions={"numpy": "2.0"}))
    return made


def test_parquet_has_the_types_units_and_values_of_the_tables(results: Store, tmp_path: Path) -> None:
    with results:
        written = export(results, "parquet", tmp_path / "out")
    filled = {path.stem: count for path, count in written.rows.items() if count}
    assert filled == {"jobs": 10, "items": 2, "picks": 2, "versions": 1}
    for table in TABLES:
        read = parquet.read_table(tmp_path / "out" / f"{table.name}.parquet")
        assert read.schema.names == [column.name for column in table.columns]
    picks: Any = parquet.read_table(tmp_path / "out" / "picks.parquet")
    assert picks.schema.field("held").type == pa.bool_()
    assert picks.schema.field("time").type == pa.float64()
    assert picks.schema.field("time").metadata[b"unit"] == b"s"
    assert picks["held"].to_pylist() == [True, False]
    assert picks["object"].to_pylist() == ["can_1", "=can_2"]
    jobs: Any = parquet.read_table(tmp_path / "out" / "jobs.parquet")
    assert jobs["seed"].to_pylist() == list(range(10))
    assert jobs["sim_seconds"].to_pylist() == [None] * 3 + [10.0] + [None] * 6


def test_csv_says_the_same_and_holds_no_formula(results: Store, tmp_path: Path) -> None:
    with results:
        export(results, "csv", tmp_path / "out")
    with (tmp_path / "out" / "picks.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows == [
        ["job", "time", "object", "held", "node"],
        [f"{3:016x}", "1.5", "can_1", "true", "Main/Grasp"],
        [f"{3:016x}", "0.5", "'=can_2", "false", "Main/Grasp"],
    ]


def test_nothing_is_left_of_an_export_that_fails(results: Store, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with results, pytest.raises(PicktreeError) as refused:
        export(results, "csv", tmp_path / "out")
    assert str(refused.value) == f"{tmp_path}/out cannot be written: file exists"
    (tmp_path / "out").unlink()
    (tmp_path / "out" / "versions.csv").mkdir(parents=True)
    with (
        pytest.raises(PicktreeError, match=r"versions\.csv cannot be written: it is a folder"),
        Store(tmp_path / "b" / "results.sqlite") as again,
    ):
        export(again, "csv", tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["versions.csv"]


def test_parquet_needs_its_extra(results: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with results, pytest.raises(PicktreeError) as refused:
        export(results, "parquet", tmp_path / "out")
    assert (
        str(refused.value) == f"An export to Parquet needs the extra 'parquet': {install_command('parquet')}"
    )


def test_it_is_typed_so(results: Store, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results.close()
    out = tmp_path / "out"
    assert answer(["batch", "export", str(tmp_path / "b"), "--to", "csv", "-o", str(out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["to"], said["output"], said["tables"]["items"]) == ("csv", str(out), 2)
    assert answer(["batch", "export", str(tmp_path), "--to", "csv", "-o", str(out)]) == 2
    assert capsys.readouterr().err == f"{tmp_path}: not a batch: there is no results.sqlite in this folder\n"
