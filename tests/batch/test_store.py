"""What is asked of results: tables, the summary, and which of two recipes is better."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from picktree.apps.batch import RESULTS_FILE, BatchPlan, Job, JobRow, Store, summarise
from picktree.apps.batch.tables import (
    FigureRow,
    JobFailureRow,
    JobItemRow,
    JobRows,
    JobTimingRow,
    TimeToDoneRow,
)
from picktree.files import PicktreeError
from picktree.logs import Activity, FigureCounts

SUCCESS = JobRow(
    status="success",
    message="",
    digest="d",
    attempts=1,
    items_total=2,
    items_sorted=2,
    items_misplaced=0,
    items_left=0,
    picks_tried=2,
    picks_held=2,
    sim_seconds=10.0,
    cpu_seconds=1.0,
    wall_seconds=1.0,
    last_tick=200,
)
MISSED = replace(
    SUCCESS, status="incomplete", items_sorted=1, items_left=1, look_at="4.00 s: slipped", folder="jobs/x"
)
SLIP = JobFailureRow(4.0, "Main/Grasp", "grasp.slipped", "it slipped", "can_1", "cured", "SafeRetreat", 2.5)
ITEMS = (
    JobItemRow("item_0", "can", "cylinder", "red", 0.4, 0.1, 0.0, "red_bin", "red_bin", "sorted"),
    JobItemRow("item_1", "can", "cylinder", "red", 0.5, 0.1, 3.0, "red_bin", None, "left"),
)


USES: dict[Activity, float] = {"moving": 7.5, "thinking": 2.5}


def store(folder: Path, rows: dict[int, JobRow], values: tuple[str, ...] = ("15",), seeds: int = 10) -> Store:
    """A batch's folder with a job for each setting and seed; `rows` by number."""
    folder.mkdir()
    plan = BatchPlan("test", (Path("/m/sort.yaml"),), tuple(range(seeds)), settings={"Grasp.force": values})
    jobs = [
        Job(f"{n:016x}", n, variant, seed, "recipe")
        for n, (variant, seed) in enumerate((v, s) for v in plan.variants() for s in plan.seeds)
    ]
    made = Store.create(folder / RESULTS_FILE, jobs)
    for number, row in rows.items():
        rest = JobRows(row, items=ITEMS, timings=(JobTimingRow("grasp", 6.0), JobTimingRow("think", 1.0)))
        counts = FigureCounts(
            10.0, row.items_sorted or 0, 2, row.items_sorted or 0, activities=USES, times=(4.0, 6.0)
        )
        if row.status != "success":
            counts = replace(counts, set_aside=1, times=(4.0,))
        took = tuple(TimeToDoneRow(n, seconds) for n, seconds in enumerate(counts.times))
        rest = replace(rest, figures=(FigureRow.of(counts),), times_to_done=took)
        failures = (SLIP,) if row.status != "success" else ()
        assert made.record(f"{number:016x}", replace(rest, failures=failures))
    return made


def test_a_job_is_recorded_once(tmp_path: Path) -> None:
    with store(tmp_path / "b", {0: SUCCESS}) as made:
        assert not made.record(f"{0:016x}", JobRows(MISSED, items=ITEMS))
        assert made.query("SELECT status FROM jobs WHERE number = 0").rows == (("success",),)
        assert made.query("SELECT count(*) FROM items").rows == ((2,),)


def test_a_crashed_job_is_recorded_again_when_it_was_run(tmp_path: Path) -> None:
    with store(tmp_path / "b", {0: replace(SUCCESS, status="crashed")}) as made:
        assert f"{0:016x}" in made.to_do()
        assert made.record(f"{0:016x}", JobRows(SUCCESS, items=ITEMS))
        assert made.query("SELECT count(*) FROM items").rows == ((2,),)


@pytest.mark.parametrize(
    ("sql", "message"),
    [
        ("DELETE FROM jobs", "the query would change the results; a query may only read them"),
        ("SELECT * FROM job", "no such table: job (did you mean 'jobs'?)"),
        ("SELECT sucess FROM success", "no such column: sucess"),
        ("SELECT jobs.sed FROM jobs", "no such column: jobs.sed (did you mean 'seed'?)"),
        ("SELEC 1", 'near "SELEC": syntax error'),
        ("SELECT 1; SELECT 2", "You can only execute one statement at a time."),
        ("", "it is not a SELECT"),
    ],
)
def test_a_query_that_is_none_is_refused_and_changes_nothing(tmp_path: Path, sql: str, message: str) -> None:
    with store(tmp_path / "b", {0: SUCCESS}) as made:
        with pytest.raises(PicktreeError) as refused:
            made.query(sql)
        assert str(refused.value) == f"the query cannot be answered: {message}"
        assert made.query("SELECT count(*) FROM jobs").rows == ((10,),)


def test_tables_are_told_as_text_csv_and_json(tmp_path: Path) -> None:
    with store(tmp_path / "b", {0: SUCCESS}) as made:
        table = made.query("SELECT seed, status, look_at, sim_seconds FROM jobs ORDER BY seed LIMIT 2")
    assert table.to_text() == (
        "seed  status   look_at  sim_seconds\n"
        "────  ───────  ───────  ───────────\n"
        "   0  success                    10\n"
        "   1  waiting"
    )
    assert table.to_csv() == "seed,status,look_at,sim_seconds\r\n0,success,,10.0\r\n1,waiting,,\r\n"
    assert json.loads(table.to_json_text())["rows"] == [[0, "success", "", 10.0], [1, "waiting", "", None]]


def test_the_summary_says_how_it_went(tmp_path: Path) -> None:
    rows = dict.fromkeys(range(8), SUCCESS) | {8: MISSED}
    with store(tmp_path / "b", rows) as made:
        found = summarise(made)
    assert (found.total, found.waiting, found.reached) == (10, 1, False)
    assert found.to_text() == (
        "9 of 10 jobs run\n"
        "\n"
        "sort\n"
        "  goal reached  8 of 9 (88.9 %, 56.5 … 98.0 %)\n"
        "                41.9 … 99.9 % at any time, however often one looks\n"
        "  items sorted  17 of 18 (94.4 %, 74.2 … 99.0 %)\n"
        "  units         680 an hour (600 … 720); first pass 17 of 18 (94.4 %, 74.2 … 99.0 %)\n"
        "  MTBF          90.0 s (16.2 s … 59.2 min): 1 set aside, no assist\n"
        "  to done       half of the units within 4.0 s, 90 % within 6.0 s\n"
        "  time          moving 75 % (75 … 75), thinking 25 % (25 … 25)\n"
        "  s a pick      think 0.50, grasp 3.00\n"
        "\n"
        "cause          failures     sum    jobs\n"
        "grasp.slipped         1   100 %       1\n"
        "\n"
        "items sorted  by form: cylinder 9 of 18\n"
        "              by colour: red 9 of 18\n"
        "              by place: 0 of 9 at 0.50, 0.10 m; all in 1 other cell of 5 cm\n"
        "\n"
        "missed their goal\n"
        "  seed 8, sort: incomplete, 1 not sorted; 4.00 s: slipped (jobs/x)"
    )
