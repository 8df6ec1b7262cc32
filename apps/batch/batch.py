"""Execution of a batch: jobs are given to workers, and each result is recorded once."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections import deque
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Protocol, TypeAlias

from picktree.analysis import Run
from picktree.files import PicktreeError

from .batch_decision import decisions
from .executor import Event, Executor, JobFailed, JobFinished, JobOrder, JobStopped
from .job_process import OUTPUT_FILE
from .plan import BatchPlan, Job, jobs_of, read_plan, write_plan
from .store import RESULTS_FILE, Store
from .tables import CrashRow, JobRow, JobRows

_JOBS = "jobs"


def try_folder(batch: Path, job: str, attempt: int) -> Path:
    return batch / _JOBS / f"{job}-{attempt}"


def result_of(order: JobOrder) -> JobRows | None:
    """Return the result of an attempt; None when it is missing or unreadable."""
    try:
        return JobRows.from_json(order.result.read_bytes(), order.result)
    except (OSError, PicktreeError):
        return None


def run_folder(order: JobOrder, batch: Path) -> str:
    """Return the folder of the run with its log, relative to the batch's folder; empty without a run."""
    return str(order.log.parent.relative_to(batch)) if order.log else ""


def lost_attempt(order: JobOrder, reason: str, batch: Path, *, kept: bool) -> CrashRow:
    """Return the row of an attempt without a result, with the last tick of its log.

    Its folder is that of the run; without a log that of the attempt, if it printed output.
    """
    folder = ""
    if kept:
        folder = run_folder(order, batch)
        if not folder and (order.folder / OUTPUT_FILE).exists():
            folder = str(order.folder.relative_to(batch))
    return CrashRow(order.attempt, reason, _last_tick(order), folder)


def crashed_job(crash: CrashRow) -> JobRow:
    """Return the row of a job whose last attempt was lost."""
    return JobRow(
        status="crashed",
        message=crash.reason,
        digest="",
        attempts=crash.attempt,
        last_tick=crash.last_tick,
        look_at=crash.reason,
        folder=crash.folder,
    )


def _last_tick(order: JobOrder) -> int | None:
    if order.log is None:
        return None
    try:
        with Run(order.log) as run:
            return len(run.ticks) - 1 if run.ticks else None
    except PicktreeError:
        return None


MAX_ATTEMPTS = 2
"""Number of attempts after which a job counts as crashed."""
_STOP_CHECK_PERIOD = 0.2
"""Interval between checks for a stop request, wall s."""
_MIN_FREE_BYTES = 200 * 10**6
"""Least free space on the batch's disk for the start of a job, bytes."""
Stop: TypeAlias = Literal["no", "finish", "now"]


@dataclass(frozen=True, slots=True)
class RecordedJob:
    job: Job
    row: JobRow
    causes: tuple[str, ...]
    """Causes of its failures, each once."""


class BatchWatcher(Protocol):
    """Observer of a batch, without influence on it."""

    def started(self, total: int, done: Sequence[JobRow], workers: int) -> None: ...
    def ended(self, ended: RecordedJob) -> None: ...
    def tried_again(self, job: Job, reason: str) -> None: ...
    def stopping(self, under_way: int) -> None: ...
    def waiting(self) -> None:
        """Called several times a second while the batch waits."""


class Batch:
    """Batch in its folder. A context manager that locks the folder against other processes."""

    def __init__(
        self, folder: Path, plan: BatchPlan, jobs: tuple[Job, ...], store: Store, lock: ExitStack
    ) -> None:
        self.folder, self.plan, self.jobs, self.store = folder, plan, jobs, store
        self._place = folder.absolute()
        self._lock = lock
        self._by_id = {job.id: job for job in jobs}
        self._stop: Stop = "no"
        self._full = False
        self.decided = False
        """Whether the recipes were distinguished, in a batch that runs until then."""

    @classmethod
    def create(cls, folder: Path, plan: BatchPlan) -> Batch:
        """Create a batch of a checked plan. Raises PicktreeError when the folder holds one already."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise PicktreeError(f"{folder}: the folder cannot be made: {error.strerror}") from None
        with _locked(folder) as lock:
            if (folder / RESULTS_FILE).exists():
                raise PicktreeError(f"{folder}: there is a batch already; continue it with --resume {folder}")
            return cls._made(folder, plan, lock)

    @classmethod
    def resume(cls, folder: Path) -> Batch:
        """Open the batch in that folder; missing and crashed jobs are still to do.

        It runs its recorded recipes, even if the files have changed. Raises PicktreeError without a batch
        there, or when another process runs it.
        """
        plan = read_plan(folder)
        with _locked(folder) as lock:
            if not (folder / RESULTS_FILE).exists():  # its creation was cut short
                return cls._made(folder, plan, lock)
            store = Store(folder / RESULTS_FILE)
            return cls(folder, plan, store.jobs(), store, lock.pop_all())

    @classmethod
    def _made(cls, folder: Path, plan: BatchPlan, lock: ExitStack) -> Batch:
        jobs = jobs_of(plan, folder)
        write_plan(plan, folder)
        return cls(folder, plan, jobs, Store.create(folder / RESULTS_FILE, jobs), lock.pop_all())

    def __enter__(self) -> Batch:
        return self

    def __exit__(self, *_: object) -> None:
        self.store.close()
        self._lock.close()

    def stop(self) -> None:
        """Request a stop: the first call finishes running jobs, the second breaks them off. Safe in a signal
        handler."""
        self._stop = "finish" if self._stop == "no" else "now"

    def finish(self) -> None:
        """Request a stop after the running jobs, also when called again. Safe in a signal handler."""
        self._stop = "finish" if self._stop == "no" else self._stop

    def break_off(self) -> None:
        """Break off the running jobs. Safe in a signal handler."""
        self._stop = "now"

    def run(self, executor: Executor, onlooker: BatchWatcher) -> bool:
        """Run all open jobs, each seed with all variants. Return False when stopped before the end.

        A plan `until: decided` ends when the recipes are distinguished. A stopped batch then has the same
        seeds of each variant, but for the last. Raises PicktreeError when results cannot be written, or the
        disk is full; --resume continues.
        """
        self._take_in()
        to_do, tried = self.store.to_do(), self.store.lost_tries()
        jobs = sorted(self.jobs, key=lambda job: job.number % len(self.plan.seeds))
        waiting = deque((job, 1 + tried.get(job.id, 0)) for job in jobs if job.id in to_do)
        self._decide()
        onlooker.started(len(self.jobs), self.store.recorded(), executor.slots)
        under_way: dict[str, JobOrder] = {}
        reported: Stop = "no"
        while (waiting and not self.decided) or under_way:
            if self._stop != reported:
                reported = self._stop
                onlooker.stopping(len(under_way))
                if reported == "now":
                    executor.stop()
            while self._stop == "no" and waiting and not self.decided and len(under_way) < executor.slots:
                if not self._has_disk_space():
                    self._full = True
                    self.finish()
                    break
                job, attempt = waiting.popleft()
                under_way[job.id] = order = self._attempt_order(job, attempt)
                executor.submit(order)
            if not under_way and reported != "no":
                break
            for event in executor.wait(_STOP_CHECK_PERIOD):
                order = under_way.pop(event.order.job)
                ended = self._record_event(event, onlooker)
                if ended is not None:
                    onlooker.ended(ended)
                    self._decide()
                else:
                    job = self._by_id[order.job]
                    waiting.appendleft((job, 1 + self.store.lost_tries().get(job.id, 0)))
            onlooker.waiting()
        if self._full:
            raise PicktreeError(
                f"{self.folder}: less than {_MIN_FREE_BYTES / 1e6:.0f} MB are left on its disk, "
                f"so no further job is begun; free some space, and continue with --resume {self.folder}"
            )
        return self.decided or not waiting

    def _decide(self) -> None:
        """Look whether the recipes are distinguished. A decision stays: jobs under way do not undo it."""
        if self.plan.until == "decided" and not self.decided:
            self.decided = all(each.result.decided for each in decisions(self.store, self.plan))

    def _record_event(self, event: Event, onlooker: BatchWatcher) -> RecordedJob | None:
        """Record the result of an event; return None when its job is still to be run."""
        order = event.order
        job = self._by_id[order.job]
        rows = result_of(order)
        if rows is not None:
            return self._record(job, order, rows)
        match event:
            case JobStopped() if self._stop == "now":
                shutil.rmtree(order.folder, ignore_errors=True)
                return None
            case JobStopped():
                reason = "the job was interrupted, by its own code or from outside"
            case JobFinished():
                reason = f"{order.result}: its result is missing or damaged"
            case JobFailed():
                reason = event.reason
        if not self._has_disk_space():
            shutil.rmtree(order.folder, ignore_errors=True)
            if not self._has_disk_space():  # it was not this job that filled the disk
                return None
        crash = lost_attempt(order, reason, self._place, kept=self.plan.keep != "none")
        if order.attempt >= MAX_ATTEMPTS:
            return self._record(job, order, JobRows(crashed_job(crash)), crash)
        self.store.lose(job.id, crash)
        if not crash.folder:
            shutil.rmtree(order.folder, ignore_errors=True)
        onlooker.tried_again(job, reason)
        return None

    def _record(self, job: Job, order: JobOrder, rows: JobRows, crash: CrashRow | None = None) -> RecordedJob:
        keep = self.plan.keep
        kept = keep == "all" or (keep == "failures" and rows.job.status != "success")
        row = rows.job if crash else replace(rows.job, folder=run_folder(order, self._place) if kept else "")
        self.store.record(job.id, replace(rows, job=row), crash)
        for attempt in range(1, MAX_ATTEMPTS + 1):
            lost_before = attempt < order.attempt and keep != "none"
            if not lost_before and not (attempt == order.attempt and row.folder):
                shutil.rmtree(try_folder(self._place, job.id, attempt), ignore_errors=True)
        return RecordedJob(job, row, tuple(dict.fromkeys(failure.cause for failure in rows.failures)))

    def _attempt_order(self, job: Job, attempt: int) -> JobOrder:
        """Return the order of an attempt; remains of earlier attempts are deleted."""
        order = self._order(job, attempt)
        if attempt == 1:
            self.store.reset_crashed(job.id)
        for later in range(attempt, MAX_ATTEMPTS + 1):
            shutil.rmtree(try_folder(self._place, job.id, later), ignore_errors=True)
        return order

    def _order(self, job: Job, attempt: int) -> JobOrder:
        folder, plan = try_folder(self._place, job.id, attempt), self.plan
        recipe = job.recipe_in(self._place)
        return JobOrder(job.id, attempt, recipe, job.seed, folder, plan.wall_limit, plan.memory, plan.disk)

    def _take_in(self) -> None:
        """Record results that workers finished after the batch ended."""
        to_do = self.store.to_do()
        for job in self.jobs:
            if job.id not in to_do:
                continue
            for attempt in range(MAX_ATTEMPTS, 0, -1):
                order = self._order(job, attempt)
                if (rows := result_of(order)) is not None:
                    self._record(job, order, rows)
                    break

    def _has_disk_space(self) -> bool:
        """Whether the disk has room for another job."""
        return shutil.disk_usage(self.folder).free >= _MIN_FREE_BYTES


def _locked(folder: Path) -> ExitStack:
    """Lock the folder until this process ends; the file holds its number.

    Raises PicktreeError when another has the lock.
    """
    if not folder.is_dir():
        raise PicktreeError(f"{folder}: there is no such folder")
    try:
        lock = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise PicktreeError(f"{folder}: nothing can be written there: {error.strerror}") from None
    held = ExitStack()
    held.callback(os.close, lock)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        held.close()
        raise PicktreeError(f"{folder}: another process runs this batch") from None
    os.ftruncate(lock, 0)
    os.write(lock, f"{os.getpid()}\n".encode())
    return held
