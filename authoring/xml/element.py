"""XML elements with their places in the file, and comments."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from ...files.marks import Mark
from .btcpp_vocabulary import ELEMENTS

_SLOT = re.compile(r" *[a-z_][\w.*]*: *", re.ASCII)
"""Line with nothing but the key of a slot: `do:`, `otherwise:`, a case."""
_COMMENT = re.compile(r"\s*#+\s?(.*?)\s*")
_UNFIT = re.compile(r"[^\t -~\u00a0-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]")


class Comments:
    """Comments of one text; each is returned once."""

    def __init__(self, text: str) -> None:
        self._lines = text.split("\n")
        self._given: set[int] = set()

    def at_the_top(self) -> tuple[str, ...]:
        """Return the comments at the start of the file."""
        found: list[str] = []
        for index, line in enumerate(self._lines):
            match = _COMMENT.fullmatch(line)
            if match is None:
                break
            self._given.add(index)
            found.append(match[1])
        return tuple(filter(None, found))

    def above(self, line: int) -> tuple[str, ...]:
        """Return the comments directly above a line, which counts from 1, or above the slot that holds it.

        One that is indented further belongs to what ends there.
        """
        found: list[str] = []
        indent = _indent(self._lines[line - 1]) if 0 < line <= len(self._lines) else 0
        for index in range(line - 2, -1, -1):
            if index < len(self._lines) and _SLOT.fullmatch(self._lines[index]):
                indent = _indent(self._lines[index])
                continue
            match = _COMMENT.fullmatch(self._lines[index]) if index < len(self._lines) else None
            if match is None or index in self._given or _indent(self._lines[index]) > indent:
                break
            self._given.add(index)
            found.append(match[1])
        return tuple(filter(None, reversed(found)))

    def rest(self) -> Iterator[LooseComment]:
        """Yield the comments that have not been returned, in the order of the file."""
        for index, text in enumerate(self._lines):
            match = _COMMENT.fullmatch(text)
            if match is not None and index not in self._given:
                self._given.add(index)
                if match[1]:
                    yield LooseComment(index + 1, _indent(text), match[1])


@dataclass(frozen=True, slots=True)
class LooseComment:
    """Comment behind the last part of something: its line, which counts from 1, its indent and its text."""

    line: int
    indent: int
    text: str


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def one_line(comment: str) -> str:
    """Return the comment as one line that any file can hold."""
    return _UNFIT.sub("", " ".join(comment.split()))


NOWHERE: Final = Mark("", 1, 1)


@dataclass(frozen=True, slots=True)
class Element:
    """XML element. `text`: text between the tags next to children. `comments`: comments before the element.

    Two elements are equal when their content is, wherever they are.
    """

    name: str
    attributes: Mapping[str, str] = field(default_factory=dict[str, str])
    children: tuple[Element, ...] = ()
    text: str = ""
    comments: tuple[str, ...] = field(default=(), compare=False)
    mark: Mark = field(default=NOWHERE, compare=False)
    places: Mapping[str, Mark] = field(default_factory=dict[str, Mark], compare=False)
    """Places of the attributes' values."""
    end_comments: tuple[str, ...] = field(default=(), compare=False)
    """Comments behind the last child."""
    comments_below: tuple[str, ...] = field(default=(), compare=False)
    """Comments below the element; only the root has them."""

    def get(self, attribute: str, default: str = "") -> str:
        return self.attributes.get(attribute, default)

    @property
    def identity(self) -> str:
        """ID of the element's node: its name, or in the explicit form its attribute ID."""
        return self.get("ID") if self.name in ELEMENTS else self.name

    def place(self, attribute: str) -> Mark:
        """Return the place of an attribute's value; for a missing one, that of the element."""
        return self.places.get(attribute, self.mark)

    def all(self, name: str) -> tuple[Element, ...]:
        """Return the children of that name."""
        return tuple(child for child in self.children if child.name == name)

    def iterate(self) -> Iterator[Element]:
        """Yield this element and its descendants, parents first."""
        yield self
        for child in self.children:
            yield from child.iterate()
