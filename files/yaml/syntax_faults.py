"""Syntax faults of YAML in words of our own: typing slips, as look-alike characters and missing blanks,
and texts that libyaml cannot read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import yaml

from picktree.files import Diagnostic, Mark

from .file_text import PositionIndex

LOOK_ALIKE: Final = "P127"
NO_BLANK: Final = "P128"
COMMA: Final = "a ',' in a number ends the value"
"""Message of a decimal comma in braces."""
_BLANKS: Final = "\u00a0\u1680\u2000-\u200a\u202f\u205f\u3000"
_WIDTHLESS: Final = "\u200b-\u200d\u2060\u00ad"
_LOOK_ALIKE_SPACE = re.compile(f"[{_BLANKS}{_WIDTHLESS}]+")
_LOOK_ALIKE_SPACE_AT_EDGE = re.compile(rf"^[{_BLANKS}{_WIDTHLESS}]+|[{_BLANKS}{_WIDTHLESS}]+$")
_OPENING, _CLOSING = "“”„‟‘’‚‛«»", "“”‟‘’‛«»"
_CURLY = re.compile(rf"[{_OPENING}](?P<inner>[^“”„‟«»]*)[{_CLOSING}]")
_JOINED_KEY = re.compile(
    rf"(?P<key>[\w.]+)(?:(?P<colon>:)[{_BLANKS}{_WIDTHLESS}]*|(?P<wide>：)\s*)(?P<value>[^\s/].*)"
)
_OPENED_KEY = re.compile(rf"(?P<key>[\w.]+):(?=[\[{{\"'{_OPENING}])")
_MARKS: Final[Mapping[str, str]] = {"：": ": ", "，": ", ", "｛": "{", "｝": "}", "［": "[", "］": "]"}
_NAMES: Final[Mapping[str, str]] = {
    "\u00a0": "no-break space", "\u202f": "narrow no-break space", "\u2009": "thin space",
    "\u3000": "ideographic space", "\u200b": "zero width space", "\u00ad": "soft hyphen",
}  # fmt: skip
_DASHES: Final = "–—−‐•"
MAX_LENGTH: Final = 100_000
"""Number of characters from which the cause of a fault of form is no longer searched."""
MAX_SLIPS: Final = 10
"""Maximum number of slips that are reported for one file that cannot be read."""
_MAX_ATTEMPTS: Final = 12


@dataclass(frozen=True, slots=True)
class Slip:
    """Characters `start` … `end` (from 0) in whose place `meant` was meant."""

    start: int
    end: int
    meant: str
    message: str
    hint: str
    code: str

    def repair(self, text: str) -> str:
        return text[: self.start] + self.meant + text[self.end :]

    def moved(self, characters: int) -> Slip:
        start, end = self.start + characters, self.end + characters
        return Slip(start, end, self.meant, self.message, self.hint, self.code)


@dataclass(frozen=True, slots=True)
class PlainText:
    """A text without quotes in its intended reading; `value` for a key that holds its value, too.

    `quoted`: the intended value is a text in quotes, never a number.
    """

    text: str
    slip: Slip
    value: str | None = None
    quoted: bool = False


def look_alike(text: str, *, is_key: bool) -> PlainText | None:
    """Return the intended reading of an unquoted text with look-alike characters at its ends or in a key."""
    curly = _CURLY.fullmatch(text)
    if curly is not None:
        return PlainText(curly["inner"], _curly(curly), quoted=True)
    found = (_LOOK_ALIKE_SPACE if is_key else _LOOK_ALIKE_SPACE_AT_EDGE).search(text)
    if found is None:
        return None
    plain = re.sub(f"[{_BLANKS}]", " ", re.sub(f"[{_WIDTHLESS}]", "", text)).strip()
    return PlainText(plain, _strange(found, text))


def joined_key(text: str) -> PlainText | None:
    """Return key and value of a key in braces without a value, as `pose:home`; None where none is joined."""
    found = _JOINED_KEY.fullmatch(text)
    if found is None:
        return None
    blank = _LOOK_ALIKE_SPACE.search(text)
    if blank is not None:
        slip = _strange(blank, text)
    elif found["wide"]:
        slip = _wide(text, found.end("key"))
    else:
        slip = _unspaced(found)
    return PlainText(found["key"], slip, found["value"])


def spoilt_key(text: str) -> Slip | None:
    """Return the slip of a key that hides how the file is nested: `Observe:{camera`, or a blank before it."""
    found = _OPENED_KEY.match(text)
    if found is not None:
        return _unspaced(found)
    blank = _LOOK_ALIKE_SPACE.match(text)
    return _strange(blank, text) if blank is not None else None


def structure_hint(text: str) -> str:
    """Return a hint for a text in place of a node or a mapping; "" for an unknown one.

    >>> structure_hint("pose:home"), structure_hint("a text")
    ("a blank is missing behind the ':': write 'pose: home'", '')
    >>> structure_hint("-Observe")
    "a blank is missing behind the '-': write '- Observe'"
    """
    word = text.split()[0] if text.split() else ""
    if entry := re.match(rf"(?P<dash>[-{_DASHES}])\s*(?P<rest>\w+)", text):
        dash = entry["dash"]
        reason = f"the {dash!r} is no '-'" if dash != "-" else "a blank is missing behind the '-'"
        return f"{reason}: write '- {entry['rest']}'"
    if joined := re.match(r"(?P<key>\w+)(?P<colon>[:：])", word if ":" in word else text):
        rest = (word if ":" in word else text)[joined.end() :].strip()
        reason = (
            f"the {joined['colon']!r} is no ':'"
            if joined["colon"] != ":"
            else "a blank is missing behind the ':'"
        )
        shown = rest if rest and not rest.startswith("-") else "…"
        return f"{reason}: write '{joined['key']}: {shown}'" if len(shown) <= 40 else reason
    return ""


def _curly(found: re.Match[str]) -> Slip:
    inner = found["inner"]
    quote = "'" if '"' in inner or "\\" in inner else '"'
    meant = f"{quote}{inner}{quote}"
    shown = f"write {meant}" if len(inner) <= 40 else f"write {quote} on both sides"
    return Slip(found.start(), found.end(), meant, "curly quotes are letters in YAML", shown, LOOK_ALIKE)


def _strange(found: re.Match[str], text: str) -> Slip:
    first = found[0][0]
    name = _NAMES.get(first, "space" if re.match(f"[{_BLANKS}]", first) else "invisible character")
    message = f"the {name} U+{ord(first):04X} is no blank in YAML"
    blank = re.search(f"[{_BLANKS}]", found[0]) is not None
    meant = " " * len(found[0]) if blank else ""
    hint = (
        "write a blank, or put a text with it in quotes"
        if blank
        else "leave it out, or put a text with it in quotes"
    )
    return Slip(found.start(), found.end(), meant, message, hint, LOOK_ALIKE)


def _wide(text: str, at: int) -> Slip:
    meant = _MARKS[text[at]]
    return Slip(
        at, at + 1, meant, f"{text[at]!r} is no {meant.strip()!r}", f"write {meant.strip()!r}", LOOK_ALIKE
    )


def _unspaced(found: re.Match[str]) -> Slip:
    key, at = found["key"], found.end("key") + 1
    value = found.groupdict().get("value") or "…"
    value = value if len(value) <= 40 else "…"
    message = f"a blank is missing behind the ':' of {key!r}"
    return Slip(at, at, " ", message, f"write '{key}: {value}'", NO_BLANK)


_QUOTED = re.compile(r"(?<![^\s\[{,:-])(?:\"(?:[^\"\\]|\\.)*\"|'(?:[^']|'')*')")
_HALF_CURLY = re.compile(
    rf"(?<=[\s\[{{,:])(?:[\"'](?P<a>[^\"'{_CLOSING}]*)[{_CLOSING}]|[{_OPENING}](?P<b>[^\"']*)[\"'])"
)
_JOINED = re.compile(r"(?<![\w\"'/.])(?P<key>[A-Za-z_][\w.]*):(?=[^\s/,}\]])(?P<value>[\w.%]+)?")
_NO_DASH_BLANK = re.compile(r"^\s*(?:- +)*-(?=[A-Za-z{\[\"'])")
_ENTRY_START = re.compile(r"(?P<indent> *)(?P<entry>[A-Za-z_]\w*:?)")


def slips_behind(text: str, error: yaml.YAMLError) -> Iterator[Slip]:
    """Yield the slips that keep a text from being read.

    Places are those of the text in which the former slips are mended.
    """
    attempts = _MAX_ATTEMPTS
    found: Slip | None = None
    current: yaml.YAMLError | None = error
    for _ in range(MAX_SLIPS):
        if len(text) > MAX_LENGTH or not isinstance(current, yaml.MarkedYAMLError):
            return
        before = _index(current)
        found, after = None, None
        for slip in _candidates(text, current):
            attempts -= 1
            after = _first_error(slip.repair(text))
            if after is None or _index(after) > before + len(slip.meant):
                found = slip
                break
            if attempts <= 0:
                return
        if found is None:
            return
        yield found
        text, current = found.repair(text), after


def slip_at(lines: Sequence[str], row: int, column: int, message: str) -> Slip | None:
    """Return the slip of that message at a place, with its columns in that line; None where its repair takes
    more than one line. All count from 0.
    """
    line = lines[row]
    found = [slip for slip in _slips_of_line(line) if (slip.start, slip.message) == (column, message)]
    if not found and message == COMMA and line[column : column + 1] == ",":
        return Slip(column, column + 1, ".", message, "", LOOK_ALIKE)
    if not found:
        below = next((each for each in lines[row + 1 :] if each.strip()), "")
        inside = len(below) - len(below.lstrip()) > column
        before = sum(map(len, lines[:row]))
        found = [] if inside else [slip.moved(-before) for slip in _missing_dash(list(lines), row)]
        found = [slip for slip in found if (slip.start, slip.message) == (column, message)]
    return found[0] if found else None


def _index(error: yaml.YAMLError) -> int:
    """Return the index of an error in the text; for an unclosed quote the index of its opening."""
    if not isinstance(error, yaml.MarkedYAMLError):
        return 0
    opens = "quoted scalar" in str(error.context or "")
    mark = (error.context_mark if opens else None) or error.problem_mark or error.context_mark
    return int(mark.index) if mark is not None else 0


def _first_error(text: str) -> yaml.YAMLError | None:
    try:
        for _ in yaml.parse(text, yaml.CSafeLoader):
            pass
    except yaml.YAMLError as error:
        return error
    return None


def _candidates(text: str, error: yaml.MarkedYAMLError) -> Iterator[Slip]:
    """Yield what may be wrong in the lines up to the error: from its construct, or from the line above."""
    at = error.problem_mark or error.context_mark
    if at is None:
        return
    lines = text.splitlines(keepends=True)
    last = min(at.line, len(lines) - 1)
    opened = error.context_mark.line if error.context_mark is not None else last
    above = next((n for n in range(last - 1, -1, -1) if lines[n].strip()), 0)
    first = max(min(opened, above), last - 3)
    start = sum(map(len, lines[:first]))
    for line in lines[first : last + 1]:
        yield from (slip.moved(start) for slip in _slips_of_line(line.rstrip("\r\n")))
        start += len(line)
    if "'-' indicator" in str(error.problem):
        yield from _missing_dash(lines, last)
    elif "expected ':'" in str(error.problem):
        yield from _missing_dash(lines, min(opened, last))


def _slips_of_line(line: str) -> list[Slip]:
    """Return all possible slips of one line, outside of its quoted texts and its comment."""
    masked = _QUOTED.sub(lambda quoted: '"' + "\0" * (len(quoted[0]) - 2) + '"', line)
    comment = re.search(r"(?:^|[ \t])#", masked)
    masked = masked[: comment.start()] if comment is not None else masked
    code = line[: len(masked)]
    found = [_curly(match) for match in _CURLY.finditer(code) if masked[match.start()] != "\0"]
    for half in _HALF_CURLY.finditer(code):
        inner = half["a"] if half["a"] is not None else half["b"]
        message, hint = "one of the two quotes is a curly one", f'write "{inner}"'
        found.append(Slip(half.start(), half.end(), f'"{inner}"', message, hint, LOOK_ALIKE))
    found += [_strange(match, line) for match in _LOOK_ALIKE_SPACE.finditer(code)]
    found += [_wide(line, at) for at, letter in enumerate(masked) if letter in _MARKS]
    found += [
        _unspaced(match)
        for match in _JOINED.finditer(code)
        if "\0" not in masked[match.start() : match.end()]
    ]
    if dash := _NO_DASH_BLANK.match(line):
        message = "a blank is missing behind the '-'"
        found.append(Slip(dash.end(), dash.end(), " ", message, "write '- ' before the entry", NO_BLANK))
    return sorted(found, key=lambda slip: slip.start)


def _missing_dash(lines: list[str], row: int) -> Iterator[Slip]:
    entry = _ENTRY_START.match(lines[row])
    if entry is not None:
        at = sum(map(len, lines[:row])) + entry.end("indent")
        message = "a '-' is missing before this entry of the list above"
        yield Slip(at, at, "- ", message, f"write '- {entry['entry']}'", NO_BLANK)


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
    """Whether the fault is placed where the construct begins, not where the reader gave up."""


_NEVER_CLOSED = _Words(
    "the quote that opens here is never closed", "close it, or double a quote inside", True
)
_NO_TAB = _Words("a tab cannot indent", "use spaces")
_PROBLEMS: Mapping[str, _Words] = {
    "mapping values are not allowed in this context": _Words(
        "a ':' does not fit here", "quote the text, or indent it"
    ),
    "block sequence entries are not allowed in this context": _Words(
        "a list cannot begin here", "write each '-' on a line of its own, under the key"
    ),
    "did not find expected key": _Words(
        "this does not line up with the keys above", "check indent and quotes"
    ),
    "did not find expected '-' indicator": _Words(
        "this does not line up with the list above", "check indent and quotes"
    ),
    "did not find expected ',' or '}'": _Words(
        "a ',' or '}' is missing", "the { of line {line} is not closed"
    ),
    "did not find expected ',' or ']'": _Words(
        "a ',' or ']' is missing", "the [ of line {line} is not closed"
    ),
    "could not find expected ':'": _Words("a ':' is missing behind this key", "as 'key: value'", True),
    "did not find expected alphabetic or numeric character": _Words(
        "& and * begin an anchor and an alias, and need a name", "quote a text that begins with them", True
    ),
    "did not find expected <document start>": _Words(
        "this does not belong to the mapping above", "check indent"
    ),
    "did not find expected comment or line break": _Words("the line must end here"),
    "found unknown escape character": _Words(
        'unknown escape in a "…" text', "double the backslash, or put the text in '…'"
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
    column, content = len(before) - len(before.lstrip()), before.strip().removeprefix("- ")
    if _KEY_AND_VALUE.fullmatch(content) and indent > column:
        key = here.strip().partition(":")[0]
        message = f"{key!r} is indented deeper than {content.partition(':')[0]!r} above it, which has a value"
        return at.line + 1, indent + 1, _Words(message, f"begin it in column {column + 1}")
    words = content.split()
    if 1 < len(words) <= 3 and ":" not in content and words[0].isidentifier():
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
