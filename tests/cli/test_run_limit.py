"""run --limit: how much simulated time a run may take."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.apps.cli import answer

MISSION = str(Path(__file__).parents[2] / "examples" / "one_pick.yaml")


def test_a_run_ends_at_its_limit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = ["run", MISSION, "--backend", "kinematic", "--out", str(tmp_path), "--limit", "1500 ms"]
    assert answer(line) == 1
    shown = capsys.readouterr().out
    assert "timeout: the run was ended at its limit of simulated time" in shown
    assert "simulated   1.5 s" in shown


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("3 parsecs", "--limit 3 parsecs: '3 parsecs': unknown unit 'parsecs' (s, ms, us, min, h)"),
        ("0 s", "--limit 0 s: write a time above 0, as in --limit '90 min'"),
    ],
)
def test_what_is_no_limit(text: str, fault: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["run", MISSION, "--out", str(tmp_path), "--limit", text]) == 2
    assert capsys.readouterr().err == f"{fault}\n"
    assert list(tmp_path.iterdir()) == []
