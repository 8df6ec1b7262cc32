"""Answers on the text of a mission as values for the page; its places count in UTF-16, as JavaScript does."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable, Container, Iterable
from dataclasses import asdict
from secrets import token_hex
from typing import Any
from weakref import WeakKeyDictionary

from ...authoring.drawing.chart import symbol_of
from ...authoring.editor.outline import OutlineNode, OutlinePort, OutlineTree, TreeBody
from ...authoring.editor.text_changes import TextChange
from ...authoring.schema.node_reference import NodeEntry, node_entry
from ...authoring.schema.port_wording import COMMON_DOCS
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


class TreeAnswers:
    """Answers on trees, each made once while the tree's text stays the same."""

    def __init__(self) -> None:
        self._kept: WeakKeyDictionary[TreeBody, dict[str, Any]] = WeakKeyDictionary()

    def of(
        self, text: str, trees: Iterable[OutlineTree], context: MissionContext, known: Container[str]
    ) -> list[dict[str, Any]]:
        """Return the trees of a text; of those whose `content` is among `known`, the place only."""
        places, found = Places(text), list[dict[str, Any]]()
        for tree in trees:
            body = self._kept.get(tree.body)
            if body is None:
                body = self._kept[tree.body] = _body(tree, context, places)
            start, end = places.units(tree.start), places.units(tree.end)
            content = body["content"]
            more = {"content": content} if content in known else body
            found.append({"name": tree.name, "start": start, "end": end, **more})
        return found


def _body(tree: OutlineTree, context: MissionContext, places: Places) -> dict[str, Any]:
    """Return the content of a tree, with a name that no other content has."""
    body, start = tree.body, places.units(tree.start)

    def units(place: int) -> int:
        return places.units(tree.start + place) - start

    return {
        "content": token_hex(8),
        "doc": body.doc,
        "ports": [_port(port, units) for port in body.ports],
        "root": _node(body.root, context, units) if body.root is not None else None,
    }


def _node(node: OutlineNode, context: MissionContext, units: Callable[[int], int]) -> dict[str, Any]:
    declaration = context.known(node.identity)
    symbol = node.kind if node.kind in ("subtree", "unknown") else context.symbol(node.identity)
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
        "start": units(node.start),
        "end": units(node.end),
        "ports": [_port(port, units) for port in node.ports],
        "slots": [slot.key for slot in declaration.slots] if declaration is not None else [],
        "children": [_node(child, context, units) for child in node.children],
    }


def _port(port: OutlinePort, units: Callable[[int], int]) -> dict[str, Any]:
    return {
        "key": port.key,
        "text": port.text,
        "start": units(port.start),
        "end": units(port.end),
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
