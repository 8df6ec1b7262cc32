"""Which symbol stands for a node: its kind, refined by what its slots and the usual names tell."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from ...trees.declaration import NodeDeclaration
from .chart import Symbol

RECOVERY: Final = "recovery"
"""The label of a child that runs after a failure."""
_WORDS: Final[tuple[tuple[str, Symbol], ...]] = (
    ("Parallel", "parallel"),
    ("Fallback", "fallback"),
    ("Selector", "fallback"),
    ("Sequence", "sequence"),
    ("Repeat", "loop"),
    ("Retry", "loop"),
    ("ForEach", "loop"),
    ("Keep", "loop"),
    ("Loop", "loop"),
    ("Timeout", "clock"),
    ("Delay", "clock"),
    ("Rate", "clock"),
    ("Inverter", "not"),
    ("Force", "force"),
)
"""Parts of names that behaviour trees share everywhere; the first that fits counts."""

CHARACTERS: Final[Mapping[Symbol, str]] = {
    "action": "□", "branch": "◇", "clock": "◷", "condition": "○", "control": "■", "decorator": "δ",
    "fallback": "?", "force": "!", "loop": "↻", "not": "¬", "parallel": "⇉", "recover": "✚",
    "sequence": "→", "subtree": "▣",
}  # fmt: skip
"""One character for each, as in the literature where there is a usual one."""

MEANINGS: Final[Mapping[Symbol, str]] = {
    "action": "action", "branch": "one branch by a value", "clock": "decorator of time",
    "condition": "condition", "control": "control node", "decorator": "decorator", "fallback": "fallback",
    "force": "decorator of the result", "loop": "loop", "not": "inverter", "parallel": "parallel",
    "recover": "recovery by cause", "sequence": "sequence", "subtree": "sub-tree",
}  # fmt: skip


def symbol_of(declaration: NodeDeclaration) -> Symbol:
    """
    >>> from ...trees.controls import Sequence
    >>> symbol_of(Sequence.declaration)
    'sequence'
    """
    match declaration.kind:
        case "action" | "condition" | "subtree" as kind:
            return kind
        case _:
            pass
    if any(slot.of == "cause" or RECOVERY in slot.labels for slot in declaration.slots):
        return "recover"
    for word, symbol in _WORDS:
        if word in declaration.id:
            return symbol
    if any(slot.arity == "table" or slot.labels for slot in declaration.slots):
        return "branch"
    return "decorator" if declaration.kind == "decorator" else "control"
