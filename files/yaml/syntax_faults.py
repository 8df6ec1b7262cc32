"""Faults of texts that libyaml cannot read, in words of our own."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import yaml

from ..marks import Diagnostic, Mark
from .file_text import PositionIndex
from .slips import slips_behind


def syntax_faults(error: yaml.YAMLError, text: str, file: str) -> Iterator[Diagnostic]:
    """Yield the faults behind an error of libyaml: the typing slips that cause it, else the error itself."""
    places = PositionIndex(file, text)
    mended: list[tuple[int, int]] = []
    for slip in slips_behind(text, error):
        start = slip.start - sum(more for at, more in mended if at <= slip.start)
        mended.append((slip.start, len(slip.meant) - (slip.end - slip.start)))
        yield Diagnostic(places.mark(start), "", slip.message, slip.hint, slip.code)
    if not mended:
        yield yaml_fault(error, text, file)


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
    indented = _wrong_indent(text, at) if at is not None and "mapping values" in problem else None
    if indented is not None:
        line, column, words = indented
        return Diagnostic(
            Mark(file, line, column), "", f"not valid YAML: {words.message}", words.hint, "P101"
        )
    words = _words(problem, context, text, at)
    if words is None:
        words = _Words(problem, context if error.problem else "")
    hint = words.hint.replace("{line}", str(start.line + 1)) if start is not None else words.hint
    place = start if words.at_start else at
    mark = Mark(file, 1, 1) if place is None else Mark(file, place.line + 1, place.column + 1)
    return Diagnostic(mark, "", f"not valid YAML: {words.message}", hint, "P101")


def _wrong_indent(text: str, at: yaml.Mark) -> tuple[int, int, _Words] | None:
    """Return line, column and words for a key that libyaml takes for more of the value above it; None: it is
    none."""
    lines = text.splitlines()
    here = lines[at.line]
    indent = len(here) - len(here.lstrip())
    above = next((k for k in range(at.line - 1, -1, -1) if _code(lines[k])), None)
    if above is None or ":" not in here[indent:] or ":" in here[indent : at.column]:
        return None
    before = _code(lines[above])
    column, said = len(before) - len(before.lstrip()), before.strip().removeprefix("- ")
    if _KEY_AND_VALUE.fullmatch(said) and indent > column:
        key = here.strip().partition(":")[0]
        message = f"{key!r} is indented deeper than {said.partition(':')[0]!r} above it, which has a value"
        return at.line + 1, indent + 1, _Words(message, f"begin it in column {column + 1}")
    words = said.split()
    if 1 < len(words) <= 3 and ":" not in said and words[0].isidentifier():
        value = " ".join(words[1:])
        return above + 1, column + len(words[0]) + 1, _Words(
            "a ':' is missing behind this key", f"write '{words[0]}: {value}'"
        )  # fmt: skip
    return None


_KEY_AND_VALUE = re.compile(r"[\w.]+:\s+[^\s{\[|>&!][^:]*")


def _code(line: str) -> str:
    """Return a line without its comment, and without blanks at the end."""
    return re.sub(r"(^|\s)#.*", "", line).rstrip()


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
        case "did not find expected ',' or '}'" | "did not find expected ',' or ']'" if character == "[":
            return _Words("a list cannot begin inside a text", 'quote the whole text, as "items[0]"')
        case "did not find expected key" if at is not None and text[: at.index].rpartition("\n")[2].strip():
            return _Words("this does not belong to the value before it", "quote the whole text")
        case _:
            return _PROBLEMS.get(problem)
