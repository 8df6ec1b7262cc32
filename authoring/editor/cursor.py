"""Cursor in a YAML text: the key or value in which it stands, also in a text that is being written."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from ...files.marks import Location, Mark
from ...files.yaml.reader import YamlNode
from .text_repair import CURSOR, read_repaired

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
    """Whole text as far as it can be read; the word at the cursor contains CURSOR."""
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
    """Whether nothing but dashes stands before it in its line."""
    in_list: bool
    word: Span
    """Word at the cursor, which a proposal replaces."""
    before: str
    """Text of the line before the word."""
    behind: str
    """Text of the line behind the word."""
    place: Place
    line: str
    """Line in which it stands."""

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
    start = _matched(_WORD_BEFORE.search(before))
    end = _matched(_WORD_BEHIND.match(behind))
    word = Span(
        Place(place.line, len(before) - len(start)),
        Place(place.line, len(before) + len(end)),
    )
    lines[place.line] = f"{before}{CURSOR}{behind}"
    marked = "\n".join(lines)
    reading = read_repaired(marked, file)
    if reading is None:
        return None
    root = reading[0].root
    found = next(_places(root), None)
    if found is None:
        return None
    path, scalar, parent = found
    is_key = isinstance(parent.value, dict) and scalar in parent.keys
    opened = lines[parent.mark.line - 1][parent.mark.column - 1 :][:1]
    head = before[: len(before) - len(start)]
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
        behind[len(end) :],
        place,
        line,
    )


def cursor_on(text: str, place: Place, file: str) -> Cursor | None:
    """Return the key or value that covers a place in the text as it is written; None for neither."""
    reading = read_repaired(text, file)
    lines = text.split("\n")
    if reading is None or place.line >= len(lines):
        return None
    line = lines[place.line]
    for path, written, mark, parent in _texts(reading[0].root, place.line + 1):
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


def _texts(root: YamlNode, line: int) -> Iterator[tuple[Location, str, Mark, YamlNode]]:
    """Yield location, text, mark and parent of the keys and texts that begin in a line."""
    todo: list[tuple[Location, YamlNode]] = [((), root)]
    while todo:
        path, node = todo.pop()
        for key, child in node.entries.items():
            if node.keys[key].line == line:
                yield path, key, node.keys[key], node
            todo.append(((*path, key), child))
        todo += [((*path, index), child) for index, child in enumerate(node.items)]
        below: list[tuple[str | int, YamlNode]] = [*node.entries.items(), *enumerate(node.items)]
        for step, child in below:
            if child.mark.line == line and isinstance(child.value, str):
                yield (*path, step), child.value, child.mark, node


def _matched(found: re.Match[str] | None) -> str:
    return found[0] if found else ""


def _places(root: YamlNode) -> Iterator[tuple[Location, str, YamlNode]]:
    """Yield location, text and parent of each key and value that contains CURSOR."""
    todo: list[tuple[Location, YamlNode]] = [((), root)]
    while todo:
        path, node = todo.pop()
        for key, child in node.entries.items():
            if CURSOR in key:
                yield path, key, node
            if isinstance(child.value, str) and CURSOR in child.value:
                yield (*path, key), child.value, node
            todo.append(((*path, key), child))
        for index, child in enumerate(node.items):
            if isinstance(child.value, str) and CURSOR in child.value:
                yield (*path, index), child.value, node
            todo.append(((*path, index), child))
