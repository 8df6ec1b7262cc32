"""Syntax of a YAML text: where each value begins and ends, and which comments belong to it.

Places are counted in code points from 0. Line ends are `\\n`.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal, TypeAlias

import yaml

from picktree.files import Location, PicktreeError
from picktree.files.yaml import resolve

SyntaxKind: TypeAlias = Literal["scalar", "mapping", "list", "alias"]

_LINE_END = re.compile(r"\n")


class NotEditable(PicktreeError):
    """Reason why a place of the text cannot be edited by the tree."""


@dataclass(slots=True)
class Syntax:
    """Value in the text."""

    kind: SyntaxKind
    start: int
    end: int
    """End of the value itself, behind its last character: trailing comments and line ends excluded."""
    flow: bool
    """Whether it is written in brackets; of scalars: not as a `|` or `>` block."""
    text: str = ""
    """Value of a scalar as a text, name of an alias."""
    entries: list[tuple[Syntax, Syntax]] = field(default_factory=list["tuple[Syntax, Syntax]"])
    items: list[Syntax] = field(default_factory=list["Syntax"])
    plain: bool = False
    """Whether it is a scalar without quotes."""
    target: Syntax | None = None
    """Value that an alias repeats."""

    @property
    def empty(self) -> bool:
        """Whether the value is missing, as in `key:`."""
        return self.kind == "scalar" and self.start == self.end

    def entry(self, key: str) -> tuple[Syntax, Syntax] | None:
        return next(((name, value) for name, value in self.entries if name.text == key), None)

    def child(self, step: str | int) -> Syntax | None:
        if isinstance(step, int):
            return self.items[step] if 0 <= step < len(self.items) else None
        found = self.entry(step)
        return found[1] if found is not None else None

    @property
    def keys(self) -> list[str]:
        return [key.text for key, _ in self.entries]

    @property
    def value(self) -> Syntax:
        """Value itself, or the value that the alias repeats."""
        return self.target if self.target is not None else self

    @property
    def word(self) -> str | None:
        """Text of a scalar that YAML reads as a text; None for other values."""
        if self.kind != "scalar" or (self.plain and not isinstance(_resolved(self.text), str)):
            return None
        return self.text


def _resolved(text: str) -> object:
    try:
        return resolve(text)
    except ValueError:  # a number with too many digits
        return None


@dataclass(frozen=True, slots=True)
class Lines:
    """Whole lines of the text, the first and the last one included; counted from 0."""

    first: int
    last: int


class Source:
    """Text with its syntax. Raises yaml.YAMLError when the text cannot be read."""

    def __init__(self, text: str) -> None:
        self.text = text
        self._starts = [0, *(found.end() for found in _LINE_END.finditer(text))]
        self.root, self.has_aliases = _parsed(text)

    def at(self, loc: Location) -> Syntax:
        """Return the value at a location. Raises NotEditable without a value there."""
        node: Syntax | None = self.root
        for step in loc:
            if node is not None and node.kind == "alias":
                raise NotEditable(
                    f"the value here is the alias *{node.text}: edit the value at its anchor &{node.text}"
                )
            node = node.child(step) if node is not None else None
        if node is None:
            raise NotEditable(f"there is no {'.'.join(map(str, loc))} in the text")
        return node

    def line_of(self, place: int) -> int:
        return bisect_right(self._starts, place) - 1

    def column(self, place: int) -> int:
        return place - self._starts[self.line_of(place)]

    def line(self, number: int) -> str:
        end = self._starts[number + 1] - 1 if number + 1 < len(self._starts) else len(self.text)
        return self.text[self._starts[number] : end]

    def start_of(self, line: int) -> int:
        return self._starts[line] if line < len(self._starts) else len(self.text)

    def end_of(self, line: int) -> int:
        """Return the place behind the last character of a line, before its line end."""
        return self._starts[line] + len(self.line(line))

    @property
    def line_count(self) -> int:
        return len(self._starts)

    def slice(self, node: Syntax) -> str:
        return self.text[node.start : node.end]

    def dash(self, item: Syntax) -> int:
        """Return the place of the dash of a list's item."""
        at = item.start - 1
        while at >= 0 and self.text[at] in " \n":
            at -= 1
        if at < 0 or self.text[at] != "-":
            raise NotEditable(
                f"line {self.line_of(item.start) + 1} is written in a way that only its text can be edited"
            )
        return at

    def colon(self, key: Syntax) -> int:
        """Return the place of the colon behind a key."""
        return self.text.index(":", key.end)

    def block_lines(self, start: int, end: int, floor: int) -> Lines:
        """Return the lines of a block item or entry, with the comments that belong to it.

        `start`: place of its dash or key. `floor`: last line of the content before it.
        """
        first, last = self.line_of(start), self.line_of(max(start, end - 1))
        column = start - self._starts[first]
        own = not self.line(first)[:column].strip()
        while own and first - 1 > floor and self._comment_column(first - 1) == column:
            first -= 1
        while last + 1 < self.line_count and self._comment_column(last + 1) > column:
            last += 1
        return Lines(first, last)

    def item_lines(self, node: Syntax, index: int) -> Lines:
        """Return the lines of an item of a block list."""
        item = node.items[index]
        floor = self.line_of(node.items[index - 1].end - 1) if index else self._line_above(node)
        return self.block_lines(self.dash(item), max(item.end, self.dash(item) + 1), floor)

    def entry_lines(self, node: Syntax, index: int) -> Lines:
        """Return the lines of an entry of a block mapping."""
        key, value = node.entries[index]
        floor = self.line_of(node.entries[index - 1][1].end - 1) if index else self._line_above(node)
        return self.block_lines(key.start, max(value.end, self.colon(key) + 1), floor)

    def own_lines(self, lines: Lines, start: int) -> Lines:
        """Return the lines of a block item or entry. Raises NotEditable when a dash is before it."""
        line = self.line_of(start)
        if self.line(line)[: self.column(start)].strip():
            raise NotEditable(f"line {line + 1} is written in a way that only its text can be edited")
        return lines

    def _line_above(self, node: Syntax) -> int:
        """Return the last line with content before a block collection."""
        above = self.text[: node.start].rstrip(" \n-")
        return self.line_of(len(above) - 1) if above else -1

    def _comment_column(self, line: int) -> int:
        """Return the column at which a line that is only a comment begins; -1 for other lines."""
        text = self.line(line)
        bare = text.lstrip(" ")
        return len(text) - len(bare) if bare.startswith("#") else -1

    def comment_behind(self, place: int) -> str:
        """Return the comment behind a place in its line, with the blanks before it; empty for none."""
        rest = self.text[place : self.end_of(self.line_of(place))]
        return rest.rstrip() if rest.lstrip(" ").startswith("#") else ""

    def trail(self, loc: Location) -> Iterator[tuple[Location, Syntax]]:
        """Yield the values above a location, outermost first, then the value itself."""
        for depth in range(len(loc) + 1):
            yield loc[:depth], self.at(loc[:depth])


@lru_cache(maxsize=8)
def source_of(text: str) -> Source:
    """Return the syntax of a text, read once. Raises yaml.YAMLError when it cannot be read."""
    return Source(text)


@dataclass(slots=True)
class _Open:
    node: Syntax
    anchor: str | None
    key: Syntax | None = None

    def add(self, node: Syntax) -> None:
        if self.node.kind == "list":
            self.node.items.append(node)
        elif self.key is None:
            self.key = node
        else:
            self.node.entries.append((self.key, node))
            self.key = None


def _parsed(text: str) -> tuple[Syntax, bool]:
    open_: list[_Open] = []
    anchors: dict[str, Syntax] = {}
    root: Syntax | None = None
    has_aliases = False
    for event in yaml.parse(text, yaml.CSafeLoader):
        if event.start_mark is None or event.end_mark is None:
            continue
        start, end = event.start_mark.index, event.end_mark.index
        match event:
            case yaml.ScalarEvent():
                block = event.style in ("|", ">")
                end = start + len(text[start:end].rstrip()) if block else end
                plain = event.style in (None, "")
                node = Syntax("scalar", start, end, not block, str(event.value), [], [], plain)
                anchor = event.anchor
            case yaml.AliasEvent():
                name, has_aliases = str(event.anchor), True
                node, anchor = Syntax("alias", start, end, True, name, [], [], False, anchors.get(name)), None
            case yaml.MappingStartEvent() | yaml.SequenceStartEvent():
                kind: SyntaxKind = "mapping" if isinstance(event, yaml.MappingStartEvent) else "list"
                begun = Syntax(kind, start, end, bool(event.flow_style), "", [], [])
                open_.append(_Open(begun, event.anchor))
                continue
            case yaml.MappingEndEvent() | yaml.SequenceEndEvent():
                closed = open_.pop()
                node, anchor = closed.node, closed.anchor
                bracketed = node.flow and text[end - 1 : end] in ("]", "}") and end > start
                last = node.items[-1] if node.items else node.entries[-1][1] if node.entries else None
                if node.flow and (bracketed and (last is None or end > last.end)):
                    node.end = end
                elif last is not None:
                    node.end = last.end
            case _:
                continue
        if anchor is not None:
            anchors[anchor] = node
        if open_:
            open_[-1].add(node)
        else:
            root = node if root is None else root
    return root if root is not None else Syntax("scalar", 0, 0, True), has_aliases
