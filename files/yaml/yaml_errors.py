"""File access and libyaml's errors, in words for authors."""

from __future__ import annotations

import os
import stat
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import yaml

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


@dataclass(frozen=True, slots=True)
class YamlProblem:
    """A sentence, what would be right, and the place, None where the library names none."""

    message: str
    hint: str
    mark: yaml.Mark | None


@dataclass(frozen=True, slots=True)
class _Words:
    message: str
    hint: str = ""
    at_start: bool = False
    """The fault stands where the construct begins, not where the reader gave up."""


_NEVER_CLOSED = _Words(
    "the quote that opens here is never closed", "close it, or double a quote inside", True
)
_NO_TAB = _Words("a tab cannot indent", "use spaces")
_PROBLEMS: Mapping[str, _Words] = {
    "mapping values are not allowed in this context": _Words(
        "a ':' does not fit here", "quote the text, or indent it"
    ),
    "block sequence entries are not allowed in this context": _Words(
        "a list cannot begin here", "each '-' stands on a line of its own, under the key"
    ),
    "did not find expected key": _Words(
        "this does not line up with the keys above", "check indent and quotes"
    ),
    "did not find expected '-' indicator": _Words(
        "this does not line up with the list above", "check indent and quotes"
    ),
    "did not find expected ',' or '}'": _Words("a ',' or '}' is missing", "the { of line {line} is open"),
    "did not find expected ',' or ']'": _Words("a ',' or ']' is missing", "the [ of line {line} is open"),
    "could not find expected ':'": _Words("a ':' is missing behind this key", "as 'key: value'", True),
    "did not find expected alphabetic or numeric character": _Words(
        "& and * begin an anchor and an alias, and need a name", "quote a text that begins with them", True
    ),
    "did not find expected <document start>": _Words(
        "this does not belong to the mapping above", "check indent"
    ),
    "did not find expected comment or line break": _Words("the line must end here"),
    "found unknown escape character": _Words(
        'unknown escape in a "…" text', "a backslash is written \\\\, or the text in '…'"
    ),
    "found unexpected document indicator": _NEVER_CLOSED,
    "found a tab character that violates indentation": _NO_TAB,
    "found a tab character where an indentation space is expected": _NO_TAB,
    "found incompatible YAML document": _Words("the directive %YAML asks for another YAML", "leave it out"),
    "found undefined tag handle": _Words("tags (!) are not read", "quote a text that begins with !"),
    "found unexpected ':'": _Words(
        "a ':' does not fit here", "quote the text, or put a blank behind the ':'"
    ),
    "found invalid Unicode character escape code": _Words("the escape is no character", "as \\u00e9"),
    "did not find expected hexdecimal number": _Words("the escape needs hexadecimal digits", "as \\u00e9"),
}


def describe_yaml_error(error: yaml.MarkedYAMLError, text: str) -> YamlProblem:
    """The complaint in our words; in the library's own where it is none of the known ones."""
    said, context = str(error.problem or error.context or "unknown problem"), str(error.context or "")
    at, start = error.problem_mark or error.context_mark, error.context_mark or error.problem_mark
    words = _PROBLEMS.get(said)
    character = text[at.index : at.index + 1] if at is not None else ""
    if said == "found character that cannot start any token":
        words = _NO_TAB if character == "\t" else _Words(f"a text cannot begin with {character}", "quote it")
    elif said == "did not find expected node content":
        words = _Words(f"a value is missing before {character!r}" if character else "a value is missing here")
    elif said == "found unexpected end of stream" and "quoted scalar" in context:
        words = _NEVER_CLOSED
    elif said == "did not find expected key" and at is not None and _line(text, at.index).strip():
        words = _Words("this does not belong to the value before it", "quote the whole text")
    if words is None:
        return YamlProblem(said, context if error.problem else "", at)
    hint = words.hint.replace("{line}", str(start.line + 1)) if start is not None else words.hint
    return YamlProblem(words.message, hint, start if words.at_start else at)


def _line(text: str, index: int) -> str:
    """Return the part of the line before the character."""
    return text[:index].rpartition("\n")[2]
