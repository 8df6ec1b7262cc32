"""Driver: the process that communicates with Ray for a batch.

Ray takes a process over with signal handlers, threads and output, and ends the process when the cluster is
gone. So the batch's own process does not load it."""

from __future__ import annotations

import asyncio
import os
import shutil
import sys
import threading
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

import ray

from picktree.files import PicktreeError

from .cluster import ClusterNode, RayError, ResultFile, WorkerHandle, connect, nodes, reason, shared
from .executor import Event, JobFailed, JobOrder, JobStopped
from .ray_executor import (
    STOP,
    BatchMessage,
    ClusterRefusal,
    ClusterSettings,
    DriverMessage,
    Installation,
    Task,
    WorkerCount,
    difference,
)

_COPY_PIECE_BYTES = 4 << 20
"""Size of the pieces in which files are copied, bytes."""


async def fetch_files(hired: WorkerHandle, files: tuple[ResultFile, ...], folder: Path) -> None:
    """Copy files into `folder`, which gets its name when all have arrived.

    Raises OSError when they cannot be written, RayError when the node is gone.
    """
    arriving = folder.with_name(f"{folder.name}.arriving")
    shutil.rmtree(arriving, ignore_errors=True)
    try:
        for file in files:
            path = arriving / file.name
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("wb") as written:
                for offset in range(0, file.size, _COPY_PIECE_BYTES):
                    size = min(_COPY_PIECE_BYTES, file.size - offset)
                    written.write(await hired.actor.piece.remote(folder.name, file.name, offset, size))
        shutil.rmtree(folder, ignore_errors=True)
        if files:
            arriving.rename(folder)
    finally:
        shutil.rmtree(arriving, ignore_errors=True)
    await hired.actor.forget.remote(folder.name)


_NODE_CHECK_PERIOD = 2.0
"""Interval between checks for nodes, wall s."""
_REPLACEMENT_DELAY = 1.0
"""Delay between the loss of a worker and its replacement, wall s."""
_FIRST_WORKER_TIME_LIMIT = 60.0
"""Time limit for the first worker, wall s."""
_NODE_RETURN_TIME_LIMIT = 300.0
"""Time limit for the return of nodes when all have left, wall s."""
_CLEANUP_TIME_LIMIT = 5.0
"""Time limit for a worker's cleanup, wall s."""
_SILENCE_TIME_LIMIT = 120.0
"""Time beyond an order's limit after which a silent worker counts as lost, wall s."""
_STOP_TIME_LIMIT = 30.0
"""Time limit for breaking off all runs, wall s; longer than a worker's own limit."""
_MAX_LOSSES_BEFORE_READY = 3
"""Number of consecutive losses of a worker before it is ready, after which its node is left out."""


@dataclass
class _Post:
    """Node with its workers."""

    node: ClusterNode
    slots: list[asyncio.Task[None]] = field(default_factory=list[asyncio.Task[None]])
    met: bool = False
    refused: str = ""


class WorkerPool:
    """Pool of workers that reports the results of its tasks through `tell`, within its event loop."""

    def __init__(self, here: Installation, limit: int | None, tell: Callable[[DriverMessage], None]) -> None:
        """`limit`: maximum number of workers."""
        self._here, self._limit, self._tell = here, limit, tell
        self._tasks: asyncio.Queue[Task] = asyncio.Queue()
        self._posts: dict[str, _Post] = {}
        self._under_way: dict[Path, tuple[Task, WorkerHandle]] = {}
        self._stopping: set[Path] = set()
        self._recipes: dict[Path, ray.ObjectRef[bytes]] = {}
        self._slots: set[asyncio.Task[None]] = set()
        self._changed = asyncio.Event()
        self._reported_count: int | None = None

    async def gather(self) -> None:
        """Wait until every node has a worker or its time is over.

        Raises PicktreeError when a node has another installation than the batch's machine, or no worker
        exists.
        """
        self._hire(nodes())
        if not self._posts:
            raise PicktreeError("the Ray cluster has no node with a CPU")
        with suppress(TimeoutError):
            async with asyncio.timeout(_FIRST_WORKER_TIME_LIMIT):
                while any(not (post.met or post.refused) for post in self._posts.values()):
                    self._changed.clear()
                    await self._changed.wait()
        refused = [f"the node {p.node.address}: {p.refused}" for p in self._posts.values() if p.refused]
        if refused:
            raise PicktreeError("; ".join(refused))
        if not any(post.met for post in self._posts.values()):
            raise PicktreeError(
                f"no worker could be started on the Ray cluster within {_FIRST_WORKER_TIME_LIMIT:.0f} s: its "
                "CPUs are taken"
            )
        self._reported_count = 0
        self._count()

    async def watch(self) -> None:
        """Start workers on nodes that join, while this runs. Raises PicktreeError when no worker is left."""
        alone = 0.0
        while alone < _NODE_RETURN_TIME_LIMIT:
            await asyncio.sleep(_NODE_CHECK_PERIOD)
            self._hire(await asyncio.to_thread(nodes))
            alone = 0.0 if self._reported_count else alone + _NODE_CHECK_PERIOD
        raise PicktreeError(
            f"the Ray cluster has had no node for {_NODE_RETURN_TIME_LIMIT:.0f} s; --resume continues "
            "when the cluster has a node again"
        )

    def give(self, task: Task) -> None:
        self._tasks.put_nowait(task)

    def stop(self) -> None:
        """Break off all running orders."""
        while not self._tasks.empty():
            self._tell(JobStopped(self._tasks.get_nowait().order))
        for folder, (task, hired) in self._under_way.items():
            self._stopping.add(folder)
            hired.actor.stop.remote(task.order.folder)
        asyncio.get_running_loop().call_later(_STOP_TIME_LIMIT, self._lose, tuple(self._under_way))

    async def close(self) -> None:
        for slot in self._slots:
            slot.cancel()
        await asyncio.gather(*self._slots, return_exceptions=True)

    def _hire(self, there: tuple[ClusterNode, ...]) -> None:
        """Start the missing workers, spread over the present nodes."""
        for gone in {*self._posts} - {node.id for node in there}:
            del self._posts[gone]
        for node in there:
            self._posts.setdefault(node.id, _Post(node))
        usable = [post.node for post in self._posts.values() if not post.refused]
        for node, count in _workers_by_node(usable, self._limit).items():
            post = self._posts[node.id]
            post.slots = [slot for slot in post.slots if not slot.done()]
            for _ in range(count - len(post.slots)):
                slot = asyncio.create_task(self._serve(post))
                post.slots.append(slot)
                self._slots.add(slot)
                slot.add_done_callback(self._slots.discard)
        self._count()

    def _count(self) -> None:
        """Report the number of workers when it has changed after the start."""
        serving = [post for post in self._posts.values() if not post.refused]
        count = sum(not slot.done() for post in serving for slot in post.slots)
        if self._reported_count not in (None, count):
            self._reported_count = count
            self._tell(WorkerCount(count))

    async def _serve(self, post: _Post) -> None:
        """Run one slot of a node: a worker, replaced when it is lost, while the node is present."""
        lost = 0
        while not post.refused:
            hired, idle = WorkerHandle(post.node), False
            try:
                self._meet(post, difference(self._here, await hired.actor.installed.remote()))
                lost = 0
                while not post.refused:
                    idle = True
                    task = await self._tasks.get()
                    idle = False
                    await self._see_to(task, hired)
                await _dismiss(hired, idle=True)
            except asyncio.CancelledError:
                await _dismiss(hired, idle=idle)
                raise
            except RayError as error:
                if post.node not in await asyncio.to_thread(nodes):
                    return
                lost += 1
                if lost == _MAX_LOSSES_BEFORE_READY:
                    self._meet(post, reason(error, post.node))
                await asyncio.sleep(_REPLACEMENT_DELAY)

    def _meet(self, post: _Post, refused: str) -> None:
        post.met, post.refused = True, refused
        self._changed.set()
        if refused:
            self._count()

    async def _see_to(self, task: Task, hired: WorkerHandle) -> None:
        """Run a task. Raises RayError when the worker is lost; the task itself is never lost."""
        order = task.order
        self._under_way[order.folder] = (task, hired)
        event: Event | None = None
        try:
            await hired.actor.is_there.remote()
            event = await self._outcome(task, hired)
            await hired.actor.is_there.remote()
        finally:
            del self._under_way[order.folder]
            if order.folder in self._stopping:
                self._tell(JobStopped(order))
            elif event is not None:
                self._tell(event)
            else:  # it was lost before it had anything to do
                self._tasks.put_nowait(task)

    async def _outcome(self, task: Task, hired: WorkerHandle) -> Event:
        order = task.order
        try:
            async with asyncio.timeout(order.wall + _SILENCE_TIME_LIMIT):
                report = await hired.actor.carry_out.remote(task, self._recipe(order))
                if report.files:
                    await fetch_files(hired, report.files, order.folder)
        except TimeoutError:
            hired.kill()
            return JobFailed(order, f"its worker on the node {hired.node.address} does not answer")
        except RayError as error:
            return JobFailed(order, reason(error, hired.node))
        except OSError as error:
            return JobFailed(order, f"{error.filename or order.folder}: {error.strerror}")
        return report.event

    def _recipe(self, order: JobOrder) -> ray.ObjectRef[bytes]:
        if order.recipe not in self._recipes:
            self._recipes[order.recipe] = shared(order.recipe.read_bytes())
        return self._recipes[order.recipe]

    def _lose(self, folders: tuple[Path, ...]) -> None:
        for folder in folders:
            if folder in self._under_way:
                self._under_way[folder][1].kill()


def _workers_by_node(there: list[ClusterNode], limit: int | None) -> Mapping[ClusterNode, int]:
    """Return the number of workers by node: assigned in turn while there are CPUs."""
    found = dict.fromkeys(there, 0)
    left = sum(node.cpus for node in there)
    left = left if limit is None else min(left, limit)
    while left:
        for node in there:
            if left and found[node] < node.cpus:
                found[node] += 1
                left -= 1
    return found


async def _dismiss(hired: WorkerHandle, *, idle: bool) -> None:
    if idle:
        with suppress(RayError, TimeoutError):
            async with asyncio.timeout(_CLEANUP_TIME_LIMIT):
                await hired.actor.close.remote()
    with suppress(RayError):
        hired.kill()


_JOIN_TIME_LIMIT = 45.0
"""Time limit for joining the cluster, wall s."""
_LEAVE_TIME_LIMIT = 15.0
"""Time limit for leaving, wall s; then the process ends, and with it a cluster that it started."""


def main(batch: Connection) -> None:
    """Serve the batch at the other end until its connection closes."""
    settings: ClusterSettings = batch.recv()
    os.chdir(settings.folder)  # Ray has its workers look for modules where it is started
    try:
        try:
            with _join_time_limit(batch, settings.address):
                connect(settings.address, settings.workers, settings.folder)
            asyncio.run(_serve(batch, settings))
            settings.output.unlink(missing_ok=True)  # the batch may be gone
        except PicktreeError as error:
            with suppress(OSError):
                batch.send(ClusterRefusal(str(error)))
    finally:
        ray.shutdown()
        os.chdir("/")
        shutil.rmtree(settings.folder, ignore_errors=True)


@contextmanager
def _join_time_limit(batch: Connection, address: str | None) -> Generator[None]:
    """Limit the time for joining: Ray waits without end where this machine is no node of the cluster."""

    def give_up() -> None:
        if address is None:
            reason = f"a Ray cluster on this machine did not start within {_JOIN_TIME_LIMIT:.0f} s"
        else:
            reason = (
                f"this machine is not a node of the Ray cluster at {address}; "
                f"join the cluster by the same address: ray start --address={address} --num-cpus=0"
            )
        batch.send(ClusterRefusal(reason))
        os._exit(1)

    timer = threading.Timer(_JOIN_TIME_LIMIT, give_up)
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


async def _serve(batch: Connection, settings: ClusterSettings) -> None:
    def tell(news: DriverMessage) -> None:
        with suppress(OSError):  # the batch is gone, as its end of the connection tells
            batch.send(news)

    crew = WorkerPool(settings.here, settings.workers, tell)
    gone = asyncio.Event()
    loop = asyncio.get_running_loop()

    def hear(message: BatchMessage | None) -> None:
        if message is None:
            gone.set()
        elif message == STOP:
            crew.stop()
        else:
            crew.give(message)

    threading.Thread(target=_listen, args=(batch, loop, hear), daemon=True).start()
    service = asyncio.create_task(_work(crew))
    over = asyncio.create_task(gone.wait())
    await asyncio.wait((service, over), return_when=asyncio.FIRST_COMPLETED)
    over.cancel()
    service.cancel()
    await crew.close()
    with suppress(asyncio.CancelledError):
        await service


async def _work(crew: WorkerPool) -> None:
    await crew.gather()
    await crew.watch()


def _listen(
    batch: Connection, loop: asyncio.AbstractEventLoop, hear: Callable[[BatchMessage | None], None]
) -> None:
    """Wait for messages of the batch, in a separate thread."""
    while True:
        try:
            message: BatchMessage | None = batch.recv()
        except (EOFError, OSError):
            message = None
        with suppress(RuntimeError):  # the loop is over
            loop.call_soon_threadsafe(hear, message)
        if message is None:
            threading.Timer(_LEAVE_TIME_LIMIT, os._exit, (1,)).start()
            return


if __name__ == "__main__":
    main(Connection(int(sys.argv[1])))
