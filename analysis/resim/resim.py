"""Re-simulation of a recorded run in another process with another hash seed, and its comparison with the
record.

The other process reads one order from stdin. It writes lines of JSON to stdout: its progress, and in the end
the answer.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, cast

from pydantic import TypeAdapter

from ...files.diagnostics.fault_rendering import fault_lines
from ...files.errors import PicktreeError
from ...files.marks import FileError
from ...logs.run_result import RunResult
from ...logs.schema.json_records import Arithmetic
from ...session.arithmetic_probe import arithmetic
from ...session.observer import Observer
from ...session.recipe import Recording
from ...session.recorded_recipe import RecordedRun
from ...session.session import Session
from ...trees.runner import TickReport
from ..compare.alignment import align
from ..compare.divergence import MessageDifference
from ..compare.divergence_text import parting_lines
from ..compare.run_outcome import outcome_of
from ..run import Run
from .changes import RunChanges, apply_changes, parse_tick
from .resim_comparison import RecordComparison, is_cut
from .resim_result import Resimulation, moved_sources, notes, reasons

_PROGRESS_PERIOD = 0.2
"""Wall seconds between two messages about the progress."""


@dataclass(frozen=True)
class ResimOrder:
    log: Path
    changes: RunChanges
    until: float | None
    """End of the comparison, simulated s; None: the end of the record."""
    out: Path | None
    """Folder for the run's folder; None: its log is not kept."""


@dataclass(frozen=True)
class ResimAnswer:
    """Line of the process: `at` during the run, `error` when the input is bad, else the comparison."""

    at: float | None = None
    """Progress, simulated s; None: no progress message."""
    error: str = ""
    ticks: int = 0
    digest: str = ""
    exact: bool = True
    difference: MessageDifference | None = None
    trees: MessageDifference | None = None
    result: str = ""
    """Result of the run as JSON text."""
    told: tuple[str, ...] = field(default_factory=tuple[str, ...])
    """Sentences about the changes."""
    warnings: str = ""
    """Warnings of the checker about another mission, as lines."""
    arithmetic: Mapping[str, str] = field(default_factory=dict[str, str])
    """Arithmetic of the process, as `Arithmetic.words`."""


ORDER = TypeAdapter(ResimOrder)
ANSWER = TypeAdapter(ResimAnswer)


class _Progress(Observer):
    """Observer that reports the progress of the run."""

    def __init__(self, say: Callable[[ResimAnswer], None]) -> None:
        self._say = say
        self._said = 0.0

    def ticked(self, now: float, report: TickReport, items_done: int, items_total: int) -> None:
        wall = time.monotonic()
        if wall - self._said >= _PROGRESS_PERIOD:
            self._said = wall
            self._say(ResimAnswer(at=now))


def run_order(order: ResimOrder, say: Callable[[ResimAnswer], None]) -> ResimAnswer:
    """Run the order and return the comparison. Raises PicktreeError for a log that cannot be run again."""
    with (
        Run(order.log) as run,
        RecordedRun(run) as recorded,
        tempfile.TemporaryDirectory(prefix="picktree-") as away,
    ):
        changed = apply_changes(order.changes, recorded.recipe())
        recipe = changed.recipe
        comparison = RecordComparison(
            run,
            order.until,
            order.changes.settings if order.changes else None,
            stop_at_difference=not order.changes,
        )
        limit = recipe.limit if comparison.until is None else min(recipe.limit, comparison.until)
        edits = () if order.changes.mission else (recorded.edits(),)
        result = Session(
            replace(recipe, limit=limit),
            record=Recording(order.out or Path(away)),
            observers=(_Progress(say), comparison, recorded.operator(), *edits),
        ).run()
        comparison.finish()
        return ResimAnswer(
            ticks=comparison.ticks,
            digest=comparison.digest,
            exact=comparison.exact,
            difference=comparison.difference,
            trees=comparison.trees,
            result=result.to_json_text(),
            told=changed.told,
            warnings=fault_lines(changed.warnings) if changed.warnings else "",
            arithmetic=arithmetic().words(),
        )


def main() -> int:
    # The libraries in C++ print on their own: stdout is for the answers alone.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)

    def say(answer: ResimAnswer) -> None:
        answers.write(ANSWER.dump_json(answer).decode() + "\n")
        answers.flush()

    try:
        say(run_order(ORDER.validate_json(sys.stdin.buffer.read()), say))
    except FileError as error:
        say(ResimAnswer(error=fault_lines(error.faults)))
    except PicktreeError as error:
        say(ResimAnswer(error=str(error)))
    except (KeyboardInterrupt, BrokenPipeError):
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())


_TERMINATION_TIMEOUT = 10.0
"""Wall seconds that the other process has to finish after an interrupt."""


def resimulate(
    where: str | Path,
    *,
    changes: RunChanges | None = None,
    until: str | None = None,
    out: Path | None = None,
    progress: Callable[[float, float], None] = lambda now, end: None,
) -> Resimulation:
    """Run a logged run again from its log alone, and compare the runs message by message.

    `until`: a tick or a time (see `parse_tick`); `progress` receives the simulated time, and the time at
    which the record ends. Without changes it ends at the first difference. Raises PicktreeError.
    """
    changes = changes or RunChanges()
    with Run(where) as run, tempfile.TemporaryDirectory(prefix="picktree-") as away:
        times = run.ticks.times
        if not times:
            raise PicktreeError(f"{run.path}: the log holds no tick: there is nothing to run again")
        run.log.require_beginning()
        last = parse_tick(until, run, "--until") if until else None
        limit = RecordComparison(run, None if last is None else times[last]).until
        keep = out if out is not None or not changes else Path(away)
        order = ResimOrder(run.path.absolute(), changes, None if last is None else times[last], keep)
        answer = _run_in_process(order, lambda now: progress(now, times[-1] if limit is None else limit))
        result = RunResult.from_json_text(answer.result, run.path)
        first = 1 if run.info.continues else 0  # the tick of the checkpoint is no tick of this run
        count = (len(times) if limit is None else run.ticks.number_at(limit) + 1) - first
        found = Resimulation(
            log=run.path.absolute(),
            recovered=run.recovered,
            cut=is_cut(run),
            changes=answer.told,
            until=limit,
            last_tick=first + count - 1,
            ticks=answer.ticks,
            recorded_ticks=count,
            seconds=times[first + min(answer.ticks, count) - 1] if answer.ticks else times[0],
            digest=answer.digest,
            exact=answer.exact,
            difference=answer.difference,
            trees=answer.trees,
            reasons=(
                reasons(run, Arithmetic.from_words(answer.arithmetic))
                if answer.difference or answer.trees
                else ()
            ),
            # Where it differs, the reasons have it.
            notes=(*notes(run), *(() if answer.difference or answer.trees else moved_sources(run))),
            parting=(),
            outcomes=None,
            warnings=answer.warnings,
            kept=result.log if out is not None else None,
        )
        return _with_outcomes(found, run, result.log) if changes else found


def _with_outcomes(found: Resimulation, run: Run, log: Path) -> Resimulation:
    with Run(log) as other:
        parting = align(run, other).parting
        lines = () if parting is None else tuple(parting_lines(parting))
        return replace(found, parting=lines, outcomes=(outcome_of(run), outcome_of(other)))


def _run_in_process(order: ResimOrder, progress: Callable[[float], None]) -> ResimAnswer:
    """Have the other process carry out the order, and return its answer."""
    environment = {**os.environ, "PYTHONHASHSEED": "random"}
    process = subprocess.Popen(
        [sys.executable, "-m", "picktree.analysis.resim.resim"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment,
    )
    answer: ResimAnswer | None = None
    try:
        given, answers = cast("IO[bytes]", process.stdin), cast("IO[bytes]", process.stdout)
        with given:
            given.write(ORDER.dump_json(order))
        for line in answers:
            answer = ANSWER.validate_json(line)
            if answer.at is not None:
                progress(answer.at)
        process.wait()
    except BaseException:
        _end_process(process)
        raise
    if process.returncode == 130:
        raise KeyboardInterrupt
    if process.returncode != 0 or answer is None or answer.at is not None:
        raise RuntimeError(f"the process that runs it again ended with {process.returncode}")
    if answer.error:
        raise PicktreeError(answer.error)
    return answer


def _end_process(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(_TERMINATION_TIMEOUT)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
