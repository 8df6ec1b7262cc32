"""Text and JSON of a comparison of two recipes, with the divergence of seeds with a changed result."""

from __future__ import annotations

import json
import math
import shlex
import tempfile
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from ...analysis.compare.alignment import Alignment, align
from ...analysis.compare.diff import value_changes
from ...analysis.compare.divergence import Divergence
from ...analysis.compare.divergence_text import DIVERGENCE_TEXTS, end_text
from ...analysis.compare.message_fields import value_text
from ...analysis.run import Run
from ...files.errors import PicktreeError
from ...logs.visits import Visit
from .comparison import ChangedSeed, RecipeComparison, Side
from .differences import MeanDifference, RecipeOutcomes
from .executor import Executor
from .local_executor import LocalExecutor
from .rates import SIGNIFICANCE_LEVEL
from .rerun_job import remake_into
from .store import RESULTS_FILE, Store


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
        return f"they cannot be aligned: {error}"


def divergence_line(found: Alignment, a: Run) -> str:
    """Return the divergence in a line, with the first different end when the runs first differ in something
    else."""
    parting = found.parting
    if parting is None:
        return "the runs do not part"
    said = f"they part at tick {a.ticks.number_at(parting.time)}, {parting.time:.2f} s: {_what(parting)}"
    end = _first_other_end(found) if parting.how not in ("outcome", "cause") else None
    if end is not None:
        time, one, other = end
        said += (
            f"; first other end at tick {a.ticks.number_at(time)}, {time:.2f} s: "
            f"{one.name}{one.about}: A {end_text(one, short=True)}, B {end_text(other, short=True)}"
        )
    return said


def _what(parting: Divergence) -> str:
    a, b = parting.a, parting.b
    match parting.how:
        case "inputs" if a is not None and b is not None:
            changes = value_changes(a.inputs, b.inputs)
            ports = ", ".join(f"{c.name} {value_text(c.a)} and {value_text(c.b)}" for c in changes)
            return f"{a.name}{a.about} {DIVERGENCE_TEXTS['inputs']}: {ports}"
        case "type" | "outcome" | "cause" | "length" if a is not None and b is not None:
            return f"{a.name}{a.about} {DIVERGENCE_TEXTS[parting.how]}: A {_course(a)}, B {_course(b)}"
        case "order":
            return f"{DIVERGENCE_TEXTS['order']}: A {_begins(a)}, B {_begins(b)}"
        case _:
            return "the log of one ends there"


def _first_other_end(found: Alignment) -> tuple[float, Visit, Visit] | None:
    ends = [
        (min(pair.a.end, pair.b.end), -pair.a.path.count("/"), pair.a.number, pair)
        for pair in found.pairs
        if "outcome" in pair.differs or "cause" in pair.differs
    ]
    if not ends:
        return None
    time, _, _, pair = min(ends, key=lambda end: end[:3])
    return time, pair.a, pair.b


def _begins(visit: Visit | None) -> str:
    return "nothing more" if visit is None else f"{visit.name}{visit.about}"


def _course(visit: Visit) -> str:
    return f"{end_text(visit, short=True)} after {visit.duration:.2f} s"


_TITLES = {
    "goal": "goal reached, %",
    "items": "items sorted",
    "in_vain": "grasps in vain",
    "failures": "failures",
    "seconds_a_pick": "seconds a pick",
}
_MOST_CAUSES = 8


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
        left = f"; {found.alone} in one alone are left out" if found.alone else ""
        yield f"paired by seed: {table.total} seeds in both{left}"
    else:
        of = f"{found.success_a.total} and {found.success_b.total} jobs, {found.shared} seeds in both"
        yield f"not paired: {of}; they are compared as independent runs"
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
    yield ""
    better = [f"{c.better} {c.words}" for c in found.criteria if c.better]
    yield "so: " + ("; ".join(better) or _undecided(found))
    if found.causes:
        yield ""
        yield _row("failures by cause", "A", "B", "B − A, 95 % interval", "p", "Holm")
        for change in found.causes[:_MOST_CAUSES]:
            yield _difference_row(change.cause, change.difference, change.adjusted)
        if len(found.causes) > _MOST_CAUSES:
            yield f"and {len(found.causes) - _MOST_CAUSES} causes more"
    if found.changed:
        yield ""
        yield f"{len(found.changed)} seeds changed sides"
        for changed in found.changed:
            yield from _changed_lines(changed, program)
        lacking = [changed for changed in found.changed if changed.missing]
        if lacking and not any(changed.parting for changed in lacking):
            yield f"of {len(lacking)} a log was not kept: --remake runs them again and says where they part"


def _undecided(found: RecipeComparison) -> str:
    """Return what the runs leave open: too few changed seeds for any verdict, or no difference."""
    table = found.paired
    changed = 0 if table is None else table.only_a + table.only_b
    tests = sum(criterion.difference.count > 0 for criterion in found.criteria)
    if table is None or not changed or _least_p(changed, tests) < SIGNIFICANCE_LEVEL:
        return "no difference that these runs could show"
    needed = next(n for n in range(changed, 100) if _least_p(n, tests) < SIGNIFICANCE_LEVEL)
    ahead = max((table.only_a, "A"), (table.only_b, "B"))
    return (
        f"too few runs to tell: {ahead[0]} of the {changed} seeds that changed sides are {ahead[1]}'s, and "
        f"{changed} cannot reach {100 * SIGNIFICANCE_LEVEL:.0f} % with {tests} criteria; {needed} could, "
        f"which takes about {math.ceil(needed * table.total / changed)} seeds"
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


def _changed_lines(changed: ChangedSeed, program: str) -> Iterator[str]:
    said = f"  seed {changed.seed}: {changed.winner} alone reached its goal"
    yield f"{said}; {changed.parting}" if changed.parting else said
    if changed.logs is not None:
        yield f"    {program} diff {shlex.join(changed.logs)}"


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
    }


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
