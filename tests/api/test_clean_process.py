"""numpy before picktree: runs and batches are those of any process, and a cell's log names the difference."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import picktree as pt
from picktree.analysis import Run
from picktree.apps.api.runs import in_clean_process
from picktree.files import FileError, arithmetic
from picktree.logs import RunResult

PROGRAM = """
import json, warnings
import numpy
import picktree as pt

with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    tree = pt.Sequence(pt.Observe(camera="overhead"))
    found = {
        "made": pt.run(tree, scene="sort_small", backend="kinematic").digest,
        "batch": pt.batch("one_pick", seeds=[0], backend="kinematic", workers=1, out="batch")
        .query("SELECT digest FROM jobs").rows[0][0],
    }
    found["warnings of runs"] = [str(each.message) for each in said]
    for _ in range(2):
        with pt.Cell("sort_small", backend="kinematic") as cell:
            found["log"] = str(cell.run(pt.Observe(camera="overhead"), log="cells").log)
    found["warnings"] = [str(each.message)[:35] for each in said]
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a script without a guard for `__main__` gets that imports numpy first, with other kernels."""
    folder = tmp_path_factory.mktemp("late")
    (folder / "script.py").write_text(PROGRAM, encoding="utf-8")
    clean = {k: v for k, v in os.environ.items() if k not in arithmetic.PINNED}
    ran = subprocess.run(
        [sys.executable, "script.py"], cwd=folder, env={**clean, "OPENBLAS_CORETYPE": "Sandybridge"},
        capture_output=True, text=True,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout.splitlines()[-1])


def test_runs_and_batches_are_those_of_any_process(
    late: dict[str, Any], picked: RunResult, tmp_path: Path
) -> None:
    tree = pt.Sequence(pt.Observe(camera="overhead"))
    made = pt.run(tree, scene="sort_small", backend="kinematic", out=tmp_path)
    assert (late["made"], late["batch"]) == (made.digest, picked.digest)
    assert late["warnings of runs"] == []


def test_a_cell_warns_once_and_its_log_names_the_reason(late: dict[str, Any]) -> None:
    assert late["warnings"] == ["numpy was imported before picktree "]
    with Run(late["log"]) as run:
        assert run.info.arithmetic.departures == {"numpy": "imported before picktree"}


def test_faults_come_from_the_other_process_as_they_are(tmp_path: Path) -> None:
    file = tmp_path / "m.yaml"
    file.write_text("picktree: 1\nkind: mission\ntrees:\n  Main: Graps\n", encoding="utf-8")
    with pytest.raises(FileError) as there:
        in_clean_process(_checked, str(file))
    with pytest.raises(FileError) as here:
        _checked(str(file))
    assert there.value.faults == here.value.faults


def test_a_process_that_ends_without_a_result_is_an_error() -> None:
    with pytest.raises(
        pt.PicktreeError, match=r"^the process of the run ended with exit code 3 without a result$"
    ):
        in_clean_process(os._exit, 3)


def _checked(file: str) -> None:
    pt.load(file).checked()
