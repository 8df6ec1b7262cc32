"""Chart as indented text for a terminal."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Sequence
from typing import Final

from .chart import CHARACTERS, Branch, Chart, ChartNode, ChartPort, ChartTree

DEFAULT_COLUMNS: Final = 100
"""Default width, columns."""
_MIN_NODE_COLUMNS: Final = 40
"""Minimum width of a node's line at any depth, columns."""
_MIN_VALUE_COLUMNS: Final = 8
"""Minimum width of a shortened value, columns."""


def text(chart: Chart, *, columns: int = DEFAULT_COLUMNS, expand: bool = False) -> str:
    """Return the trees as text, one node per line. `expand`: each call is followed by its tree."""
    about = [chart.title, *([f"scene {chart.scene}"] if chart.scene else [])]
    rows = [_cut(" · ".join(about), columns)]
    for tree in chart.trees[:1] if expand else chart.trees:
        rows += ["", _row("", tree.name, [_port(port) for port in tree.ports], columns)]
        rows += [_cut(tree.doc, columns)] if tree.doc else []
        rows += _below(chart, tree.root, "", columns, expand)
    return "\n".join(rows) + "\n"


def _below(chart: Chart, root: ChartNode, indent: str, columns: int, expand: bool) -> Iterator[str]:
    yield from _branch(chart, Branch("", "child", root), indent, "└── ", "    ", columns, expand)


def _branch(
    chart: Chart, branch: Branch, indent: str, mark: str, beyond: str, columns: int, expand: bool
) -> Iterator[str]:
    node = branch.node
    head, words = _title(branch), _words(node)
    yield _row(f"{indent}{mark}", head, words, columns)
    inner = f"{indent}{beyond}"
    called = _called(chart, node) if expand else None
    if called is not None:
        yield from _below(chart, called.root, inner, columns, expand)
    for index, below in enumerate(node.branches):
        last = index + 1 == len(node.branches)
        marks = ("└── ", "    ") if last else ("├── ", "│   ")
        yield from _branch(chart, below, inner, *marks, columns, expand)


def _called(chart: Chart, node: ChartNode) -> ChartTree | None:
    return chart.tree(node.calls) if node.calls else None


def _title(branch: Branch) -> str:
    node, label = branch.node, f"{branch.label}:" if branch.label else ""
    if node.written_as_list:
        return label
    name = node.given_name
    title = f"{CHARACTERS[node.symbol]} {node.id}{'' if name[:1] in ('', '#') else ' '}{name}"
    return f"{label} {title}" if label else title


def _words(node: ChartNode) -> list[str]:
    stop = [f"● stops {node.breakpoint}"] if node.breakpoint else []
    before = [f"[{rule.key}: {rule.text}]" for rule in node.before]
    after = [f"[{rule.key}: {rule.text}]" for rule in node.after]
    return [*stop, *before, *map(_port, node.ports), *after]


def _port(port: ChartPort) -> str:
    return f"{port.key} → {port.value}" if port.role == "output" else f"{port.key}: {port.value}"


def _row(indent: str, title: str, words: Sequence[str], columns: int) -> str:
    """Return one line with the longest words shortened to fit; lines of deep nodes may be longer."""
    words = list(words)
    columns = max(columns, _cells(indent) + _MIN_NODE_COLUMNS)
    room = columns - _cells(indent) - _cells(title) - 2 * len(words)
    while words and sum(map(_cells, words)) > room:
        longest = max(range(len(words)), key=lambda index: _cells(words[index]))
        excess = sum(map(_cells, words)) - room
        size = _cells(words[longest])
        if size <= _MIN_VALUE_COLUMNS:
            break
        words[longest] = _cut(words[longest], max(size - excess, _MIN_VALUE_COLUMNS))
    return _cut("  ".join([f"{indent}{title}", *words]), columns)


def _cut(line: str, columns: int) -> str:
    """Return the line, ended by an ellipsis where it is longer than the columns."""
    if _cells(line) <= columns:
        return line
    kept, room = "", columns - 1
    for character in line:
        room -= _cells(character)
        if room < 0:
            break
        kept += character
    return f"{kept.rstrip()}…"


def _cells(line: str) -> int:
    """Return the number of terminal columns of the line."""
    return sum(
        0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in line
    )
