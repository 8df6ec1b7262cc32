"""Execution of plug-in code: output goes to stderr, and any exception becomes one error with its own
traceback."""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
from collections.abc import Generator
from contextlib import contextmanager, redirect_stdout, suppress
from types import FrameType, TracebackType

from picktree.files import PicktreeError
from picktree.world import CauseError, known_causes, restore_causes

GROUP = "picktree.nodes"
"""Group of the entry points under which distributions offer nodes."""
_MAX_TRACEBACK_LINES = 40
"""Maximum length of a traceback, lines; an endless recursion produces thousands."""
_LEADING_TRACEBACK_LINES = 8


class PluginError(PicktreeError):
    """A plug-in that cannot be used: one sentence, a hint, and the plug-in's own traceback."""

    def __init__(self, message: str, hint: str = "", *, code: str, detail: str = "") -> None:
        self.message, self.hint, self.code, self.detail = message, hint, code, detail
        line = message + (f" ({hint})" if hint else "")
        super().__init__(f"{line}\n{detail}" if detail else line)


@contextmanager
def importing(plugin: str) -> Generator[None]:
    """Run the block as a plug-in's code. Raises PluginError for everything that the block raises.

    Its output goes to stderr, because stdout carries the command's result. Causes registered before a failure
    are removed. An interrupt by the user (Ctrl-C) is passed on.
    """
    causes = known_causes()
    with _stdout_to_stderr(), _interrupts() as pressed:
        try:
            yield
        except BaseException as error:
            restore_causes(causes)
            if isinstance(error, PluginError) or (isinstance(error, KeyboardInterrupt) and pressed):
                raise
            raise _failed(plugin, error) from error


def own_traceback(error: BaseException) -> str:
    """Return the traceback without the frames of picktree and of Python's own machinery, shortened when
    long."""
    seen: set[int] = set()
    todo: list[BaseException | None] = [error]
    while todo:
        one = todo.pop()
        if one is not None and id(one) not in seen:
            seen.add(id(one))
            one.__traceback__ = _foreign(one.__traceback__)
            todo += [one.__cause__, one.__context__]
    lines = "".join(traceback.format_exception(error)).rstrip().splitlines()
    if len(lines) > _MAX_TRACEBACK_LINES:
        left_out = len(lines) - _MAX_TRACEBACK_LINES
        end = len(lines) - (_MAX_TRACEBACK_LINES - _LEADING_TRACEBACK_LINES)
        lines = [*lines[:_LEADING_TRACEBACK_LINES], f"  … {left_out} lines are left out", *lines[end:]]
    return "\n".join(lines)


def _failed(plugin: str, error: BaseException) -> PluginError:
    detail = own_traceback(error)
    # The message holds picktree's own objection already; the traceback need not end with it.
    where = detail.rpartition("\n")[0]
    if isinstance(error, CauseError):
        return PluginError(f"the plug-in {plugin!r}: {error}", code="P255", detail=where)
    if isinstance(error, PicktreeError):
        # The declaration of a node is checked when its class is created.
        return PluginError(f"the plug-in {plugin!r}: {error}", code="P254", detail=where)
    return PluginError(
        f"the plug-in {plugin!r} cannot be imported: {_in_a_line(error)}", code="P252", detail=detail
    )


def _in_a_line(error: BaseException) -> str:
    try:
        text = str(error).strip().split("\n")[0]
    except Exception:  # noqa: BLE001 - it is a plug-in's own class, and may do anything
        text = ""
    name = type(error).__name__
    return f"{name}: {text}" if text else name


def _foreign(trace: TracebackType | None) -> TracebackType | None:
    """Return the traceback's frames that belong neither to picktree nor to the import system."""
    frames: list[TracebackType] = []
    while trace is not None:
        frames.append(trace)
        trace = trace.tb_next
    kept: TracebackType | None = None
    for one in reversed(frames):
        module = str(one.tb_frame.f_globals.get("__name__", ""))
        frozen = one.tb_frame.f_code.co_filename.startswith("<frozen ")  # the import system, and abc
        if not frozen and module.split(".")[0] not in ("picktree", "importlib"):
            kept = TracebackType(kept, one.tb_frame, one.tb_lasti, one.tb_lineno)
    return kept


@contextmanager
def _stdout_to_stderr() -> Generator[None]:
    """Redirect both Python's stdout and the file descriptor that C libraries and child processes use."""
    sys.stdout.flush()
    kept: int | None = None
    with suppress(OSError):  # a program may run without one of the two
        kept = os.dup(1)
        os.dup2(2, 1)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        if kept is not None:
            os.dup2(kept, 1)
            os.close(kept)


@contextmanager
def _interrupts() -> Generator[list[int]]:
    """Record SIGINTs that arrive, to distinguish them from a KeyboardInterrupt that the code itself
    raises."""
    pressed: list[int] = []
    before = signal.getsignal(signal.SIGINT)
    if not callable(before) or threading.current_thread() is not threading.main_thread():
        yield pressed
        return

    def arrived(number: int, frame: FrameType | None) -> None:
        pressed.append(number)
        before(number, frame)

    signal.signal(signal.SIGINT, arrived)
    try:
        yield pressed
    finally:
        signal.signal(signal.SIGINT, before)
