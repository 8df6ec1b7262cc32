"""Explanations of many runs: root causes and recoveries, counted, with a typical run of each cause."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from picktree.analysis import Run
from picktree.files import Paint, PicktreeError, listed, plain
from picktree.logs import FigureCounts, OperatorFigures, episode_counts, log_files, run_index

from .explanation import CONFIDENCES, Confidence, RootCause
from .run_explanation import explain
from .wording import counted, wrapped


@dataclass(frozen=True, slots=True)
class CauseOfRuns:
    """Root cause with its counts over many runs."""

    cause: str
    runs: int
    """Number of runs that have it."""
    first: int
    """Number of runs in which it is the first root cause."""
    items: int
    """Number of items that are not where they belong because of it."""
    seconds: float
    """Simulated s that it cost, over all runs."""
    confidence: tuple[tuple[Confidence, int], ...]
    """Number of runs by confidence."""
    typical: str
    """Folder or log of a run with a cost in the middle."""
    title: str
    """Description in that run."""


@dataclass(frozen=True, slots=True)
class ExplainedRuns:
    """Root causes of many runs, those first that cost most items, then most runs."""

    folder: str
    statuses: tuple[tuple[str, int], ...]
    """Number of runs by the status of their outcome."""
    items: tuple[int, int]
    """Numbers of sorted items and of all items, over the runs that have a result."""
    causes: tuple[CauseOfRuns, ...]
    cures: tuple[episode_counts.CauseCount, ...]
    """Causes of failures with what was tried or done instead, with the most time lost first."""
    unreadable: tuple[str, ...]
    """Sentences about logs that could not be read."""
    notes: tuple[str, ...] = ()
    """Sentences about what the counts leave out, such as jobs without logs."""
    figures: OperatorFigures = field(default_factory=lambda: OperatorFigures(()))
    """Operators' figures of the runs together."""

    @property
    def runs(self) -> int:
        return sum(number for _, number in self.statuses)


def holds_runs(where: str) -> bool:
    """Whether a path is a folder of runs, and neither a log nor the folder of one run."""
    folder = Path(where)
    try:
        return folder.is_dir() and not log_files.find_log(folder)
    except PicktreeError:
        return bool(run_index.logs_below(folder))


def explain_runs(
    folder: Path,
    say: Callable[[str], None] = lambda text: None,
    notes: Sequence[str] = (),
    truth: bool | None = None,
) -> ExplainedRuns:
    """Explain all runs of a folder; `say` is called with the number of each.

    `notes`: sentences about what the folder's logs leave out. `truth`: as in `explain`.

    Raises PicktreeError when the folder holds no log.
    """
    logs = run_index.logs_below(folder)
    if not logs:
        raise PicktreeError(f"{folder}: no log in it; give a log, a run's folder, or a folder of runs")
    statuses: Counter[str] = Counter()
    cures: list[episode_counts.CureCount] = []
    done, total, figures = 0, 0, list[FigureCounts]()
    found: dict[str, list[tuple[RootCause, bool, str]]] = {}
    unreadable: list[str] = []
    for number, log in enumerate(logs, 1):
        say(f"{number} of {len(logs)}")
        try:
            with Run(log) as run:
                explanation = explain(run, items=False, truth=truth)
                figures += run.operator_figures.runs
        except PicktreeError as error:
            unreadable.append(str(error))
            continue
        outcome = explanation.outcome
        statuses[outcome.status] += 1
        cures += explanation.recovery.cures
        done, total = done + (outcome.items_sorted or 0), total + (outcome.items_total or 0)
        where = str(log.parent if log.name == "log.mcap" else log)
        for root in explanation.root_causes:
            first = root is explanation.root_causes[0]
            found.setdefault(root.cause, []).append((root, first, where))
    causes = sorted((_cause(*each) for each in found.items()), key=lambda c: (-c.items, -c.runs, -c.seconds))
    return ExplainedRuns(
        str(folder),
        tuple(statuses.most_common()),
        (done, total),
        tuple(causes),
        episode_counts.by_cause(episode_counts.added_cures(cures)),
        tuple(unreadable),
        tuple(notes),
        OperatorFigures(tuple(figures)),
    )


def _cause(cause: str, found: Sequence[tuple[RootCause, bool, str]]) -> CauseOfRuns:
    middle = sorted(found, key=lambda each: (len(each[0].items), each[0].seconds_lost))[len(found) // 2]
    sure = Counter(root.confidence for root, _, _ in found)
    return CauseOfRuns(
        cause=cause,
        runs=len({where for _, _, where in found}),
        first=sum(first for _, first, _ in found),
        items=sum(len(root.items) for root, _, _ in found),
        seconds=round(sum(root.seconds_lost for root, _, _ in found), 2),
        confidence=tuple((word, sure[word]) for word in CONFIDENCES if sure[word]),
        typical=middle[2],
        title=middle[0].title,
    )


def runs_text(found: ExplainedRuns, program: str = "picktree", paint: Paint = plain) -> str:
    """Return a text for a terminal, without a trailing newline."""
    return "\n".join(_lines(found, program, paint))


def _lines(found: ExplainedRuns, program: str, paint: Paint) -> Iterator[str]:
    ends = ", ".join(f"{number} {status}" for status, number in found.statuses)
    done, total = found.items
    items = f"; {done} of {counted(total, 'item')} sorted" if total else ""
    yield from wrapped(f"{counted(found.runs, 'run')} in {found.folder}: {ends}{items}", "")
    for sentence in (*found.notes, *found.unreadable):
        yield from wrapped(f"Note: {sentence}", "")
    if found.figures.runs:
        yield ""
        yield paint("Operators' figures", "place")
        for title, text in found.figures.lines():
            yield from wrapped(f"{title:<8}{text}", "  ", " " * 10)
    if found.causes:
        yield ""
        yield from _roots(found, program, paint)
    if found.cures:
        yield ""
        yield paint("Recovery", "place")
        width = max(len(each.cause) for each in found.cures)
        for each in found.cures:
            yield from wrapped(f"{each.cause:<{width}}  {each.to_text()}", "  ", " " * (width + 4))


def _roots(found: ExplainedRuns, program: str, paint: Paint) -> Iterator[str]:
    yield paint(f"Root causes ({len(found.causes)})", "place")
    width = max(len(each.cause) for each in found.causes)
    yield f"  {'cause':<{width}}  runs  first  items   s lost"
    for each in found.causes:
        numbers = f"{each.runs:>4}  {each.first:>5}  {each.items:>5}  {each.seconds:>7.1f}"
        yield f"  {paint(f'{each.cause:<{width}}', 'warning')}  {numbers}"
        yield from wrapped(each.title, "     ")
        sure = listed([f"{word} {number}" for word, number in each.confidence], 3)
        yield f"     {sure}; {program} explain {shlex.quote(each.typical)}"


def runs_json_text(found: ExplainedRuns) -> str:
    """Return one object with a trailing newline; docs/explain.md names its keys."""
    causes = [{**asdict(each), "confidence": dict(each.confidence)} for each in found.causes]
    values = {
        "folder": found.folder,
        "runs": found.runs,
        "statuses": dict(found.statuses),
        "items": {"sorted": found.items[0], "total": found.items[1]},
        "figures": found.figures.to_json(),
        "causes": causes,
        "cures": [asdict(cure) for each in found.cures for cure in each.by_cure],
        "unreadable": list(found.unreadable),
        "notes": list(found.notes),
    }
    return json.dumps(values, ensure_ascii=False, indent=2) + "\n"
