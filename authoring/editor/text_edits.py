"""Edits of a YAML text at one place: an item or entry added, replaced or removed, and the pieces of text
that are put there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from difflib import SequenceMatcher
from typing import Literal, TypeAlias

from picktree.files import Location
from picktree.files.yaml import MAX_LINE_LENGTH, scalar_text

from .syntax import Lines, NotEditable, Source, Syntax, source_of

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
    """Source lines of a block, moved to column 0."""
    above: tuple[str, ...] = ()
    """Comments above it as an item of a block."""
    block: bool = False
    """Whether it was a block, and remains one where blocks are allowed."""

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
        single = self.kind == "mapping" and len(self.entries) == 1
        if not single and self.kind != "raw" and self.inline is not None and len(self.inline) <= room - 2:
            lines = [self.inline]
        else:
            lines = self.lines(room - len(dash))
        blank = " " * len(dash)
        return [f"{dash}{lines[0]}", *(f"{blank}{line}" if line.strip() else line for line in lines[1:])]


def entry_lines(key: str, value: Piece, room: int, comment: str = "") -> list[str]:
    """Return the lines of an entry of a block mapping; `key` is its text, and `comment` follows it."""
    if value.fits(room - len(key) - 2):
        return [f"{key}: {value.inline}{comment}" if value.inline else f"{key}:{comment}"]
    return [f"{key}:{comment}", *(f"  {line}" if line.strip() else line for line in value.lines(room - 2))]


def key_text(key: str) -> str:
    """Return a key as a file writes it: keys are texts, so a number needs no quotes."""
    return key if re.fullmatch(r"\w+", key, re.ASCII) else scalar_text(key)


def scalar(text: str) -> Piece:
    """Return the piece of a value's final text in one line."""
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
    """Return a block collection in one line; None for one with a comment or a text of several lines."""
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


def fragment(source: Source, loc: Location) -> Piece:
    """Return the value at a location with its comments."""
    node, parent = source.at(loc), source.at(loc[:-1])
    if parent.flow:
        return piece_of(source, node)
    if parent.kind == "list" and isinstance(loc[-1], int):
        lines = source.item_lines(parent, loc[-1])
        dash = source.line_of(source.dash(node))
        above = tuple(source.line(number).strip() for number in range(lines.first, dash))
        if node.flow:
            piece, comment = piece_of(source, node), source.comment_behind(node.end)
            if comment and piece.inline is not None:
                piece = Piece("raw", None, raw=(f"{piece.item_lines(ROOM)[0][2:]}{comment}",), block=True)
            return replace(piece, above=above)
        return replace(block_piece(source, node, lines.last), above=above)
    if node.flow:
        return piece_of(source, node)
    lines = source.entry_lines(parent, parent.keys.index(str(loc[-1])))
    return block_piece(source, node, lines.last) if node.kind != "scalar" else piece_of(source, node)


def replace_value(text: str, loc: Location, piece: Piece) -> str:
    """Replace the value at a location, with its comments where `fragment` has them."""
    source = source_of(text)
    node, parent = source.at(loc), source.at(loc[:-1])
    if parent.flow:
        if piece.inline is not None:
            changed = _spliced(
                source, node.start, node.end, piece.inline if node.end > node.start else f" {piece.inline}"
            )
            if changed is not None:
                return changed
        return _in_brackets(source, loc, lambda _: piece)
    return _replace_in_block(source, loc, piece)


def _replace_in_block(source: Source, loc: Location, piece: Piece) -> str:
    node, parent = source.at(loc), source.at(loc[:-1])
    if parent.kind == "list" and isinstance(loc[-1], int):
        dash = source.dash(node)
        column = source.column(dash)
        same_line = source.line_of(dash) == source.line_of(node.start)
        mark = source.text[dash : node.start] if same_line and not node.empty else "- "
        lines = source.item_lines(parent, loc[-1])
        first, *rest = piece.item_lines(ROOM - column, mark)
        end = source.end_of(lines.last)
        return _with(source, dash, end, "\n".join([first, *(_indented(line, column) for line in rest)]))
    key, _ = parent.entries[parent.keys.index(str(loc[-1]))]
    column, colon = source.column(key.start), source.colon(key)
    begins_below = not node.empty and source.line_of(node.start) > source.line_of(colon)
    if node.flow and not begins_below:
        if (
            piece.inline is not None
            and not node.empty
            and piece.fits(ROOM - column - (colon - key.start) - 2)
        ):
            return _with(source, node.start, node.end, piece.inline)
        comment, end = source.comment_behind(node.end), node.end
        end += len(comment)
    else:
        comment = source.comment_behind(colon + 1)
        lines = source.entry_lines(parent, parent.keys.index(str(loc[-1])))
        end = source.end_of(lines.last)
        first = source.line_of(node.start)
        between = (
            source.text[source.end_of(source.line_of(colon)) : source.start_of(first)] if begins_below else ""
        )
        if between.strip():  # comments between the key and its value
            indent = source.column(node.start)
            written = "\n".join(_indented(line, indent) for line in piece.lines(ROOM - indent))
            return _with(source, source.start_of(first), end, written)
    name = source.text[key.start : colon].rstrip()
    first, *rest = entry_lines(name, piece, ROOM - column, comment)
    return _with(source, key.start, end, "\n".join([first, *(_indented(line, column) for line in rest)]))


def insert_item(text: str, loc: Location, index: int, piece: Piece) -> str:
    """Insert an item into the list at a location, in the layout of the list."""
    source = source_of(text)
    node = source.at(loc)
    if node.kind != "list":
        raise NotEditable(f"line {source.line_of(node.start) + 1} is no list")
    if not node.flow:
        column = source.column(source.dash(node.items[0]))
        lines = [*piece.above, *piece.item_lines(ROOM - column)]
        at = (
            source.own_lines(source.item_lines(node, index), source.dash(node.items[index])).first
            if index < len(node.items)
            else source.item_lines(node, len(node.items) - 1).last + 1
        )
        return _insert_lines(source, at, [_indented(line, column) for line in lines])
    in_block = not node.items and piece.block and not any(above.flow for _, above in source.trail(loc[:-1]))
    if piece.inline is not None and not piece.above and not in_block:
        if index < len(node.items):
            at, written = node.items[index].start, f"{piece.inline}, "
        elif node.items:
            at, written = node.items[-1].end, f", {piece.inline}"
        else:
            at, written = node.end - 1, piece.inline
        changed = _spliced(source, at, at, written)
        if changed is not None:
            return changed

    def inserted(old: Piece) -> Piece:
        return listing([*old.items[:index], piece, *old.items[index:]], block=in_block)

    return _in_brackets(source, loc, inserted)


def remove_item(text: str, loc: Location, index: int) -> str:
    """Remove an item of the list at a location, with the comments that belong to it."""
    source = source_of(text)
    node = source.at(loc)
    item = source.at((*loc, index))
    if len(node.items) == 1:
        return replace_value(text, loc, scalar("[]"))
    if not node.flow:
        return _remove_lines(source, source.own_lines(source.item_lines(node, index), source.dash(item)))
    return _without(
        source, [part.start for part in node.items], [part.end for part in node.items], index, item
    )


def put_entry(text: str, loc: Location, key: str, piece: Piece, before: Collection[str] = ()) -> str:
    """Give a key of the mapping at a location a value; a new key comes before the first of `before`."""
    source = source_of(text)
    node = source.at(loc)
    if node.kind == "scalar" and node.empty:
        return replace_value(text, loc, mapping([(key, piece)], block=piece.block))
    if node.kind != "mapping":
        raise NotEditable(f"line {source.line_of(node.start) + 1} is no mapping")
    if node.entry(_plain(key)) is not None:
        return replace_value(text, (*loc, _plain(key)), piece)
    index = next((n for n, name in enumerate(node.keys) if name in before), len(node.entries))
    if not node.flow:
        column = source.column(node.entries[0][0].start)
        lines = [_indented(line, column) for line in entry_lines(key, piece, ROOM - column)]
        at = (
            source.own_lines(source.entry_lines(node, index), node.entries[index][0].start).first
            if index < len(node.entries)
            else source.entry_lines(node, len(node.entries) - 1).last + 1
        )
        return _insert_lines(source, at, lines)
    if piece.inline is not None:
        written = f"{key}: {piece.inline}"
        if index < len(node.entries):
            at, written = node.entries[index][0].start, f"{written}, "
        elif node.entries:
            at, written = max(node.entries[-1][1].end, node.entries[-1][0].end), f", {written}"
        else:
            at = node.end - 1
        changed = _spliced(source, at, at, written) if source.text[node.start] == "{" else None
        if changed is not None:
            return changed

    def added(old: Piece) -> Piece:
        return mapping([*old.entries[:index], (key, piece), *old.entries[index:]])

    return _in_brackets(source, loc, added)


def remove_entry(text: str, loc: Location, key: str) -> str:
    """Remove an entry of the mapping at a location, with the comments that belong to it."""
    source = source_of(text)
    node = source.at(loc)
    index = node.keys.index(key)
    if len(node.entries) == 1:
        return replace_value(text, loc, scalar("{}"))
    if not node.flow:
        start = node.entries[index][0].start
        return _remove_lines(source, source.own_lines(source.entry_lines(node, index), start))
    starts = [name.start for name, _ in node.entries]
    ends = [max(value.end, source.colon(name) + 1) for name, value in node.entries]
    return _without(source, starts, ends, index, node)


def rename_key(text: str, loc: Location, written: str) -> str:
    """Replace the key of the entry at a location."""
    source = source_of(text)
    found = source.at(loc[:-1]).entry(str(loc[-1]))
    if found is None:
        raise NotEditable(f"there is no {'.'.join(map(str, loc))} in the text")
    return _with(source, found[0].start, found[0].end, written)


def _in_brackets(source: Source, loc: Location, change: Callable[[Piece], Piece]) -> str:
    """Lay out the outermost brackets around a location again, with a changed value in them."""
    outer = next(place for place, node in source.trail(loc) if node.flow)
    piece = _changed(piece_of(source, source.at(outer)), source, outer, loc[len(outer) :], change)
    if not outer:
        return "\n".join([*piece.lines(ROOM), ""])
    return _replace_in_block(source, outer, piece)


def _changed(
    piece: Piece, source: Source, at: Location, below: Location, change: Callable[[Piece], Piece]
) -> Piece:
    if not below:
        return change(piece)
    step, node = below[0], source.at(at)
    if piece.kind == "list" and isinstance(step, int):
        items = list(piece.items)
        items[step] = _changed(items[step], source, (*at, step), below[1:], change)
        return listing(items)
    if piece.kind == "mapping":
        entries = list(piece.entries)
        index = node.keys.index(str(step))
        key, value = entries[index]
        entries[index] = key, _changed(value, source, (*at, step), below[1:], change)
        return mapping(entries)
    line = source.line_of(node.start) + 1
    raise NotEditable(f"line {line} has a comment or an anchor in brackets: only its text can be edited")


def _spliced(source: Source, start: int, end: int, written: str) -> str | None:
    """Replace a part of a line; None when the line would become too long."""
    line = source.line_of(start)
    before = source.end_of(line) - source.start_of(line)
    if "\n" not in source.text[start:end]:
        after = before + len(written) - (end - start)
        comment = len(_comment_of(source.line(line)))
        if before - comment <= ROOM < after - comment:
            return None
    return _with(source, start, end, written)


def _comment_of(line: str) -> str:
    """Return the comment behind the last bracket of a line, with the blanks before it."""
    close = max(line.rfind("]"), line.rfind("}"))
    rest = line[close + 1 :]
    return rest if rest.lstrip().startswith("#") else ""


def _without(source: Source, starts: list[int], ends: list[int], index: int, node: Syntax) -> str:
    if index + 1 < len(starts):
        return _with(source, starts[index], starts[index + 1], "")
    if source.text[node.start : node.start + 1] == "&":
        raise NotEditable(
            f"line {source.line_of(node.start) + 1} holds an anchor: only its text can be edited"
        )
    return _with(source, ends[index - 1], ends[index], "")


def _with(source: Source, start: int, end: int, written: str) -> str:
    return source.text[:start] + written + source.text[end:]


def _insert_lines(source: Source, at: int, lines: list[str]) -> str:
    if at >= source.line_count:
        text = source.text if source.text.endswith("\n") else f"{source.text}\n"
        return text + "\n".join(lines) + "\n"
    start = source.start_of(at)
    return _with(source, start, start, "".join(f"{line}\n" for line in lines))


def _remove_lines(source: Source, lines: Lines) -> str:
    return _with(source, source.start_of(lines.first), source.start_of(lines.last + 1), "")


def _indented(line: str, column: int) -> str:
    return f"{' ' * column}{line}" if line.strip() else line


def _plain(key: str) -> str:
    """Return a key's value from its text."""
    return key[1:-1] if key[:1] in ("'", '"') and key[-1:] == key[:1] and len(key) > 1 else key


def entry_fragment(source: Source, loc: Location, key: str) -> Piece:
    """Return an entry of the mapping at a location as a mapping of its own, with its comments."""
    node = source.at(loc)
    index = node.keys.index(key)
    name, value = node.entries[index]
    if node.flow:
        return mapping([(source.slice(name), piece_of(source, value))])
    lines = source.entry_lines(node, index)
    entry = Syntax(
        "mapping", name.start, max(value.end, source.colon(name) + 1), False, entries=[(name, value)]
    )
    return block_piece(source, entry, lines.last)


def replace_entry(text: str, loc: Location, key: str, piece: Piece) -> str:
    """Replace an entry of the mapping at a location, its comments included, by a node."""
    source = source_of(text)
    node = source.at(loc)
    index = node.keys.index(key)
    name, value = node.entries[index]
    if node.flow:
        inline = piece.inline
        if inline is None or source.text[node.start] != "{":
            line = source.line_of(name.start) + 1
            raise NotEditable(f"line {line} is written in a way that only its text can be edited")
        written = inline[1:-1] if inline.startswith("{") else f"{inline}: {{}}"
        changed = _spliced(source, name.start, max(value.end, source.colon(name) + 1), written)
        if changed is not None:
            return changed
        return _in_brackets(source, loc, lambda old: _exchanged(old, index, piece))
    column = source.column(name.start)
    lines = piece.lines(ROOM - column) if piece.kind != "scalar" else [f"{piece.inline}:"]
    first, *rest = lines
    end = source.end_of(source.entry_lines(node, index).last)
    return _with(source, name.start, end, "\n".join([first, *(_indented(line, column) for line in rest)]))


def _exchanged(old: Piece, index: int, piece: Piece) -> Piece:
    if piece.kind != "mapping":
        raise NotEditable("what is written in brackets here is too long: break its lines first")
    return mapping([*old.entries[:index], *piece.entries, *old.entries[index + 1 :]])


@dataclass(frozen=True, slots=True)
class TextChange:
    """Replacement of the part of a text from `start` to `end`, in code points from 0."""

    start: int
    end: int
    text: str


def changes(old: str, new: str) -> list[TextChange]:
    """Return replacements of whole lines, narrowed to the letters that differ, that make `new` of `old`."""
    before, after = old.splitlines(keepends=True), new.splitlines(keepends=True)
    head = 0
    while head < min(len(before), len(after)) and before[head] == after[head]:
        head += 1
    tail = 0
    while tail < min(len(before), len(after)) - head and before[-1 - tail] == after[-1 - tail]:
        tail += 1
    middle_old, middle_new = before[head : len(before) - tail], after[head : len(after) - tail]
    starts = [0]
    for line in before:
        starts.append(starts[-1] + len(line))
    found: list[TextChange] = []
    matcher = SequenceMatcher(None, middle_old, middle_new, autojunk=False)
    for tag, a, b, c, d in matcher.get_opcodes():
        if tag != "equal":
            start, end = starts[head + a], starts[head + b]
            found.append(_narrowed(old, start, end, "".join(middle_new[c:d])))
    return found


def _narrowed(old: str, start: int, end: int, written: str) -> TextChange:
    """Leave out equal letters at both ends."""
    replaced = old[start:end]
    head = _common(replaced, written)
    replaced, written = replaced[head:], written[head:]
    tail = _common(replaced[::-1], written[::-1])
    return TextChange(start + head, end - tail, written[: len(written) - tail])


def _common(one: str, other: str) -> int:
    """Return the number of equal letters at the beginning of two texts."""
    return next(
        (at for at, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other))
    )
