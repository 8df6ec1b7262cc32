"""Profile of a run: the functions that take its time, in a file and as tables."""

from __future__ import annotations

import json
import pstats
from pathlib import Path

import pytest

from picktree.apps.cli import answer

from ..commands import call

MISSION = Path(__file__).parents[1] / "golden" / "one_item.yaml"


def test_a_profile_has_the_functions_of_the_run_and_leaves_its_digest(tmp_path: Path) -> None:
    file = tmp_path / "run.prof"
    line = ["run", str(MISSION), "--backend", "kinematic", "--out", str(tmp_path / "runs"), "--json"]
    digest = json.loads(call(line).stdout)["digest"]
    profiled = call([*line, "--profile", str(file)])
    assert json.loads(profiled.stdout)["digest"] == digest
    functions = {name for _, _, name in pstats.Stats(str(file)).stats}  # type: ignore[attr-defined]
    assert {"pass_time", "step_tick"} <= functions
    own, cumulative = profiled.stderr.split("Ordered by: internal time")[1].split(
        "Ordered by: cumulative time"
    )
    assert "{built-in method" in own
    assert "session.py:" in cumulative and "(run)" in cumulative


@pytest.mark.parametrize(
    ("file", "reason"), [("gone/run.json", "there is no folder {}/gone"), (".", "it is a folder")]
)
def test_a_file_that_cannot_be_written_is_refused_before_the_run(
    file: str, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["run", str(MISSION), "--out", str(tmp_path / "runs"), "--profile", str(tmp_path / file)]
    assert answer(line) == 2
    expected = f"{tmp_path / file}: the profile cannot be written: {reason.format(tmp_path)}\n"
    assert capsys.readouterr().err == expected
    assert not (tmp_path / "runs").exists()
