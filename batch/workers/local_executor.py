"""Workers as processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from .executor import Event, Failed, Order, Stopped
from .processes import how_it_ended
from .worker import READY, serve

_GRACE = 5.0
"""Wall s that a worker has for ending a job before it is killed."""


@dataclass
class _Worker:
    process: BaseProcess
    orders: Connection
    order: Order | None = None
    stopped_at: float | None = None


class LocalExecutor:
    """`slots` processes, started when they are first needed; a context manager that lets them go."""

    def __init__(self, slots: int | None = None) -> None:
        """By default one for each core that this process may use."""
        self._slots = slots if slots is not None else len(os.sched_getaffinity(0))
        self._workers: list[_Worker] = []

    def __enter__(self) -> LocalExecutor:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def slots(self) -> int:
        return self._slots

    def submit(self, order: Order) -> None:
        worker = next((w for w in self._workers if w.order is None), None)
        if worker is None:
            if len(self._workers) >= self._slots:
                raise ValueError("every worker is busy")
            worker = _started()
            self._workers.append(worker)
        worker.order = order
        with suppress(OSError):  # it has died: `wait` finds out
            worker.orders.send(order)

    def wait(self, seconds: float) -> Sequence[Event]:
        until = time.monotonic() + seconds
        while True:
            sources = [source for w in self._workers for source in (w.orders, w.process.sentinel)]
            if sources:
                wait(sources, max(0.0, until - time.monotonic()))
            events = [event for worker in list(self._workers) for event in self._heard(worker)]
            self._kill_overdue()
            if events or not sources or time.monotonic() >= until:
                return events

    def stop(self) -> None:
        for worker in self._workers:
            if worker.order is not None and worker.stopped_at is None:
                worker.stopped_at = time.monotonic()
                worker.process.terminate()

    def close(self) -> None:
        for worker in self._workers:
            worker.orders.close()
            if worker.order is not None:
                worker.process.terminate()
        for worker in self._workers:
            worker.process.join(_GRACE)
            if worker.process.exitcode is None:
                worker.process.kill()
                worker.process.join()
        self._workers.clear()

    def _heard(self, worker: _Worker) -> list[Event]:
        """What a worker says, or that it is gone."""
        with suppress(EOFError, OSError):
            if worker.orders.poll():
                said: Event | str = worker.orders.recv()
                if isinstance(said, str):
                    assert said == READY
                    return []
                worker.order = None
                return [said]
        return [] if worker.process.exitcode is None else self._gone(worker, worker.process.exitcode)

    def _kill_overdue(self) -> None:
        """The workers that were told to stop and do not."""
        for worker in self._workers:
            if worker.stopped_at is not None and time.monotonic() - worker.stopped_at > _GRACE:
                worker.process.kill()

    def _gone(self, worker: _Worker, code: int) -> list[Event]:
        self._workers.remove(worker)
        worker.orders.close()
        order = worker.order
        if order is None:
            return []
        if worker.stopped_at is not None:
            return [Stopped(order)]
        return [Failed(order, f"its worker {how_it_ended(code)}")]


def _started() -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=serve, args=(theirs,), name="picktree-worker")
    process.start()
    theirs.close()
    return _Worker(process, ours)
