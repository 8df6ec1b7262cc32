"""Answers on a text that come later than its picture: palette, forms, completion, documentation.

They run in a worker process, which keeps what the texts share.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from ...authoring.editor.completion import Proposal
from ...authoring.editor.cursor import Place as CursorPlace
from ...authoring.editor.cursor import Span
from ...authoring.schema.port_wording import default_words
from ...files.errors import PicktreeError
from ...trees.loading.loader import load_surroundings
from .answers import Places, common_entries, palette_values
from .checks import LineStarts
from .context import MissionTexts, library_declarations, own_trees


@cache
def _texts() -> MissionTexts:
    return MissionTexts()


def palette(path: Path, text: str) -> dict[str, Any]:
    """Return the nodes and sub-trees that may be added, and the keys that each node may have."""
    context, _ = _texts().read(path, text)
    return {
        "nodes": palette_values(context, own_trees(path, text), library_declarations().values()),
        "common": common_entries(),
    }


def form(path: Path, text: str, node: str) -> dict[str, Any]:
    """Return what may be given to the ports of a node, and the keys of its tree's blackboard."""
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
                "default": default_words(port),
            }
            for port in (declaration.ports if declaration is not None else ())
        ],
        "keys": texts.file(path, text).keys_of(node.partition("/")[0]),
    }


def completion(path: Path, text: str, line: int, character: int) -> dict[str, Any] | None:
    """Return what may be written at a place; None for nothing."""
    file, place = _texts().file(path, text), _cursor(text, line, character)
    found = file.complete(place)
    if found is None:
        return None
    span, proposals = found
    includes = {each.include: file.include_edit(each.include) for each in proposals if each.include}
    places, lines = Places(text), LineStarts(text)
    values: list[dict[str, Any]] = []
    for each in proposals:
        value = _proposal(each)
        more = includes.get(each.include)
        if more is not None:
            at = places.units(lines.place(more.span.start))
            value["also"] = {"from": at, "to": at, "insert": more.text}
        values.append(value)
    return {**_range(text, span), "options": values}


def documentation(path: Path, text: str, line: int, character: int) -> dict[str, Any] | None:
    """Return the documentation of what stands at a place as Markdown; None for nothing."""
    found = _texts().file(path, text).hover(_cursor(text, line, character))
    return None if found is None else {**_range(text, found[0]), "text": found[1]}


def _scene_names(scene: str, path: Path) -> dict[Any, tuple[str, ...]]:
    if not scene:
        return {}
    try:
        return dict(load_surroundings(scene, path.parent).names)
    except PicktreeError:
        return {}


def _cursor(text: str, line: int, character: int) -> CursorPlace:
    lines = text.split("\n")
    if not 0 <= line < len(lines):
        raise PicktreeError(f"the text has no line {line + 1}")
    return CursorPlace(line, Places(lines[line]).points(character))


def _range(text: str, span: Span) -> dict[str, Any]:
    places, lines = Places(text), LineStarts(text)
    return {"from": places.units(lines.place(span.start)), "to": places.units(lines.place(span.end))}


def _proposal(proposal: Proposal) -> dict[str, Any]:
    return {
        "label": proposal.label,
        "kind": proposal.kind,
        "snippet": proposal.snippet,
        "doc": proposal.doc,
        "include": proposal.include,
    }
