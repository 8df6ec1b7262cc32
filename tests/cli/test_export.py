"""picktree export"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from picktree.analysis.export.run_tables import TABLES
from picktree.apps.cli import answer

GOLDEN = Path(__file__).parents[1] / "logs" / "golden" / "format-2.mcap"


def test_tables_are_named_with_their_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "tables"
    assert answer(["export", str(GOLDEN), "--to", "csv", "-o", str(folder)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [f"{folder}/{table.name}.csv" for table in TABLES]
    assert lines[1] == f"{folder}/ticks.csv            60 rows"


def test_json_is_one_object(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "tables"
    assert answer(["export", str(GOLDEN), "--to", "parquet", "-o", str(folder), "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert (told["to"], told["output"], told["notes"]) == ("parquet", str(folder), [])
    assert told["tables"]["ticks"] == 60
    assert set(told["tables"]) == {table.name for table in TABLES}


def test_a_recording_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "run.rrd"
    assert answer(["export", str(GOLDEN), "--to", "rerun", "-o", str(file)]) == 0
    assert capsys.readouterr().out == f"{file}\n"
    assert file.read_bytes()[:3] == b"RRF"


def test_another_form_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["export", str(GOLDEN), "--to", "xlsx", "-o", str(tmp_path / "x")]) == 2
    assert "'xlsx' is not one of 'csv', 'parquet', 'rerun'" in capsys.readouterr().err
