"""Pieces of YAML text that can be laid out in a line or as a block: parts of the source, and new nodes."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from ...files.yaml.writer import MAX_LINE_LENGTH, scalar_text
from .syntax import Source, Syntax

PieceKind: TypeAlias = Literal["scalar", "mapping", "list", "raw"]

_UNSAFE_IN_FLOW = re.compile(r"[\[\]{},]|: |:$|\s#")


@dataclass(slots=True)
class Piece:
    """Value that can be placed. `inline`: its text in one line; None where it cannot be written so."""

    kind: PieceKind
    inline: str | None
    entries: list[tuple[str, Piece]] = field(default_factory=list["tuple[str, Piece]"])
    items: list[Piece] = field(default_factory=list["Piece"])
    raw: tuple[str, ...] = ()
    """Lines of a block, as they stand in the source, at column 0."""
    above: tuple[str, ...] = ()
    """Comments that stand above it as an item of a block."""
    block: bool = False
    """Whether it was a block, and remains one where a block can stand."""

    def fits(self, room: int) -> bool:
        """Whether it is to be written in one line with `room` characters."""
        if self.inline is None:
            return False
        return self.kind == "scalar" or (not self.block and len(self.inline) <= room)

    def lines(self, room: int) -> list[str]:
        """Return its lines as a block at column 0; `room`: characters of a line."""
        match self.kind:
            case "raw":
                return list(self.raw)
            case "mapping" if self.entries:
                return [line for key, value in self.entries for line in entry_lines(key, value, room)]
            case "list" if self.items:
                return [line for item in self.items for line in (*item.above, *item.item_lines(room))]
            case _:
                return [self.inline or ""]

    def item_lines(self, room: int, dash: str = "- ") -> list[str]:
        """Return its lines as an item of a block list."""
        single = self.kind == "mapping" and len(self.entries) == 1
        if not single and self.kind != "raw" and self.inline is not None and len(self.inline) <= room - 2:
            lines = [self.inline]
        else:
            lines = self.lines(room - len(dash))
        blank = " " * len(dash)
        return [f"{dash}{lines[0]}", *(f"{blank}{line}" if line.strip() else line for line in lines[1:])]


def entry_lines(key: str, value: Piece, room: int, comment: str = "") -> list[str]:
    """Return the lines of an entry of a block mapping; `key` is its text, and `comment` stands behind it."""
    if value.fits(room - len(key) - 2):
        return [f"{key}: {value.inline}{comment}" if value.inline else f"{key}:{comment}"]
    return [f"{key}:{comment}", *(f"  {line}" if line.strip() else line for line in value.lines(room - 2))]


def key_text(key: str) -> str:
    """Return a key as a file writes it: keys are texts, so a number needs no quotes."""
    return key if re.fullmatch(r"\w+", key, re.ASCII) else scalar_text(key)


def scalar(text: str) -> Piece:
    """Return the piece of a value's text in one line, as it is to be written."""
    return Piece("scalar", text)


def mapping(entries: list[tuple[str, Piece]], *, block: bool = False) -> Piece:
    parts = [None if value.inline is None else f"{key}: {value.inline}".rstrip() for key, value in entries]
    return Piece("mapping", _joined("{", parts, "}"), entries=entries, block=block)


def listing(items: list[Piece], *, block: bool = False) -> Piece:
    return Piece("list", _joined("[", [item.inline for item in items], "]"), items=items, block=block)


def _joined(opening: str, parts: list[str | None], closing: str) -> str | None:
    if any(part is None for part in parts):
        return None
    return f"{opening}{', '.join(part or '' for part in parts)}{closing}"


def call(identity: str, body: Piece | None) -> Piece:
    """Return a node: its ID alone, or with its body."""
    if body is None:
        return scalar(identity)
    return mapping([(identity, body)], block=body.block)


def piece_of(source: Source, node: Syntax) -> Piece:
    """Return a value of the source as a piece, without the comments around it."""
    if node.kind in ("scalar", "alias"):
        if node.flow and "\n" not in source.slice(node):
            return scalar(source.slice(node))
        return Piece("raw", scalar_text(node.text), raw=_dedented(source, node.start, node.end), block=True)
    if node.flow:
        return _flow_piece(source, node)
    return block_piece(source, node, source.line_of(node.end - 1))


def block_piece(source: Source, node: Syntax, last_line: int) -> Piece:
    """Return a block collection as a piece, up to the end of a line."""
    lines = _dedented(source, node.start, source.end_of(last_line))
    inline = _one_line(source, node, lines)
    return Piece("raw", inline, raw=lines, block=inline is None or len(lines) > 1)


def _flow_piece(source: Source, node: Syntax) -> Piece:
    text = source.slice(node)
    braces = text[:1] in ("{", "[")
    if node.kind == "mapping":
        entries = [(source.slice(key), piece_of(source, value)) for key, value in node.entries]
        piece = mapping(entries)
    else:
        piece = listing([piece_of(source, item) for item in node.items])
    if "\n" in text:
        if any(" #" in line for line in text.split("\n")):
            return Piece("raw", None, raw=_dedented(source, node.start, node.end), block=True)
    elif braces:
        piece.inline = text
    if text[:1] == "&":  # an anchor belongs to the whole value
        return Piece("raw", text if "\n" not in text else None, raw=_dedented(source, node.start, node.end))
    return piece


def _one_line(source: Source, node: Syntax, lines: tuple[str, ...]) -> str | None:
    """Return a block collection in one line; None where a comment or a text of several lines stands in it."""
    if any(line.lstrip().startswith("#") or " #" in line for line in lines):
        return None
    return _flowed(source, node)


def _flowed(source: Source, node: Syntax) -> str | None:
    text = source.slice(node)
    if text.startswith("&"):
        return None
    if node.kind == "alias":
        return text
    if node.kind == "scalar":
        if not node.flow or "\n" in text:
            return scalar_text(node.text)
        return scalar_text(node.text) if node.plain and _UNSAFE_IN_FLOW.search(text) else text
    if node.flow:
        return _flow_piece(source, node).inline
    parts: list[str | None] = []
    if node.kind == "list":
        parts = [_flowed(source, item) for item in node.items]
        return _joined("[", parts, "]")
    for key, value in node.entries:
        below = _flowed(source, value)
        name = _flowed(source, key)
        parts.append(None if below is None or name is None else f"{name}: {below}".rstrip())
    return _joined("{", parts, "}")


def _dedented(source: Source, start: int, end: int) -> tuple[str, ...]:
    """Return a part of the text as lines, moved to column 0 by the column at which it begins."""
    column = source.column(start)
    first, *rest = source.text[start:end].split("\n")
    moved = [line[min(column, len(line) - len(line.lstrip(" "))) :] for line in rest]
    return (first.rstrip(), *(line.rstrip() for line in moved))


ROOM = MAX_LINE_LENGTH
"""Maximum length of a line that an edit writes."""
