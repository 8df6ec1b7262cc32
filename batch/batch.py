"""A batch: its jobs are handed to workers, and what comes of each is recorded once."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Protocol, TypeAlias

from ..logs.run import Run
from ..logs.session import LOG
from ..world.errors import PicktreeError
from .executor import Event, Executor, Failed, Finished, Order
from .job import Job, jobs_of
from .plan import Plan
from .plan_record import read_plan, write_plan
from .rows import JobRow, JobRows
from .store import NAME, Store

TRIES = 2
"""How often a job is begun before it counts as crashed."""
_LOOK = 0.2
"""Wall s between two looks at whether the batch was told to stop."""
Stop: TypeAlias = Literal["no", "finish", "now"]


@dataclass(frozen=True, slots=True)
class Ended:
    """A job that was recorded."""

    job: Job
    row: JobRow
    causes: tuple[str, ...]
    """Of its failures, each once."""


class Onlooker(Protocol):
    """Whoever follows a batch; nothing that it does changes it."""

    def started(self, total: int, done: Sequence[JobRow], workers: int) -> None: ...
    def ended(self, ended: Ended) -> None: ...
    def tried_again(self, job: Job, reason: str) -> None: ...
    def stopping(self, under_way: int) -> None: ...
    def waiting(self) -> None:
        """Several times a second: time goes on."""
        ...


class Batch:
    """One batch in its folder. A context manager: it holds the folder, so that no other process runs it."""

    def __init__(self, folder: Path, plan: Plan, jobs: tuple[Job, ...], store: Store, lock: int) -> None:
        self.folder, self.plan, self.jobs, self.store = folder, plan, jobs, store
        self._lock = lock
        self._by_id = {job.id: job for job in jobs}
        self._stop: Stop = "no"

    @classmethod
    def create(cls, folder: Path, plan: Plan) -> Batch:
        """A new batch of a checked plan. Raises PicktreeError when the folder holds one already."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise PicktreeError(f"{folder}: the folder cannot be made: {error.strerror}") from None
        lock = _locked(folder)
        if (folder / NAME).exists():
            raise PicktreeError(f"{folder}: there is a batch already; go on with it by --resume {folder}")
        jobs = jobs_of(plan, folder)
        write_plan(plan, folder)
        return cls(folder, plan, jobs, Store.create(folder / NAME, jobs), lock)

    @classmethod
    def resume(cls, folder: Path) -> Batch:
        """The batch in that folder, with what is missing or crashed still to do.

        It runs what it ran when it began, whatever became of the files since. Raises PicktreeError when there
        is none, or another process runs it.
        """
        plan = read_plan(folder)
        lock = _locked(folder)
        store = Store(folder / NAME)
        return cls(folder, plan, store.jobs(), store, lock)

    def __enter__(self) -> Batch:
        return self

    def __exit__(self, *_: object) -> None:
        self.store.close()
        os.close(self._lock)

    def stop(self) -> None:
        """The first time: finish what is under way; the second time: break it off. A signal may call it."""
        self._stop = "finish" if self._stop == "no" else "now"

    def run(self, executor: Executor, onlooker: Onlooker) -> bool:
        """Run all that is to do. False when it was stopped before the end."""
        self._take_in()
        to_do = self.store.to_do()
        waiting = deque((job, 1) for job in self.jobs if job.id in to_do)
        onlooker.started(len(self.jobs), self.store.recorded(), executor.slots)
        under_way: dict[str, Order] = {}
        told: Stop = "no"
        while waiting or under_way:
            if self._stop != told:
                told = self._stop
                onlooker.stopping(len(under_way))
                if told == "now":
                    executor.stop()
            while told == "no" and waiting and len(under_way) < executor.slots:
                job, attempt = waiting.popleft()
                under_way[job.id] = order = self._order(job, attempt)
                shutil.rmtree(order.folder, ignore_errors=True)  # of a try that was broken off
                executor.submit(order)
            if told != "no" and not under_way:
                return False
            for event in executor.wait(_LOOK):
                del under_way[event.order.job]
                self._deal_with(event, waiting, onlooker, stopping=told != "no")
            onlooker.waiting()
        return True

    def _deal_with(
        self, event: Event, waiting: deque[tuple[Job, int]], onlooker: Onlooker, *, stopping: bool
    ) -> None:
        order = event.order
        job = self._by_id[order.job]
        match event:
            case Finished():
                onlooker.ended(self._record(job, order, _result(order)))
            case Failed(_, reason) if order.attempt < TRIES:
                onlooker.tried_again(job, reason)
                if not stopping:
                    waiting.appendleft((job, order.attempt + 1))
            case Failed(_, reason):
                onlooker.ended(self._record(job, order, JobRows(_crashed(order, reason))))
            case _:
                pass

    def _record(self, job: Job, order: Order, rows: JobRows) -> Ended:
        keep = self.plan.keep
        kept = keep == "all" or (keep == "failures" and rows.job.status != "success")
        log = next(iter(sorted(order.folder.glob(f"*/{LOG}"))), None) if kept else None
        row = replace(rows.job, folder=str(log.parent.relative_to(self.folder)) if log else "")
        self.store.record(job.id, replace(rows, job=row))
        if not kept:
            shutil.rmtree(order.folder, ignore_errors=True)
        return Ended(job, row, tuple(dict.fromkeys(failure.cause for failure in rows.failures)))

    def _order(self, job: Job, attempt: int) -> Order:
        folder, limits = self.folder / "jobs" / f"{job.id}-{attempt}", self.plan.limits
        recipe = job.recipe_in(self.folder)
        return Order(job.id, attempt, recipe, job.seed, folder, limits.wall, limits.memory)

    def _take_in(self) -> None:
        """Record what workers had finished when the batch was ended before it could."""
        to_do = self.store.to_do()
        for job in self.jobs:
            if job.id not in to_do:
                continue
            for attempt in range(TRIES, 0, -1):
                order = self._order(job, attempt)
                if order.result.is_file():
                    self._record(job, order, _result(order))
                    break


def _result(order: Order) -> JobRows:
    return JobRows.from_json(order.result.read_bytes(), order.result)


def _crashed(order: Order, reason: str) -> JobRow:
    """With the last tick that its log tells of."""
    last: int | None = None
    log = next(iter(sorted(order.folder.glob(f"*/{LOG}"))), None)
    if log is not None:
        try:
            with Run(log) as run:
                last = len(run.ticks) - 1
        except PicktreeError:
            pass
    return JobRow(
        status="crashed",
        message=reason,
        digest="",
        attempts=order.attempt,
        items_total=None,
        items_sorted=None,
        items_misplaced=None,
        items_left=None,
        picks_tried=None,
        picks_held=None,
        sim_seconds=None,
        cpu_seconds=None,
        wall_seconds=None,
        last_tick=last,
        look_at=reason,
    )


def _locked(folder: Path) -> int:
    """A lock on the folder that goes with this process. Raises PicktreeError when another has it."""
    if not folder.is_dir():
        raise PicktreeError(f"{folder}: there is no such folder")
    lock = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        raise PicktreeError(f"{folder}: another process runs this batch") from None
    return lock
