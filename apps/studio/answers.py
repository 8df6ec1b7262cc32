"""Answers on the text of a mission as values for the page: tree, faults, rehearsal, palette, forms and
completion.

Its places count in UTF-16, as JavaScript does.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable, Container, Iterable
from dataclasses import asdict
from functools import cache
from pathlib import Path
from secrets import token_hex
from typing import Any
from weakref import WeakKeyDictionary

from picktree.authoring import CHECKS, mission_chart
from picktree.authoring.editor import Edit, Place, Span, TextChange, document_faults, mission_outline
from picktree.authoring.rehearsal import Rehearsal, rehearse_files, to_json
from picktree.authoring.schema import node_reference
from picktree.files import PicktreeError
from picktree.trees import BREAKPOINT, NodeDeclaration
from picktree.trees.loading import load_surroundings

from .context import MissionContext, MissionTexts, library_declarations, own_trees

_WIDE = re.compile(r"[\U00010000-\U0010ffff]")


class PageText:
    """Places of a text: in code points here, in UTF-16 units in the page."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._wide = [found.start() for found in _WIDE.finditer(text)]
        self._units = [at + number for number, at in enumerate(self._wide)]

    def units(self, place: int) -> int:
        return place + bisect_left(self._wide, place) if self._wide else place

    def points(self, place: int) -> int:
        return place - bisect_left(self._units, place) if self._units else place

    def place(self, at: Place) -> int:
        """Return a place by line and character in code points."""
        start = -1
        for _ in range(at.line):
            start = self._text.find("\n", start + 1)
            if start < 0:
                return len(self._text)
        return min(start + 1 + at.character, len(self._text))

    def range(self, span: Span) -> dict[str, Any]:
        return {"from": self.units(self.place(span.start)), "to": self.units(self.place(span.end))}

    def edit(self, edit: Edit) -> dict[str, Any]:
        """Return a replacement as CodeMirror takes it."""
        return {**self.range(edit.span), "insert": edit.text}

    def changes(self, found: Iterable[TextChange]) -> list[dict[str, Any]]:
        """Return replacements as CodeMirror takes them."""
        return [
            {"from": self.units(each.start), "to": self.units(each.end), "insert": each.text}
            for each in found
        ]


class TreeAnswers:
    """Answers on trees, each made once while the tree's text stays the same."""

    def __init__(self) -> None:
        self._kept: WeakKeyDictionary[mission_outline.TreeBody, dict[str, Any]] = WeakKeyDictionary()

    def of(
        self,
        text: str,
        trees: Iterable[mission_outline.OutlineTree],
        context: MissionContext,
        known: Container[str],
    ) -> list[dict[str, Any]]:
        """Return the trees of a text. For trees whose `content` is among `known` only the place is
        returned."""
        places, found = PageText(text), list[dict[str, Any]]()
        for tree in trees:
            body = self._kept.get(tree.body)
            if body is None:
                body = self._kept[tree.body] = _body(tree, context, places)
            start, end = places.units(tree.start), places.units(tree.end)
            content = body["content"]
            more = {"content": content} if content in known else body
            found.append({"name": tree.name, "start": start, "end": end, **more})
        return found


def _body(tree: mission_outline.OutlineTree, context: MissionContext, places: PageText) -> dict[str, Any]:
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


def _node(
    node: mission_outline.OutlineNode, context: MissionContext, units: Callable[[int], int]
) -> dict[str, Any]:
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


def _port(port: mission_outline.OutlinePort, units: Callable[[int], int]) -> dict[str, Any]:
    return {"key": port.key, "text": port.text, "start": units(port.start), "end": units(port.end)}


def palette_values(
    context: MissionContext, own: Iterable[NodeDeclaration], library: Iterable[tuple[NodeDeclaration, str]]
) -> list[dict[str, Any]]:
    """Return nodes and sub-trees that may be added, with their reference."""
    causes = context.registry.causes
    found: list[dict[str, Any]] = []
    taken: set[str] = set()
    calls = [*((tree, "") for tree in own), *((tree, "") for tree in context.included.values()), *library]
    for tree, include in calls:
        if tree.id not in taken and tree.id != "Main":
            taken.add(tree.id)
            found.append(
                {**_entry(node_reference.node_entry(tree, causes)), "symbol": "subtree", "include": include}
            )
    for declaration in context.registry.declarations():
        node = context.registry.find(declaration.id)
        entry = _entry(node_reference.node_entry(declaration, causes, node))
        wraps = declaration.slot("do") is not None
        found.append({**entry, "symbol": mission_chart.symbol_of(declaration), "include": "", "wraps": wraps})
    return found


def _entry(entry: node_reference.NodeEntry) -> dict[str, Any]:
    values = asdict(entry)
    return {
        key: values[key]
        for key in ("id", "kind", "summary", "doc", "ports", "slots", "limit", "rule", "example")
    }


def faults(path: Path, text: str) -> list[dict[str, Any]]:
    """Return the faults that `picktree check` finds in a text, with places in UTF-16 units."""
    places = PageText(text)
    return [
        {
            **places.range(each.span),
            "line": each.fault.mark.line,
            "column": each.fault.mark.column,
            "where": each.fault.where,
            "message": each.message,
            "code": each.fault.code,
            "severity": each.fault.severity,
            "elsewhere": each.elsewhere,
            "fix": None if each.fix is None else places.edit(each.fix),
        }
        for each in document_faults(path, text, CHECKS)
    ]


def rehearsal(path: Path, text: str, cases: Path | None, names: tuple[str, ...]) -> dict[str, Any]:
    """Rehearse a text with its cases. Raises FileError with the faults of both."""
    result = rehearse_files(path, cases, names, text=text)
    values: dict[str, Any] = dict(to_json(result))
    return {**values, "nodes": _coverage(result)}


def _coverage(result: Rehearsal) -> dict[str, dict[str, Any]]:
    """Return the number of reached points by node, and sentences about the others."""
    found: dict[str, dict[str, Any]] = {}
    for point in result.coverage.points:
        entry = found.setdefault(point.node, {"reached": 0, "total": 0, "missed": []})
        entry["total"] += 1
        entry["reached"] += point.reached
        if not point.reached:
            entry["missed"].append(point.missed)
    return found


@cache
def _texts() -> MissionTexts:
    return MissionTexts()


def palette(path: Path, text: str) -> dict[str, Any]:
    """Return the nodes and sub-trees that may be added, and the keys that each node may have."""
    context, _ = _texts().read(path, text)
    common = [
        {
            "key": key,
            "doc": doc,
            "type": "expression" if key.startswith("_") else "text",
            "choices": ["before", "after"] if key == BREAKPOINT else [],
        }
        for key, doc in node_reference.COMMON_DOCS.items()
    ]
    nodes = palette_values(context, own_trees(path, text), library_declarations().values())
    return {"nodes": nodes, "common": common}


def form(path: Path, text: str, node: str) -> dict[str, Any]:
    """Return the possible values of a node's ports, and the keys of its tree's blackboard."""
    texts = _texts()
    context, reading = texts.read(path, text)
    found = context.outline(reading.source)
    shown = found.nodes().get(node)
    if shown is None:
        raise PicktreeError(f"the mission has no node {node!r}")
    declaration = context.known(shown.identity)
    for tree in own_trees(path, text):
        declaration = tree if tree.id == shown.identity else declaration
    names = _scene_names(found.scene, path)
    return {
        "ports": [
            {
                "key": port.key,
                "names": list(names.get(port.names, ())) if port.names else [],
                "default": node_reference.default_words(port),
            }
            for port in (declaration.ports if declaration is not None else ())
        ],
        "keys": texts.file(path, text).keys_of(node.partition("/")[0]),
    }


def completion(path: Path, text: str, line: int, character: int) -> dict[str, Any] | None:
    """Return the proposals at a place; None without any."""
    file, place = _texts().file(path, text), _cursor(text, line, character)
    found = file.complete(place)
    if found is None:
        return None
    span, proposals = found
    includes = {each.include: file.include_edit(each.include) for each in proposals if each.include}
    places, values = PageText(text), [asdict(each) for each in proposals]
    for value in values:
        if (more := includes.get(value["include"])) is not None:
            value["also"] = places.edit(more)
    return {**places.range(span), "options": values}


def documentation(path: Path, text: str, line: int, character: int) -> dict[str, Any] | None:
    """Return the documentation of the word at a place as Markdown; None without any."""
    found = _texts().file(path, text).hover(_cursor(text, line, character))
    return None if found is None else {**PageText(text).range(found[0]), "text": found[1]}


def _scene_names(scene: str, path: Path) -> dict[Any, tuple[str, ...]]:
    if not scene:
        return {}
    try:
        return dict(load_surroundings(scene, path.parent).names)
    except PicktreeError:
        return {}


def _cursor(text: str, line: int, character: int) -> Place:
    lines = text.split("\n")
    if not 0 <= line < len(lines):
        raise PicktreeError(f"the text has no line {line + 1}")
    return Place(line, PageText(lines[line]).points(character))
