"""Driver: the process that communicates with Ray for a batch.

Ray takes a process over with signal handlers, threads and output, and ends the process when the cluster is
gone. So the batch's own process does not load it.
"""

from __future__ import annotations

import asyncio
import os
import shutil
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection

import ray

from ...errors import PicktreeError
from .connection import connect
from .messages import STOP, ClusterRefusal, ClusterSettings, News, Said
from .worker_pool import WorkerPool

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
                f"the Ray cluster at {address} does not have this machine as a node, "
                f"by the address that it goes by: ray start --address={address} --num-cpus=0"
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
    def tell(news: News) -> None:
        with suppress(OSError):  # the batch is gone, as its end of the connection tells
            batch.send(news)

    crew = WorkerPool(settings.here, settings.workers, tell)
    gone = asyncio.Event()
    loop = asyncio.get_running_loop()

    def hear(said: Said | None) -> None:
        if said is None:
            gone.set()
        elif said == STOP:
            crew.stop()
        else:
            crew.give(said)

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


def _listen(batch: Connection, loop: asyncio.AbstractEventLoop, hear: Callable[[Said | None], None]) -> None:
    """Wait for messages of the batch, in a separate thread."""
    while True:
        try:
            said: Said | None = batch.recv()
        except (EOFError, OSError):
            said = None
        with suppress(RuntimeError):  # the loop is over
            loop.call_soon_threadsafe(hear, said)
        if said is None:
            threading.Timer(_LEAVE_TIME_LIMIT, os._exit, (1,)).start()
            return


if __name__ == "__main__":
    main(Connection(int(sys.argv[1])))
