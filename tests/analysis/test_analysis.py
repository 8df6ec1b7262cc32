"""docs/analysis.md, the script and the notebook, as their reader runs them: one after another, on one run."""

# pyright: reportUnknownMemberType=false

from __future__ import annotations

import json
import re
import runpy
import sys
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.logs.recording import decode_colour
from picktree.session import RunRequest, Session

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "analysis"
PAGE = (ROOT / "docs" / "analysis.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the command of the page was typed: `last` means its run there."""
    folder = tmp_path_factory.mktemp("reader")
    request = RunRequest(
        mission=ROOT / "examples" / "sort_by_colour.yaml",
        scene="sort_small",
        backend="kinematic",
        faults=EXAMPLE / "faults.yaml",
        out=folder / "runs",
    )
    Session(request).run()
    return folder


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def test_the_run_of_the_page_fails_as_it_says(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    assert "--scene sort_small --backend kinematic" in blocks("sh")[0]
    with Run("last") as run:
        assert run.result is not None and not run.result.reached
        assert {"grasp.missed", "grasp.slipped"} <= {failure.cause for failure in run.failures}


def test_the_code_of_the_page_runs_and_prints_what_its_comments_say(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    names: dict[str, object] = {}
    code = blocks("python")
    assert len(code) == 8 and sum(text.count("# <") for text in code) == 3
    for text in code:
        exec(text, names)
        said = capsys.readouterr().out
        assert said or "print" not in text
        for promised in re.findall(r"^print\([\w.]+\) +# (<.*>)$", text, re.MULTILINE):
            pattern = re.escape(promised).replace("…", ".*").replace(r"\ .*\ ", " … ")
            assert re.search(pattern, said), promised
    run = names["run"]
    assert isinstance(run, Run)
    run.close()
    assert names["running"] == [
        "Main",
        "Repeat",
        "Sequence",
        "ForEach",
        "SortOne",
        "Recover",
        "Sequence",
        "Grasp",
    ]
    assert len(names["planted"]) == 2  # pyright: ignore[reportArgumentType]


def test_every_attribute_that_the_page_names_is_there(folder: Path) -> None:
    with Run(folder / "runs" / next((folder / "runs").iterdir()).name) as run:
        for name in re.findall(r"`run\.(\w+)", PAGE):
            assert hasattr(run, name), name


def test_the_timeline_is_drawn(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", ["timeline.py", "last", "-o", "timeline.png"])
    runpy.run_path(str(EXAMPLE / "timeline.py"), run_name="__main__")
    assert capsys.readouterr().out == "timeline.png\n"
    picture = decode_colour((folder / "timeline.png").read_bytes()).astype(int)
    assert picture.shape[1] == 1430
    red = (picture[:, :, 0] > 180) & (picture[:, :, 1] < 80) & (picture[:, :, 2] < 60)
    blue = (picture[:, :, 2] > 150) & (picture[:, :, 0] < 90)
    assert red.sum() > 3000 and blue.sum() > 30_000


def test_the_notebook_runs_and_holds_no_output(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import matplotlib

    monkeypatch.chdir(folder)
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    notebook = json.loads((EXAMPLE / "run.ipynb").read_text(encoding="utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert len(cells) == 5
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
    names: dict[str, object] = {}
    for cell in cells:
        exec("".join(cell["source"]), names)
    assert [len(plt.figure(number).axes) for number in plt.get_fignums()] == [2, 2, 1]
    plt.close("all")
    run = names["run"]
    assert isinstance(run, Run)
    run.close()
