"""Drivers of failure: settings, scenes, robots and items of a batch, ranked by their effect on failures.

Each value of a factor is compared with the other values of the same factor, seed by seed. In a complete plan
every value meets the same seeds and the same other settings, so that the mean difference is its effect. Runs
of one seed share items and faults: of `n` seeds, the least p value is 2 / 2^n.
"""

from __future__ import annotations

import json
import math
import shlex
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

from picktree.logs import Interval, Rate, rate

from .comparison import paired_difference
from .rates import SIGNIFICANCE_LEVEL, holm
from .store import Store

Subject: TypeAlias = Literal["job", "item"]
"""Subject that fails: a job that misses its goal, or an item that is not at its destination."""


@dataclass(frozen=True, slots=True)
class FailureDriver:
    """Value of a factor with its effect on failures, against the other values of the factor."""

    factor: str
    """Name of the setting, or `mission`, `scene`, `robot`, `faults`, `kind`, `colour`."""
    value: str
    subject: Subject
    failed: Rate
    """Share of failures with this value."""
    others: Rate
    """Share of failures with the other values."""
    difference: float
    """Share with this value minus that with the others: mean over the seeds that have both."""
    interval: Interval
    """95 % interval of the difference: BCa bootstrap over the seeds."""
    p_value: float
    """Two-sided p value: permutation within the seeds."""
    adjusted: float = 1.0
    """P value by Holm's method over all compared values."""

    @property
    def name(self) -> str:
        return f"{self.factor}={self.value}"

    @property
    def significant(self) -> bool:
        return self.adjusted < SIGNIFICANCE_LEVEL


@dataclass(frozen=True, slots=True)
class RunPair:
    """Failure with the value of a driver and the nearest success without it, for `diff` and `whatif`."""

    driver: str
    failure: str
    """Id of the job that failed."""
    success: str
    seed: int
    """Seed of the failure."""
    same_seed: bool
    others: tuple[str, ...]
    """Names of other factors in which both jobs differ."""
    diff: str
    """Command that compares both runs."""
    whatif: str
    """Command that resumes the failed run before its first failure, with the parameter of the success."""
    remake: tuple[str, ...] = ()
    """Commands that make the logs which were not kept."""


@dataclass(frozen=True, slots=True)
class DriverRanking:
    """Drivers of failure, the clearest and strongest first, and a pair of runs for the first one."""

    drivers: tuple[FailureDriver, ...] = ()
    pair: RunPair | None = None
    seeds: int = 0
    """Number of seeds of the jobs."""

    @property
    def least_seeds(self) -> int:
        """Least number of seeds with which a value can be significant."""
        return math.ceil(math.log2(2 * max(len(self.drivers), 1) / SIGNIFICANCE_LEVEL))

    def to_json(self) -> dict[str, Any]:
        return {
            "drivers": [
                {**asdict(each), "name": each.name, "significant": each.significant} for each in self.drivers
            ],
            "pair": None if self.pair is None else asdict(self.pair),
            "too_few_seeds": next(self._too_few_seeds(), None),
        }

    def _too_few_seeds(self) -> Iterator[str]:
        if self.drivers and self.seeds < self.least_seeds:
            yield f"{self.seeds} seeds: no value can be significant with fewer than {self.least_seeds}"

    def lines(self) -> Iterator[str]:
        """Yield a table for a terminal; nothing without a compared value."""
        if not self.drivers:
            return
        shown = self.drivers[:_MAX_SHOWN]
        width = max(len(_TITLE), *(len(each.name) for each in shown))
        head = f"{_TITLE:<{width}}  {'failed with it':<22}  {'with others':<22}  "
        yield f"{head}{'difference, 95 % interval':<28} {'p':>7} {'Holm':>7}"
        for each in shown:
            low, high = 100 * each.interval.low, 100 * each.interval.high
            difference = f"{100 * each.difference:+.1f} % ({low:+.1f} … {high:+.1f})"
            p_values = " ".join(f"{_p_text(p):>7}" for p in (each.p_value, each.adjusted))
            line = f"{each.name:<{width}}  {_share(each.failed):<22}  {_share(each.others):<22}  "
            yield f"{line}{difference:<28} {p_values}{' *' if each.significant else ''}"
        if len(self.drivers) > len(shown):
            yield f"and {len(self.drivers) - len(shown)} values more"
        yield from self._too_few_seeds()
        if self.pair is not None:
            yield from _pair_lines(self.pair)


_TITLE = "what drives failure"
_MAX_SHOWN = 10


def rank_drivers(store: Store) -> DriverRanking:
    """Rank the values of all factors. Raises PicktreeError when the results cannot be read."""
    jobs = _jobs(store)
    if not any(job.failed for job in jobs):
        return DriverRanking()
    items = _rows(
        store,
        "SELECT seed, kind, colour, verdict <> 'sorted' FROM items JOIN jobs USING (job) "
        "WHERE verdict <> 'no destination' ORDER BY job, item",
    )
    drivers = [
        *_drivers("job", [(job.seed, job.factors, job.failed) for job in jobs]),
        *_drivers("item", [(seed, {"kind": k, "colour": c}, bool(failed)) for seed, k, c, failed in items]),
    ]
    adjusted = holm([each.p_value for each in drivers])
    ranked = sorted(
        (replace(each, adjusted=p) for each, p in zip(drivers, adjusted, strict=True)),
        key=lambda each: (not each.significant, -abs(each.difference), each.name),
    )
    pair = _pair(store.path.parent, jobs, ranked[0]) if ranked else None
    return DriverRanking(tuple(ranked), pair, len({job.seed for job in jobs}))


@dataclass(frozen=True, slots=True)
class _Job:
    id: str
    seed: int
    failed: bool
    factors: Mapping[str, str]
    folder: str
    first: float | None
    """Time of the first failure, simulated s; None without one."""
    items: frozenset[tuple[str, str]] = frozenset()
    """Kinds and colours of items that are not at their destination, as `("kind", "can")`."""


def _jobs(store: Store) -> tuple[_Job, ...]:
    missed: defaultdict[str, set[tuple[str, str]]] = defaultdict(set)
    for job, kind, colour in _rows(
        store, "SELECT job, kind, colour FROM items WHERE verdict NOT IN ('sorted', 'no destination')"
    ):
        missed[job] |= {("kind", kind), ("colour", colour)}
    found = _rows(
        store,
        "SELECT job, seed, status <> 'success', mission, scene, robot, faults, settings, folder, "
        "(SELECT min(time) FROM failures WHERE failures.job = jobs.job) "
        "FROM jobs WHERE status <> 'waiting' ORDER BY number",
    )
    return tuple(
        _Job(
            job,
            seed,
            bool(failed),
            {
                "mission": Path(mission).stem,
                "scene": Path(scene).stem or "own",
                "robot": Path(robot).stem or "own",
                "faults": Path(faults).stem or "none",
                **json.loads(settings),
            },
            folder,
            first,
            frozenset(missed[job]),
        )
        for job, seed, failed, mission, scene, robot, faults, settings, folder, first in found
    )


def _drivers(
    subject: Subject, outcomes: Sequence[tuple[int, Mapping[str, str], bool]]
) -> Iterator[FailureDriver]:
    """Yield the compared values of all factors. `outcomes`: seed, values by factor, and whether it failed.

    Jobs of one seed have the same items and faults: they are one block, not as many samples.
    """
    for factor in dict.fromkeys(name for _, values, _ in outcomes for name in values):
        blocks: defaultdict[int, _Counts] = defaultdict(_counts)
        counts = _counts()
        for seed, values, failed in outcomes:
            if factor in values:
                for count in (blocks[seed][values[factor]], counts[values[factor]]):
                    count[0] += failed
                    count[1] += 1
        failed, total = (sum(count[n] for count in counts.values()) for n in (0, 1))
        for value, (own, size) in _compared(counts):
            both = [_shares(each, value) for each in blocks.values() if value in each and len(each) > 1]
            found = paired_difference(both)
            if found.count > 1:
                yield FailureDriver(
                    factor,
                    value,
                    subject,
                    rate(own, size),
                    rate(failed - own, total - size),
                    found.mean,
                    found.interval,
                    found.p_value,
                )


_Counts: TypeAlias = defaultdict[str, list[int]]
"""Failures and all, by value."""


def _counts() -> _Counts:
    return defaultdict(lambda: [0, 0])


def _compared(counts: Mapping[str, Sequence[int]]) -> list[tuple[str, Sequence[int]]]:
    """Return the values to be compared: of two the worse one, since both say the same."""
    values = list(counts.items())
    if len(values) == 2:
        return [max(values, key=lambda each: (each[1][0] / each[1][1], each[0]))]
    return values if len(values) > 2 else []


def _shares(counts: Mapping[str, Sequence[int]], value: str) -> tuple[float, float]:
    """Return the shares of failures with one seed, with the other values and with this one."""
    own, others = counts[value], [count for name, count in counts.items() if name != value]
    return sum(c[0] for c in others) / sum(c[1] for c in others), own[0] / own[1]


def _pair(folder: Path, jobs: Sequence[_Job], driver: FailureDriver) -> RunPair | None:
    """Return the nearest pair of jobs: equal in most other factors, then in the seed, then with kept logs."""
    failed_with, succeeded = _sides(jobs, driver)
    best: tuple[tuple[int, bool, int], _Job, _Job] | None = None
    for failure in failed_with:
        for success in succeeded:
            apart = _apart(failure, success, driver)
            key = (len(apart), failure.seed != success.seed, (not failure.folder) + (not success.folder))
            if failure.id != success.id and (best is None or key < best[0]):
                best = key, failure, success
        if best is not None and best[0] == (0, False, 0):
            break
    if best is None:
        return None
    _, failure, success = best
    a, b = (shlex.quote(f"{folder}@{job.id}") for job in (failure, success))
    return RunPair(
        driver.name,
        failure.id,
        success.id,
        failure.seed,
        failure.seed == success.seed,
        tuple(_apart(failure, success, driver)),
        f"picktree diff {a} {b}",
        f"picktree whatif {a} --at {failure.first or 0.0:g}s{_setting(success, driver)}",
        tuple(f"picktree resim {name}" for name, job in ((a, failure), (b, success)) if not job.folder),
    )


def _setting(success: _Job, driver: FailureDriver) -> str:
    """Return the option that gives the mission's parameter the value of the success; empty for others."""
    if driver.subject == "item" or driver.factor in _FILES or "." in driver.factor:
        return ""
    return f" --set {shlex.quote(f'{driver.factor}={success.factors[driver.factor]}')}"


_FILES = ("mission", "scene", "robot", "faults")
"""Factors that are files."""


def _sides(jobs: Sequence[_Job], driver: FailureDriver) -> tuple[list[_Job], list[_Job]]:
    """Return the failures that have the worse value, and the successes that lack it."""
    if driver.subject == "item":
        fault = (driver.factor, driver.value)
        return [job for job in jobs if fault in job.items], [job for job in jobs if not job.failed]
    with_it = [job for job in jobs if job.factors.get(driver.factor) == driver.value]
    without = [job for job in jobs if job.factors.get(driver.factor) != driver.value]
    worse, better = (with_it, without) if driver.difference > 0 else (without, with_it)
    return [job for job in worse if job.failed], [job for job in better if not job.failed]


def _apart(a: _Job, b: _Job, driver: FailureDriver) -> list[str]:
    names = dict.fromkeys((*a.factors, *b.factors))
    return [n for n in names if n != driver.factor and a.factors.get(n) != b.factors.get(n)]


def _pair_lines(pair: RunPair) -> Iterator[str]:
    seed = f"both with seed {pair.seed}" if pair.same_seed else "of different seeds"
    others = f"; they differ in {', '.join(pair.others)}, too" if pair.others else ""
    yield f"nearest failure and success for {pair.driver}, {seed}{others}"
    for command in (*pair.remake, pair.diff, pair.whatif):
        yield f"  {command}"


def _share(found: Rate) -> str:
    return f"{found.successes} of {found.total} ({100 * (found.share or 0.0):.1f} %)"


def _p_text(value: float) -> str:
    return f"{value:.3f}" if value >= 0.001 else "< 0.001"


def _rows(store: Store, sql: str) -> Iterable[tuple[Any, ...]]:
    rows: Any = store.query(sql).rows
    return rows
