"""Drawing of a chart as lines of text for a terminal."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Sequence
from typing import Final

from .mission_chart import (
    CHARACTERS,
    Branch,
    Chart,
    ChartPort,
)

DEFAULT_COLUMNS: Final = 100


_MIN_NODE_COLUMNS: Final = 40
"""Minimum width of a node's line at any depth, columns."""


_MIN_VALUE_COLUMNS: Final = 8
"""Minimum width of a shortened value, columns."""


def text(chart: Chart, *, columns: int = DEFAULT_COLUMNS, expand: bool = False) -> str:
    """Return the trees as text, one node per line. `expand`: each call is followed by its tree."""
    about = [chart.title, *([f"scene {chart.scene}"] if chart.scene else [])]
    rows = [_cut(" · ".join(about), columns)]
    for tree in chart.trees[:1] if expand else chart.trees:
        rows += ["", _row("", tree.name, [port_text(port) for port in tree.ports], columns)]
        rows += [_cut(tree.doc, columns)] if tree.doc else []
        rows += _branches(chart, [Branch("", "child", tree.root)], "", columns, expand)
    return "\n".join(rows) + "\n"


def _branches(
    chart: Chart, branches: Sequence[Branch], indent: str, columns: int, expand: bool
) -> Iterator[str]:
    for branch in branches:
        node, last = branch.node, branch is branches[-1]
        stop = [f"● stops {node.breakpoint}"] if node.breakpoint else []
        before, after = (
            [f"[{rule.key}: {rule.text}]" for rule in rules] for rules in (node.before, node.after)
        )
        words = [*stop, *before, *map(port_text, node.ports), *after]
        label = f"{branch.label}:" if branch.label else ""
        title = "" if node.written_as_list else f"{CHARACTERS[node.symbol]} {node.title}"
        yield _row(f"{indent}{'└── ' if last else '├── '}", f"{label} {title}".strip(), words, columns)
        called = [Branch("", "child", chart.tree(node.calls).root)] if expand and node.calls else []
        beyond = f"{indent}{'    ' if last else '│   '}"
        yield from _branches(chart, [*called, *node.branches], beyond, columns, expand)


def port_text(port: ChartPort) -> str:
    """Return the port as a drawing shows it: the arrow of an output, or the value of an input."""
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
