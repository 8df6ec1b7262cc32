"""Definition and references of what is under a cursor: files, nodes, sub-trees and keys."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final

from ...files.errors import PicktreeError
from ...files.marks import Location, Mark
from ...files.shipped_files import find_file, is_file
from ...files.yaml.document import Document
from ...files.yaml.reader import YamlNode
from ...trees.loading.registry import NodeRegistry
from ...trees.mission import MissionFiles, path_of
from ...trees.node import Node
from ...world.robot_model.loading import SHIPPED as ROBOTS
from ...world.scene.scene_loading import SHIPPED as SCENES
from ..schema.mission_context import mission_files
from .cursor import Cursor
from .navigation import calls_with, key_at, key_home, key_places_of, writes
from .schema_walk import SchemaWalk, node_ids

_FILE_KEYS: Final[Mapping[str, Mapping[str, Path | None]]] = {
    "mission": {"scene": SCENES},
    "scene": {"base": SCENES, "robot": ROBOTS},
    "faults": {"scene": SCENES},
    "cases": {"mission": None},
    "plan": {"missions": None, "scenes": SCENES, "robots": ROBOTS, "faults": None},
}
"""Keys at the top of each kind of file that name other files; the folder of shipped ones, None: there are
none."""


def named_file(cursor: Cursor, document: Document) -> Mark | None:
    """Return the start of the file whose name is under the cursor; None where no name of a file is."""
    key = cursor.path[0] if cursor.path and not cursor.is_key else None
    keys = _FILE_KEYS.get(document.kind, {})
    path: Path | None = None
    if document.kind == "mission" and key == "include":
        path = path_of(cursor.written, document.path.parent)
    elif document.kind == "mission" and key == "plugins":
        path = _plugin_file(cursor.written, document.path.parent)
    elif isinstance(key, str) and key in keys:
        path = _shipped_or_own(cursor.written, keys[key], document.path)
    return Mark(str(path), 1, 1) if path is not None and is_file(path) else None


def _shipped_or_own(name: str, shipped: Path | None, beside: Path) -> Path | None:
    if shipped is None:
        return beside.parent / name
    try:
        return find_file(name, shipped, beside, "file")
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
    return cursor.written if any(cursor.written in node_ids(part) for part in walk.at(cursor.path)) else None


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
    trees = root.entries.get("trees")
    todo: list[tuple[Location, YamlNode]] = [] if trees is None else [(("trees",), trees)]
    while todo:
        path, node = todo.pop()
        if name in node.keys and _offers(walk, path, name):
            yield node.keys[name]
        if node.value == name and _offers(walk, path, name):
            yield node.mark
        todo += [((*path, key), child) for key, child in node.entries.items()]
        todo += [((*path, index), child) for index, child in enumerate(node.items)]


def _offers(walk: SchemaWalk, path: Location, name: str) -> bool:
    return any(name in node_ids(part) for part in walk.at(path))
