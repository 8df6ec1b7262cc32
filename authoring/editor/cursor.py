"""Cursor in an unfinished YAML text: its key or value, and repair of the text for the reader."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from picktree.files import FileError, Location, Mark
from picktree.files.yaml import YamlNode, YamlReadResult, read

CURSOR: Final = "\ue000"
"""Character for the cursor, of the private use area: YAML reads it as a letter, and no file contains it."""
MAX_BLANKED: Final = 8
"""Maximum number of unreadable lines that are left out, one after the other."""
_CLOSERS = {"{": "}", "[": "]"}
_ENTRY = re.compile(r"[ ]*(?:- |-$|[\w.*-]+:(?: |$))")
_BARE = re.compile(rf"(?P<indent> *)(?P<dashes>(?:- +)*)[\w{CURSOR}][^:#{{}}\[\]\"',&|>]*")
_KEY = re.compile(r"(?P<indent> *)(?P<dashes>(?:- +)*)(?:[\w.*]+|\"[^\"]*\")[ ]*:(?: |$)")
_REFERENCE = re.compile(rf"\{{(?:=[^\"'#}}]*|[@\w.{CURSOR}]*)\}}?")
_BEFORE_QUOTE = " \t[{,:-"


@dataclass(slots=True)
class _Open:
    """Open bracket: its character, and the indent of its line."""

    bracket: str
    indent: int


@dataclass(slots=True)
class _Repair:
    """State of one repair: finished lines, and the brackets that are open behind them."""

    lines: list[str] = field(default_factory=list[str])
    open: list[_Open] = field(default_factory=list[_Open])
    ends: list[int] = field(default_factory=list[int])
    """Index behind the last character of each line that is no comment."""

    def close(self) -> None:
        """Close all open brackets at the end of the last line with content."""
        closers = "".join(_CLOSERS[each.bracket] for each in reversed(self.open))
        self.open.clear()
        written = (n for n in reversed(range(len(self.lines))) if self.lines[n][: self.ends[n]].strip())
        at = next(written, None)
        if at is not None and closers:
            line, comment = self.lines[at][: self.ends[at]], self.lines[at][self.ends[at] :]
            self.lines[at] = f"{line.rstrip()}{closers} {comment}" if comment else line + closers

    def add(self, line: str) -> None:
        indent = len(line) - len(line.lstrip(" "))
        if self.open and line.strip() and not line.lstrip().startswith("#"):
            outside = indent <= self.open[0].indent and line.lstrip()[:1] not in "]}"
            if outside or line.lstrip().startswith("- "):
                self.close()
        line, end = self._scan(line, indent)
        self.lines.append(line)
        self.ends.append(end)

    def _scan(self, line: str, indent: int) -> tuple[str, int]:
        """Follow brackets and quotes through a line; return it repaired, and where its comment begins."""
        at, flow = 0, bool(self.open)
        while at < len(line):
            letter = line[at]
            before = line[at - 1] if at else " "
            if letter == "#" and before in " \t":
                return line, at
            if letter in "\"'" and before in _BEFORE_QUOTE:
                line, at = self._quoted(line, at)
                continue
            if letter in _CLOSERS and (self.open or before in _BEFORE_QUOTE):
                self.open.append(_Open(letter, indent))
                flow = True
            elif letter in "]}" and flow:
                line, at = self._closed(line, at)
            at += 1
        return line, len(line)

    def _closed(self, line: str, at: int) -> tuple[str, int]:
        """Match a closing bracket; missing ones are put before it, one without an opener is blanked."""
        missing = ""
        for depth, opened in enumerate(reversed(self.open)):
            if _CLOSERS[opened.bracket] == line[at]:
                del self.open[len(self.open) - depth - 1 :]
                return line[:at] + missing + line[at:], at + len(missing)
            missing += _CLOSERS[opened.bracket]
        return f"{line[:at]} {line[at + 1 :]}", at

    def _quoted(self, line: str, at: int) -> tuple[str, int]:
        """Return the line with this quoted text closed, and the index behind it."""
        quote, end = line[at], at + 1
        while end < len(line) and line[end] != quote:
            end += 2 if quote == '"' and line[end] == "\\" else 1
        if end < len(line):
            return line, end + 1
        reference = _REFERENCE.match(line, at + 1)
        if reference is None:
            comment = line.find(" #", at)
            stop = comment if comment >= 0 else len(line)
            return f"{line[:stop]}{quote}{line[stop:]}", stop + 1
        stop = reference.end()
        closed = line[:stop] + ("" if line[stop - 1] == "}" else "}") + quote
        return closed + line[stop:], len(closed)


def repaired(text: str) -> str:
    """Return the text with closed brackets and quotes, and with colons behind bare keys."""
    repair = _Repair()
    for line in text.split("\n"):
        repair.add(line)
    repair.close()
    return "\n".join(_with_colon(repair.lines, number) for number in range(len(repair.lines)))


def _with_colon(lines: list[str], number: int) -> str:
    """Return a line with a colon where its neighbours show that a bare word in it is a key."""
    line = lines[number]
    bare = _BARE.fullmatch(line.rstrip())
    if bare is None:
        return line
    column = bare.end("dashes")
    below = next((each for each in lines[number + 1 :] if each.strip()), "")
    key = _KEY.match(below)
    if key is not None and key.end("indent") == column and not key["dashes"]:
        return line.rstrip() + ":"
    if len(below) - len(below.lstrip()) > column:
        return line.rstrip() + ":"
    if bare["dashes"]:
        return line
    for above in reversed(lines[:number]):
        indent = len(above) - len(above.lstrip())
        if above.strip() and not above.lstrip().startswith("#") and indent <= column:
            key = _KEY.match(above)
            same = key is not None and key.end("dashes") == column
            return line.rstrip() + ":" if same else line
    return line


def with_key_at_cursor(text: str) -> str:
    """Return the text with a colon behind the cursor's word, where that word is a key of a block."""
    lines = text.split("\n")
    for number, line in enumerate(lines):
        if CURSOR in line:
            lines[number] = _with_colon(lines, number)
    return "\n".join(lines)


def read_repaired(text: str, file: str) -> tuple[YamlReadResult, str] | None:
    """Read a text as far as possible; return also the readable text. None: no readable text."""
    for attempt in (with_key_at_cursor(text), repaired(text), repaired(_cut_behind_cursor(text))):
        try:
            return read(attempt, file), attempt
        except FileError as error:
            fault = error.faults[0]
    lines = repaired(_cut_behind_cursor(text)).split("\n")
    for _ in range(MAX_BLANKED):
        wrong = min(fault.mark.line, len(lines)) - 1
        while wrong > 0 and not lines[wrong].strip():
            wrong -= 1
        lines[wrong] = ""
        attempt = repaired("\n".join(lines))
        try:
            return read(attempt, file), attempt
        except FileError as error:
            fault = error.faults[0]
    return None


def _cut_behind_cursor(text: str) -> str:
    """Return the text without the rest of the cursor's line behind its word."""
    return re.sub(rf"({CURSOR}[\w.]*[\"'}}]*)[^\n]*", r"\1", text)


_WORD_BEFORE = re.compile(r"[\w.*/+-]*\Z")
_WORD_BEHIND = re.compile(r"[\w*/+-]*")


@dataclass(frozen=True, slots=True)
class Place:
    """Place in a text: line and character count from 0, in code points."""

    line: int
    character: int


@dataclass(frozen=True, slots=True)
class Span:
    """Part of a text, its end excluded."""

    start: Place
    end: Place

    def __contains__(self, place: object) -> bool:
        return isinstance(place, Place) and self.key(self.start) <= self.key(place) <= self.key(self.end)

    @staticmethod
    def key(place: Place) -> tuple[int, int]:
        return place.line, place.character


@dataclass(frozen=True, slots=True)
class Cursor:
    """Key or value under the cursor."""

    root: YamlNode
    """Readable part of the text; the word at the cursor contains CURSOR."""
    path: Location
    """Location of the value, or of the mapping that holds the key."""
    scalar: str
    """Text of the key or value, with CURSOR."""
    is_key: bool
    siblings: frozenset[str]
    """Other keys of the mapping; empty for a value."""
    flow: bool
    """Whether the collection around it is written in brackets."""
    alone: bool
    """Whether only dashes are before it in its line."""
    in_list: bool
    word: Span
    """Word at the cursor, which a proposal replaces."""
    before: str
    """Text of the line before the word."""
    behind: str
    """Text of the line behind the word."""
    place: Place
    line: str

    @property
    def written(self) -> str:
        """Text of the key or value without CURSOR."""
        return self.scalar.replace(CURSOR, "")


def cursor_at(text: str, place: Place, file: str) -> Cursor | None:
    """Return the key or value at a place; None in a comment, or where the text cannot be read."""
    lines = text.split("\n")
    if place.line >= len(lines):
        return None
    line = lines[place.line].rstrip("\r")
    before, behind = line[: place.character], line[place.character :]
    before_word, behind_word = _WORD_BEFORE.search(before), _WORD_BEHIND.match(behind)
    start = before_word.start() if before_word else len(before)
    end = behind_word.end() if behind_word else 0
    word = Span(Place(place.line, start), Place(place.line, len(before) + end))
    lines[place.line] = f"{before}{CURSOR}{behind}"
    reading = read_repaired("\n".join(lines), file)
    if reading is None:
        return None
    root = reading[0].root
    found = next((each for each in _texts(root) if CURSOR in each[1]), None)
    if found is None:
        return None
    path, scalar, _, parent = found
    is_key = isinstance(parent.value, dict) and scalar in parent.keys
    opened = lines[parent.mark.line - 1][parent.mark.column - 1 :][:1]
    head = before[:start]
    return Cursor(
        root,
        path,
        scalar,
        is_key,
        frozenset(parent.keys) - {scalar} if is_key else frozenset(),
        opened in ("{", "["),
        not head.strip(" -"),
        isinstance(parent.value, list),
        word,
        head,
        behind[end:],
        place,
        line,
    )


def cursor_on(text: str, place: Place, file: str) -> Cursor | None:
    """Return the key or value that covers a place in the unrepaired text; None for neither."""
    reading = read_repaired(text, file)
    lines = text.split("\n")
    if reading is None or place.line >= len(lines):
        return None
    line = lines[place.line]
    for path, written, mark, parent in _texts(reading[0].root):
        if mark.line != place.line + 1:
            continue
        start = mark.column - 1 + (line[mark.column - 1 : mark.column] in ("'", '"'))
        if start <= place.character <= start + len(written):
            is_key = isinstance(parent.value, dict) and parent.keys.get(written) == mark
            word = Span(Place(place.line, start), Place(place.line, start + len(written)))
            return Cursor(
                reading[0].root,
                path,
                written,
                is_key,
                frozenset(),
                False,
                False,
                isinstance(parent.value, list),
                word,
                line[:start],
                line[start + len(written) :],
                place,
                line,
            )
    return None


def walk(root: YamlNode, above: Location = ()) -> Iterator[tuple[Location, YamlNode]]:
    """Yield a value and all below it with their locations, in the order of the text."""
    todo: list[tuple[Location, YamlNode]] = [(above, root)]
    while todo:
        path, node = todo.pop()
        yield path, node
        below: list[tuple[str | int, YamlNode]] = [*node.entries.items(), *enumerate(node.items)]
        todo += [((*path, step), child) for step, child in reversed(below)]


def _texts(root: YamlNode) -> Iterator[tuple[Location, str, Mark, YamlNode]]:
    """Yield location, text, mark and parent of all keys and texts."""
    for path, node in walk(root):
        for key in node.entries:
            yield path, key, node.keys[key], node
        below: list[tuple[str | int, YamlNode]] = [*node.entries.items(), *enumerate(node.items)]
        for step, child in below:
            if isinstance(child.value, str):
                yield (*path, step), child.value, child.mark, node
