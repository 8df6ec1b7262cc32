"""Cluster of Ray: the connection to a running one or one of this machine, its nodes and workers."""

from __future__ import annotations

import asyncio
import logging
import os
import shutil
import signal
import socket
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import ray
from ray.exceptions import OutOfMemoryError, RayError
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from picktree.files import PicktreeError

from .executor import Event, JobFailed, JobOrder, JobStopped
from .local_executor import LocalExecutor
from .ray_executor import TOKEN, Installation, Task, installed

_WORKER_CHECK_PERIOD = 0.02
"""Interval between checks of the worker, wall s."""
_PREFIX: Final = "picktree-foreman-"


@dataclass(frozen=True, slots=True)
class ResultFile:
    """File that must be copied to the batch's machine."""

    name: str
    """Path in the order's folder."""
    size: int


@dataclass(frozen=True, slots=True)
class TaskReport:
    event: Event
    files: tuple[ResultFile, ...]
    """Files to copy; empty when they are in place already."""


class NodeWorker:
    """Actor of Ray: its methods are called remotely, one after the other except `stop`."""

    def __init__(self) -> None:
        # A spawned process rereads its parent's main file; that of Ray's workers would load Ray.
        vars(sys.modules["__main__"]).pop("__file__", None)
        _clear_after_the_dead()
        self._place = Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{os.getpid()}-"))
        os.environ["TMPDIR"] = str(self._place)  # a worker that is killed leaves nothing elsewhere
        self._executor = LocalExecutor(1)
        self._stopped: set[Path] = set()

    async def installed(self) -> Installation:
        return installed()

    async def is_there(self) -> None:
        """Do nothing: a reply shows that the worker is alive."""

    async def carry_out(self, task: Task, recipe: bytes) -> TaskReport:
        """Run an order in its folder when this machine shares it, else in a separate folder."""
        order = task.order
        shared = _takes_token(task)
        try:
            own = order if shared else self._moved(order, recipe)
        except OSError as error:
            return TaskReport(
                JobFailed(order, f"its node cannot write to {self._place}: {error.strerror}"), ()
            )
        if order.folder in self._stopped:
            return TaskReport(JobStopped(order), ())
        with _no_signal_blocked():
            self._executor.submit(own)
        while not (events := self._executor.wait(0.0)):
            await asyncio.sleep(_WORKER_CHECK_PERIOD)
        return TaskReport(replace(events[0], order=order), () if shared else _files(own.folder))

    async def stop(self, folder: Path) -> None:
        """Break off the order of that folder, which may still be in transit."""
        self._stopped.add(folder)
        self._executor.stop()

    async def piece(self, folder: str, name: str, offset: int, size: int) -> bytes:
        """Return a part of a file in one of the worker's own folders."""
        with (self._place / folder / name).open("rb") as file:
            file.seek(offset)
            return file.read(size)

    async def forget(self, folder: str) -> None:
        """Delete an order's files after they were copied."""
        shutil.rmtree(self._place / folder, ignore_errors=True)

    async def close(self) -> None:
        """End the worker; nothing is left on this machine."""
        self._executor.close()
        shutil.rmtree(self._place, ignore_errors=True)

    def _moved(self, order: JobOrder, recipe: bytes) -> JobOrder:
        file = self._place / order.recipe.name
        if not file.is_file():
            file.write_bytes(recipe)
        folder = self._place / order.folder.name
        shutil.rmtree(folder, ignore_errors=True)
        return replace(order, recipe=file, folder=folder)


@contextmanager
def _no_signal_blocked() -> Generator[None]:
    """Unblock signals, so that a process started in the block can be stopped; Ray's threads block them."""
    before = signal.pthread_sigmask(signal.SIG_SETMASK, ())
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _takes_token(task: Task) -> bool:
    """Return whether the order's folder is that of the batch: then the token can be removed."""
    token = task.order.folder / TOKEN
    try:
        if token.read_text() != task.token:
            return False
        token.unlink()
    except OSError:
        return False
    return True


def _files(folder: Path) -> tuple[ResultFile, ...]:
    return tuple(
        ResultFile(str(path.relative_to(folder)), path.stat().st_size)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    )


def _clear_after_the_dead() -> None:
    """Delete the folders of workers that were killed."""
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        pid = folder.name.removeprefix(_PREFIX).partition("-")[0]
        if not Path("/proc", pid).exists():
            shutil.rmtree(folder, ignore_errors=True)


_REPLY_TIME_LIMIT = 5.0
"""Time limit for a reply of the cluster's port, wall s."""
_OBJECT_STORE_BYTES = 100 << 20
"""Size of the object store of a cluster of this machine, bytes."""


@dataclass(frozen=True, slots=True)
class ClusterNode:
    id: str
    address: str
    cpus: int


def connect(address: str | None, workers: int | None, folder: Path) -> None:
    """Connect to the cluster at `address`; None: start one with this number of CPUs, its files in `folder`.

    Raises PicktreeError without a cluster there.
    """
    if address is None:
        _start(workers or len(os.sched_getaffinity(0)), folder)
        return
    if address != "auto":
        _require_answer(address)
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError, ValueError) as error:
        if address == "auto":
            raise PicktreeError("no Ray cluster runs here that --address auto could find") from None
        why = str(error).strip().partition("\n")[0].strip() or type(error).__name__
        raise PicktreeError(f"the Ray cluster at {address} cannot be used: {why}") from None


def nodes() -> tuple[ClusterNode, ...]:
    """Return the present nodes that have CPUs."""
    made = (
        ClusterNode(str(n["NodeID"]), str(n["NodeManagerAddress"]), int(n["Resources"].get("CPU", 0)))
        for n in ray.nodes()
        if n["Alive"]
    )
    return tuple(sorted((node for node in made if node.cpus), key=lambda node: node.id))


def _start(cpus: int, folder: Path) -> None:
    ray.init(
        address="local",
        num_cpus=cpus,
        include_dashboard=False,
        log_to_driver=False,
        logging_level=logging.ERROR,
        object_store_memory=_OBJECT_STORE_BYTES,
        _temp_dir=str(folder),
    )


def _require_answer(address: str) -> None:
    """Check that the port replies: Ray itself ends the process when it does not."""
    host, _, port = address.rpartition(":")
    if not host or "/" in address or not port.isdigit():
        raise PicktreeError(f"--address {address}: the address of a Ray cluster is HOST:PORT, or auto")
    try:
        socket.create_connection((host, int(port)), _REPLY_TIME_LIMIT).close()
    except (OSError, OverflowError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise PicktreeError(f"no Ray cluster answers at {address}: {why.lower()}") from None


__all__ = ["RayError", "WorkerHandle", "reason"]


class WorkerHandle:
    """Worker that takes one CPU of a node. Calls of its actor raise RayError when the worker is gone."""

    def __init__(self, node: ClusterNode) -> None:
        self.node = node
        self.actor = (
            ray.remote(NodeWorker)
            .options(
                num_cpus=1,
                max_restarts=0,  # who tries again is the batch
                max_task_retries=0,
                scheduling_strategy=NodeAffinitySchedulingStrategy(node.id, soft=False),
            )
            .remote()
        )

    def kill(self) -> None:
        """Kill the worker with its process, whatever that does."""
        ray.kill(self.actor)


def shared(content: bytes) -> ray.ObjectRef[bytes]:
    """Store content that many tasks need and each node fetches once."""
    return ray.put(content)


def reason(error: RayError, node: ClusterNode) -> str:
    """Return the reason why a worker does not reply, in a few words."""
    if isinstance(error, OutOfMemoryError):
        return f"Ray ended its worker: the node {node.address} ran out of memory"
    if "its node has died" in str(error):
        return f"the node {node.address} is gone"
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    import_error = next(
        (line for line in lines if line.startswith(("ModuleNotFoundError", "ImportError"))), ""
    )
    return import_error or f"its worker on the node {node.address} is gone"
