"""The folder of a try at a job: what it left there, and what of it stays."""

from __future__ import annotations

from pathlib import Path

from ...analysis.run import Run
from ...errors import PicktreeError
from ...session.session import LOG
from ..results.rows import CrashRow, JobRow, JobRows
from . import job_output as output
from .executor import Order

_JOBS = "jobs"


def try_folder(batch: Path, job: str, attempt: int) -> Path:
    return batch / _JOBS / f"{job}-{attempt}"


def result_of(order: Order) -> JobRows | None:
    """What the try came to; None when it came to nothing, or nothing that can be read."""
    try:
        return JobRows.from_json(order.result.read_bytes(), order.result)
    except (OSError, PicktreeError):
        return None


def run_folder(order: Order, batch: Path) -> str:
    """Of the run with its log, below the batch's folder; empty when there is none."""
    log = _log(order)
    return str(log.parent.relative_to(batch)) if log else ""


def lost(order: Order, reason: str, batch: Path, *, kept: bool) -> CrashRow:
    """A try that came to no result, with the last tick that its log tells of.

    Its folder: of the run, or of the try where no log was begun but something was printed.
    """
    folder = ""
    if kept:
        folder = run_folder(order, batch)
        if not folder and (order.folder / output.NAME).exists():
            folder = str(order.folder.relative_to(batch))
    return CrashRow(order.attempt, reason, _last_tick(order), folder)


def crashed(crash: CrashRow) -> JobRow:
    """A job whose last try was lost."""
    return JobRow(
        status="crashed",
        message=crash.reason,
        digest="",
        attempts=crash.attempt,
        items_total=None,
        items_sorted=None,
        items_misplaced=None,
        items_left=None,
        picks_tried=None,
        picks_held=None,
        sim_seconds=None,
        cpu_seconds=None,
        wall_seconds=None,
        last_tick=crash.last_tick,
        look_at=crash.reason,
        folder=crash.folder,
    )


def _log(order: Order) -> Path | None:
    return next(iter(sorted(order.folder.glob(f"*/{LOG}"))), None)


def _last_tick(order: Order) -> int | None:
    log = _log(order)
    if log is None:
        return None
    try:
        with Run(log) as run:
            return len(run.ticks) - 1 if run.ticks else None
    except PicktreeError:
        return None
