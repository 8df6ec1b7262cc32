"""Errors of libyaml, in words for authors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import yaml

from ..marks import Diagnostic, Mark


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


def yaml_fault(error: yaml.YAMLError, text: str, file: str) -> Diagnostic:
    """Return a fault for an error of libyaml: in our words, in its own where none of ours fit."""
    if not isinstance(error, yaml.MarkedYAMLError):
        return Diagnostic(Mark(file, 1, 1), "", f"not valid YAML: {error}", code="P101")
    problem, context = str(error.problem or error.context or "unknown problem"), str(error.context or "")
    at, start = error.problem_mark or error.context_mark, error.context_mark or error.problem_mark
    words = _words(problem, context, text, at)
    if words is None:
        words = _Words(problem, context if error.problem else "")
    hint = words.hint.replace("{line}", str(start.line + 1)) if start is not None else words.hint
    place = start if words.at_start else at
    mark = Mark(file, 1, 1) if place is None else Mark(file, place.line + 1, place.column + 1)
    return Diagnostic(mark, "", f"not valid YAML: {words.message}", hint, "P101")


def _words(problem: str, context: str, text: str, at: yaml.Mark | None) -> _Words | None:
    character = text[at.index : at.index + 1] if at is not None else ""
    match problem:
        case "found character that cannot start any token":
            return (
                _NO_TAB if character == "\t" else _Words(f"a text cannot begin with {character}", "quote it")
            )
        case "did not find expected node content":
            return _Words(f"a value is missing {f'before {character!r}' if character else 'here'}")
        case "found unexpected end of stream" if "quoted scalar" in context:
            return _NEVER_CLOSED
        case "did not find expected key" if at is not None and text[: at.index].rpartition("\n")[2].strip():
            return _Words("this does not belong to the value before it", "quote the whole text")
        case _:
            return _PROBLEMS.get(problem)
