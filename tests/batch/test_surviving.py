"""A batch that is cut short, or finds no room, loses nothing and leaves nothing behind."""

from __future__ import annotations

import resource
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

from picktree.apps.batch import RESULTS_FILE, Batch, BatchPlan, Executor, Keep, Store
from picktree.apps.batch import batch as module
from picktree.files import PicktreeError

from .trouble import troubled
from .watching import Remembering

ONCE = """\
if not (HERE / "tried").exists():
    (HERE / "tried").touch()
    os.abort()
"""


@pytest.mark.parametrize("keep", ["all", "failures", "none"])
def test_a_lost_first_try_stays_beside_the_second_unless_no_log_is_kept(
    tmp_path: Path, worker: Executor, keep: Keep
) -> None:
    mission = troubled(tmp_path, {1: ONCE})
    folder = tmp_path / "batch"
    with Batch.create(folder, BatchPlan("once", (mission,), (1,), backend="kinematic", keep=keep)) as batch:
        assert batch.run(worker, Remembering())
        (job,) = batch.store.query("SELECT job, status, attempts, folder FROM jobs").rows
        (lost,) = batch.store.query("SELECT job, attempt, reason, folder FROM crashes").rows
    assert job[1:3] == ("success", 2)
    assert lost[:3] == (job[0], 1, "its process was ended by SIGABRT, at trouble.py:26 in trouble_1")
    kept = {str(log.parent.relative_to(folder)) for log in folder.glob("jobs/*/*/log.mcap")}
    assert kept == {where for where in (job[3], lost[3]) if where}
    assert len(kept) == {"all": 2, "failures": 1, "none": 0}[keep]
    assert {path.name for path in folder.glob("jobs/*")} == {Path(where).parent.name for where in kept}


def test_a_job_that_crashed_is_begun_anew_by_resume(tmp_path: Path, worker: Executor) -> None:
    mission = troubled(tmp_path, {1: 'if not (HERE / "mended").exists(): os.abort()'})
    folder = tmp_path / "batch"
    with Batch.create(folder, BatchPlan("twice", (mission,), (1,), backend="kinematic")) as batch:
        assert batch.run(worker, Remembering())
        assert batch.store.query("SELECT status, attempts FROM jobs").rows == (("crashed", 2),)
        assert len(list(folder.glob("jobs/*/*/log.mcap"))) == 2
    (tmp_path / "mended").touch()
    with Batch.resume(folder) as batch:
        assert batch.run(worker, Remembering())
        assert batch.store.query("SELECT status, attempts FROM jobs").rows == (("success", 1),)
        assert batch.store.query("SELECT * FROM crashes").rows == ()
    assert list(folder.glob("jobs/*")) == []


def test_the_count_of_tries_survives_the_batch(tmp_path: Path, worker: Executor) -> None:
    mission = troubled(tmp_path, {1: "os.abort()"})
    folder = tmp_path / "batch"
    batch = Batch.create(folder, BatchPlan("lost", (mission,), (1,), backend="kinematic"))
    seen = Remembering(at_again=batch.stop)
    with batch:
        assert not batch.run(worker, seen)
        assert batch.store.query("SELECT status FROM jobs").rows == (("waiting",),)
    with Batch.resume(folder) as batch:
        assert batch.run(worker, seen)
        assert batch.store.query("SELECT status, attempts FROM jobs").rows == (("crashed", 2),)
    assert len(seen.again) == 1


def test_a_full_disk_stops_the_batch_and_costs_no_job_a_try(
    tmp_path: Path, worker: Executor, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "batch"
    plan = BatchPlan("full", (troubled(tmp_path, {1: "os.abort()"}),), (0, 1, 2), backend="kinematic")

    def has(free: int) -> None:
        def usage(path: Path) -> SimpleNamespace:
            return SimpleNamespace(free=free)

        monkeypatch.setattr(module.shutil, "disk_usage", usage)

    def fills_up() -> None:
        has(199_999_999)

    with Batch.create(folder, plan) as batch, pytest.raises(PicktreeError) as caught:
        batch.run(worker, Remembering(at_end=fills_up))
    assert str(caught.value) == (
        f"{folder}: less than 200 MB are left on its disk, so no further job is begun; "
        f"free some space, and continue with --resume {folder}"
    )
    has(200_000_000)
    with Batch.resume(folder) as batch:
        assert batch.store.query("SELECT count(*) FROM jobs WHERE status = 'success'").rows == ((1,),)
        seen = Remembering(at_begin=fills_up)
        with pytest.raises(PicktreeError, match="less than 200 MB are left"):
            batch.run(worker, seen)
        assert (seen.ends, seen.again) == ([], [])
    assert list(folder.glob("jobs/*")) == []
    monkeypatch.undo()
    with Batch.resume(folder) as batch:
        assert batch.run(worker, Remembering())
        found = batch.store.query("SELECT seed, status, attempts FROM jobs").rows
    assert found == ((0, "success", 1), (1, "crashed", 2), (2, "success", 1))


@contextmanager
def no_longer_files(length: int) -> Generator[None]:
    """What this process writes beyond that many bytes of a file, its disk refuses."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (length, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_results_that_cannot_be_written_are_one_error_and_resume_takes_in_what_is_done(
    tmp_path: Path, worker: Executor
) -> None:
    folder = tmp_path / "batch"
    plan = BatchPlan("full", (troubled(tmp_path, {}),), (0, 1, 2), backend="kinematic")
    with Batch.create(folder, plan) as batch:
        with no_longer_files(1000), pytest.raises(PicktreeError) as caught:
            batch.run(worker, Remembering())
        assert str(caught.value) == (
            f"{folder}/results.sqlite: the results cannot be written: disk I/O error; "
            f"nothing that was recorded is lost: mend the cause, and continue with --resume {folder}"
        )
        assert batch.store.query("SELECT count(*) FROM jobs WHERE status <> 'waiting'").rows == ((0,),)
    assert len(list(folder.glob("jobs/*/rows.json"))) == 1
    with Batch.resume(folder) as batch:
        seen = Remembering()
        assert batch.run(worker, seen)
        assert len(seen.ends) == 2
        assert batch.store.query("SELECT count(*) FROM jobs WHERE status = 'success'").rows == ((3,),)


@pytest.mark.parametrize("at", ["before the plan", "within the results", "before the results"])
def test_a_batch_whose_creation_was_cut_short_is_created_by_resume_or_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: str
) -> None:
    folder = tmp_path / "batch"
    plan = BatchPlan("cut", (troubled(tmp_path, {}),), (0, 1), backend="kinematic")

    def cut(*_: object) -> None:
        raise KeyboardInterrupt

    def half(path: Path, jobs: object) -> None:
        for name in ("results.part", "results.part-wal", "results.part-shm"):
            (folder / name).write_bytes(b"half of it")
        raise KeyboardInterrupt

    match at:
        case "before the plan":
            monkeypatch.setattr(module, "write_plan", cut)
        case "within the results":
            monkeypatch.setattr(Store, "create", half)
        case _:
            monkeypatch.setattr(Store, "create", cut)
    with pytest.raises(KeyboardInterrupt):
        Batch.create(folder, plan)
    monkeypatch.undo()
    if at == "before the plan":
        with pytest.raises(PicktreeError, match=r"not a batch: there is no plan\.json in this folder"):
            Batch.resume(folder)
        made = Batch.create(folder, plan)
    else:
        made = Batch.resume(folder)
    with made:
        assert [job.seed for job in made.jobs] == [0, 1]
    assert {path.name for path in folder.iterdir()} == {"plan.json", RESULTS_FILE, "lock", "recipes"}


def test_whatever_is_left_of_the_last_commits_the_earlier_ones_are_whole(
    tmp_path: Path, worker: Executor
) -> None:
    """As after kill -9, or a power cut, in the middle of a commit."""
    folder = tmp_path / "batch"
    with Batch.create(
        folder, BatchPlan("cut", (troubled(tmp_path, {}),), (0, 1, 2), backend="kinematic")
    ) as batch:
        assert batch.run(worker, Remembering())
        log = Path(f"{folder / RESULTS_FILE}-wal").read_bytes()
        for name in ("", "-wal"):
            shutil.copy(f"{folder / RESULTS_FILE}{name}", f"{tmp_path / RESULTS_FILE}{name}")
    counts: set[int] = set()
    for length in range(0, len(log), max(1, len(log) // 60)):
        cut = tmp_path / f"cut-{length}"
        cut.mkdir()
        shutil.copy(tmp_path / RESULTS_FILE, cut)
        (cut / f"{RESULTS_FILE}-wal").write_bytes(log[:length])
        with Store(cut / RESULTS_FILE) as store:
            done, items = store.query(
                "SELECT count(*), (SELECT count(DISTINCT job) FROM items) FROM jobs WHERE status = 'success'"
            ).rows[0]
            assert done == items == 3 - len(store.to_do())
            assert store.query("PRAGMA integrity_check").rows == (("ok",),)
            counts.add(int(str(done)))
    assert counts == {0, 1, 2}
