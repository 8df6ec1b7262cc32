"""Running a recorded run again, in another process with another hash seed."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import IO, cast

from ...errors import PicktreeError
from ...logs.run_result import RunResult
from ...logs.schema.arithmetic_record import Arithmetic
from ..compare.alignment import align
from ..compare.run_outcome import outcome_of
from ..compare.text.divergence_text import parting_lines
from ..run import Run
from .changes import Changes
from .difference_reasons import notes, reasons
from .moment_syntax import parse_tick
from .resim_comparison import Comparison, is_cut
from .resim_process import ANSWER, ORDER, Answer, Order
from .resim_result import Resimulation

_WAIT = 10.0
"""Wall seconds that the other process has to finish after an interrupt."""


def resimulate(
    where: str | Path,
    *,
    changes: Changes | None = None,
    until: str | None = None,
    out: Path | None = None,
    progress: Callable[[float, float], None] = lambda now, end: None,
) -> Resimulation:
    """Run the run of a log again from what the log holds, and compare as it goes.

    `until`: a tick or a time (see `parse_tick`); `progress` is told the simulated time, and the time at which
    the record ends. Without changes it ends at the first difference. Raises PicktreeError.
    """
    changes = changes or Changes()
    with Run(where) as run, tempfile.TemporaryDirectory(prefix="picktree-") as away:
        times = run.ticks.times
        if not times:
            raise PicktreeError(f"{run.path}: the log holds no tick: there is nothing to run again")
        run.log.require_beginning()
        last = parse_tick(until, run, "--until") if until else None
        limit = Comparison(run, None if last is None else times[last]).until
        keep = out if out is not None or not changes else Path(away)
        order = Order(run.path.absolute(), changes, None if last is None else times[last], keep)
        answer = _ask(order, lambda now: progress(now, times[-1] if limit is None else limit))
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
            notes=notes(run),
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


def _ask(order: Order, progress: Callable[[float], None]) -> Answer:
    """Let the other process carry out the order."""
    environment = {**os.environ, "PYTHONHASHSEED": "random"}
    process = subprocess.Popen(
        [sys.executable, "-m", "picktree.analysis.resim.resim_process"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment,
    )
    answer: Answer | None = None
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
        _end(process)
        raise
    if process.returncode == 130:
        raise KeyboardInterrupt
    if process.returncode != 0 or answer is None or answer.at is not None:
        raise RuntimeError(f"the process that runs it again ended with {process.returncode}")
    if answer.error:
        raise PicktreeError(answer.error)
    return answer


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(_WAIT)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
