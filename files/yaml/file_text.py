"""Text of a file: its bytes, decoded and checked, and the places of its characters."""

from __future__ import annotations

import os
import re
import stat
from bisect import bisect_right
from pathlib import Path
from typing import Final, cast

from picktree.files import MAX_NEAR_NAMES, Diagnostic, FileError, Mark, PicktreeError, suggest_name

MAX_BYTES: Final = 1_000_000
"""Maximum size of a YAML file."""

# Characters that YAML 1.2 allows in a stream (section 5.1), without the byte order mark in mid-text. Line
# separators that only some readers recognise are also left out: readers disagree about the text behind them.
_FORBIDDEN = re.compile(
    "[^\t\n\r\x20-\x7e\xa0-\u2027\u202a-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]|\r(?!\n)"
)
_LINE_SEPARATORS = "\r\x85\u2028\u2029"
_LINE_END = re.compile(r"\r\n|\n|\r")


def read_text(path: Path) -> str:
    """Read a file. Raises FileError when it is no regular file, too large or not UTF-8."""
    try:
        return decoded(read_bytes(path, MAX_BYTES), str(path))
    except Unreadable as error:
        code = "P123" if error.large else "P124"
        raise _fault(Mark(str(path), 1, 1), error.message, error.hint, code) from None


def decoded(raw: bytes, file: str) -> str:
    """Return the text of a file's bytes. Raises FileError when they are not UTF-8."""
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")) or 0 < raw[:4].count(0) < 4:
        wide = "the file is UTF-16 or UTF-32, not UTF-8"
        raise _fault(Mark(file, 1, 1), wide, "save it as UTF-8", "P122")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = raw[: error.start].decode("utf-8-sig", errors="replace")
        mark = mark_at(file, before, len(before))
        raise _fault(mark, "the file is not UTF-8", "save it as UTF-8", "P122") from None


def check_characters(text: str, file: str) -> None:
    """Check a text's length and characters. Raises FileError at the first forbidden character."""
    if len(text) > MAX_BYTES:
        message = f"the file is larger than {MAX_BYTES // 1_000_000} MB"
        raise _fault(Mark(file, 1, 1), message, "", "P123")
    bad = _FORBIDDEN.search(text)
    if bad:
        mark, name = mark_at(file, text, bad.start()), f"U+{ord(bad[0]):04X}"
        if bad[0] in _LINE_SEPARATORS:
            message = f"the line separator {name} ends a line for some readers and not for others"
            raise _fault(mark, message, "end the line as your editor does", "P121")
        raise _fault(mark, f"the character {name} is not allowed in a text file", "", "P121")


def _fault(mark: Mark, message: str, hint: str, code: str) -> FileError:
    return FileError([Diagnostic(mark, "", message, hint, code)])


class PositionIndex:
    """Lines and columns of a text's characters, which are counted from 0."""

    def __init__(self, file: str, text: str) -> None:
        self._file = file
        self._starts = [0, *(end.end() for end in _LINE_END.finditer(text))]

    def mark(self, index: int) -> Mark:
        line = bisect_right(self._starts, index)
        return Mark(self._file, line, index - self._starts[line - 1] + 1)


def mark_at(file: str, text: str, index: int) -> Mark:
    """Return the place of one character, which is counted from 0."""
    return PositionIndex(file, text[:index]).mark(index)


class Unreadable(PicktreeError):
    """Reason why a file cannot be read: a sentence without the file's name, and what would be right."""

    def __init__(self, message: str, hint: str = "", *, large: bool = False) -> None:
        super().__init__(message)
        self.message, self.hint, self.large = message, hint, large


def read_bytes(path: Path, most: int) -> bytes:
    """Read a whole file. Raises Unreadable when it is absent, irregular or larger than `most` bytes."""
    try:
        # Without O_NONBLOCK, opening a pipe waits for its writer.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        raise _refusal(error, path) from None
    try:
        mode = os.fstat(descriptor).st_mode
        if not stat.S_ISREG(mode):
            raise Unreadable(f"this is {_file_kind(mode)}, not a file")
        with open(descriptor, "rb", closefd=False) as file:
            content = cast("bytes | None", file.read(most + 1))
    except OSError as error:
        raise _refusal(error, path) from None
    finally:
        os.close(descriptor)
    if content is None or len(content) > most:  # None: an unwilling file of /proc
        raise Unreadable(f"the file is larger than {most / 1e6:g} MB", large=True)
    return content


def _refusal(error: OSError | ValueError, path: Path) -> Unreadable:
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return Unreadable("there is no such file", near_files(path))
    if isinstance(error, ValueError):
        return Unreadable("this is no path: it holds a null character")
    reason = error.strerror or type(error).__name__
    return Unreadable(f"the file cannot be read: {reason[:1].lower()}{reason[1:]}")


def near_files(path: Path) -> str:
    """Return a hint with the files beside a missing one whose names are near; empty when none is."""
    try:
        names = sorted(each.stem for each in path.parent.iterdir() if each.suffix == path.suffix)
    except (OSError, ValueError):
        return ""
    hint = suggest_name(path.stem, names, most=MAX_NEAR_NAMES)
    return re.sub(r"(?<=\w)'", f"{path.suffix}'", hint) if hint.startswith("did") else ""


def _file_kind(mode: int) -> str:
    if stat.S_ISDIR(mode):
        return "a folder"
    if stat.S_ISFIFO(mode):
        return "a pipe"
    return "a socket" if stat.S_ISSOCK(mode) else "a device"
