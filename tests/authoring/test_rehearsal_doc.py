"""The page on rehearsals: its case passes, and prints what the page shows."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from picktree.authoring.rehearsal import rehearse_files
from picktree.authoring.rehearsal.cases import Expectation, LeafAnswer
from picktree.authoring.rehearsal.rehearsal import to_text
from picktree.files.yaml import file_models

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "rehearsal.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    found = re.search(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert found is not None
    return found[1]


def test_its_case_passes_and_prints_what_it_shows(tmp_path: Path) -> None:
    shutil.copy(ROOT / "examples" / "sort_by_colour.yaml", tmp_path)
    (tmp_path / "cases.yaml").write_text(block("yaml"), encoding="utf-8")
    rehearsal = rehearse_files(tmp_path / "sort_by_colour.yaml", tmp_path / "cases.yaml")
    assert rehearsal.passed
    assert to_text(rehearsal).startswith(block("text") + "\ncoverage ")


def test_its_python_runs() -> None:
    names: dict[str, object] = {"Path": lambda name: ROOT / "examples" / name}
    exec(block("python"), names)
    assert "rehearsal" in names


def test_it_names_all_that_may_be_expected_and_answered() -> None:
    expected = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \| ", PAGE, re.MULTILINE)
    assert set(re.findall(r"\w+", " ".join(expected))) == set(file_models.keys_of(Expectation))
    assert [name for name in file_models.keys_of(LeafAnswer) if f"`{name}`" not in PAGE] == []
