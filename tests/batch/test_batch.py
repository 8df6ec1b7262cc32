"""A batch gives what its jobs give alone, each once, whatever happens to its workers or to itself."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from picktree.apps.batch import Batch, BatchPlan, Executor, LocalExecutor, check_plan, load_plan
from picktree.apps.batch.plan import PLAN_FILE, jobs_of, read_plan, write_plan
from picktree.files import PicktreeError
from picktree.files.yaml import read_document
from picktree.session import RunRequest, Session

from .trouble import troubled
from .watching import Remembering

EXAMPLES = Path(__file__).parents[2] / "examples"
ONE_PICK = EXAMPLES / "one_pick.yaml"


def plan(folder: Path, seeds: tuple[int, ...] = (0, 1, 2), **changes: object) -> BatchPlan:
    return BatchPlan("test", (ONE_PICK,), seeds, backend="kinematic", **changes)  # type: ignore[arg-type]


def run(batch: Batch, workers: Executor) -> Remembering:
    seen = Remembering()
    with batch:
        assert batch.run(workers, seen)
    return seen


def test_jobs_on_workers_give_what_they_give_alone(tmp_path: Path, workers: LocalExecutor) -> None:
    seen = run(Batch.create(tmp_path / "batch", plan(tmp_path, keep="all")), workers)
    alone = [
        Session(RunRequest(ONE_PICK, seed=seed, backend="kinematic", out=tmp_path / "alone")).run()
        for seed in (0, 1, 2)
    ]
    found = {ended.job.seed: ended.row for ended in seen.ends}
    assert [found[seed].digest for seed in (0, 1, 2)] == [result.digest for result in alone]
    assert [found[seed].status for seed in (0, 1, 2)] == [result.status for result in alone]
    assert all((tmp_path / "batch" / row.folder / "log.mcap").is_file() for row in found.values())


def test_what_was_recorded_is_not_run_again_and_the_rest_is(
    tmp_path: Path, workers: LocalExecutor, worker: Executor
) -> None:
    batch = Batch.create(tmp_path / "batch", plan(tmp_path, seeds=tuple(range(4))))
    seen = Remembering(at_end=batch.stop)
    with batch:
        assert not batch.run(worker, seen)
    assert len(seen.ends) == 1
    rest = run(Batch.resume(tmp_path / "batch"), workers)
    assert rest.done == (seen.ends[0].row,)
    assert {ended.job.seed for ended in rest.ends} == {1, 2, 3}
    again = run(Batch.resume(tmp_path / "batch"), workers)
    assert (len(again.done), again.ends) == (4, [])


def test_a_stopped_batch_has_the_same_seeds_of_each_variant(tmp_path: Path, worker: Executor) -> None:
    batch = Batch.create(tmp_path / "batch", plan(tmp_path, scenes=("sort_small", "three_bins")))
    seen = Remembering()
    seen.at_end = lambda: batch.stop() if len(seen.ends) == 2 else None
    with batch:
        assert not batch.run(worker, seen)
    found = [(ended.job.variant.scene, ended.job.seed) for ended in seen.ends]
    assert found == [("sort_small", 0), ("three_bins", 0)]


def test_a_batch_is_run_by_one_process_at_a_time(tmp_path: Path) -> None:
    with (
        Batch.create(tmp_path / "batch", plan(tmp_path)),
        pytest.raises(PicktreeError, match="another process runs this batch"),
    ):
        Batch.resume(tmp_path / "batch")


def test_a_recorded_plan_is_read_again(tmp_path: Path) -> None:
    made = plan(
        tmp_path, scenes=(None, "three_bins"), faults=(None, ONE_PICK), settings={"g": ("1",)}, limit=60.0
    )
    write_plan(made, tmp_path)
    assert read_plan(tmp_path) == made
    record = json.loads((tmp_path / PLAN_FILE).read_text())
    limits = {"limit": "simulated", "wall_limit": "wall", "memory": "memory", "disk": "disk"}
    record["limits"] = {old: record.pop(key) for key, old in limits.items()}
    (tmp_path / PLAN_FILE).write_text(json.dumps(record))
    assert read_plan(tmp_path) == made


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("{", ""),
        ("{}", ""),
        ('{"missions": 1}', ": Input should be a valid tuple"),
    ],
)
def test_a_record_that_is_no_plan(tmp_path: Path, text: str, fault: str) -> None:
    (tmp_path / PLAN_FILE).write_text(text)
    with pytest.raises(PicktreeError) as raised:
        read_plan(tmp_path)
    assert str(raised.value) == f"{tmp_path / PLAN_FILE}: not a valid plan of a batch{fault}"


def test_a_plan_file_says_all_of_it(tmp_path: Path) -> None:
    file = tmp_path / "night.yaml"
    file.write_text(
        f"picktree: 1\nkind: plan\nmissions: [{ONE_PICK}]\nscenes: [sort_small, three_bins]\n"
        "seeds: [0:2, 7]\nset: {Grasp.force: [15 N, 30]}\nbackend: kinematic\nmemory: 2 GB\n"
    )
    loaded = load_plan(file)
    assert (loaded.name, loaded.seeds, loaded.memory) == ("night", (0, 1, 7), 2 * 10**9)
    assert [variant.label for variant in loaded.variants()] == [
        "sort_small, Grasp.force=15 N",
        "sort_small, Grasp.force=30",
        "three_bins, Grasp.force=15 N",
        "three_bins, Grasp.force=30",
    ]


def test_every_example_of_a_plan_is_free_of_faults() -> None:
    plans = [load_plan(plan) for plan in sorted(EXAMPLES.glob("plan_*.yaml"))]
    assert ("grip force", 2, 40) in [
        (plan.name, len(list(plan.variants())), len(plan.seeds)) for plan in plans
    ]


def test_a_plan_tries_robots_and_refuses_those_that_are_none(tmp_path: Path) -> None:
    file = tmp_path / "arms.yaml"
    text = f"picktree: 1\nkind: plan\nmissions: [{ONE_PICK}]\nrobots: [iiwa, xarm6]\nseeds: 0\n"
    file.write_text(f"{text}backend: kinematic\n")
    loaded = load_plan(file)
    assert [(v.label, v.robot) for v in loaded.variants()] == [("iiwa", "iiwa"), ("xarm6", "xarm6")]
    jobs = jobs_of(loaded, tmp_path / "batch")
    assert len({job.id for job in jobs}) == 2
    file.write_text(text.replace("iiwa", "iwaa"))
    checked = check_plan(
        read_document(file, "plan", text.replace("iiwa", "iwaa").replace("0\n", "0\nscenes: [x.yaml]\n"))
    )
    assert [str(fault).partition(" (")[0] for fault in checked.faults] == [
        f"{file}:6:10: scenes[0]: there is no scene file {tmp_path}/x.yaml",
        f"{file}:4:10: robots[0]: there is no robot file {tmp_path}/iwaa",
    ]


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("seeds: 4:4", "4:8: seeds: seeds '4:4': the range '4:4' is empty: write 0:100 (half open), 3,7 or "
        "both"),
        ("set: {Grasp.forse: 3}", "5:7: set.Grasp.forse: Grasp.forse: Grasp has no input 'forse' "
         "(did you mean 'force'?)"),
        ("memory: 2", "5:9: memory: 2 is not an amount of memory (as 2 GB)"),
    ],
)  # fmt: skip
def test_a_faulty_plan_is_refused_before_anything_runs(tmp_path: Path, line: str, fault: str) -> None:
    seeds = "" if line.startswith("seeds") else "seeds: 3\n"
    text = f"picktree: 1\nkind: plan\nmissions: [{ONE_PICK}]\n{seeds}{line}\n"
    found = check_plan(read_document(tmp_path / "plan.yaml", "plan", text))
    assert [str(each).removeprefix(f"{tmp_path}/plan.yaml:") for each in found.faults] == [fault]
    assert found.value is None


def test_a_batch_runs_what_it_began_with_whatever_becomes_of_the_files(
    tmp_path: Path, worker: Executor
) -> None:
    mission = troubled(tmp_path, {})
    folder = tmp_path / "batch"
    with Batch.create(folder, BatchPlan("trouble", (mission,), (0, 1), backend="kinematic")) as batch:
        ids = [job.id for job in batch.jobs]
        assert [job.number for job in batch.jobs] == [0, 1]
        assert batch.store.jobs() == batch.jobs
    (tmp_path / "trouble.py").write_text("raise SystemExit('an edit half done')\n")
    mission.unlink()
    moved = tmp_path / "elsewhere"
    folder.rename(moved)
    seen = run(Batch.resume(moved), worker)
    assert [(ended.job.id, ended.row.status) for ended in seen.ends] == [(each, "success") for each in ids]
