"""Workers as processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

from .executor import Event, Failed, Order, Stopped
from .worker import READY, THREADS, serve

_LOOK = 0.5
"""Wall s between two looks at what the workers take."""
_GRACE = 15.0
"""Wall s that a run has for breaking off before its worker is killed."""
_PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass
class _Worker:
    process: BaseProcess
    orders: Connection
    order: Order | None = None
    ready: bool = False
    began: float = 0.0
    stopped_at: float | None = None


class LocalExecutor:
    """`slots` processes, started when they are first needed; a context manager that lets them go."""

    def __init__(self, slots: int | None = None) -> None:
        """By default one for each core that this process may use."""
        self._slots = slots if slots is not None else len(os.sched_getaffinity(0))
        self._workers: list[_Worker] = []
        self._looked = 0.0

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
        worker.order, worker.began, worker.stopped_at = order, time.monotonic(), None
        with suppress(OSError):  # it has died: `wait` finds out
            worker.orders.send(order)

    def wait(self, seconds: float) -> Sequence[Event]:
        until = time.monotonic() + seconds
        while True:
            left = until - time.monotonic()
            sources = [source for w in self._workers for source in (w.orders, w.process.sentinel)]
            if sources:
                wait(sources, max(0.0, min(left, _LOOK)))
            events = [event for worker in list(self._workers) for event in self._heard(worker)]
            events += self._overdue()
            if events or left <= 0 or not sources:
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
                worker.process.kill()
        for worker in self._workers:
            worker.process.join(_GRACE)
            if worker.process.exitcode is None:
                worker.process.kill()
                worker.process.join()
        self._workers.clear()

    def _heard(self, worker: _Worker) -> list[Event]:
        """What a worker says, or that it is gone."""
        try:
            if worker.orders.poll():
                said: Event | str = worker.orders.recv()
                if isinstance(said, str):
                    worker.ready, worker.began = said == READY, time.monotonic()
                    return []
                worker.order = None
                return [said]
        except (EOFError, OSError):
            pass
        if worker.process.exitcode is None:
            return []
        return self._gone(worker, _how_it_ended(worker.process.exitcode))

    def _overdue(self) -> list[Event]:
        """The orders that are over their limits; their workers are killed."""
        now = time.monotonic()
        if now - self._looked < _LOOK:
            return []
        self._looked = now
        events: list[Event] = []
        for worker in [w for w in self._workers if w.order is not None]:
            order = worker.order
            assert order is not None
            reason = ""
            if worker.stopped_at is not None:
                reason = "it did not break off" if now - worker.stopped_at > _GRACE else ""
            elif worker.ready and now - worker.began > order.wall:
                reason = f"it took more than {order.wall:g} s of wall time"
            elif _resident(worker.process.pid) > order.memory:
                reason = f"it took more than {order.memory / 1e6:.0f} MB of memory"
            if reason:
                worker.process.kill()
                worker.process.join()
                events += self._gone(worker, reason)
        return events

    def _gone(self, worker: _Worker, reason: str) -> list[Event]:
        self._workers.remove(worker)
        worker.orders.close()
        order = worker.order
        if order is None:
            return []
        return [Stopped(order) if worker.stopped_at is not None else Failed(order, reason)]


def _started() -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=serve, args=(theirs,), name="picktree-worker", daemon=True)
    with _one_thread_each():
        process.start()
    theirs.close()
    return _Worker(process, ours)


@contextmanager
def _one_thread_each() -> Generator[None]:
    """What is started meanwhile uses one core: the libraries read it when they are loaded."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _how_it_ended(code: int) -> str:
    if code >= 0:
        return f"its worker ended with exit code {code}"
    try:
        return f"its worker was ended by {signal.Signals(-code).name}"
    except ValueError:
        return f"its worker was ended by signal {-code}"


def _resident(pid: int | None) -> int:
    """Bytes of memory that a process holds; 0 when it is no more."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE
    except (OSError, IndexError, ValueError):
        return 0
