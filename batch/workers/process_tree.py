"""Process of a worker with its descendants: their memory, their end, and their ties to the parent."""

from __future__ import annotations

import ctypes
import os
import signal
from contextlib import suppress
from pathlib import Path

_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
_MAX_END_ROUNDS = 100
"""Maximum number of rounds of ending children, each of which may leave children."""


def die_with_parent(number: signal.Signals) -> None:
    """Make this process receive the signal when its parent ends, in whatever way."""
    _prctl(_PR_SET_PDEATHSIG, number)


def adopt_orphans() -> None:
    """Adopt orphaned descendants as children of this process, which can then end them."""
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)


def children(pid: int) -> list[int]:
    found: list[int] = []
    with suppress(OSError):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            with suppress(OSError):
                found += map(int, (thread / "children").read_text().split())
    return found


def resident(pid: int) -> int:
    """Return the resident memory of a process and its descendants, bytes; 0 after its end."""
    try:
        own = int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE_BYTES
    except (OSError, IndexError, ValueError):
        return 0
    return own + sum(resident(child) for child in children(pid))


def end_children(expected: int) -> int:
    """End every child of this process with its descendants; return their number besides the expected."""
    count = 0
    for _ in range(_MAX_END_ROUNDS):
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


def exit_code_words(code: int) -> str:
    """Return the end in words for an exit code of `subprocess` or `multiprocessing`: `was ended by
    SIGSEGV`."""
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was ended by {signal.Signals(-code).name}"
    except ValueError:
        return f"was ended by signal {-code}"


def _prctl(option: int, value: int) -> None:
    ctypes.CDLL(None).prctl(option, value)
