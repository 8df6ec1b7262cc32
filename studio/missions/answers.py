"""Answers on the text of a mission as values for the page; its places count in UTF-16, as JavaScript does."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from ...authoring.drawing.chart import symbol_of
from ...authoring.editing.outline import Outline, OutlineNode, OutlinePort, OutlineTree
from ...authoring.editing.text_changes import TextChange
from ...authoring.reference.node_reference import NodeEntry, node_entry
from ...authoring.reference.port_wording import COMMON_DOCS
from ...trees.declaration import BREAKPOINT, NodeDeclaration
from .context import MissionContext

_WIDE = re.compile(r"[\U00010000-\U0010ffff]")


class Places:
    """Places of a text: in code points here, in UTF-16 units in the page."""

    def __init__(self, text: str) -> None:
        self._wide = [found.start() for found in _WIDE.finditer(text)]
        self._units = [at + number for number, at in enumerate(self._wide)]

    def units(self, place: int) -> int:
        """Return a place in UTF-16 units."""
        return place + bisect_left(self._wide, place) if self._wide else place

    def points(self, place: int) -> int:
        """Return a place in code points."""
        return place - bisect_left(self._units, place) if self._units else place


def tree_values(found: Outline, context: MissionContext, places: Places) -> list[dict[str, Any]]:
    return [_tree(tree, context, places) for tree in found.trees]


def _tree(tree: OutlineTree, context: MissionContext, places: Places) -> dict[str, Any]:
    return {
        "name": tree.name,
        "doc": tree.doc,
        "ports": [_port(port, places) for port in tree.ports],
        "start": places.units(tree.start),
        "end": places.units(tree.end),
        "root": _node(tree.root, context, places) if tree.root is not None else None,
    }


def _node(node: OutlineNode, context: MissionContext, places: Places) -> dict[str, Any]:
    declaration = context.known(node.identity)
    symbol = (
        node.kind if node.kind in ("subtree", "unknown") or declaration is None else symbol_of(declaration)
    )
    return {
        "id": node.id,
        "identity": node.identity,
        "name": node.name,
        "symbol": symbol,
        "slot": node.slot,
        "label": node.label,
        "shown": node.shown,
        "listed": node.listed,
        "aliased": node.aliased,
        "start": places.units(node.start),
        "end": places.units(node.end),
        "ports": [_port(port, places) for port in node.ports],
        "slots": [slot.key for slot in declaration.slots] if declaration is not None else [],
        "children": [_node(child, context, places) for child in node.children],
    }


def _port(port: OutlinePort, places: Places) -> dict[str, Any]:
    return {
        "key": port.key,
        "text": port.text,
        "start": places.units(port.start),
        "end": places.units(port.end),
    }


def change_values(found: Iterable[TextChange], places: Places) -> list[dict[str, Any]]:
    """Return replacements as CodeMirror takes them."""
    return [
        {"from": places.units(change.start), "to": places.units(change.end), "insert": change.text}
        for change in found
    ]


def palette_values(
    context: MissionContext, own: Iterable[NodeDeclaration], library: Iterable[tuple[NodeDeclaration, str]]
) -> list[dict[str, Any]]:
    """Return nodes and sub-trees that may be added, with what the reference says of them."""
    causes = context.registry.causes
    found: list[dict[str, Any]] = []
    taken: set[str] = set()
    calls = [*((tree, "") for tree in own), *((tree, "") for tree in context.included.values()), *library]
    for tree, include in calls:
        if tree.id not in taken and tree.id != "Main":
            taken.add(tree.id)
            found.append({**_entry(node_entry(tree, causes)), "symbol": "subtree", "include": include})
    for declaration in context.registry.declarations():
        node = context.registry.find(declaration.id)
        entry = _entry(node_entry(declaration, causes, node))
        wraps = declaration.slot("do") is not None
        found.append({**entry, "symbol": symbol_of(declaration), "include": "", "wraps": wraps})
    return found


def _entry(entry: NodeEntry) -> dict[str, Any]:
    values = asdict(entry)
    return {
        key: values[key]
        for key in ("id", "kind", "summary", "doc", "ports", "slots", "limit", "rule", "example")
    }


def common_entries() -> list[dict[str, Any]]:
    """Return the keys that every node may have, in the form of its ports."""
    return [
        {
            "key": key,
            "doc": doc,
            "type": "expression" if key.startswith("_") else "text",
            "choices": ["before", "after"] if key == BREAKPOINT else [],
        }
        for key, doc in COMMON_DOCS.items()
    ]
