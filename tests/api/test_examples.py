"""docs/python.md, the programs of examples/python and the notebook run as they stand."""

from __future__ import annotations

import re
import runpy
import shutil
from pathlib import Path

import pytest

from ..rooms import ROOT
from .notebook import code_cells, execute

NOTEBOOK = ROOT / "examples" / "python.ipynb"
PROGRAMS = sorted((ROOT / "examples" / "python").glob("*.py"))


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_there_are_ten_programs() -> None:
    assert len(PROGRAMS) == 10


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda file: file.stem)
def test_program(program: Path, capsys: pytest.CaptureFixture[str], empty_folder: Path) -> None:
    runpy.run_path(str(program), run_name="__main__")
    printed = capsys.readouterr().out
    assert printed or {file.suffix for file in empty_folder.iterdir()} == {".png"}


def test_document(empty_folder: Path) -> None:
    shutil.copytree(ROOT / "examples" / "plugins", empty_folder / "plugins")
    text = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 17
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "docs/python.md", "exec"), names)
    written = {file.name for file in empty_folder.iterdir()}
    assert {"top.png", "moment.png", "sort.yaml", "sort.svg", "forces", "runs"} <= written


def test_sample_of_the_readme(capsys: pytest.CaptureFixture[str]) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (sample,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    exec(compile(sample, "README.md", "exec"), {})
    assert capsys.readouterr().out.startswith("Grasp: SUCCESS after ")


def test_notebook() -> None:
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code_cells(NOTEBOOK))
    shown = execute(NOTEBOOK)
    assert [form for forms in shown for form in forms] == [
        "_repr_html_", "_repr_html_", "_repr_png_", "_repr_png_", "_repr_svg_",
        "_repr_html_", "_repr_html_", "_repr_html_", "_repr_png_", "_repr_html_",
    ]  # fmt: skip
