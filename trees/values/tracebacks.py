"""Tracebacks for the record: the same wherever picktree and a mission's files lie, and in every process."""

from __future__ import annotations

import re
import traceback
from pathlib import Path
from typing import Final

from ...files.rooms import ROOT, rooms

_ADDRESS: Final = re.compile(r"\b0x[0-9a-fA-F]{6,}\b")


def portable_trace(error: BaseException) -> str:
    """As Python prints it, with names of files in place of paths, and without addresses of objects."""
    summary = traceback.TracebackException.from_exception(error)
    todo: list[traceback.TracebackException | None] = [summary]
    while todo:
        one = todo.pop()
        if one is None:
            continue
        for frame in one.stack:
            frame.filename = _portable(frame.filename)
        todo += [one.__cause__, one.__context__]
    return without_addresses("".join(summary.format()))


def without_addresses(text: str) -> str:
    """`<Wave object at 0x7f3a10b2c4d0>` is another in each process.

    >>> without_addresses("<Wave object at 0x7f3a10b2c4d0>")
    '<Wave object at 0x…>'
    """
    return _ADDRESS.sub("0x…", text)


def _portable(file: str) -> str:
    path = Path(file)
    if path.is_relative_to(ROOT) and path.relative_to(ROOT).parts[0] in rooms():
        return f"picktree/{path.relative_to(ROOT).as_posix()}"
    for place in ("site-packages", "dist-packages"):
        if place in path.parts:
            return "/".join(path.parts[path.parts.index(place) + 1 :])
    return path.name
