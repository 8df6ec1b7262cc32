"""Forecast of a batch: its matrix, and the CPU time that recorded jobs of the same missions took."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from picktree.files import PicktreeError

from .plan import PLAN_FILE, BatchPlan, read_plan
from .store import RESULTS_FILE, run_query

MAX_BATCHES = 50
"""Number of recorded batches that are read, the newest ones."""


@dataclass(frozen=True, slots=True)
class RecordedCost:
    """Cost of recorded jobs of one mission in one scene."""

    jobs: int
    cpu_seconds: float
    """CPU time of a job, mean, s."""


@dataclass(frozen=True, slots=True)
class VariantForecast:
    """Cell of the matrix: one variant with its cost."""

    label: str
    mission: str
    scene: str
    """Scene that replaces the mission's; empty: the mission's own."""
    robot: str
    faults: str
    settings: Mapping[str, str]
    jobs: int
    cpu_seconds: float | None
    """CPU time of all its jobs, s; None when no job of its mission is recorded."""
    recorded: int
    """Number of recorded jobs behind it."""


@dataclass(frozen=True, slots=True)
class BatchForecast:
    """Matrix of a plan with its cost."""

    name: str
    backend: str
    keep: str
    variants: tuple[VariantForecast, ...]
    workers: int

    @property
    def jobs(self) -> int:
        return sum(each.jobs for each in self.variants)

    @property
    def cpu_seconds(self) -> float | None:
        """CPU time of the whole batch, s; None when a variant's is unknown."""
        known = [each.cpu_seconds for each in self.variants if each.cpu_seconds is not None]
        return sum(known) if len(known) == len(self.variants) else None

    @property
    def wall_seconds(self) -> float | None:
        """Wall time with a core for each worker, s; None when a variant's cost is unknown."""
        total = self.cpu_seconds
        return None if total is None else total / max(1, min(self.workers, self.jobs))

    def to_json(self) -> dict[str, Any]:
        totals = {"jobs": self.jobs, "cpu_seconds": self.cpu_seconds, "wall_seconds": self.wall_seconds}
        return {**asdict(self), **totals}

    def to_text(self) -> str:
        """Return a line for each variant and one for all, without a trailing newline."""
        width = max(len(each.label) for each in self.variants)
        lines = [
            f"{each.label:{width}}  {each.jobs:6} jobs  {_duration(each.cpu_seconds)} CPU"
            + (f", by {each.recorded} recorded" if each.recorded else "")
            for each in self.variants
        ]
        wall = self.wall_seconds
        cost = (
            "cost unknown, because not every recipe has recorded jobs"
            if wall is None
            else f"about {_duration(wall)}"
        )
        return "\n".join([*lines, f"{self.jobs} jobs on {self.workers} workers: {cost}"])


def forecast(plan: BatchPlan, recorded: Iterable[Path], workers: int | None = None) -> BatchForecast:
    """Return the matrix of a checked plan with its cost, by the jobs of recorded batches in those folders.

    A job costs the mean of recorded ones with its mission's file name, scene and backend. Without recorded
    jobs in the scene, those with its mission and backend count.
    """
    costs = _costs(recorded, plan.backend)
    slots = workers or len(os.sched_getaffinity(0))
    variants: list[VariantForecast] = []
    for variant in plan.variants():
        scene = Path(variant.scene).stem if variant.scene else ""
        cost = costs.get((variant.mission.name, scene)) or costs.get((variant.mission.name, None))
        variants.append(
            VariantForecast(
                variant.label,
                variant.mission.name,
                scene,
                Path(variant.robot).stem if variant.robot else "",
                variant.faults.stem if variant.faults else "",
                variant.settings,
                len(plan.seeds),
                None if cost is None else cost.cpu_seconds * len(plan.seeds),
                0 if cost is None else cost.jobs,
            )
        )
    return BatchForecast(plan.name, plan.backend, plan.keep, tuple(variants), slots)


def recorded_batches(folder: Path) -> list[Path]:
    """Return the folders of batches in a folder, the newest first."""
    found = [path.parent for path in folder.glob(f"*/{RESULTS_FILE}") if (path.parent / PLAN_FILE).is_file()]
    found.sort(key=lambda each: (each / RESULTS_FILE).stat().st_mtime, reverse=True)
    return found[:MAX_BATCHES]


def _costs(folders: Iterable[Path], backend: str) -> dict[tuple[str, str | None], RecordedCost]:
    """Return costs by mission and scene; under the scene None those of all scenes together."""
    sums: dict[tuple[str, str | None], tuple[int, float]] = {}
    for folder in folders:
        try:
            if read_plan(folder).backend != backend:
                continue
            rows: Any = run_query(
                folder / RESULTS_FILE,
                "SELECT mission, scene, count(cpu_seconds), coalesce(sum(cpu_seconds), 0) FROM jobs "
                "WHERE status NOT IN ('waiting', 'crashed') GROUP BY mission, scene",
            ).rows
        except PicktreeError:
            continue
        for mission, scene, jobs, seconds in rows:
            for key in ((Path(mission).name, Path(scene).stem if scene else ""), (Path(mission).name, None)):
                before = sums.get(key, (0, 0.0))
                sums[key] = (before[0] + jobs, before[1] + seconds)
    return {key: RecordedCost(jobs, total / jobs) for key, (jobs, total) in sums.items() if jobs}


def _duration(seconds: float | None) -> str:
    """Return a time in words.

    >>> _duration(42), _duration(4000), _duration(None)
    ('42 s', '67 min', 'unknown')
    """
    if seconds is None:
        return "unknown"
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
