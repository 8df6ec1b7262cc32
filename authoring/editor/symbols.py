"""Outline of a file: its keys, and for a mission its trees with their nodes."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from picktree.files import Mark
from picktree.files.yaml import YamlNode

from .cursor import Place, Span

SymbolKind: TypeAlias = Literal["tree", "node", "key"]
_BETWEEN = " \t\r\n-,[{"
"""Characters between a value and the next key."""


@dataclass(frozen=True, slots=True)
class DocumentSymbol:
    """Entry of the outline."""

    name: str
    kind: SymbolKind
    detail: str
    """Value of a key, or the texts of a node's ports."""
    word: Span
    """Key, or bare name of a node."""
    whole: Span
    """Key with its value."""
    children: tuple[DocumentSymbol, ...]


@dataclass(slots=True)
class _Entry:
    name: str
    mark: Mark
    kind: SymbolKind
    detail: str = ""
    children: list[_Entry] = field(default_factory=list["_Entry"])


def document_symbols(root: YamlNode, text: str, nodes: Collection[str]) -> tuple[DocumentSymbol, ...]:
    """Return the outline of a text. `nodes`: IDs of the nodes and sub-trees of a mission; else empty."""
    trees = root.entries.get("trees") if nodes else None
    entries: list[_Entry] = []
    for key, value in root.entries.items():
        entry = _Entry(key, root.keys[key], "key", _scalar(value))
        if value is trees:
            for name, body in value.entries.items():
                below = list(_nodes_in(body, nodes))
                entry.children.append(_Entry(name, value.keys[name], "tree", children=below))
        else:
            entry.children += _keys_of(value)
        entries.append(entry)
    lines = text.split("\n")
    return tuple(_placed(entries, Place(len(lines), 0), lines))


def _keys_of(value: YamlNode) -> list[_Entry]:
    return [_Entry(key, value.keys[key], "key", _scalar(each)) for key, each in value.entries.items()]


def _nodes_in(body: YamlNode, nodes: Collection[str]) -> Iterator[_Entry]:
    """Yield the topmost nodes in a value, each with those below it."""
    if isinstance(body.value, str):
        if body.value in nodes:
            yield _Entry(body.value, body.mark, "node")
        return
    for key, value in body.entries.items():
        if key in nodes:
            ports = (f"{port}: {text}" for port, each in value.entries.items() if (text := _scalar(each)))
            yield _Entry(key, body.keys[key], "node", ", ".join(ports), list(_nodes_in(value, nodes)))
        elif not isinstance(value.value, str) or key == "do":
            yield from _nodes_in(value, nodes)
    for item in body.items:
        yield from _nodes_in(item, nodes)


def _scalar(value: YamlNode) -> str:
    return "" if value.value is None or isinstance(value.value, dict | list) else str(value.value)


def _placed(entries: list[_Entry], end: Place, lines: list[str]) -> Iterator[DocumentSymbol]:
    """Yield entries with their spans; each ends where the next one begins, the last one at `end`."""
    ordered = sorted(entries, key=lambda each: (each.mark.line, each.mark.column))
    starts = [Place(each.mark.line - 1, each.mark.column - 1) for each in ordered]
    for entry, start, following in zip(ordered, starts, [*starts, end][1:], strict=True):
        word = Span(start, Place(start.line, _word_end(lines[start.line], start.character, entry.name)))
        whole = Span(start, max(_trimmed(lines, following), word.end, key=Span.key))
        yield DocumentSymbol(
            entry.name,
            entry.kind,
            entry.detail,
            word,
            whole,
            tuple(_placed(entry.children, whole.end, lines)),
        )


def _word_end(line: str, start: int, name: str) -> int:
    quoted = 2 if line[start : start + 1] in ('"', "'") else 0
    return min(len(line), start + len(name) + quoted)


def _trimmed(lines: list[str], end: Place) -> Place:
    """Return the end of the text before a place, without the separator of the next key."""
    row, column = end.line, end.character
    while row >= 0:
        line = lines[row][:column].rstrip(_BETWEEN) if row < len(lines) else ""
        if line and not line.lstrip().startswith("#"):
            return Place(row, len(line))
        row -= 1
        column = len(lines[row]) if row >= 0 else 0
    return Place(0, 0)
