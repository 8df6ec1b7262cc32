"""What drives failure: planted effects come first, with hand-computed differences and a pair of runs."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest

from picktree.apps.batch import RESULTS_FILE, BatchPlan, Job, Store, summarise
from picktree.apps.batch.failure_drivers import rank_drivers
from picktree.apps.batch.tables import JobRows
from picktree.logs import rate

from .test_store import ITEMS, MISSED, SLIP, SUCCESS

SETTINGS = {"rounds": ("1", "3"), "Grasp.force": ("15", "30"), "Grasp.speed": ("0.9", "1")}


@pytest.fixture
def results(tmp_path: Path) -> Store:
    """Eight recipes on five seeds. With one round all seeds but 4 fail, with three only seed 0."""
    (tmp_path / "b").mkdir()
    plan = BatchPlan("test", (Path("/m/sort.yaml"),), tuple(range(5)), settings=SETTINGS)
    jobs = [
        Job(f"{n:016x}", n, variant, seed, "recipe")
        for n, (variant, seed) in enumerate(product(plan.variants(), plan.seeds))
    ]
    made = Store.create(tmp_path / "b" / RESULTS_FILE, jobs)
    for job in jobs:
        fails = job.seed < 4 if job.variant.settings["rounds"] == "1" else job.seed == 0
        plate = replace(ITEMS[1], kind="plate", verdict="left" if fails else "sorted")
        row = replace(MISSED, folder="") if fails else replace(SUCCESS, folder=f"jobs/{job.number}")
        failures = (SLIP,) if fails else ()
        assert made.record(job.id, JobRows(row, items=(ITEMS[0], plate), failures=failures))
    return made


def test_what_was_planted_comes_first_with_its_interval(results: Store) -> None:
    with results:
        found = rank_drivers(results)
        text = summarise(results).to_text()
    rounds, plate, *rest = found.drivers
    assert (rounds.name, rounds.significant) == ("rounds=1", True)
    assert (rounds.failed, rounds.others) == (rate(16, 20), rate(4, 20))
    assert rounds.difference == pytest.approx(0.6)
    # Newcombe's interval from Wilson's, 0.5840 … 0.9193 and 0.0807 … 0.4160.
    assert (rounds.interval.low, rounds.interval.high) == pytest.approx((0.2945, 0.7688), abs=1e-4)
    assert rounds.p_value == pytest.approx(0.000364, abs=1e-5)  # Fisher's test, 2 × 2 table
    assert rounds.adjusted == pytest.approx(3 * rounds.p_value)  # the second smallest of four
    assert {each.name.partition("=")[0] for each in rest} == {"Grasp.force", "Grasp.speed"}
    assert all(each.difference == 0.0 and not each.significant for each in rest)
    # All failures are plates: 20 of 40 jobs leave one, and none leaves a can.
    assert (plate.name, plate.subject, plate.difference) == ("kind=plate", "item", 0.5)
    assert plate.significant
    assert "rounds=1             16 of 20 (80.0 %)       4 of 20 (20.0 %)        +60.0 % (" in text


def test_the_pair_of_runs_differs_in_the_driver_alone(results: Store) -> None:
    with results:
        found = rank_drivers(results)
    pair = found.pair
    assert pair is not None
    assert (pair.driver, pair.same_seed, pair.seed, pair.others) == ("rounds=1", True, 1, ())
    # Job 1 has one round and job 21 three; the log of the failure was not kept.
    a, b = (f"{results.path.parent}@{number:016x}" for number in (1, 21))
    assert (pair.diff, pair.remake) == (f"picktree diff {a} {b}", (f"picktree resim {a}",))
    assert pair.whatif == f"picktree whatif {a} --at 4s --set rounds=3"
