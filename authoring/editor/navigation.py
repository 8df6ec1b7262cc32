"""Navigation from a cursor: hover, rename, and the definition and references of files, nodes, sub-trees and
keys.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from picktree.authoring.schema import Schema, mission_files
from picktree.files import Location, Mark, PicktreeError, file_system
from picktree.files.yaml import Document, YamlNode
from picktree.trees import IDENTIFIER, MAIN, MissionFiles, Node, path_of, references
from picktree.trees.loading import NodeRegistry
from picktree.world.robot_model import robot_file
from picktree.world.scene import scene_loading

from .completion import is_expression
from .cursor import Cursor, Place, Span
from .cursor import walk as cursor_walk
from .schema_walk import SchemaWalk, markdown_of, node_ids
from .tree_keys import KeyPlace, key_places, places_of, tree_of

_OUTPUT = "*output:"


@dataclass(frozen=True, slots=True)
class Edit:
    """Replacement of a part of the text."""

    span: Span
    text: str


def hover(cursor: Cursor, walk: SchemaWalk) -> str:
    """Return the documentation of the node, port, key or value under the cursor; empty for none."""
    found = key_at(cursor, walk)
    if found is not None and found.kind != "port":
        return _key_words(cursor, walk, found)
    parts = walk.at(cursor.path)
    for part in parts:
        reference = node_ids(part).get(cursor.written)
        if reference is not None:
            return _node_words(walk.resolved(reference), walk)
    return markdown_of(walk.at((*cursor.path, cursor.written)) if cursor.is_key else parts)


def _node_words(body: Schema, walk: SchemaWalk) -> str:
    """Return the documentation of a node or sub-tree, with a line for each of its ports."""
    lines: list[str] = []
    for key, part in walk.own_keys(body).items():
        about, *details = markdown_of([part]).split("\n\n")
        lines.append(" ".join([f"- `{key}`: {about}", *details[-1:]]) if about else f"- `{key}`")
    return "\n\n".join(filter(None, [markdown_of([body]), "\n".join(lines)]))


def _key_words(cursor: Cursor, walk: SchemaWalk, place: KeyPlace) -> str:
    tree, key = key_home(place)
    every = list(key_places_of(cursor, walk, tree, key))
    lines = [f"Key `{key}` of the tree {tree}."]
    port = next((each for each in every if each.kind == "port"), None)
    if port is not None:
        documentation = markdown_of(walk.at(port.path))
        about: YamlNode | None = cursor.root
        for step in (*port.path, "doc"):
            about = about.child(step) if about is not None else None
        doc = f": {about.value}" if about is not None and isinstance(about.value, str) else ""
        lines.append(f"Port of the tree{doc}." if doc or documentation else "Port of the tree.")
    for each in every:
        if writes(each, walk):
            owner = next((str(step) for step in reversed(each.path[:-1]) if isinstance(step, str)), tree)
            lines.append(f"Written by {owner}, line {each.mark.line}.\n\n{markdown_of(walk.at(each.path))}")
    return "\n\n".join(lines)


def writes(place: KeyPlace, walk: SchemaWalk) -> bool:
    if place.kind == "reference":
        return _OUTPUT in markdown_of(walk.at(place.path))
    return place.kind == "assignment"


def renamed_span(cursor: Cursor, walk: SchemaWalk, text: str) -> Span | None:
    """Return the key under the cursor if it can be renamed; else None."""
    found = key_at(cursor, walk)
    if found is None:
        return None
    key = found.key.removeprefix(references.ROOT_KEY)
    return written_span(found.mark, found.at + len(found.key) - len(key), key, text.split("\n"))


def rename(cursor: Cursor, walk: SchemaWalk, name: str, text: str) -> list[Edit]:
    """Return the edits that rename the key under the cursor in its whole tree.

    A key of Main changes where other trees of this file write it as `@key`, and the name of a port at the
    calls of its tree, too. Raises PicktreeError for an invalid or used name, and for a key in a text with
    escapes or of several lines.
    """
    found = key_at(cursor, walk)
    if found is None:
        raise PicktreeError("there is no key of the blackboard here")
    if not IDENTIFIER.fullmatch(name):
        raise PicktreeError(
            f"{name!r} is not a valid key: write a letter or '_', then letters, digits and '_'"
        )
    tree, _ = key_home(found)
    if list(key_places_of(cursor, walk, tree, name)):
        raise PicktreeError(f"the tree {tree!r} has a key {name!r} already")
    lines, edits = text.split("\n"), list[Edit]()
    for mark, at, key in key_references(cursor, walk) or ():
        span = written_span(mark, at, key, lines)
        if span is None:
            raise PicktreeError(f"line {mark.line}: write the text in one line and without escapes first")
        edits.append(Edit(span, name))
    return edits


def key_home(place: KeyPlace) -> tuple[str, str]:
    """Return the tree to which a key belongs, and its name there."""
    own = tree_of(place.path) or ""
    return (MAIN, place.key[1:]) if place.key.startswith(references.ROOT_KEY) else (own, place.key)


def key_places_of(cursor: Cursor, walk: SchemaWalk, tree: str, key: str) -> Iterator[KeyPlace]:
    return places_of(cursor.root, key, tree, lambda path: is_expression(walk, path))


def key_at(cursor: Cursor, walk: SchemaWalk) -> KeyPlace | None:
    """Return the key of the blackboard under the cursor."""
    tree = tree_of(cursor.path)
    if tree is None:
        return None
    for place in key_places(cursor.root, tree, lambda path: is_expression(walk, path)):
        if place.mark.line == cursor.word.start.line + 1 and _covers(place, cursor):
            return place
    return None


def _covers(place: KeyPlace, cursor: Cursor) -> bool:
    if place.kind == "port":
        return cursor.is_key and (*cursor.path, cursor.written) == place.path
    if cursor.is_key or cursor.path != place.path:
        return False
    start = _text_start(place.mark, cursor.line) + place.at
    within = start <= cursor.place.character <= start + len(place.key)
    return within and cursor.word.start.line == cursor.place.line


def _text_start(mark: Mark, line: str) -> int:
    """Return the position of a text's beginning in its line, behind its quote."""
    return mark.column - 1 + (line[mark.column - 1 : mark.column] in ("'", '"'))


def written_span(mark: Mark, at: int, key: str, lines: list[str]) -> Span | None:
    """Return the span of a key in the text; None when the text has escapes or several lines."""
    line = lines[mark.line - 1]
    start = _text_start(mark, line) + at
    if line[start : start + len(key)] != key:
        return None
    return Span(Place(mark.line - 1, start), Place(mark.line - 1, start + len(key)))


def calls_with(root: YamlNode, tree: str, port: str) -> Iterator[Mark]:
    for path, node in cursor_walk(root):
        call = node.entries.get(tree)
        if len(path) > 1 and path[0] == "trees" and call is not None and port in call.keys:
            yield call.keys[port]


_FILE_KEYS: Final[Mapping[str, Mapping[str, Path | None]]] = {
    "mission": {"scene": scene_loading.SHIPPED},
    "scene": {"base": scene_loading.SHIPPED, "robot": robot_file.SHIPPED},
    "faults": {"scene": scene_loading.SHIPPED},
    "cases": {"mission": None},
    "plan": {"missions": None, "scenes": scene_loading.SHIPPED, "robots": robot_file.SHIPPED, "faults": None},
}
"""Keys at the top of each kind of file that name other files, with the folder of shipped ones."""


def named_file(cursor: Cursor, document: Document) -> Mark | None:
    """Return the start of the file whose name is under the cursor; None without the name of a file."""
    key = cursor.path[0] if cursor.path and not cursor.is_key else None
    keys = _FILE_KEYS.get(document.kind, {})
    path: Path | None = None
    if document.kind == "mission" and key == "include":
        path = path_of(cursor.written, document.path.parent)
    elif document.kind == "mission" and key == "plugins":
        path = _plugin_file(cursor.written, document.path.parent)
    elif isinstance(key, str) and key in keys:
        path = _shipped_or_own(cursor.written, keys[key], document.path)
    return Mark(str(path), 1, 1) if path is not None and file_system.is_file(path) else None


def _shipped_or_own(name: str, shipped: Path | None, beside: Path) -> Path | None:
    if shipped is None:
        return beside.parent / name
    try:
        return file_system.find_file(name, shipped, beside, "file")
    except PicktreeError:
        return None


def _plugin_file(name: str, folder: Path) -> Path | None:
    if name.endswith(".py"):
        return folder / name
    module = sys.modules.get(name)  # the registry has imported it
    return Path(module.__file__) if module is not None and module.__file__ else None


def class_mark(node: type[Node]) -> Mark | None:
    """Return the place of a node's class in its Python file; None when it has no file."""
    module = sys.modules.get(node.__module__)
    file = Path(module.__file__) if module is not None and module.__file__ else None
    try:
        source = file.read_text(encoding="utf-8") if file is not None else ""
    except (OSError, UnicodeDecodeError):
        return None
    found = re.search(rf"^class +(?P<name>{re.escape(node.__name__)})\b", source, re.MULTILINE)
    if found is None:
        return None
    line = source.count("\n", 0, found.start()) + 1
    return Mark(str(file), line, found.start("name") - found.start() + 1)


def definition(
    cursor: Cursor, walk: SchemaWalk, document: Document, files: MissionFiles, registry: NodeRegistry
) -> Mark | None:
    """Return the place where the file, key, sub-tree or node under the cursor is defined.

    `files`: source of the included files. `registry`: nodes of the mission, its plug-ins included.
    """
    file = named_file(cursor, document)
    if file is not None or document.kind != "mission":
        return file
    found = key_at(cursor, walk)
    if found is not None:
        every = key_places_of(cursor, walk, *key_home(found))
        writers = [each for each in every if each.kind == "port" or writes(each, walk)]
        return next((Mark(str(document.path), e.mark.line, e.mark.column) for e in writers), None)
    if called_name(cursor, walk) is None:
        return None
    tree = tree_mark(cursor.written, mission_files(document, files))
    node = registry.find(cursor.written) if tree is None else None
    return class_mark(node) if node is not None else tree


def called_name(cursor: Cursor, walk: SchemaWalk) -> str | None:
    """Return the ID of the node or sub-tree that is called under the cursor."""
    return cursor.written if _offers(walk, cursor.path, cursor.written) else None


def tree_mark(name: str, files: Iterable[Document]) -> Mark | None:
    """Return the place of a tree's name in the first file that has it."""
    for file in files:
        trees = file.root.entries.get("trees")
        if trees is not None and name in trees.keys:
            mark = trees.keys[name]
            return Mark(str(Path(mark.file).absolute()), mark.line, mark.column)
    return None


def key_references(cursor: Cursor, walk: SchemaWalk) -> list[tuple[Mark, int, str]] | None:
    """Return mark, offset and text of each occurrence of the key under the cursor; None for no key."""
    found = key_at(cursor, walk)
    if found is None:
        return None
    tree, key = key_home(found)
    every = list(key_places_of(cursor, walk, tree, key))
    places = [(each.mark, each.at + len(each.key) - len(key), key) for each in every]
    if any(each.kind == "port" for each in every):
        places += [(mark, 0, key) for mark in calls_with(cursor.root, tree, key)]
    return places


def calls_of(root: YamlNode, walk: SchemaWalk, name: str) -> Iterator[Mark]:
    """Yield the marks at which a node or sub-tree of that name is called."""
    for path, node in cursor_walk(root):
        named = name in node.keys or node.value == name
        if path[:1] == ("trees",) and named and _offers(walk, path, name):
            yield node.keys.get(name, node.mark)


def _offers(walk: SchemaWalk, path: Location, name: str) -> bool:
    return any(name in node_ids(part) for part in walk.at(path))
