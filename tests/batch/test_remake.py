"""A job whose log was dropped is run again from its row."""

from __future__ import annotations

import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from picktree.apps.batch import RESULTS_FILE, Batch, BatchPlan, Executor, Store, rerun_job
from picktree.apps.cli import answer
from picktree.files import PicktreeError

from .trouble import troubled
from .watching import Remembering

ONE_PICK = Path(__file__).parents[2] / "examples/one_pick.yaml"


@pytest.fixture(scope="module")
def dropped(tmp_path_factory: pytest.TempPathFactory, worker: Executor) -> Path:
    """A batch of two recipes with two seeds each, the last job not run, that keeps no log."""
    folder = tmp_path_factory.mktemp("dropped")
    mission = folder / "mission.yaml"
    shutil.copy(ONE_PICK, mission)
    plan = BatchPlan(
        "two",
        (mission,),
        (3, 4),
        settings={"Grasp.force": ("15 N", "30 N")},
        backend="kinematic",
        keep="none",
    )
    batch = Batch.create(folder / "batch", plan)
    ended = iter(range(4))
    seen = Remembering(at_end=lambda: batch.stop() if next(ended) == 2 else None)
    with batch:
        assert not batch.run(worker, seen)
    mission.unlink()
    return folder / "batch"


@pytest.fixture
def batch(dropped: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(dropped, tmp_path / "ba@tch"))


def row(batch: Path, number: int, columns: str = "folder") -> tuple[object, ...]:
    with Store(batch / RESULTS_FILE) as store:
        return store.query(f"SELECT {columns} FROM jobs WHERE number = {number}").rows[0]


@pytest.mark.usefixtures("no_other_workers")
def test_its_log_goes_where_the_batch_would_have_kept_it(
    batch: Path, worker: Executor, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not list(batch.glob("jobs/*/*"))
    job, digest = row(batch, 1, "job, digest")
    assert answer(["resim", f"{batch}@15 N,seed=4"]) == 0
    (folder,) = row(batch, 1)
    assert (batch / str(folder) / "log.mcap").is_file()
    assert capsys.readouterr().out == (
        f"job         {job}: seed 4, Grasp.force=15 N\n"
        f"identical   success, digest {str(digest)[:16]} as recorded\n"
        f"log         {batch / str(folder)}\n"
    )
    assert not list(batch.glob("jobs/.*"))
    again = rerun_job(f"{batch}@{str(job)[:6]}", executor=worker)
    assert (again.identical, again.kept_before, again.log) == (True, True, batch / str(folder))
    assert len(list(batch.glob("jobs/*/*"))) == 1


@pytest.mark.usefixtures("no_other_workers")
def test_commands_of_a_run_take_a_job_whose_log_is_kept(
    batch: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    where = f"{batch}@15 N,seed=4"
    assert answer(["explain", where]) == 2
    assert capsys.readouterr().err == (
        f"{where}: the batch keeps no log of this job (success); `picktree resim {where}` makes it\n"
    )
    assert answer(["resim", where]) == 0
    capsys.readouterr()
    assert answer(["explain", where]) == 0
    assert "success: " in capsys.readouterr().out
    assert answer(["diff", where, str(batch / str(row(batch, 1)[0]))]) == 0
    capsys.readouterr()
    assert answer(["explain", f"{batch}@30 N,seed=4"]) == 2
    assert "this job was not run yet" in capsys.readouterr().err
    assert answer(["replay", f"{batch}@seed=9"]) == 2
    assert "no job has the seed 9" in capsys.readouterr().err
    assert answer(["report", str(batch), "-o", str(batch / "page.html")]) == 2
    assert f"it is a batch: name one of its jobs, as {batch}@seed=0" in capsys.readouterr().err


def test_another_run_than_the_recorded_one_is_not_taken_for_it(batch: Path, worker: Executor) -> None:
    with (
        closing(sqlite3.connect(batch / RESULTS_FILE)) as results,
        results,
    ):  # as if another machine had run it
        results.execute("UPDATE jobs SET digest = 'of another run' WHERE number = 0")
        results.execute("UPDATE versions SET version = '0.1' WHERE library = 'numpy'")
    found = rerun_job(f"{batch}@15 N,seed=3", executor=worker)
    told = found.to_text().splitlines()
    assert told[1:3] == ["different", "  recorded  success, digest of another run"]
    assert told[4].startswith("likely why  numpy: recorded 0.1, now ")
    assert row(batch, 0) == ("",)
    (kept,) = batch.glob("jobs/*/*/log.mcap")
    assert told[-1] == f"log         {kept.parent}"


@pytest.mark.parametrize(
    ("named", "message"),
    [
        ("30 N,seed=4", "this job was not run yet; picktree batch run --resume {batch}"),
        ("seed=9", "no job has the seed 9; 2 seeds from 3 to 4"),
        ("seed=3", "name one recipe as {batch}@LABEL,seed=3 (one of Grasp.force=15 N; Grasp.force=30 N)"),
        ("zz", "there is no such job; name it as a job's id or its beginning, seed=7, or LABEL,seed=7"),
        ("", "there is no such job; name it as a job's id or its beginning, seed=7, or LABEL,seed=7"),
    ],
)
def test_what_names_no_job_that_was_run_is_refused(dropped: Path, named: str, message: str) -> None:
    where = f"{dropped}@{named}"
    with pytest.raises(PicktreeError) as refused:
        rerun_job(where)
    assert str(refused.value) == f"{where}: {message.format(batch=dropped)}"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["{batch}@15 N,seed=3", "--seed", "5"],
            "a job of a batch is run again without changes: for changes, first get its log by "
            "resim {batch}@15 N,seed=3, then give that log\n",
        ),
        (["{batch}"], "{batch} is a batch: name one of its jobs, as {batch}@seed=7\n"),
    ],
)
def test_a_job_is_named_and_not_changed(
    dropped: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answer(["resim", *(word.format(batch=dropped) for word in words)]) == 2
    assert capsys.readouterr().err == said.format(batch=dropped)


def test_a_recipe_that_is_damaged_is_not_run(batch: Path, worker: Executor) -> None:
    (recipe,) = {path for path in batch.glob("recipes/*.zip") if path.stem == row(batch, 0, "recipe")[0]}
    recipe.write_bytes(recipe.read_bytes()[:-200])
    with pytest.raises(PicktreeError) as refused:
        rerun_job(f"{batch}@15 N,seed=3", executor=worker)
    assert str(refused.value) == (
        f"{batch}@15 N,seed=3: {recipe}: not a recipe of a batch, or a damaged recipe"
    )


def test_a_job_that_crashed_shows_how_it_crashes_in_a_folder_of_its_own(
    tmp_path: Path, worker: Executor
) -> None:
    mission = troubled(tmp_path, {1: "os._exit(7)"})
    plan = BatchPlan("trouble", (mission,), (1,), backend="kinematic", keep="none")
    with Batch.create(tmp_path / "batch", plan) as batch:
        assert batch.run(worker, Remembering())
    found = rerun_job(f"{tmp_path}/batch@seed=1", tmp_path / "out", worker)
    assert (found.identical, found.recorded_status, found.status) == (False, "crashed", "crashed")
    (run,) = (tmp_path / "out").iterdir()
    assert (found.log, (run / "log.mcap").is_file()) == (run, True)
    said = json.loads(found.to_json_text())
    assert (said["identical"], said["seed"], said["log"]) == (False, 1, str(run))
    assert row(tmp_path / "batch", 0) == ("",)
    assert f"crashed     {found.message}" in found.to_text()
    assert "exit code 7" in found.message
