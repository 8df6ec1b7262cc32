"""Workers that all tests of batches share: starting one takes longer than a job."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import nullcontext

import pytest

from picktree.apps.batch import Executor, LocalExecutor, comparison, rerun
from picktree.apps.batch.executor import Event, JobOrder


@pytest.fixture(scope="package")
def workers() -> Generator[LocalExecutor]:
    """Two."""
    with LocalExecutor(2) as executor:
        yield executor


class OneAtATime:
    """The same, but only one of them is made use of."""

    slots = 1

    def __init__(self, workers: LocalExecutor) -> None:
        self._workers = workers

    def submit(self, order: JobOrder) -> None:
        self._workers.submit(order)

    def wait(self, seconds: float) -> Sequence[Event]:
        return self._workers.wait(seconds)

    def stop(self) -> None:
        self._workers.stop()

    def close(self) -> None:
        self._workers.close()


@pytest.fixture(scope="package")
def worker(workers: LocalExecutor) -> Executor:
    """One."""
    return OneAtATime(workers)


@pytest.fixture
def no_other_workers(worker: Executor, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands that start a worker of their own get this one."""
    for module in (comparison, rerun):
        monkeypatch.setattr(module, "LocalExecutor", lambda slots: nullcontext(worker))
