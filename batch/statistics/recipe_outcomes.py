"""What the jobs of one recipe came to, as far as recipes are compared."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...errors import PicktreeError
from ...logs.schema.arithmetic_record import Arithmetic
from ..results.job_names import choose_label, split
from ..results.store import NAME, Store


@dataclass(frozen=True, slots=True)
class Outcome:
    """Of one job; None where it crashed before it could be told."""

    job: str
    seed: int
    success: bool
    items_sorted: int | None
    picks_tried: int | None
    picks_held: int | None
    sim_seconds: float | None
    folder: str
    """Of the log, below the batch's folder; empty when it was not kept."""
    causes: Mapping[str, int] = field(default_factory=dict[str, int])
    """Of its failures, how often each."""

    @property
    def failures(self) -> int:
        return sum(self.causes.values())

    @property
    def in_vain(self) -> int | None:
        """Grasps that brought no item to its bin. A grasp that is broken off between closing and lifting is
        not counted as tried, though its item may be sorted by the next."""
        if self.picks_tried is None or self.items_sorted is None:
            return None
        return max(self.picks_tried - self.items_sorted, 0)

    @property
    def seconds_a_pick(self) -> float | None:
        return (
            self.sim_seconds / self.picks_held if self.sim_seconds is not None and self.picks_held else None
        )


@dataclass(frozen=True, slots=True)
class Recipe:
    """One recipe of a batch, and what came of its jobs, by seed."""

    label: str
    """With the batch's folder, as it is named on the command line."""
    folder: Path
    outcomes: Mapping[int, Outcome]
    arithmetics: tuple[Arithmetic, ...] = ()
    """Of the processes that computed its jobs, without repetition."""


def read_recipe(where: str) -> Recipe:
    """`where`: a batch's folder, or FOLDER@LABEL for one recipe of several.

    Raises PicktreeError when there is no such recipe, or none of its jobs was run.
    """
    folder, wanted = split(where)
    with Store(folder / NAME) as store:
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
        seed: Outcome(job, seed, bool(success), *rest, causes=causes.get(job, Counter()))
        for variant, job, seed, success, *rest in jobs
        if variant == label
    }
    if not found:
        raise PicktreeError(f"{where}: none of its jobs was run: there is nothing to compare")
    name = folder.absolute().name
    return Recipe(
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
