"""The table of the fault campaign: what each column counts, from the measures of its runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from fnmatch import fnmatch
from typing import Any

from _fault_measures import Measure
from picktree.logs import Rate, rate
from picktree.simulation.fault_entries import FaultExpectation
from picktree.world import matches

COLUMNS: Mapping[str, str] = {
    "took effect": "of all runs, those in which a fault did something (a `fault` event that neither waits "
    "nor finds no item; a process that was killed)",
    "detected": "of these, those that reported a failure at or after that moment",
    "reported": "of the detected, those whose first failure after that moment has one of the accepted causes "
    "(`causes` of the fault file's `expect`): what the skill itself says",
    "right cause": "of the runs in which a fault took effect and something failed after it, or an item is "
    "not where it belongs, those in which the root cause that `picktree explain` names first is among the "
    "accepted ones (`roots` of `expect`); it is asked of a log without the events of faults",
    "absorbed": "of the runs in which a fault took effect, those without any failure after it; beside it "
    "the items that were sorted in these, of those that could be",
    "finished": "of all runs, those whose tree came to its end in SUCCESS, whatever was sorted",
    "sorted": "of the items that can physically be sorted (all that came, less `lost` of the fault file in "
    "a run in which it took effect), those that lie in their bin by the scorer; in a run without a result, "
    "none",
    "worst force": "at the wrist as the robot felt it, N: mean over 50 ms at each tick, or that of a stop",
    "beyond": "runs in which a joint or the tool went further beyond a limit of the monitor than braking "
    "from the speed at which it crossed the limit explains (joint: v²/2a; tool: its speed for as long as "
    "the slowest joint brakes; each and one tick); in brackets those that crossed one at all",
    "crashed, hung": "processes that came to no result though no fault had killed them; runs that were "
    "ended at their limit of simulated time",
    "s": "simulated seconds of a run, mean",
}
"""Name and exact meaning of each column."""


@dataclass(frozen=True, slots=True)
class Line:
    """One fault, with recovery or without."""

    fault: str
    recovery: bool
    runs: int
    took_effect: int
    detected: int
    reported: int
    to_explain: int
    right: int
    absorbed: int
    absorbed_sorted: int
    absorbed_sortable: int
    finished: int
    sorted: int
    sortable: int
    misplaced: int
    on_floor: int
    worst_force: float
    above_force: int
    """Runs in which the force was above the limit of the scene."""
    crossed: int
    beyond: int
    crashed: int
    hung: int
    killed: int
    resumed: int
    seconds: float
    """Simulated, mean of the runs with a result."""
    first_causes: Mapping[str, int]
    """Of the first failures after the fault."""
    first_roots: Mapping[str, int]
    """Of the root causes that are named first."""

    def to_json(self) -> dict[str, Any]:
        rates = {
            "detected": rate(self.detected, self.took_effect),
            "reported": rate(self.reported, self.detected),
            "right": rate(self.right, self.to_explain),
            "finished": rate(self.finished, self.runs),
            "sorted": rate(self.sorted, self.sortable),
        }
        intervals = {name: [each.interval.low, each.interval.high] for name, each in rates.items()}
        return {**asdict(self), "intervals": intervals}


def is_right(cause: str, expect: FaultExpectation) -> bool:
    """Whether a cause is among those that count as the right ones."""
    return any(matches(pattern, cause) for pattern in expect.causes)


def names_root(measure: Measure, expect: FaultExpectation) -> bool:
    """Whether the root cause that stands first is among those that count as the right ones."""
    return bool(measure.roots) and any(fnmatch(measure.roots[0], pattern) for pattern in expect.roots)


def sortable(measure: Measure, expect: FaultExpectation) -> int:
    """Items of a run that can physically be sorted."""
    if measure.total is None:
        raise ValueError(f"{measure.job}: how many items it had is not known")
    return measure.total - (expect.lost if measure.took_effect else 0)


def line(
    fault: str,
    recovery: bool,
    measures: Iterable[Measure],
    expect: FaultExpectation,
    items: int,
    limit: float,
) -> Line:
    """Sum up the runs of one fault. `items`: those of a run without result; `limit`: of force, N."""
    runs = [_counted(measure, items) for measure in measures]
    struck = [run for run in runs if run.took_effect]
    told = [run for run in struck if run.after]
    silent = [run for run in struck if not run.after]
    firsts = [run.after[0].cause for run in told]
    done = [run.seconds for run in runs if run.seconds is not None and run.status != "crashed"]
    return Line(
        fault=fault,
        recovery=recovery,
        runs=len(runs),
        took_effect=len(struck),
        detected=len(told),
        reported=sum(is_right(cause, expect) for cause in firsts),
        to_explain=sum(run.to_explain for run in runs),
        right=sum(run.to_explain and names_root(run, expect) for run in runs),
        absorbed=len(silent),
        absorbed_sorted=sum(_sorted(run, expect) for run in silent),
        absorbed_sortable=sum(sortable(run, expect) for run in silent),
        finished=sum(run.finished for run in runs),
        sorted=sum(_sorted(run, expect) for run in runs),
        sortable=sum(sortable(run, expect) for run in runs),
        misplaced=sum(run.misplaced or 0 for run in runs),
        on_floor=sum(run.on_floor for run in runs),
        worst_force=max((run.force for run in runs), default=0.0),
        above_force=sum(run.force > limit for run in runs),
        crossed=sum(bool(run.beyond) for run in runs),
        beyond=sum(bool(run.lasting) for run in runs),
        crashed=sum(run.crashed for run in runs),
        hung=sum(run.hung for run in runs),
        killed=sum(run.killed for run in runs),
        resumed=sum(run.resumed for run in runs),
        seconds=round(sum(done) / len(done), 2) if done else 0.0,
        first_causes=dict(Counter(firsts).most_common()),
        first_roots=dict(
            Counter(run.roots[0] if run.roots else "nothing" for run in runs if run.to_explain).most_common()
        ),
    )


ALL = "all faults"
"""Name of the line that `total` makes."""


def total(lines: Sequence[Line], recovery: bool) -> Line:
    """All faults of one side together; runs without any fault are not in it, nor totals."""
    side = [each for each in lines if each.recovery == recovery and each.fault not in ("none", ALL)]
    causes: Counter[str] = Counter()
    roots: Counter[str] = Counter()
    for each in side:
        causes.update(each.first_causes)
        roots.update(each.first_roots)
    runs = sum(each.runs for each in side)
    sums = {
        name: sum(getattr(each, name) for each in side)
        for name in (
            *(
                "runs",
                "took_effect",
                "detected",
                "reported",
                "to_explain",
                "right",
                "absorbed",
                "absorbed_sorted",
                "absorbed_sortable",
            ),
            *("finished", "sorted", "sortable", "misplaced", "on_floor", "above_force", "crossed", "beyond"),
            *("crashed", "hung", "killed", "resumed"),
        )
    }
    return Line(
        fault=ALL,
        recovery=recovery,
        **sums,
        worst_force=max((each.worst_force for each in side), default=0.0),
        seconds=round(sum(each.seconds * each.runs for each in side) / runs, 2) if runs else 0.0,
        first_causes=dict(causes.most_common()),
        first_roots=dict(roots.most_common()),
    )


def _counted(measure: Measure, items: int) -> Measure:
    """A run without a result has sorted nothing of what it would have had."""
    from dataclasses import replace

    return measure if measure.total is not None else replace(measure, total=items, sorted=0, misplaced=0)


def _sorted(measure: Measure, expect: FaultExpectation) -> int:
    return min(measure.sorted or 0, sortable(measure, expect))


def brief(found: Rate) -> str:
    """`19/20 (76…99 %)`"""
    if not found.total:
        return "–"
    low, high = 100 * found.interval.low, 100 * found.interval.high
    return f"{found.successes}/{found.total} ({low:.0f}…{high:.0f} %)"


HEADINGS = (
    "fault", "", "took effect", "detected", "reported", "right cause", "absorbed", "finished", "sorted",
    "worst force", "beyond", "crashed, hung", "s",
)  # fmt: skip


def cells(each: Line) -> tuple[str, ...]:
    """A line as it is printed, below `HEADINGS`."""
    absorbed = f"{each.absorbed}: {each.absorbed_sorted}/{each.absorbed_sortable}" if each.absorbed else "0"
    return (
        each.fault.replace("_", " "),
        "with" if each.recovery else "without",
        f"{each.took_effect}/{each.runs}",
        brief(rate(each.detected, each.took_effect)),
        brief(rate(each.reported, each.detected)),
        brief(rate(each.right, each.to_explain)),
        absorbed,
        brief(rate(each.finished, each.runs)),
        brief(rate(each.sorted, each.sortable)),
        f"{each.worst_force:.0f} N",
        f"{each.beyond} ({each.crossed})",
        f"{each.crashed}, {each.hung}",
        f"{each.seconds:.0f}",
    )


def to_text(lines: Sequence[Line]) -> str:
    """For a terminal."""
    rows = [HEADINGS, *map(cells, lines)]
    widths = [max(len(row[n]) for row in rows) for n in range(len(HEADINGS))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )


def to_markdown(lines: Sequence[Line]) -> str:
    rows = [HEADINGS, tuple("---" for _ in HEADINGS), *map(cells, lines)]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)
