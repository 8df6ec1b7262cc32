"""Opening files that somebody else names: regular ones only, never more than a bound, never waiting."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import cast

from ...errors import PicktreeError


class Unreadable(PicktreeError):
    """Why a file cannot be read, as a sentence without the file's name, and what would be right."""

    def __init__(self, message: str, hint: str = "", *, large: bool = False) -> None:
        super().__init__(message)
        self.message, self.hint, self.large = message, hint, large


def read_bytes(path: Path, most: int) -> bytes:
    """The whole file. Raises Unreadable when it is absent, no regular file, or larger than `most` bytes."""
    try:
        # Without O_NONBLOCK, opening a pipe waits for its writer.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        raise _refusal(error) from None
    try:
        mode = os.fstat(descriptor).st_mode
        if not stat.S_ISREG(mode):
            raise Unreadable(f"this is {_what(mode)}, not a file")
        with open(descriptor, "rb", closefd=False) as file:
            content = cast("bytes | None", file.read(most + 1))
    except OSError as error:
        raise _refusal(error) from None
    finally:
        os.close(descriptor)
    if content is None or len(content) > most:  # None: an unwilling file of /proc
        raise Unreadable(f"the file is larger than {most / 1e6:g} MB", large=True)
    return content


def _refusal(error: OSError | ValueError) -> Unreadable:
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return Unreadable("there is no such file")
    if isinstance(error, ValueError):
        return Unreadable("this is no path: it holds a null character")
    reason = error.strerror or type(error).__name__
    return Unreadable(f"the file cannot be read: {reason[:1].lower()}{reason[1:]}")


def _what(mode: int) -> str:
    if stat.S_ISDIR(mode):
        return "a folder"
    if stat.S_ISFIFO(mode):
        return "a pipe"
    return "a socket" if stat.S_ISSOCK(mode) else "a device"
