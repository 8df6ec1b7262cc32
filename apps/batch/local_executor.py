"""Executor with workers as processes of this machine."""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from types import FrameType, ModuleType
from typing import NoReturn

from .executor import Event, JobFailed, JobOrder, JobStopped
from .job_process import JobProcess, adopt_orphans, die_with_parent, exit_code_words, silence

READY = "ready"
"""Message of a worker that has loaded everything."""

_MODULES = (
    "pybullet",
    "scipy.optimize",  # the search out of contacts
    "trimesh",  # hulls of unknown obstacles
    "picktree.recovery",
    "picktree.skills",
    "picktree.simulation.kinematic.backend",
    "picktree.simulation.physics.backend",
    "picktree.apps.batch.job_process",
    "picktree.apps.batch.run_rows",
    "picktree.session.run_recipe",
)


class _StopRequest(BaseException):
    """Exception in a worker when the batch stops it, or is gone."""


def serve(orders: Connection) -> None:
    """Run each order that arrives in a separate process, until the other side is closed.

    On SIGTERM, and when the batch's process is gone, it ends with all running orders.
    """
    os.setsid()  # Ctrl-C is for the batch to deal with
    die_with_parent(signal.SIGTERM)
    adopt_orphans()
    with silence():  # libraries greet when they are loaded
        load()
    with suppress(EOFError, OSError, _StopRequest):
        orders.send(READY)
        while True:
            orders.send(_served(orders.recv()))
    os._exit(0)  # without the farewells of libraries, which would stand in the batch's output


def _served(order: JobOrder) -> Event:
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    before = signal.signal(signal.SIGTERM, _raise_stop)
    try:
        under_way = JobProcess(order)
        try:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
            return under_way.event()
        finally:
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
            under_way.end()
    finally:
        signal.signal(signal.SIGTERM, before)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})


def _raise_stop(number: int, frame: FrameType | None) -> NoReturn:
    raise _StopRequest


def load() -> None:
    """Load all modules and data that jobs share."""
    for module in _MODULES:
        import_module(module)
    from picktree.logs import FIXED, binary_gltf, log_records
    from picktree.recovery import NODES as RECOVERY
    from picktree.robot.perception import RobotMask, catalogue_poses
    from picktree.robot.planning import robot_geometry
    from picktree.session import arithmetic, environment, frozen_before_runs, run_recipe, sources
    from picktree.skills import (
        NODES as SKILLS,  # a node is imported when it is asked for: here, all of them are
    )
    from picktree.trees.loading import installed_entries
    from picktree.world import Tree
    from picktree.world.robot_model import RobotModel, load_robot
    from picktree.world.scene import load_scene

    assert RECOVERY and SKILLS
    # The robot of the shipped scenes; with another one, each job loads that itself.
    robot = load_robot("panda")
    catalogue_poses(load_scene("three_bins").catalogue)
    binary_gltf.link_meshes(robot.urdf)
    run_recipe.installed_meshes(robot)
    model = RobotModel(robot)
    robot_geometry(model)
    RobotMask(model)
    arithmetic()
    environment.revision()
    sources()
    installed_entries()
    for kind in (
        log_records.BodyRecord,
        log_records.Event,
        log_records.PartRecord,
        log_records.TickMessage,
        log_records.NodesMessage,
        Tree,
    ):
        log_records.record_adapter(kind)
    for topic in FIXED:
        topic.schema_data()
    gc.collect()
    gc.freeze()  # what is shared with the jobs' processes stays shared
    frozen_before_runs()


_STOP_TIME_LIMIT = 5.0
"""Time limit of a worker for ending a job before it is killed, wall s."""


@dataclass
class _Worker:
    process: BaseProcess
    orders: Connection
    order: JobOrder | None = None
    stopped_at: float | None = None


class LocalExecutor:
    """Executor with `slots` processes, started on demand. A context manager that ends them."""

    def __init__(self, slots: int | None = None) -> None:
        """`slots`: by default one for each core that this process may use."""
        self._slots = slots if slots is not None else len(os.sched_getaffinity(0))
        self._workers: list[_Worker] = []

    def __enter__(self) -> LocalExecutor:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def slots(self) -> int:
        return self._slots

    def submit(self, order: JobOrder) -> None:
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
            events = [event for worker in list(self._workers) for event in self._events_of(worker)]
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
            worker.process.join(_STOP_TIME_LIMIT)
            if worker.process.exitcode is None:
                worker.process.kill()
                worker.process.join()
        self._workers.clear()

    def _events_of(self, worker: _Worker) -> list[Event]:
        """Return the events of a worker's message, or of its loss."""
        with suppress(EOFError, OSError):
            if worker.orders.poll():
                message: Event | str = worker.orders.recv()
                if isinstance(message, str):
                    assert message == READY
                    return []
                worker.order = None
                return [message]
        return [] if worker.process.exitcode is None else self._gone(worker, worker.process.exitcode)

    def _kill_overdue(self) -> None:
        """Kill the workers that were stopped and do not end."""
        for worker in self._workers:
            if worker.stopped_at is not None and time.monotonic() - worker.stopped_at > _STOP_TIME_LIMIT:
                worker.process.kill()

    def _gone(self, worker: _Worker, code: int) -> list[Event]:
        self._workers.remove(worker)
        worker.orders.close()
        order = worker.order
        if order is None:
            return []
        if worker.stopped_at is not None:
            return [JobStopped(order)]
        return [JobFailed(order, f"its worker {exit_code_words(code)}")]


def _started() -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=serve, args=(theirs,), name="picktree-worker")
    with without_main():
        process.start()
    theirs.close()
    return _Worker(process, ours)


@contextmanager
def without_main() -> Generator[None]:
    """Start a process without the program of this one.

    A spawned process imports the `__main__` of its parent, and a script without a guard would then run its
    batch again. A worker needs nothing of it.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
