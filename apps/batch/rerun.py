"""Rerun of a job from the batch's records, to get its log."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from picktree.files import PicktreeError
from picktree.logs import arithmetic_record
from picktree.session import LOG_FILE_NAME

from .executor import Event, Executor, JobFailed, JobFinished, JobOrder
from .local_executor import LocalExecutor
from .plan import Job, read_plan
from .store import RESULTS_FILE, Store, find_job, split
from .tables import JobRows

_WORKER_CHECK_PERIOD = 0.5
"""Interval between checks of the worker, wall s."""


@dataclass(frozen=True, slots=True)
class RerunJob:
    """Rerun of a job, next to its recorded result."""

    job: Job
    recorded_status: str
    recorded_digest: str
    """Recorded digest; empty when the job had crashed."""
    status: str
    digest: str
    """Digest of the rerun; empty when it crashed."""
    message: str
    """Reason of the rerun's crash."""
    log: Path | None
    kept_before: bool
    """Whether the batch has the log of the recorded run; the new one is then deleted."""
    reasons: tuple[str, ...]
    """Differences between the environments of the two runs."""

    @property
    def identical(self) -> bool:
        return bool(self.digest) and self.digest == self.recorded_digest

    def to_text(self) -> str:
        """Return a text for a terminal, without a trailing newline."""
        lines = [f"job         {self.job.id}: seed {self.job.seed}, {self.job.variant.label}"]
        if self.identical:
            lines.append(f"identical   {self.status}, digest {self.digest[:16]} as recorded")
        elif not self.digest:
            lines.append(f"crashed     {self.message}")
        elif not self.recorded_digest:
            lines.append(
                f"now         {self.status}; the job crashed in the batch, so there is no digest to compare"
            )
        else:
            lines += [
                "different",
                f"  recorded  {self.recorded_status}, digest {self.recorded_digest[:16]}",
                f"  now       {self.status}, digest {self.digest[:16]}",
            ]
            lines += [f"likely why  {reason}" for reason in self.reasons]
        if self.log is not None:
            lines.append(f"log         {self.log}" + (", as the batch kept it" if self.kept_before else ""))
        return "\n".join(lines)

    def to_json_text(self) -> str:
        values: dict[str, Any] = {
            "identical": self.identical,
            "job": self.job.id,
            "seed": self.job.seed,
            "recipe": self.job.variant.label,
            "recorded": {"status": self.recorded_status, "digest": self.recorded_digest},
            "now": {"status": self.status, "digest": self.digest, "message": self.message},
            "reasons": list(self.reasons),
            "log": str(self.log) if self.log is not None else None,
        }
        return json.dumps(values, ensure_ascii=False, indent=2) + "\n"


def rerun_job(where: str, out: Path | None = None, executor: Executor | None = None) -> RerunJob:
    """Rerun the job that `where` names as FOLDER@JOB.

    The log goes to a folder in `out`. Without `out`, the log of an identical run goes to its place in the
    batch, and the batch records it. The log of a different run goes next to that place. `executor`: by
    default one with a single worker. Raises PicktreeError when there is no such job, it was not run yet, or
    cannot be run.
    """
    folder, named = split(where)
    own: AbstractContextManager[Executor] = LocalExecutor(1) if executor is None else nullcontext(executor)
    with Store(folder / RESULTS_FILE) as store, own as workers:
        return _rerun(store, find_job(store, where, named), where, out, workers)


def remake_into(store: Store, job: Job, scratch: Path, executor: Executor) -> Path:
    """Rerun a job and return the folder of its log in `scratch`.

    Raises PicktreeError when it cannot be run, or differs from the recorded run.
    """
    found = _rerun(store, job, f"{store.path.parent}@{job.id}", scratch, executor)
    if not found.identical or found.log is None:
        raise PicktreeError(
            f"seed {job.seed}, {job.variant.label}: the repeated run differs from the recorded one"
        )
    return found.log


def _rerun(store: Store, job: Job, where: str, out: Path | None, executor: Executor) -> RerunJob:
    folder = store.path.parent
    before = store.row(job.id)
    if before is None:
        raise PicktreeError(f"{where}: this job was not run yet; picktree batch run --resume {folder}")
    kept = (
        folder / before.folder
        if before.folder and (folder / before.folder / LOG_FILE_NAME).is_file()
        else None
    )
    scratch = (out or folder / "jobs") / f".again-{job.id}"
    plan = read_plan(folder)
    shutil.rmtree(scratch, ignore_errors=True)
    try:
        order = JobOrder(job.id, 1, job.recipe_in(folder), job.seed, scratch, plan.wall_limit, plan.memory)
        event = _carried_out(order, executor)
        rows = JobRows.from_json(order.result.read_bytes(), order.result) if order.result.is_file() else None
        digest = rows.job.digest if rows else ""
        same = bool(digest) and digest == before.digest
        reason = event.reason if isinstance(event, JobFailed) else ""
        if order.log is None:
            raise PicktreeError(f"{where}: {reason or 'it left no log'}")
        run, log = order.log.parent, None
        if out is not None:
            log = _move_run(run, out / run.name)
        elif kept is None or not same:
            place = folder / "jobs" / (f"{job.id}-{before.attempts}" if same else f"{job.id}-again")
            shutil.rmtree(place, ignore_errors=True)
            log = _move_run(run, place / run.name)
            if same:
                store.set_folder(job.id, str(log.relative_to(folder)))
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise PicktreeError(f"{where}: the log cannot be written: {why}") from None
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return RerunJob(
        job,
        before.status,
        before.digest,
        rows.job.status if rows else "crashed",
        digest,
        reason,
        log or kept,
        log is None,
        () if same or rows is None else tuple(_differing_versions(store.versions(job.id), rows.versions)),
    )


def _carried_out(order: JobOrder, executor: Executor) -> Event:
    executor.submit(order)
    while True:
        for event in executor.wait(_WORKER_CHECK_PERIOD):
            if not isinstance(event, JobFinished | JobFailed):
                raise KeyboardInterrupt
            return event


def _move_run(run: Path, target: Path) -> Path:
    """Move the run to that name, or to a similar free one; return its path."""
    target.parent.mkdir(parents=True, exist_ok=True)
    free, number = target, 0
    while free.exists():
        number += 1
        free = target.with_name(f"{target.name}-{number}")
    return run.rename(free)


def _differing_versions(then: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    departed = arithmetic_record.arithmetic_difference(
        arithmetic_record.Arithmetic.from_words(then), arithmetic_record.Arithmetic.from_words(now)
    )
    libraries = sorted(name for name in {*then, *now} if not name.startswith(arithmetic_record.PREFIXES))
    changed = [name for name in libraries if then.get(name, "") != now.get(name, "")]
    sentences = [
        f"{name}: recorded {then.get(name) or 'none'}, now {now.get(name) or 'none'}" for name in changed
    ]
    return [departed, *sentences] if departed else sentences
