"""Comparison of two recipes: differences beyond chance, by interval and permutation test, and seeds with a
changed result; text and JSON.
"""

from __future__ import annotations

import json
import math
import shlex
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Container, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from picktree.analysis import Run
from picktree.analysis.compare import Alignment, Divergence, align, message_differences, run_diff
from picktree.files import PicktreeError
from picktree.logs import (
    CONFIDENCE,
    FigureCounts,
    Interval,
    OperatorFigures,
    Rate,
    TimeToDone,
    arithmetic_record,
    node_visits,
    rate,
)

from .executor import Executor
from .local_executor import LocalExecutor
from .rates import (
    SIGNIFICANCE_LEVEL,
    Paired,
    difference_of_paired_rates,
    difference_of_rates,
    equal_rates_p,
    holm,
    paired,
)
from .rerun import remake_into
from .sequential_tests import SequentialResult, compare_sequentially
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
    figures: FigureCounts | None = None
    """Counts of the operators' figures; None after a crash."""

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
    arithmetics: tuple[arithmetic_record.Arithmetic, ...] = ()
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
        figures = store.figures()
    causes: dict[str, Counter[str]] = {}
    for job, cause, count in failures:
        causes.setdefault(job, Counter())[cause] = count
    found = {
        seed: JobOutcome(
            job, seed, bool(success), *rest, causes=causes.get(job, Counter()), figures=figures.get(job)
        )
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


def _arithmetics(
    versions: Iterable[tuple[str, str, str]], jobs: Container[str]
) -> tuple[arithmetic_record.Arithmetic, ...]:
    words: dict[str, dict[str, str]] = {}
    for job, library, version in versions:
        if job in jobs:
            words.setdefault(job, {})[library] = version
    found: list[arithmetic_record.Arithmetic] = []
    for table in words.values():
        arithmetic = arithmetic_record.Arithmetic.from_words(table)
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
        p_value = _p_value((changed,), np.mean, "samples")
    mean_a, mean_b = (float(mean) for mean in values.mean(axis=0))
    return MeanDifference(mean_a, mean_b, _interval((apart,), np.mean), p_value, len(pairs))


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


Side: TypeAlias = Literal["A", "B"]
_MIN_SHARED_SEED_SHARE = 0.5
"""Least share of the smaller side's seeds that both must have for a comparison by seed."""


@dataclass(frozen=True, slots=True)
class Criterion:
    """Criterion in which recipes are compared, with a test."""

    name: str
    words: str
    """Advantage of the better recipe in words."""
    more_is_better: bool
    difference: MeanDifference
    """Difference in a share for `goal`; else per job."""
    adjusted: float = 1.0
    """P value by Holm's method, over all criteria."""

    @property
    def better(self) -> Side | None:
        """Better side; None when chance explains the difference."""
        if self.adjusted >= SIGNIFICANCE_LEVEL or not self.difference.mean:
            return None
        return "B" if (self.difference.mean > 0) == self.more_is_better else "A"


@dataclass(frozen=True, slots=True)
class CurveDifference:
    """Greatest distance of two curves of time to done, and the test by Kolmogorov and Smirnov."""

    distance: float
    """Greatest difference of both shares, 0 … 1."""
    p_value: float
    """Two-sided p value for independent units."""
    time: float
    """Time at which the curves are farthest apart, simulated s; inf: after the last unit."""


def curve_difference(a: TimeToDone, b: TimeToDone) -> CurveDifference | None:
    """Compare two curves of time to done; failed units count as never done. None without units of both."""
    if not (a.ended and b.ended):
        return None
    from scipy import stats

    test: Any = stats
    never = 2 * max((*a.times, *b.times, 1.0))
    samples = [(*each.times, *([never] * (each.ended - len(each.times)))) for each in (a, b)]
    found: Any = test.ks_2samp(*samples)
    place = float(found.statistic_location)
    return CurveDifference(
        float(found.statistic), min(float(found.pvalue), 1.0), math.inf if place >= never else place
    )


@dataclass(frozen=True, slots=True)
class CauseChange:
    """Difference in failures of one cause, per job."""

    cause: str
    difference: MeanDifference
    adjusted: float = 1.0
    """P value by Holm's method, over all causes: they explain and do not decide."""


@dataclass(frozen=True, slots=True)
class ChangedSeed:
    """Seed on which one recipe succeeded and the other did not."""

    seed: int
    winner: Side
    logs: tuple[str, str] | None = None
    """Absolute paths of the logs of A and B, when both were kept."""
    missing: tuple[Side, ...] = ()
    """Sides whose log was not kept."""
    parting: str = ""
    """Place of the divergence in a line; empty when it was not searched."""


@dataclass(frozen=True, slots=True)
class RecipeComparison:
    label_a: str
    label_b: str
    success_a: Rate
    success_b: Rate
    paired: Paired | None
    """Paired result; None when the jobs are compared as independent ones."""
    criteria: tuple[Criterion, ...]
    causes: tuple[CauseChange, ...]
    """Changes of causes, the clearest first."""
    changed: tuple[ChangedSeed, ...]
    shared: int
    """Number of seeds that both have."""
    alone: int
    """Number of seeds that only one of them has."""
    figures: tuple[OperatorFigures, OperatorFigures]
    """Operators' figures of A and of B, over the compared jobs."""
    to_done: CurveDifference | None
    """Difference of the curves of time to done; None without units on both sides."""
    sequence: SequentialResult | None
    """Paired result that holds whenever the batch was stopped; None for independent jobs."""
    arithmetic: str = ""
    """Sentence when jobs were computed with different arithmetic, or it was not recorded; else empty."""

    @property
    def differ(self) -> bool:
        """Whether any criterion differs by more than chance explains; for equal recipes in 5 % of all
        cases."""
        return any(criterion.better for criterion in self.criteria)


def compare_recipes(a: RecipeOutcomes, b: RecipeOutcomes, *, unpaired: bool = False) -> RecipeComparison:
    """Compare two recipes by seed, or as independent jobs.

    They are independent when they share less than half of their seeds, or `unpaired` is set.
    """
    shared = sorted(set(a.outcomes) & set(b.outcomes))
    by_seed = not unpaired and len(shared) >= _MIN_SHARED_SEED_SHARE * min(len(a.outcomes), len(b.outcomes))
    pairs = [(a.outcomes[seed], b.outcomes[seed]) for seed in shared]
    of_a, of_b = (
        ([x for x, _ in pairs], [y for _, y in pairs])
        if by_seed
        else (list(a.outcomes.values()), list(b.outcomes.values()))
    )

    def difference(value: Callable[[JobOutcome], float | None]) -> MeanDifference:
        if by_seed:
            both = ((value(x), value(y)) for x, y in pairs)
            return paired_difference([(x, y) for x, y in both if x is not None and y is not None])
        return unpaired_difference(*(_known(map(value, side)) for side in (of_a, of_b)))

    rate_a, rate_b = (rate(sum(x.success for x in side), len(side)) for side in (of_a, of_b))
    table = paired([(x.success, y.success) for x, y in pairs]) if by_seed else None
    return RecipeComparison(
        a.label,
        b.label,
        rate_a,
        rate_b,
        table,
        _criteria(_goal(rate_a, rate_b, table), difference),
        _causes(of_a, of_b, difference),
        tuple(_changed(x, y, a, b) for x, y in pairs if x.success != y.success),
        len(shared),
        len(set(a.outcomes) ^ set(b.outcomes)),
        (figures_a := _figures(of_a), figures_b := _figures(of_b)),
        curve_difference(figures_a.time_to_done, figures_b.time_to_done),
        compare_sequentially([(x.success, y.success) for x, y in pairs]) if by_seed else None,
        _arithmetic_difference(a, b),
    )


def _figures(outcomes: Iterable[JobOutcome]) -> OperatorFigures:
    return OperatorFigures(tuple(each.figures for each in outcomes if each.figures is not None))


def _arithmetic_difference(a: RecipeOutcomes, b: RecipeOutcomes) -> str:
    """Return the difference in arithmetic between jobs of A and B, or within one of them; empty when none."""
    sides = ((a, b, "in B"), (a, a, "in other jobs of A"), (b, b, "in other jobs of B"))
    phrase = (
        arithmetic_record.arithmetic_difference(one, other, where)
        for first, second, where in sides
        for one in first.arithmetics
        for other in second.arithmetics
    )
    return next(filter(None, phrase), "")


def _criteria(
    goal: MeanDifference, difference: Callable[[Callable[[JobOutcome], float | None]], MeanDifference]
) -> tuple[Criterion, ...]:
    found = (
        Criterion("goal", "reaches the goal more often", True, goal),
        Criterion("items", "sorts more items", True, difference(lambda o: o.items_sorted)),
        Criterion("in_vain", "has fewer grasps that hold nothing", False, difference(lambda o: o.in_vain)),
        Criterion("failures", "has fewer failures", False, difference(lambda o: o.failures)),
        Criterion("seconds_a_pick", "picks faster", False, difference(lambda o: o.seconds_a_pick)),
    )
    adjusted = holm([criterion.difference.p_value for criterion in found])
    return tuple(replace(c, adjusted=p_value) for c, p_value in zip(found, adjusted, strict=True))


def _goal(a: Rate, b: Rate, table: Paired | None) -> MeanDifference:
    interval: Interval
    if table is not None:
        interval, p_value = difference_of_paired_rates(table), table.p_value
    else:
        interval, p_value = difference_of_rates(a, b), equal_rates_p(a, b)
    return MeanDifference(a.share, b.share, interval, p_value, min(a.total, b.total))


def _causes(
    a: Iterable[JobOutcome],
    b: Iterable[JobOutcome],
    difference: Callable[[Callable[[JobOutcome], float | None]], MeanDifference],
) -> tuple[CauseChange, ...]:
    names = sorted({cause for outcome in (*a, *b) for cause in outcome.causes})
    found = [difference(lambda outcome, cause=cause: outcome.causes.get(cause, 0)) for cause in names]
    adjusted = holm([each.p_value for each in found])
    changes = [CauseChange(*each) for each in zip(names, found, adjusted, strict=True)]
    return tuple(sorted(changes, key=lambda c: (c.difference.p_value, -abs(c.difference.mean), c.cause)))


def _changed(x: JobOutcome, y: JobOutcome, a: RecipeOutcomes, b: RecipeOutcomes) -> ChangedSeed:
    folders = [
        str((recipe.folder / o.folder).absolute()) if o.folder else "" for recipe, o in ((a, x), (b, y))
    ]
    sides: tuple[Side, Side] = ("A", "B")
    return ChangedSeed(
        x.seed,
        "A" if x.success else "B",
        (folders[0], folders[1]) if all(folders) else None,
        tuple(side for side, folder in zip(sides, folders, strict=True) if not folder),
    )


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def with_divergences(
    found: RecipeComparison,
    a: RecipeOutcomes,
    b: RecipeOutcomes,
    most: int,
    *,
    remake: bool = False,
    say: Callable[[str], None] = lambda text: None,
) -> RecipeComparison:
    """Add the divergence of the runs for up to `most` of the seeds with a changed result.

    `remake`: recompute missing logs for it, and delete them afterwards; `say` is called for each.
    """
    changed = list(found.changed)
    able = [n for n, each in enumerate(changed) if remake or each.logs is not None]
    with LocalExecutor(1) as executor:
        for n in able[:most]:
            with _logs(changed[n], a, b, executor, say) as logs:
                changed[n] = replace(changed[n], parting=_divergence_text(*logs))
    return replace(found, changed=tuple(changed))


@contextmanager
def _logs(
    changed: ChangedSeed, a: RecipeOutcomes, b: RecipeOutcomes, executor: Executor, say: Callable[[str], None]
) -> Generator[tuple[Path, Path]]:
    def log(recipe: RecipeOutcomes, side: Side, scratch: Path) -> Path:
        outcome = recipe.outcomes[changed.seed]
        kept = recipe.folder / outcome.folder
        if outcome.folder and kept.is_dir():
            return kept
        say(f"seed {changed.seed} of {side}")
        with Store(recipe.folder / RESULTS_FILE) as store:
            job = next(job for job in store.jobs() if job.id == outcome.job)
            return remake_into(store, job, scratch, executor)

    with tempfile.TemporaryDirectory(prefix="picktree-") as away:
        yield log(a, "A", Path(away) / "a"), log(b, "B", Path(away) / "b")


def _divergence_text(log_a: Path, log_b: Path) -> str:
    try:
        with Run(log_a) as a, Run(log_b) as b:
            return divergence_line(align(a, b), a)
    except PicktreeError as error:
        return f"the runs cannot be aligned: {error}"


def divergence_line(found: Alignment, a: Run) -> str:
    """Return the divergence in a line, with the first different end when the runs first differ in something
    else."""
    parting = found.parting
    if parting is None:
        return "the runs do not diverge"
    place = f"tick {a.ticks.number_at(parting.time)}, {parting.time:.2f} s"
    text = f"the runs diverge at {place}: {_divergence_words(parting)}"
    end = _first_other_end(found) if parting.how not in ("outcome", "cause") else None
    if end is not None:
        time, one, other = end
        text += (
            f"; first node that ends differently, at tick {a.ticks.number_at(time)}, {time:.2f} s: "
            f"{one.name}{one.about}: A {run_diff.end_text(one, short=True)}, "
            f"B {run_diff.end_text(other, short=True)}"
        )
    return text


def _divergence_words(parting: Divergence) -> str:
    a, b = parting.a, parting.b
    match parting.how:
        case "inputs" if a is not None and b is not None:
            changes = run_diff.value_changes(a.inputs, b.inputs)
            ports = ", ".join(
                f"{c.name} {message_differences.value_text(c.a)} and {message_differences.value_text(c.b)}"
                for c in changes
            )
            return f"{a.name}{a.about} {run_diff.DIVERGENCE_TEXTS['inputs']}: {ports}"
        case "type" | "outcome" | "cause" | "length" if a is not None and b is not None:
            return (
                f"{a.name}{a.about} {run_diff.DIVERGENCE_TEXTS[parting.how]}: A {_course(a)}, B {_course(b)}"
            )
        case "order":
            return f"{run_diff.DIVERGENCE_TEXTS['order']}: A {_begins(a)}, B {_begins(b)}"
        case _:
            return "one of the two logs ends there"


def _first_other_end(found: Alignment) -> tuple[float, node_visits.Visit, node_visits.Visit] | None:
    ends = [
        (min(pair.a.end, pair.b.end), -pair.a.path.count("/"), pair.a.number, pair)
        for pair in found.pairs
        if "outcome" in pair.differs or "cause" in pair.differs
    ]
    if not ends:
        return None
    time, _, _, pair = min(ends, key=lambda end: end[:3])
    return time, pair.a, pair.b


def _begins(visit: node_visits.Visit | None) -> str:
    return "nothing more" if visit is None else f"{visit.name}{visit.about}"


def _course(visit: node_visits.Visit) -> str:
    return f"{run_diff.end_text(visit, short=True)} after {visit.duration:.2f} s"


_TITLES = {
    "goal": "goal reached, %",
    "items": "items sorted",
    "in_vain": "grasps in vain",
    "failures": "failures",
    "seconds_a_pick": "seconds a pick",
}
_MAX_NAMED_CAUSES = 8


def text_of(found: RecipeComparison, program: str = "picktree") -> str:
    """Return a text for a terminal, without a trailing newline. `program`: name of picktree in commands to
    copy."""
    return "\n".join(_lines(found, program))


def json_text_of(found: RecipeComparison) -> str:
    return json.dumps(_json(found), ensure_ascii=False, indent=2, allow_nan=False) + "\n"


def _lines(found: RecipeComparison, program: str) -> Iterator[str]:
    yield f"A  {found.label_a}: goal reached {found.success_a}"
    yield f"B  {found.label_b}: goal reached {found.success_b}"
    table = found.paired
    if table is not None:
        left = f"; left out: {found.alone} that only A or only B has" if found.alone else ""
        yield f"paired by seed: {table.total} seeds in both{left}"
    else:
        of = f"{found.success_a.total} and {found.success_b.total} jobs, {found.shared} seeds in both"
        yield f"not paired: {of}; all are compared as independent runs"
    if found.arithmetic:
        yield found.arithmetic
    yield ""
    yield _row("of a job", "A", "B", "B − A, 95 % interval", "p", "Holm")
    for criterion in found.criteria:
        scale = 100.0 if criterion.name == "goal" else 1.0
        yield _difference_row(_TITLES[criterion.name], criterion.difference, criterion.adjusted, scale)
    if table is not None:
        counts = f"both {table.both}, only A {table.only_a}, only B {table.only_b}, neither {table.neither}"
        yield f"goal by seed: {counts}"
    if found.sequence is not None:
        yield f"anytime-valid: {found.sequence.to_text()}"
    yield ""
    better = [f"{c.better} {c.words}" for c in found.criteria if c.better]
    yield "so: " + ("; ".join(better) or _undecided(found))
    if found.causes:
        yield ""
        yield _row("failures by cause", "A", "B", "B − A, 95 % interval", "p", "Holm")
        for change in found.causes[:_MAX_NAMED_CAUSES]:
            yield _difference_row(change.cause, change.difference, change.adjusted)
        if len(found.causes) > _MAX_NAMED_CAUSES:
            yield f"and {len(found.causes) - _MAX_NAMED_CAUSES} causes more"
    yield from _figure_lines(found)
    if found.changed:
        yield ""
        yield f"{len(found.changed)} seeds changed sides"
        for changed in found.changed:
            line = f"  seed {changed.seed}: only {changed.winner} reached its goal"
            yield f"{line}; {changed.parting}" if changed.parting else line
            if changed.logs is not None:
                yield f"    {program} diff {shlex.join(changed.logs)}"
        lacking = [changed for changed in found.changed if changed.missing]
        if lacking and not any(changed.parting for changed in lacking):
            yield (
                f"seeds without a log: {len(lacking)}; --remake runs them again and shows where they diverge"
            )


def _figure_lines(found: RecipeComparison) -> Iterator[str]:
    """Yield the operators' figures of both, and the difference of the curves of time to done."""
    a, b = (dict(each.lines()) if each.runs else {} for each in found.figures)
    if not (a or b):
        return
    yield ""
    yield "operators' figures"
    for title in dict.fromkeys((*a, *b)):
        yield f"  {title:<8}A  {a.get(title, 'none')}"
        yield f"  {'':<8}B  {b.get(title, 'none')}"
    curves = found.to_done
    if curves is not None:
        place = f" at {curves.time:.1f} s" if math.isfinite(curves.time) else ""
        yield (
            f"  the curves of time to done differ by up to {100 * curves.distance:.0f} %{place}, "
            f"p {_p(curves.p_value)} (Kolmogorov–Smirnov)"
        )


def _undecided(found: RecipeComparison) -> str:
    """Return what the runs leave open: too few changed seeds for any verdict, or no difference."""
    table = found.paired
    changed = 0 if table is None else table.only_a + table.only_b
    tests = sum(criterion.difference.count > 0 for criterion in found.criteria)
    if table is None or not changed or _least_p(changed, tests) < SIGNIFICANCE_LEVEL:
        return "no significant difference in these runs"
    needed = next(n for n in range(changed, 100) if _least_p(n, tests) < SIGNIFICANCE_LEVEL)
    ahead = max((table.only_a, "A"), (table.only_b, "B"))
    return (
        f"too few runs to tell: only {ahead[1]} reached its goal with {ahead[0]} of the {changed} seeds that "
        f"changed sides; {changed} such seeds cannot give a p value of {100 * SIGNIFICANCE_LEVEL:.0f} % with "
        f"{tests} criteria; {needed} can, for which about {math.ceil(needed * table.total / changed)} seeds "
        "must be run"
    )


def _least_p(changed: int, tests: int) -> float:
    """Least p value, by Holm's method over all criteria, that so many changed seeds can have."""
    return tests * 2.0 * 0.5**changed


def _row(title: str, a: str, b: str, difference: str, p_value: str, adjusted: str) -> str:
    return f"{title:<22} {a:>8} {b:>8}  {difference:<28} {p_value:>7} {adjusted:>7}"


def _difference_row(title: str, found: MeanDifference, adjusted: float, scale: float = 1.0) -> str:
    digits = 1 if scale != 1.0 else 2

    def said(value: float | None) -> str:
        return "–" if value is None else f"{scale * value:.{digits}f}"

    apart = "–"
    if found.count:
        low, high = scale * found.interval.low, scale * found.interval.high
        within = f"{low:+.{digits}f} … {high:+.{digits}f}" if math.isfinite(low) else "too few for one"
        apart = f"{scale * found.mean:+.{digits}f} ({within})"
    clear = " *" if adjusted < SIGNIFICANCE_LEVEL else ""
    return _row(title, said(found.a), said(found.b), apart, _p(found.p_value), _p(adjusted)) + clear


def _p(value: float) -> str:
    return f"{value:.3f}" if value >= 0.001 else "< 0.001"


def _json(found: RecipeComparison) -> dict[str, Any]:
    table = found.paired
    return {
        "a": found.label_a,
        "b": found.label_b,
        "paired": table is not None,
        "arithmetic": found.arithmetic,
        "jobs": {"a": found.success_a.total, "b": found.success_b.total},
        "shared": found.shared,
        "alone": found.alone,
        "goal": None
        if table is None
        else {name: count for name, count in asdict(table).items() if name != "p_value"},
        "differ": found.differ,
        "criteria": {
            c.name: {**_difference_json(c.difference), "holm": c.adjusted, "better": c.better}
            for c in found.criteria
        },
        "causes": {c.cause: {**_difference_json(c.difference), "holm": c.adjusted} for c in found.causes},
        "changed": [asdict(c) for c in found.changed],
        "figures": {"a": found.figures[0].to_json(), "b": found.figures[1].to_json()},
        "sequence": None
        if found.sequence is None
        else {**asdict(found.sequence), "p": found.sequence.p_value},
        "to_done": _curves_json(found.to_done),
    }


def _curves_json(found: CurveDifference | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {**asdict(found), "time": found.time if math.isfinite(found.time) else None}


def _difference_json(found: MeanDifference) -> dict[str, Any]:
    finite = math.isfinite(found.interval.low)
    return {
        "a": found.a,
        "b": found.b,
        "difference": found.mean,
        "low": found.interval.low if finite else None,
        "high": found.interval.high if finite else None,
        "p": found.p_value,
        "jobs": found.count,
    }
