"""What a cure is called, from the shape of the tree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

AGAIN = "again"
_MOST = 3
"""Nodes that are named of a handler that is a list."""
_AROUND = frozenset(
    {
        "Sequence",
        "SequenceWithMemory",
        "ReactiveSequence",
        "RetryUntilSuccessful",
        "Repeat",
        "Timeout",
        "Delay",
    }
)
"""Nodes that are called as what is below them."""
_CHOOSING = frozenset({"Fallback", "ReactiveFallback"})


class Shaped(Protocol):
    """A node as a tree's record has it."""

    @property
    def path(self) -> str: ...
    @property
    def id(self) -> str: ...
    @property
    def children(self) -> Sequence[str]: ...


class Names:
    """Names of branches: of a sub-tree or a leaf its own, of a list those of its parts."""

    def __init__(self, nodes: Iterable[Shaped]) -> None:
        self._nodes: Mapping[str, Shaped] = {node.path: node for node in nodes}

    def of(self, path: str) -> str:
        parts = list(dict.fromkeys(self._parts(path)))
        if len(parts) > _MOST:
            return f"{' + '.join(parts[: _MOST - 1])} + {len(parts) - _MOST + 1} more"
        return " + ".join(parts)

    def _parts(self, path: str) -> list[str]:
        node = self._nodes.get(path)
        if node is None:
            return [_last(path)]
        if node.id in _AROUND and node.children:
            return [part for child in node.children for part in self._parts(child)]
        if node.id in _CHOOSING and node.children:
            either = [" + ".join(self._parts(child)) for child in node.children]
            return [" or ".join(either[:_MOST])]
        own = _last(path).partition("#")[0]
        return [node.id if own == node.id else f"{node.id} ({own})"]


def _last(path: str) -> str:
    return path.rsplit("/", 1)[-1]
