"""Comparisons that end when they may: hand-computed evidence, and false decisions under optional stopping."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from picktree.apps.batch import Batch, summarise
from picktree.apps.batch.batch_decision import decisions
from picktree.apps.batch.executor import Event, JobFinished, JobOrder
from picktree.apps.batch.plan import plan_of, read_plan, write_plan
from picktree.apps.batch.sequential_tests import (
    MeanSequence,
    compare_sequentially,
    rate_sequence,
    sign_evidence,
)
from picktree.apps.batch.tables import JobRows
from picktree.files import PicktreeError

from .test_store import MISSED, SUCCESS, store
from .watching import Remembering

EXAMPLE = Path(__file__).parents[2] / "examples" / "one_pick.yaml"


def test_the_evidence_is_that_of_the_evenly_mixed_bet() -> None:
    assert sign_evidence(0, 0) == 1.0
    assert sign_evidence(3, 0) == pytest.approx(2**3 / 4)
    assert sign_evidence(2, 2) == pytest.approx(2**4 / 30)  # B(3, 3) = 1 / 30


def test_a_verdict_needs_evidence_for_its_level() -> None:
    seven = compare_sequentially([(0.0, 1.0)] * 7)
    assert (seven.verdict, seven.decided) == ("open", False)
    assert compare_sequentially([(0.0, 1.0)] * 8).verdict == "B"  # 2⁸ / 9 ≥ 20
    assert compare_sequentially([(1.0, 0.0)] * 8).verdict == "A"
    assert compare_sequentially([(1.0, 1.0)] * 200).verdict == "equal"
    assert compare_sequentially([(1.0, 1.0)] * 200, margin=0.01).verdict == "open"


def test_false_decisions_stay_rare_although_each_seed_is_looked_at() -> None:
    """Equal recipes, looked at after each of 150 seeds: the fixed-number test would be wrong in a fifth."""
    rng = np.random.default_rng(1)
    wrong = 0
    for _ in range(400):
        signs = np.where(rng.random(150) < 0.4, np.where(rng.random(150) < 0.5, 1, -1), 0)
        only_a, only_b = np.cumsum(signs < 0), np.cumsum(signs > 0)
        wrong += any(sign_evidence(int(a), int(b)) >= 20 for a, b in zip(only_a, only_b, strict=True))
    assert wrong <= 20


def test_sequences_cover_the_truth_at_all_times() -> None:
    rng = np.random.default_rng(2)
    missed = 0
    for _ in range(100):
        values = rng.choice([-1.0, 0.0, 1.0], size=80, p=[0.1, 0.6, 0.3]).tolist()
        sequence, outside = MeanSequence(), False
        for value in values:
            sequence.add(value)
            outside |= not sequence.interval.low <= 0.2 <= sequence.interval.high
        missed += outside
    assert missed <= 5
    shares = rng.random((100, 50)) < 0.8
    outside = 0
    for run in shares.cumsum(axis=1):
        intervals = (rate_sequence(int(good), n) for n, good in enumerate(run, 1))
        outside += any(not each.low <= 0.8 <= each.high for each in intervals)
    assert outside <= 5


def test_seeds_count_in_the_order_of_the_plan_only(tmp_path: Path) -> None:
    """Seed 9 of B is recorded before its seed 7: it does not count yet."""
    rows = dict.fromkeys(range(10), MISSED) | {10 + n: SUCCESS for n in (*range(7), 9)}
    with store(tmp_path / "b", rows, values=("1", "3")) as made:
        words = {"missions": [str(EXAMPLE)], "seeds": "0:10", "set": {"Grasp.force": ["1 N", "3 N"]}}
        plan = replace(plan_of({**words, "until": "decided"}), seeds=tuple(range(10)))
        (found,) = decisions(made, plan)
        assert (found.result.seeds, found.result.only_b, found.result.verdict) == (7, 7, "open")
        write_plan(plan, tmp_path / "b")
        assert read_plan(tmp_path / "b") == plan
        summary = summarise(made)
        assert "not decided yet after 7 seeds" in summary.to_text().splitlines()[1]
        (a, b) = summary.recipes
        assert a.sequence is not None
        assert b.sequence is not None
        assert a.sequence.high < b.sequence.low


class Pretending:
    """Executor whose jobs succeed with the second setting only; `made` counts them."""

    slots = 1

    def __init__(self, good: frozenset[str]) -> None:
        self.good, self.made = good, 0
        self._ends: list[Event] = []

    def submit(self, order: JobOrder) -> None:
        self.made += 1
        order.folder.mkdir(parents=True)
        row = SUCCESS if order.job in self.good else replace(MISSED, folder="")
        order.result.write_bytes(JobRows(row).to_json())
        self._ends = [JobFinished(order)]

    def wait(self, seconds: float) -> list[Event]:
        ends, self._ends = self._ends, []
        return ends

    def stop(self) -> None: ...
    def close(self) -> None: ...


def test_a_batch_ends_when_its_recipes_are_told_apart(tmp_path: Path) -> None:
    words = {"missions": [str(EXAMPLE)], "seeds": "0:40", "set": {"Grasp.force": ["1 N", "3 N"]}}
    with Batch.create(tmp_path / "b", plan_of({**words, "until": "decided"})) as batch:
        good = frozenset(job.id for job in batch.jobs if job.variant.settings["Grasp.force"] == "3 N")
        executor = Pretending(good)
        assert batch.run(executor, Remembering())
        assert batch.decided
        assert executor.made == 2 * 8  # 2⁸ / 9 ≥ 20
        text = summarise(batch.store).to_text()
    assert "B reaches the goal more often after 8 seeds: only A 0, only B 8, e-value 28.4" in text
    with Batch.resume(tmp_path / "b") as again:
        assert again.run(executor, Remembering())
        assert executor.made == 16


def test_one_recipe_has_nothing_to_decide() -> None:
    with pytest.raises(PicktreeError) as refused:
        plan_of({"missions": [str(EXAMPLE)], "seeds": "0:3", "until": "decided"})
    assert str(refused.value) == (
        "--until decided: the plan has one recipe, and nothing to decide: "
        "give a setting, scene or mission at least two values"
    )
