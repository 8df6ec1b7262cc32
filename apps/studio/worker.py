"""Worker: a separate process for computations, so that the server stays responsive."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Final, ParamSpec, TypeVar

from picktree.files import Diagnostic, FileError, PicktreeError
from picktree.trees.loading import PLUGINS_VARIABLE

P = ParamSpec("P")
T = TypeVar("T")

NICENESS: Final = 1
"""Priority of the process below the server's and the browser's: they answer while it computes.
Much below it would get nothing on a machine that simulates."""
LIMIT: Final = 60.0
"""Longest time of one request, wall s; then the process is ended, and the next request starts another."""


class Worker:
    """Process that serves requests one after the other."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None

    async def run(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Run a function there. Raises its exceptions, and PicktreeError when it takes too long."""
        pool = self._pool = self._pool or ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin)
        policy = os.environ.get(PLUGINS_VARIABLE, "")
        work = asyncio.get_running_loop().run_in_executor(pool, _run, policy, function, args, kwargs)
        try:
            result = await asyncio.wait_for(work, LIMIT)
        except TimeoutError:
            self._end(pool)
            raise PicktreeError(f"this took longer than {LIMIT:g} s and was stopped") from None
        except BrokenProcessPool:
            self._end(pool)
            raise PicktreeError("the process that computes this has ended; try again") from None
        if isinstance(result, _Refusal):
            raise result.error()
        return result

    async def close(self) -> None:
        """End the process."""
        if self._pool is not None:
            self._end(self._pool)

    def _end(self, pool: ProcessPoolExecutor) -> None:
        if self._pool is pool:
            self._pool = None
        for process in list(getattr(pool, "_processes", None) or {}):
            os.kill(process, 9)
        # A request that nobody reads any more would keep the thread that writes it, and with it this process.
        reader = getattr(getattr(pool, "_call_queue", None), "_reader", None)
        if reader is not None:
            reader.close()
        pool.shutdown(wait=False, cancel_futures=True)


@dataclass(frozen=True, slots=True)
class _Refusal:
    """Error of a request, in a form that goes from process to process."""

    message: str
    faults: tuple[Diagnostic, ...] = ()

    def error(self) -> PicktreeError:
        return FileError(self.faults) if self.faults else PicktreeError(self.message)


def _begin() -> None:
    """Lower the priority of this process, and end it with the server, even after a kill."""
    os.nice(NICENESS)
    server = multiprocessing.parent_process()
    assert server is not None

    def wait() -> None:
        server.join()
        os._exit(0)

    threading.Thread(target=wait, daemon=True).start()


def _run(
    policy: str, function: Callable[..., T], args: tuple[object, ...], kwargs: dict[str, object]
) -> T | _Refusal:
    """Run a function with the server's policy on plug-ins."""
    if policy:
        os.environ[PLUGINS_VARIABLE] = policy
    else:
        os.environ.pop(PLUGINS_VARIABLE, None)
    try:
        return function(*args, **kwargs)
    except FileError as error:
        return _Refusal(str(error), error.faults)
    except PicktreeError as error:
        return _Refusal(str(error))
