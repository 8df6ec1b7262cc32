"""What a job's process prints, and what its last words say of where it was."""

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

NAME = "output.txt"
"""In the folder of a try; there is none when nothing was printed."""
ASKING = signal.SIGABRT
"""The signal on which a process says where it is, and ends."""
_LAST = 65536
"""Bytes of the end in which a traceback is looked for."""
_FRAME = re.compile(r'^  File "(?P<file>.*)", line (?P<line>\d+) in (?P<name>.*)$', re.MULTILINE)
_LIBRARIES = (sysconfig.get_path("stdlib"), sysconfig.get_path("purelib"), "<")


def print_into(folder: Path) -> None:
    """Everything that this process and its children print goes there, what C and C++ print, too.

    So does a traceback when it is ended by a fault, or by SIGABRT.
    """
    file = os.open(folder / NAME, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(file, 1)
    os.dup2(file, 2)
    os.close(nothing)
    faulthandler.enable(file=file, all_threads=False)  # of its own: a job may close the others


@contextmanager
def silence() -> Generator[None]:
    """Nothing is printed meanwhile, by C and C++ either."""
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
    """What is still in the buffers of Python and C."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    ctypes.CDLL(None).fflush(None)


def add(folder: Path, line: str) -> None:
    """What the worker has to say of it."""
    with suppress(OSError), (folder / NAME).open("a", encoding="utf-8") as file:
        file.write(f"{line}\n")


def last_place(folder: Path) -> str:
    """Where a process was when it was ended, as `trouble.py:7 in run`; empty when it could not say.

    A library's own lines are passed over for those of whoever called it.
    """
    try:
        with (folder / NAME).open("rb") as file:
            file.seek(0, os.SEEK_END)
            file.seek(max(0, file.tell() - _LAST))
            text = file.read().decode(errors="replace")
    except OSError:
        return ""
    _, fault, said = text.rpartition("Fatal Python error: ")
    frames = list(_FRAME.finditer(said)) if fault else []
    if not frames:
        return ""
    return _named([(frame["file"], frame["line"], frame["name"]) for frame in frames])


def place_of(error: BaseException) -> str:
    """The same, where an exception was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    return _named([(frame.filename, frame.lineno, frame.name) for frame in reversed(frames)])


def _named(frames: list[tuple[str, object, str]]) -> str:
    """Of the innermost frame that is no library's; the innermost is the first."""
    file, line, name = next((f for f in frames if not f[0].startswith(_LIBRARIES)), frames[0])
    return f"{Path(file).name}:{line} in {name}"
