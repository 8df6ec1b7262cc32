"""Comparison of two recipes: the better one, and how sure that is."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from picktree.apps.batch import JobRow, RecipeComparison, compare_recipes, json_text_of, read_recipe, text_of
from picktree.apps.batch.comparison import Criterion, JobOutcome, RecipeOutcomes
from picktree.apps.batch.tables import JobRows
from picktree.files import PicktreeError
from picktree.logs.arithmetic_record import Arithmetic

from .test_store import MISSED, SUCCESS, store


def compare(a: str, b: str, **options: Any) -> RecipeComparison:
    return compare_recipes(read_recipe(a), read_recipe(b), **options)


def criterion(found: RecipeComparison, name: str) -> Criterion:
    return next(each for each in found.criteria if each.name == name)


def by_force(folder: Path, rows: dict[int, JobRow], **options: Any) -> RecipeComparison:
    """Jobs 0 to 9 of 15 N and 10 to 19 of 30 N, with the same ten seeds."""
    with store(folder / "b", rows, values=("15", "30")):
        return compare(f"{folder}/b@force=15", f"{folder}/b@30", **options)


def recipe(label: str, seeds: range, sample: np.random.Generator, hard: float = 0.1) -> RecipeOutcomes:
    """Made-up jobs of 12 items, each missed with that probability."""
    outcomes: dict[int, JobOutcome] = {}
    for seed in seeds:
        missed = int(sample.binomial(12, hard))
        tried = 12 + int(sample.poisson(10 * hard))
        seconds = 55.0 + float(sample.gamma(2.0, 4.0)) + 60 * hard
        causes = {"grasp.slipped": tried - 12} if tried > 12 else {}
        outcomes[seed] = JobOutcome(
            f"{seed}", seed, not missed, 12 - missed, tried, tried, seconds, "", causes
        )
    return RecipeOutcomes(label, Path(), outcomes)


def test_two_recipes_are_compared_on_the_same_seeds(tmp_path: Path) -> None:
    slower = replace(SUCCESS, sim_seconds=12.0)
    rows = dict.fromkeys(range(10), SUCCESS) | {10 + n: MISSED if n < 7 else slower for n in range(10)}
    found = by_force(tmp_path, rows)
    assert found.paired is not None
    assert (found.paired.both, found.paired.only_a, found.paired.only_b) == (3, 7, 0)
    goal, items = criterion(found, "goal"), criterion(found, "items")
    assert goal.difference.p_value == pytest.approx(2 / 2**7)
    assert goal.adjusted == pytest.approx(5 * 2 / 2**7)  # the least of five
    assert items.difference.mean == pytest.approx(-0.7)
    assert not found.differ  # seven of ten that fail are too few for five questions at once
    assert [(changed.seed, changed.winner) for changed in found.changed] == [(n, "A") for n in range(7)]
    assert all(changed.missing == ("A",) for changed in found.changed)
    assert text_of(found).splitlines() == [
        "A  b@Grasp.force=15: goal reached 10 of 10 (100.0 %, 72.2 … 100.0 %)",
        "B  b@Grasp.force=30: goal reached 3 of 10 (30.0 %, 10.8 … 60.3 %)",
        "paired by seed: 10 seeds in both",
        "",
        "of a job                      A        B  B − A, 95 % interval               p    Holm",
        "goal reached, %           100.0     30.0  -70.0 (-89.2 … -28.9)          0.016   0.078",
        "items sorted               2.00     1.30  -0.70 (-0.90 … -0.40)          0.016   0.078",
        "grasps in vain             0.00     0.70  +0.70 (+0.40 … +0.90)          0.016   0.078",
        "failures                   0.00     0.70  +0.70 (+0.40 … +0.90)          0.016   0.078",
        "seconds a pick             5.00     5.30  +0.30 (+0.10 … +0.60)          0.250   0.250",
        "goal by seed: both 3, only A 7, only B 0, neither 0",
        "anytime-valid: not decided yet after 10 seeds: only A 7, only B 0, e-value 16, "
        "difference -100.0 … +21.4 %",
        "",
        "so: too few runs to tell: only A reached its goal with 7 of the 7 seeds that changed sides; 7 such "
        "seeds cannot give a p value of 5 % with 5 criteria; 8 can, for which about 12 seeds must be run",
        "",
        "failures by cause             A        B  B − A, 95 % interval               p    Holm",
        "grasp.slipped              0.00     0.70  +0.70 (+0.40 … +0.90)          0.016   0.016 *",
        "",
        "operators' figures",
        "  units   A  720 an hour (720 … 720); first pass 20 of 20 (100.0 %, 83.9 … 100.0 %)",
        "          B  442 an hour (360 … 514); first pass 13 of 20 (65.0 %, 43.3 … 81.9 %)",
        "  MTBF    A  at least 27.1 s: no failure, no assist in 100.0 s",
        "          B  15.1 s (7.3 s … 37.7 s): 7 set aside, no assist",
        "  to done A  half of the units within 4.0 s, 90 % within 6.0 s",
        "          B  half of the units within 4.0 s, 90 % are never done",
        "  time    A  moving 75 % (75 … 75), thinking 25 % (25 … 25)",
        "          B  moving 75 % (75 … 75), thinking 25 % (25 … 25)",
        "  the curves of time to done differ by up to 35 % at 6.0 s, p 0.175 (Kolmogorov–Smirnov)",
        "",
        "7 seeds changed sides",
        *(f"  seed {n}: only A reached its goal" for n in range(7)),
        "seeds without a log: 7; --remake runs them again and shows where they diverge",
    ]


def test_a_clear_difference_is_named(tmp_path: Path) -> None:
    rows = dict.fromkeys(range(10), SUCCESS) | {10 + n: MISSED for n in range(10)}
    found = by_force(tmp_path, rows)
    assert found.differ
    assert [(c.name, c.better) for c in found.criteria] == [
        ("goal", "A"), ("items", "A"), ("in_vain", "A"), ("failures", "A"), ("seconds_a_pick", None),
    ]  # fmt: skip
    said = json.loads(json_text_of(found))
    assert (said["paired"], said["differ"], said["goal"]["only_a"]) == (True, True, 10)
    assert said["criteria"]["goal"]["difference"] == -1.0
    assert "so: A reaches the goal more often; A sorts more items;" in text_of(found)


def test_six_to_nothing_is_too_few_to_tell_and_not_no_difference(tmp_path: Path) -> None:
    with (
        store(tmp_path / "a", dict.fromkeys(range(6), SUCCESS)),
        store(tmp_path / "b", dict.fromkeys(range(6), MISSED)),
    ):
        told = text_of(compare(str(tmp_path / "a"), str(tmp_path / "b")))
    assert "no significant difference" not in told
    assert (
        "so: too few runs to tell: only A reached its goal with 6 of the 6 seeds that changed sides; 6 such "
        "seeds cannot give a p value of 5 %" in told
    )
    assert "8 can, for which about 8 seeds must be run" in told


def test_alike_recipes_do_not_differ(tmp_path: Path) -> None:
    with (
        store(tmp_path / "a", dict.fromkeys(range(9), SUCCESS)),
        store(tmp_path / "b", dict.fromkeys(range(10), SUCCESS)),
    ):
        found = compare(str(tmp_path / "a"), str(tmp_path / "b"))
    assert found.paired is not None
    assert (found.paired.total, found.alone, found.differ) == (9, 1, False)
    assert "paired by seed: 9 seeds in both; left out: 1 that only A or only B has" in text_of(found)
    json.loads(json_text_of(found))


def test_without_shared_seeds_jobs_are_taken_as_independent() -> None:
    sample = np.random.default_rng(1)
    good, bad = recipe("good", range(40), sample, 0.01), recipe("bad", range(35, 75), sample, 0.15)
    found = compare_recipes(good, bad)
    assert found.paired is None
    assert (found.shared, found.success_a.total, found.success_b.total) == (5, 40, 40)
    assert criterion(found, "goal").better == "A"
    assert found.causes[0].cause == "grasp.slipped" and found.causes[0].adjusted < 0.05
    told = text_of(found)
    assert "not paired: 40 and 40 jobs, 5 seeds in both; all are compared as independent runs" in told
    assert "goal by seed" not in told


def test_half_of_the_seeds_shared_are_enough_to_pair_unless_told_otherwise() -> None:
    sample = np.random.default_rng(2)
    a, b = recipe("a", range(40), sample), recipe("b", range(20, 60), sample)
    assert compare_recipes(a, b).paired is not None
    assert compare_recipes(a, recipe("b", range(21, 61), sample)).paired is None
    assert compare_recipes(a, b, unpaired=True).paired is None


def test_one_recipe_seldom_differs_from_itself() -> None:
    sample = np.random.default_rng(3)
    tries = 15
    wrong = sum(
        compare_recipes(recipe("a", range(40), sample), recipe("b", range(100, 140), sample)).differ
        for _ in range(tries)
    )
    assert wrong <= 3  # more, of 15 with a chance of 0.05 each, come in 0.5 % of all cases


def test_a_job_that_crashed_counts_for_the_goal_alone(tmp_path: Path) -> None:
    crashed = replace(
        SUCCESS, status="crashed", items_sorted=None, picks_tried=None, picks_held=None, sim_seconds=None
    )
    rows = dict.fromkeys(range(10), SUCCESS) | {10 + n: crashed if n < 4 else SUCCESS for n in range(10)}
    found = by_force(tmp_path, rows)
    assert criterion(found, "goal").difference.mean == pytest.approx(-0.4)
    assert (criterion(found, "items").difference.count, criterion(found, "items").difference.mean) == (6, 0.0)


def test_a_recipe_is_to_be_named_where_there_are_several(tmp_path: Path) -> None:
    with store(tmp_path / "b", {0: SUCCESS}, values=("15", "30")), pytest.raises(PicktreeError) as refused:
        compare(f"{tmp_path}/b", f"{tmp_path}/b")
    assert str(refused.value) == (
        f"{tmp_path}/b: name one recipe as {tmp_path}/b@LABEL (one of Grasp.force=15; Grasp.force=30)"
    )


def test_a_recipe_of_which_nothing_was_run_is_not_compared(tmp_path: Path) -> None:
    with store(tmp_path / "b", {0: SUCCESS}, values=("15", "30")), pytest.raises(PicktreeError) as refused:
        compare(f"{tmp_path}/b@15", f"{tmp_path}/b@30")
    assert str(refused.value) == (f"{tmp_path}/b@30: none of its jobs was run: there is nothing to compare")


def test_jobs_of_other_arithmetic_are_told_of() -> None:
    here = Arithmetic({"glibc": "2.36"}, {}, {"glibc": "01"})
    there = Arithmetic({"glibc": "2.41"}, {}, {"glibc": "02"})
    sample = np.random.default_rng(1)
    a = replace(recipe("A", range(5), sample), arithmetics=(here,))
    b = replace(recipe("B", range(5), sample), arithmetics=(there,))
    said = "recorded with other arithmetic (glibc 2.36, in B 2.41): the runs may diverge"
    assert text_of(compare_recipes(a, b)).splitlines()[3] == said
    assert json.loads(json_text_of(compare_recipes(a, b)))["arithmetic"] == said
    assert compare_recipes(a, replace(b, arithmetics=(here,))).arithmetic == ""
    mixed = compare_recipes(replace(a, arithmetics=(here, there)), replace(b, arithmetics=(here,)))
    assert mixed.arithmetic == said.replace("2.36, in B 2.41", "2.41, in B 2.36")


def test_the_arithmetic_of_jobs_comes_from_their_rows(tmp_path: Path) -> None:
    there = Arithmetic({"glibc": "2.41"}, {"numpy": "X86_V3"}, {"glibc": "02"})
    with store(tmp_path / "b", {}) as made:
        for job in list(made.jobs())[:2]:
            made.record(job.id, JobRows(SUCCESS, versions={"numpy": "2.0", **there.words()}))
    assert read_recipe(f"{tmp_path}/b").arithmetics == (there,)
