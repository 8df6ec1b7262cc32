"""picktree layout"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from picktree.apps.cli import answer

GOLDEN = Path(__file__).parents[1] / "logs" / "golden" / "format-2.mcap"


def test_a_layout_is_printed_or_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["layout", str(GOLDEN)]) == 0
    printed = capsys.readouterr().out
    file = tmp_path / "layout.json"
    assert answer(["layout", str(GOLDEN), "-o", str(file)]) == 0
    assert file.read_text(encoding="utf-8") == printed
    assert capsys.readouterr().out == f"{file}: 19 panels, 4 lanes\n"
    assert set(json.loads(printed)) == {
        "configById",
        "globalVariables",
        "layout",
        "playbackConfig",
        "userNodes",
    }


def test_what_is_no_log_and_what_cannot_be_written_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answer(["layout", str(tmp_path / "none.mcap")]) == 2
    assert capsys.readouterr().err == f"{tmp_path}/none.mcap: there is no such log\n"
    assert answer(["layout", str(GOLDEN), "-o", str(tmp_path / "nowhere" / "l.json")]) == 2
    assert capsys.readouterr().err == (
        f"{tmp_path}/nowhere/l.json cannot be written: no such file or directory\n"
    )
