"""Differences of two recipes in a number per job: mean, bootstrap interval, permutation test."""

from __future__ import annotations

import math
import warnings
from collections import Counter
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...files.errors import PicktreeError
from ...logs.schema.json_records import Arithmetic
from .rates import CONFIDENCE, Interval
from .store import RESULTS_FILE, Store, choose_label, split


@dataclass(frozen=True, slots=True)
class JobOutcome:
    """Outcome of one job; None for values that are unknown after a crash."""

    job: str
    seed: int
    success: bool
    items_sorted: int | None
    picks_tried: int | None
    picks_held: int | None
    sim_seconds: float | None
    folder: str
    """Folder of the log, relative to the batch's folder; empty when it was not kept."""
    causes: Mapping[str, int] = field(default_factory=dict[str, int])
    """Number of failures of the job by cause."""

    @property
    def failures(self) -> int:
        return sum(self.causes.values())

    @property
    def in_vain(self) -> int | None:
        """Number of grasps that brought no item to its bin; None when unknown.

        A grasp that is broken off between closing and lifting does not count as tried, though its item may be
        sorted by the next.
        """
        if self.picks_tried is None or self.items_sorted is None:
            return None
        return max(self.picks_tried - self.items_sorted, 0)

    @property
    def seconds_a_pick(self) -> float | None:
        return (
            self.sim_seconds / self.picks_held if self.sim_seconds is not None and self.picks_held else None
        )


@dataclass(frozen=True, slots=True)
class RecipeOutcomes:
    """Recipe of a batch with the outcomes of its jobs by seed."""

    label: str
    """Label with the batch's folder, as on the command line."""
    folder: Path
    outcomes: Mapping[int, JobOutcome]
    arithmetics: tuple[Arithmetic, ...] = ()
    """Arithmetics of the processes that computed its jobs, without repetition."""


def read_recipe(where: str) -> RecipeOutcomes:
    """Read a recipe's outcomes. `where`: a batch's folder, or FOLDER@LABEL for one recipe of several.

    Raises PicktreeError when there is no such recipe, or none of its jobs was run.
    """
    folder, wanted = split(where)
    with Store(folder / RESULTS_FILE) as store:
        labels = list(dict.fromkeys(job.variant.label for job in store.jobs()))
        label = choose_label(wanted, labels, where, folder)
        jobs: Any = store.query(
            "SELECT variant, job, seed, status = 'success', items_sorted, picks_tried, picks_held, "
            "sim_seconds, folder FROM jobs WHERE status <> 'waiting' ORDER BY number"
        ).rows
        failures: Any = store.query("SELECT job, cause, count(*) FROM failures GROUP BY job, cause").rows
        versions: Any = store.query("SELECT job, library, version FROM versions").rows
    causes: dict[str, Counter[str]] = {}
    for job, cause, count in failures:
        causes.setdefault(job, Counter())[cause] = count
    found = {
        seed: JobOutcome(job, seed, bool(success), *rest, causes=causes.get(job, Counter()))
        for variant, job, seed, success, *rest in jobs
        if variant == label
    }
    if not found:
        raise PicktreeError(f"{where}: none of its jobs was run: there is nothing to compare")
    name = folder.absolute().name
    return RecipeOutcomes(
        name if len(labels) == 1 else f"{name}@{label}",
        folder,
        found,
        _arithmetics(versions, {outcome.job for outcome in found.values()}),
    )


def _arithmetics(versions: Iterable[tuple[str, str, str]], jobs: Container[str]) -> tuple[Arithmetic, ...]:
    words: dict[str, dict[str, str]] = {}
    for job, library, version in versions:
        if job in jobs:
            words.setdefault(job, {})[library] = version
    found: list[Arithmetic] = []
    for table in words.values():
        arithmetic = Arithmetic.from_words(table)
        if arithmetic not in found:
            found.append(arithmetic)
    return tuple(found)


_RESAMPLES = 9999
_RESAMPLING_SEED = 0
"""Seed of the resampling: equal numbers give equal intervals and p values."""
_Numbers: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MeanDifference:
    """Mean of B minus that of A."""

    a: float | None
    """Mean of A; None without values."""
    b: float | None
    interval: Interval
    """Bootstrap interval (BCa, 95 %). Infinite with too few values."""
    p_value: float
    """Two-sided p value of a permutation test: exact where few jobs differ, else by resampling."""
    count: int
    """Number of pairs, or of jobs of the smaller side."""

    @property
    def mean(self) -> float:
        return self.b - self.a if self.a is not None and self.b is not None else 0.0


def paired_difference(pairs: Sequence[tuple[float, float]]) -> MeanDifference:
    """Compare values of A and B for the same seeds.

    The test swaps A and B within pairs, which changes nothing when both are one recipe. Equal pairs do not
    count for it.
    """
    if not pairs:
        return MeanDifference(None, None, Interval(-math.inf, math.inf), 1.0, 0)
    values = np.array(pairs, dtype=float)
    apart = values[:, 1] - values[:, 0]
    changed = apart[apart != 0.0]
    p_value = 1.0
    if len(changed) > 1:
        p_value = _p_value((changed,), _mean, "samples")
    mean_a, mean_b = (float(mean) for mean in values.mean(axis=0))
    interval = _interval((apart,), _mean)
    return MeanDifference(mean_a, mean_b, interval, p_value, len(pairs))


def unpaired_difference(a: Sequence[float], b: Sequence[float]) -> MeanDifference:
    """Compare values of independent jobs. The test redistributes the jobs to A and B."""
    one, other = np.array(a, dtype=float), np.array(b, dtype=float)
    mean_a = float(one.mean()) if len(one) else None
    mean_b = float(other.mean()) if len(other) else None
    count = min(len(one), len(other))
    if not count:
        return MeanDifference(mean_a, mean_b, Interval(-math.inf, math.inf), 1.0, 0)
    p_value = 1.0
    if len({*one.tolist(), *other.tolist()}) > 1:
        p_value = _p_value((one, other), _apart, "independent")
    return MeanDifference(mean_a, mean_b, _interval((one, other), _apart), p_value, count)


def _mean(values: _Numbers, axis: int = -1) -> Any:
    return np.mean(values, axis=axis)


def _apart(a: _Numbers, b: _Numbers, axis: int = -1) -> Any:
    return np.mean(b, axis=axis) - np.mean(a, axis=axis)


def _p_value(data: tuple[_Numbers, ...], statistic: Callable[..., Any], kind: str) -> float:
    from scipy import stats

    found = stats.permutation_test(
        data,
        statistic,
        permutation_type=kind,
        vectorized=True,
        n_resamples=_RESAMPLES,
        rng=np.random.default_rng(_RESAMPLING_SEED),
    )
    return min(float(found.pvalue), 1.0)


def _interval(data: tuple[_Numbers, ...], statistic: Callable[..., Any]) -> Interval:
    from scipy import stats

    if min(map(len, data)) < 2:
        return Interval(-math.inf, math.inf)
    if all(np.all(values == values[0]) for values in data):
        mean = float(statistic(*data))
        return Interval(mean, mean)
    for method in ("BCa", "percentile"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", stats.DegenerateDataWarning)  # then the plainer method is taken
            found = stats.bootstrap(
                data,
                statistic,
                confidence_level=CONFIDENCE,
                n_resamples=_RESAMPLES,
                method=method,
                vectorized=True,
                rng=np.random.default_rng(_RESAMPLING_SEED),
            ).confidence_interval
        if math.isfinite(found.low) and math.isfinite(found.high):
            return Interval(float(found.low), float(found.high))
    return Interval(-math.inf, math.inf)
