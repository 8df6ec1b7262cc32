"""Where the runs of a seed that changed sides part, from kept logs and from logs that are made again."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from picktree.apps.batch import Batch, BatchPlan, Executor, rerun_job
from picktree.apps.cli import answer

from .watching import Remembering

ONE_PICK = Path(__file__).parents[2] / "examples/one_pick.yaml"
SNATCHED = """\
picktree: 1
kind: faults
faults:
  - {fault: remove, when: {node: Grasp, start: 1}, target: {nearest_to: object}}
"""


@pytest.fixture(scope="module")
def failures_kept(tmp_path_factory: pytest.TempPathFactory, worker: Executor) -> Path:
    """One pick as it should be, and with the item snatched away, on two seeds; the latter's logs are kept."""
    folder = tmp_path_factory.mktemp("two")
    faults = folder / "snatched.yaml"
    faults.write_text(SNATCHED)
    plan = BatchPlan("two", (ONE_PICK,), (0, 1), faults=(None, faults), backend="kinematic")
    with Batch.create(folder / "batch", plan) as batch:
        assert batch.run(worker, Remembering())
    return folder / "batch"


def compared(batch: Path, capfd: pytest.CaptureFixture[str], *options: str) -> str:
    assert answer(["batch", "compare", f"{batch}@no faults", f"{batch}@snatched", *options]) == 0
    return capfd.readouterr().out


def test_logs_that_were_not_kept_are_asked_for(
    failures_kept: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    told = compared(failures_kept, capfd).splitlines()
    assert told[-3:] == [
        "  seed 0: only A reached its goal",
        "  seed 1: only A reached its goal",
        "seeds without a log: 2; --remake runs them again and shows where they diverge",
    ]


@pytest.mark.usefixtures("no_other_workers")
def test_logs_are_made_again_for_the_first_of_them_and_dropped(
    failures_kept: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    before = sorted(failures_kept.rglob("*.mcap"))
    told = compared(failures_kept, capfd, "--remake", "--partings", "1", "--json")
    first, second = json.loads(told)["changed"]
    assert re.fullmatch(
        r"the runs diverge at tick \d+, \d+\.\d\d s: Grasp \(.+\) ends differently: "
        r"A SUCCESS after \d+\.\d\d s, B grasp\.\w+ after \d+\.\d\d s",
        first["parting"],
    ), first["parting"]
    assert (second["parting"], second["missing"]) == ("", ["A"])
    assert sorted(failures_kept.rglob("*.mcap")) == before


def test_logs_that_are_there_are_compared_as_they_are(
    failures_kept: Path, tmp_path: Path, worker: Executor, capfd: pytest.CaptureFixture[str]
) -> None:
    batch = Path(shutil.copytree(failures_kept, tmp_path / "batch"))
    assert rerun_job(f"{batch}@no faults,seed=1", executor=worker).identical
    told = compared(batch, capfd).splitlines()
    assert told[-4] == "  seed 0: only A reached its goal"
    assert re.match(r"  seed 1: only A reached its goal; the runs diverge at tick \d+, ", told[-3])
    assert re.match(r"    \S.* diff .*/batch/jobs/.* .*/batch/jobs/", told[-2])
    assert told[-1].startswith("seeds without a log: 1; ")
