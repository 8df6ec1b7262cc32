"""A batch gives what its jobs give alone, each once, whatever happens to its workers or to itself."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.batch.batch import Batch
from picktree.batch.load import check_plan_file, load_plan
from picktree.batch.local import LocalExecutor
from picktree.batch.plan import Limits, Plan
from picktree.logs.session import RunRequest, Session
from picktree.world.errors import PicktreeError
from picktree.world.files.document import read_document

from .watching import Remembering

EXAMPLES = Path(__file__).parents[2] / "examples"
ONE_PICK = EXAMPLES / "one_pick.yaml"
TROUBLE = """\
from picktree.trees.skill import Skill, Steps
from picktree.world.world import World
import os, signal, time


class Trouble(Skill):
    \"\"\"What a skill should not do.\"\"\"

    def run(self, world: World) -> Steps:
        for _ in range(5):
            yield
        {doing}
        yield


NODES = (Trouble,)
"""


def plan(folder: Path, seeds: tuple[int, ...] = (0, 1, 2), **changes: object) -> Plan:
    return Plan("test", (ONE_PICK,), seeds, backend="kinematic", **changes)  # type: ignore[arg-type]


def troubled(folder: Path, doing: str) -> Path:
    """A mission whose only skill does that after five ticks, for seed 1 alone."""
    (folder / "trouble.py").write_text(TROUBLE.format(doing=f"if world.streams.seed == 1: {doing}"))
    mission = folder / "mission.yaml"
    mission.write_text(
        "picktree: 1\nkind: mission\nname: trouble\nscene: sort_small\ngoal: left >= 0\n"
        "plugins: [trouble.py]\ntrees:\n  Main: Trouble\n"
    )
    return mission


def run(batch: Batch, workers: int = 2) -> Remembering:
    seen = Remembering()
    with batch, LocalExecutor(workers) as executor:
        assert batch.run(executor, seen)
    return seen


def test_jobs_on_workers_give_what_they_give_alone(tmp_path: Path) -> None:
    seen = run(Batch.create(tmp_path / "batch", plan(tmp_path, keep="all")))
    alone = [
        Session(RunRequest(ONE_PICK, seed=seed, backend="kinematic", out=tmp_path / "alone")).run()
        for seed in (0, 1, 2)
    ]
    found = {ended.job.seed: ended.row for ended in seen.ends}
    assert [found[seed].digest for seed in (0, 1, 2)] == [result.digest for result in alone]
    assert [found[seed].status for seed in (0, 1, 2)] == [result.status for result in alone]
    assert all((tmp_path / "batch" / row.folder / "log.mcap").is_file() for row in found.values())


def test_what_was_recorded_is_not_run_again_and_the_rest_is(tmp_path: Path) -> None:
    batch = Batch.create(tmp_path / "batch", plan(tmp_path, seeds=tuple(range(4))))
    seen = Remembering(at_end=batch.stop)
    with batch, LocalExecutor(1) as executor:
        assert not batch.run(executor, seen)
    assert len(seen.ends) == 1
    rest = run(Batch.resume(tmp_path / "batch"))
    assert rest.done == (seen.ends[0].row,)
    assert {ended.job.seed for ended in rest.ends} == {1, 2, 3}
    again = run(Batch.resume(tmp_path / "batch"))
    assert (len(again.done), again.ends) == (4, [])


def test_a_batch_is_run_by_one_process_at_a_time(tmp_path: Path) -> None:
    with (
        Batch.create(tmp_path / "batch", plan(tmp_path)),
        pytest.raises(PicktreeError, match="another process runs this batch"),
    ):
        Batch.resume(tmp_path / "batch")


@pytest.mark.parametrize(
    ("doing", "reason"),
    [
        ("os.kill(os.getpid(), signal.SIGSEGV)", "its process was ended by SIGSEGV, at trouble.py:12 in run"),
        ("os._exit(7)", "its process ended with exit code 7"),
        (
            "self.hoard = bytearray(900_000_000); time.sleep(60)",
            "it took more than 700 MB of memory, at trouble.py:12 in run",
        ),
    ],
)
def test_a_job_that_ends_its_worker_costs_itself_alone(tmp_path: Path, doing: str, reason: str) -> None:
    mission = troubled(tmp_path, doing)
    limits = Limits(memory=700_000_000)
    asked = Plan("trouble", (mission,), (0, 1, 2), backend="kinematic", limits=limits)
    batch = Batch.create(tmp_path / "batch", asked)
    seen = Remembering()
    with batch, LocalExecutor(2) as executor:
        assert batch.run(executor, seen)
        found = batch.store.query("SELECT seed, status, message, attempts FROM jobs ORDER BY seed").rows
    assert found == ((0, "success", "", 1), (1, "crashed", reason, 2), (2, "success", "", 1))
    assert seen.again == [reason]
    crashed = next(ended for ended in seen.ends if ended.job.seed == 1)
    assert (tmp_path / "batch" / crashed.row.folder / "log.mcap").is_file()


def test_a_job_that_hangs_is_ended_at_its_limit(tmp_path: Path) -> None:
    asked = Plan(
        "trouble",
        (troubled(tmp_path, "time.sleep(600)"),),
        (1,),
        backend="kinematic",
        limits=Limits(wall=3.0),
    )
    seen = run(Batch.create(tmp_path / "batch", asked), workers=1)
    assert seen.again == ["it took more than 3 s of wall time, at trouble.py:12 in run"]
    assert [ended.row.status for ended in seen.ends] == ["crashed"]


def test_a_plan_file_says_all_of_it(tmp_path: Path) -> None:
    file = tmp_path / "night.yaml"
    file.write_text(
        f"picktree: 1\nkind: plan\nmissions: [{ONE_PICK}]\nscenes: [sort_small, three_bins]\n"
        "seeds: [0:2, 7]\nset: {Grasp.force: [15 N, 30]}\nbackend: kinematic\nmemory: 2 GB\n"
    )
    loaded = load_plan(file)
    assert (loaded.name, loaded.seeds, loaded.limits.memory) == ("night", (0, 1, 7), 2 * 10**9)
    assert [variant.label for variant in loaded.variants()] == [
        "sort_small, Grasp.force=15 N",
        "sort_small, Grasp.force=30",
        "three_bins, Grasp.force=15 N",
        "three_bins, Grasp.force=30",
    ]


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("seeds: 4:4", "4:8: seeds: seeds '4:4': '4:4' holds no seed: write 0:100 (half open), 3,7 or both"),
        ("set: {Grasp.forse: 3}", "5:7: set.Grasp.forse: Grasp.forse: Grasp has no input 'forse' "
         "(did you mean 'force'?)"),
        ("memory: 2", "5:9: memory: 2 is no amount of memory (as 2 GB)"),
    ],
)  # fmt: skip
def test_a_faulty_plan_is_refused_before_anything_runs(tmp_path: Path, line: str, fault: str) -> None:
    seeds = "" if line.startswith("seeds") else "seeds: 3\n"
    text = f"picktree: 1\nkind: plan\nmissions: [{ONE_PICK}]\n{seeds}{line}\n"
    found = check_plan_file(read_document(text, tmp_path / "plan.yaml", "plan"))
    assert [str(each).removeprefix(f"{tmp_path}/plan.yaml:") for each in found.faults] == [fault]
    assert found.plan is None


def test_a_batch_runs_what_it_began_with_whatever_becomes_of_the_files(tmp_path: Path) -> None:
    mission = troubled(tmp_path, "pass")
    folder = tmp_path / "batch"
    with Batch.create(folder, Plan("trouble", (mission,), (0, 1), backend="kinematic")) as batch:
        ids = [job.id for job in batch.jobs]
        assert [job.number for job in batch.jobs] == [0, 1]
        assert batch.store.jobs() == batch.jobs
    (tmp_path / "trouble.py").write_text("raise SystemExit('an edit half done')\n")
    mission.unlink()
    moved = tmp_path / "elsewhere"
    folder.rename(moved)
    seen = run(Batch.resume(moved), workers=1)
    assert [(ended.job.id, ended.row.status) for ended in seen.ends] == [(each, "success") for each in ids]
