"""picktree layout"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from picktree.apps.cli import answer


def test_a_layout_is_printed_or_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["layout"]) == 0
    printed = capsys.readouterr().out
    file = tmp_path / "layout.json"
    assert answer(["layout", "last", "-o", str(file)]) == 0
    assert file.read_text(encoding="utf-8") == printed
    assert capsys.readouterr().out == f"{file}: open it in Lichtblick or Foxglove beside the log\n"
    assert set(json.loads(printed)) == {
        "configById",
        "globalVariables",
        "layout",
        "playbackConfig",
        "userNodes",
    }


def test_a_file_that_cannot_be_written_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answer(["layout", "-o", str(tmp_path / "nowhere" / "l.json")]) == 2
    assert capsys.readouterr().err == (
        f"{tmp_path}/nowhere/l.json cannot be written: no such file or directory\n"
    )
