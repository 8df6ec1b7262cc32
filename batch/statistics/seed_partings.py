"""Divergence of the runs of seeds with a changed result, in one line each."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from ...analysis.compare.alignment import Alignment, align
from ...analysis.compare.diff import value_changes
from ...analysis.compare.divergence import Divergence
from ...analysis.compare.divergence_text import DIVERGENCE_TEXTS
from ...analysis.compare.message_fields import value_text
from ...analysis.run import Run
from ...errors import PicktreeError
from ...logs.visits import HALTED, Visit
from ..results.store import RESULTS_FILE, Store
from ..workers.executor import Executor
from ..workers.local_executor import LocalExecutor
from ..workers.rerun_job import remake_into
from .comparison import ChangedSeed, RecipeComparison, Side
from .differences import RecipeOutcomes


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
            f"{_name(one)}: A {_end(one)}, B {_end(other)}"
        )
    return said


def _what(parting: Divergence) -> str:
    a, b = parting.a, parting.b
    match parting.how:
        case "inputs" if a is not None and b is not None:
            changes = value_changes(a.inputs, b.inputs)
            ports = ", ".join(f"{c.name} {value_text(c.a)} and {value_text(c.b)}" for c in changes)
            return f"{_name(a)} {DIVERGENCE_TEXTS['inputs']}: {ports}"
        case "type" | "outcome" | "cause" | "length" if a is not None and b is not None:
            return f"{_name(a)} {DIVERGENCE_TEXTS[parting.how]}: A {_course(a)}, B {_course(b)}"
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


def _name(visit: Visit) -> str:
    about = [visit.item] if visit.item else []
    if visit.attempt > 1:
        about.append(f"attempt {visit.attempt}")
    name = visit.path.rsplit("/", 1)[-1]
    return f"{name} ({', '.join(about)})" if about else name


def _begins(visit: Visit | None) -> str:
    return "nothing more" if visit is None else _name(visit)


def _end(visit: Visit) -> str:
    if visit.outcome == "RUNNING":
        return "still runs when the log ends"
    if visit.outcome == HALTED:
        return "was halted"
    return visit.cause or visit.outcome


def _course(visit: Visit) -> str:
    return f"{_end(visit)} after {visit.duration:.2f} s"
