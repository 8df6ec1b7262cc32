"""docs/planning.md: its example runs, and the causes that it lists are those that there are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from picktree.world import all_causes

PAGE = Path(__file__).parents[2] / "docs/planning.md"


def test_the_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    text = PAGE.read_text(encoding="utf-8")
    code = text.split("<!-- A test runs this")[1].split("```python\n")[1].split("```")[0]
    exec(compile(code, str(PAGE), "exec"), {})
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("direct ")
    assert second.startswith("planning.no_path only ")
    assert "table" in second


def test_the_table_of_failures_lists_every_cause() -> None:
    listed = set(re.findall(r"^\| `(planning\.\w+)`", PAGE.read_text(encoding="utf-8"), re.MULTILINE))
    assert listed == {cause.name for cause in all_causes() if cause.name.startswith("planning.")}
