"""Computation in a process of its own, where picktree chooses the kernels before numpy is loaded."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection, wait
from typing import ParamSpec, TypeVar, cast

from ...files.errors import PicktreeError
from ..batch.job_process import die_with_parent, exit_code_words
from ..batch.local_executor import without_main

P = ParamSpec("P")
T = TypeVar("T")


def in_clean_process(work: Callable[P, T], *arguments: P.args, **options: P.kwargs) -> T:
    """Return the result of a function of picktree that a new process calls; its arguments are pickled.

    An interrupt (SIGINT) is passed on, and the result is still waited for. Raises PicktreeError as the
    function does, and when the process ends without a result.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(theirs, work, arguments, options), name="picktree-run")
    with without_main():
        process.start()
    theirs.close()
    while True:
        try:
            wait([ours])
            break
        except KeyboardInterrupt:
            if process.pid is not None:
                os.kill(process.pid, signal.SIGINT)
    try:
        answer = cast("T | PicktreeError", ours.recv())
    except EOFError:
        process.join()
        words = exit_code_words(process.exitcode or 0)
        raise PicktreeError(f"the process of the run {words} without a result") from None
    process.join()
    if isinstance(answer, PicktreeError):
        raise answer
    return answer


def _serve(
    answers: Connection,
    work: Callable[..., object],
    arguments: tuple[object, ...],
    options: dict[str, object],
) -> None:
    os.setsid()  # Ctrl-C reaches the parent, which passes it on
    die_with_parent(signal.SIGTERM)
    try:
        answer = work(*arguments, **options)
    except PicktreeError as error:
        answer = error
    answers.send(answer)
