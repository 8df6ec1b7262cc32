"""Processes as Linux knows them: whose children they are, what memory they hold, how they end."""

from __future__ import annotations

import ctypes
import os
import signal
from contextlib import suppress
from pathlib import Path

_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
_PAGE = os.sysconf("SC_PAGE_SIZE")
_ROUNDS = 100
"""Of ending children, each of which may leave children in its turn."""


def die_with_parent(number: signal.Signals) -> None:
    """This process gets the signal when the one that started it is gone, however it ended."""
    _prctl(_PR_SET_PDEATHSIG, number)


def take_in_orphans() -> None:
    """What descendants leave behind becomes a child of this process, which can end it then."""
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)


def children(pid: int) -> list[int]:
    found: list[int] = []
    with suppress(OSError):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            with suppress(OSError):
                found += map(int, (thread / "children").read_text().split())
    return found


def resident(pid: int) -> int:
    """Bytes of memory that a process and all below it hold; 0 when it is no more."""
    try:
        own = int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE
    except (OSError, IndexError, ValueError):
        return 0
    return own + sum(resident(child) for child in children(pid))


def end_children(expected: int) -> int:
    """End every child of this process, with all that they leave. How many there were besides the expected."""
    count = 0
    for _ in range(_ROUNDS):
        found = children(os.getpid())
        if not found:
            break
        for child in found:
            with suppress(OSError):
                os.kill(child, signal.SIGKILL)
            with suppress(OSError):
                os.waitpid(child, 0)
            count += child != expected
    return count


def how_it_ended(code: int) -> str:
    """Of an exit code as `subprocess` and `multiprocessing` have it: `was ended by SIGSEGV`."""
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was ended by {signal.Signals(-code).name}"
    except ValueError:
        return f"was ended by signal {-code}"


def _prctl(option: int, value: int) -> None:
    ctypes.CDLL(None).prctl(option, value)
