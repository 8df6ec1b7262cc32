"""Output of a job's process, and the place in the code at its end."""

from __future__ import annotations

import ctypes
import faulthandler
import os
import re
import signal
import sys
import sysconfig
import traceback
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

OUTPUT_FILE = "output.txt"
"""File in the folder of an attempt; missing when nothing was printed."""
TRACEBACK_SIGNAL = signal.SIGABRT
"""Signal on which a process prints its traceback and ends."""
_TRACEBACK_BYTES = 65536
"""Size of the output's end in which a traceback is searched, bytes."""
_FRAME = re.compile(r'^  File "(?P<file>.*)", line (?P<line>\d+) in (?P<name>.*)$', re.MULTILINE)
_LIBRARIES = (sysconfig.get_path("stdlib"), sysconfig.get_path("purelib"), "<")


def print_into(folder: Path) -> None:
    """Redirect all output of this process and its children there, also that of C and C++.

    The traceback at a crash or at SIGABRT is written there, too.
    """
    file = os.open(folder / OUTPUT_FILE, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(file, 1)
    os.dup2(file, 2)
    os.close(nothing)
    faulthandler.enable(file=file, all_threads=False)  # of its own: a job may close the others


@contextmanager
def silence() -> Generator[None]:
    """Suppress all output in the block, also that of C and C++."""
    flush()
    kept = os.dup(1), os.dup(2)
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        flush()
        for number, before in enumerate(kept, 1):
            os.dup2(before, number)
            os.close(before)
        os.close(nothing)


def flush() -> None:
    """Write out the buffers of Python and C."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    ctypes.CDLL(None).fflush(None)


def add(folder: Path, line: str) -> None:
    """Append a line of the worker to the output."""
    with suppress(OSError), (folder / OUTPUT_FILE).open("a", encoding="utf-8") as file:
        file.write(f"{line}\n")


def last_place(folder: Path) -> str:
    """Return the place at which a process was ended, as `trouble.py:7 in run`; empty when unknown.

    Lines of libraries are skipped in favour of their callers.
    """
    try:
        with (folder / OUTPUT_FILE).open("rb") as file:
            file.seek(0, os.SEEK_END)
            file.seek(max(0, file.tell() - _TRACEBACK_BYTES))
            text = file.read().decode(errors="replace")
    except OSError:
        return ""
    _, fault, said = text.rpartition("Fatal Python error: ")
    frames = list(_FRAME.finditer(said)) if fault else []
    if not frames:
        return ""
    return _named([(frame["file"], frame["line"], frame["name"]) for frame in frames])


def place_of(error: BaseException) -> str:
    """Return the place at which an exception was raised, in the same form."""
    frames = traceback.extract_tb(error.__traceback__)
    return _named([(frame.filename, frame.lineno, frame.name) for frame in reversed(frames)])


def _named(frames: list[tuple[str, object, str]]) -> str:
    """Return the place of the innermost frame outside of libraries; the innermost is the first."""
    file, line, name = next((f for f in frames if not f[0].startswith(_LIBRARIES)), frames[0])
    return f"{Path(file).name}:{line} in {name}"
