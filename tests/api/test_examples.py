"""docs/python.md and the programs of examples/python run as they stand.

The notebook runs from the wheel: tests/test_house_wheel.py.
"""

from __future__ import annotations

import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import picktree as pt
from picktree.apps.batch import local_executor

from ..commands import forked_worker
from ..rooms import ROOT
from .notebook import code_cells

SLOW = {"compare": pytest.mark.slow}
PROGRAMS = sorted((ROOT / "examples" / "python").glob("*.py"))


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_there_are_ten_programs_and_a_notebook_without_output() -> None:
    assert len(PROGRAMS) == 10
    cells = code_cells(ROOT / "examples" / "python.ipynb")
    assert len(cells) == 17
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)


@pytest.mark.parametrize(
    "program", [pytest.param(file, id=file.stem, marks=SLOW.get(file.stem, ())) for file in PROGRAMS]
)
def test_program(program: Path, capsys: pytest.CaptureFixture[str], empty_folder: Path) -> None:
    if program.stem == "compare":  # as a process: its workers must not run the program once more
        printed = subprocess.run([sys.executable, program], capture_output=True, text=True, check=True).stdout
        assert printed.count("2 of 2 jobs run") == 1
    else:
        runpy.run_path(str(program), run_name="__main__")
        printed = capsys.readouterr().out
    assert printed or {file.suffix for file in empty_folder.iterdir()} == {".png"}


def test_document(empty_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its batch has a forked worker; the program `compare` starts one as anybody does."""
    monkeypatch.setattr(local_executor, "_started", forked_worker)
    shutil.copytree(ROOT / "examples" / "plugins", empty_folder / "plugins")
    text = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 18
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "docs/python.md", "exec"), names)
    batch = names["batch"]
    assert isinstance(batch, pt.Batch)
    assert batch.query("SELECT variant, seed, status FROM jobs ORDER BY number").rows == (
        ("Grasp.force=10", 0, "success"), ("Grasp.force=30", 0, "success"),
    )  # fmt: skip
    (compared,) = pt.Batch(empty_folder / "forces").compare()
    assert (compared.label_a, compared.label_b) == ("forces@Grasp.force=10", "forces@Grasp.force=30")
    written = {file.name for file in empty_folder.iterdir()}
    assert {"top.png", "moment.png", "sort.yaml", "sort.svg", "forces", "runs"} <= written


def test_sample_of_the_readme(capsys: pytest.CaptureFixture[str]) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (sample,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    exec(compile(sample, "README.md", "exec"), {})
    assert capsys.readouterr().out.startswith("Grasp: SUCCESS after ")
