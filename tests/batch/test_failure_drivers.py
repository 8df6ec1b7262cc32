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


def created(tmp_path: Path, plan: BatchPlan) -> tuple[Store, tuple[Job, ...]]:
    """Results of a plan of which nothing was run, and its jobs."""
    (tmp_path / "b").mkdir()
    each = enumerate(product(plan.variants(), plan.seeds))
    jobs = tuple(Job(f"{n:016x}", n, variant, seed, "recipe") for n, (variant, seed) in each)
    return Store.create(tmp_path / "b" / RESULTS_FILE, jobs), jobs


def recorded(tmp_path: Path, seeds: int) -> Store:
    """Eight recipes on each seed. With one round all seeds but 11 fail, with three only seed 0."""
    plan = BatchPlan("test", (Path("/m/sort.yaml"),), tuple(range(seeds)), settings=SETTINGS)
    made, jobs = created(tmp_path, plan)
    for job in jobs:
        fails = job.seed < 11 if job.variant.settings["rounds"] == "1" else job.seed == 0
        plate = replace(ITEMS[1], kind="plate", verdict="left" if fails else "sorted")
        row = replace(MISSED, folder="") if fails else replace(SUCCESS, folder=f"jobs/{job.number}")
        failures = (SLIP,) if fails else ()
        assert made.record(job.id, JobRows(row, items=(ITEMS[0], plate), failures=failures))
    return made


@pytest.fixture
def results(tmp_path: Path) -> Store:
    return recorded(tmp_path, seeds=12)


def test_what_was_planted_comes_first_with_its_interval(results: Store) -> None:
    with results:
        found = rank_drivers(results)
        text = summarise(results).to_text()
    rounds, plate, *rest = found.drivers
    assert (rounds.name, rounds.significant) == ("rounds=1", True)
    assert (rounds.failed, rounds.others) == (rate(44, 48), rate(4, 48))
    assert rounds.difference == pytest.approx(10 / 12)  # seeds 1 to 10 differ, and all in one direction
    assert 0.4 < rounds.interval.low < 10 / 12 < rounds.interval.high <= 1.0
    assert rounds.p_value == pytest.approx(2 / 2**10)
    assert rounds.adjusted == pytest.approx(3 * rounds.p_value)  # the second of four
    assert {each.name.partition("=")[0] for each in rest} == {"Grasp.force", "Grasp.speed"}
    assert all(each.difference == 0.0 and not each.significant for each in rest)
    # All failures are plates: 48 of 96 jobs leave one, on eleven of twelve seeds. None leaves a can.
    assert (plate.name, plate.subject, plate.difference) == ("kind=plate", "item", 0.5)
    assert plate.significant
    assert "rounds=1             44 of 48 (91.7 %)       4 of 48 (8.3 %)         +83.3 % (" in text


def test_many_runs_of_few_seeds_show_nothing(tmp_path: Path) -> None:
    with recorded(tmp_path, seeds=3) as few:
        found = rank_drivers(few)
    rounds = next(each for each in found.drivers if each.name == "rounds=1")
    assert (rounds.failed, rounds.others) == (rate(12, 12), rate(4, 12))
    assert not rounds.significant  # Fisher's test would take runs of one seed for independent: p = 0.001
    assert found.least_seeds == 8
    few = "3 seeds: no value can be significant with fewer than 8"
    assert few in "\n".join(found.lines())
    assert found.to_json()["too_few_seeds"] == few


def test_the_pair_of_runs_differs_in_the_driver_alone(results: Store) -> None:
    with results:
        found = rank_drivers(results)
    pair = found.pair
    assert pair is not None
    assert (pair.driver, pair.same_seed, pair.seed, pair.others) == ("rounds=1", True, 1, ())
    # Job 1 has one round and job 49 three; the log of the failure was not kept.
    a, b = (f"{results.path.parent}@{number:016x}" for number in (1, 49))
    assert (pair.diff, pair.remake) == (f"picktree diff {a} {b}", (f"picktree resim {a}",))
    assert pair.whatif == f"picktree whatif {a} --at 4s --set rounds=3"


def test_a_robot_is_kept_and_compared(tmp_path: Path) -> None:
    plan = BatchPlan("test", (Path("/m/sort.yaml"),), tuple(range(9)), robots=(None, "ur10e"))
    made, jobs = created(tmp_path, plan)
    with made:
        assert made.jobs() == jobs
        for job in jobs:
            assert made.record(job.id, JobRows(MISSED if job.variant.robot else SUCCESS))
        (found,) = rank_drivers(made).drivers
    assert (found.name, found.failed, found.others) == ("robot=ur10e", rate(9, 9), rate(0, 9))
