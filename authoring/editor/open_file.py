"""Open file of an editor: its unsaved text, and queries about a place in it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TypeAlias

from picktree.authoring.schema import (
    MissionSpecifics,
    Schema,
    any_mission,
    mission_files,
    mission_schema,
    one_mission,
)
from picktree.files import Mark, PicktreeError
from picktree.files.yaml import KINDS, Document, YamlNode
from picktree.trees import MAIN, FilesOnDisk, library_trees
from picktree.trees.loading import NodeRegistry

from .completion import Proposal, head_proposals, is_expression, proposals, skeletons
from .cursor import Cursor, Place, Span, cursor_at, cursor_on, read_repaired
from .navigation import (
    Edit,
    called_name,
    calls_of,
    definition,
    hover,
    key_references,
    rename,
    renamed_span,
    tree_mark,
    written_span,
)
from .schema_walk import SchemaWalk
from .symbols import DocumentSymbol, document_symbols
from .tree_keys import key_places

SchemaOf: TypeAlias = Callable[[str], Schema]
"""Schema of a kind of file other than missions."""

_KIND = re.compile(rf"^[{{\s]*kind\s*:\s*(?P<kind>{'|'.join(KINDS)})\b", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class FileSpan:
    """Part of a file's text."""

    path: Path
    span: Span


class OpenFile:
    """Text of one file at one version. `unsaved`: texts of all open files, by path."""

    def __init__(
        self,
        path: Path,
        text: str,
        registry: NodeRegistry,
        schema_of: SchemaOf,
        unsaved: Mapping[Path, str] | None = None,
    ) -> None:
        self._path, self._text = path, text
        self._files = FilesOnDisk(path.parent, unsaved)
        self._registry, self._schema_of = registry, schema_of
        found = _KIND.search(text)
        self._kind = found["kind"] if found else ""

    def complete(self, place: Place) -> tuple[Span, list[Proposal]] | None:
        """Return the proposals at a place, and the word that they replace."""
        if not self._kind and (found := skeletons(self._text, place)) is not None:
            return found
        cursor = cursor_at(self._text, place, str(self._path))
        if cursor is None:
            return None
        if not self._kind:
            return cursor.word, head_proposals(cursor)
        library = []
        if self._kind == "mission":
            library = [pair for pair in library_trees() if pair[1] not in _included(cursor.root)]
        return cursor.word, proposals(cursor, self._walk(cursor.root), library)

    def include_edit(self, name: str) -> Edit | None:
        """Return the edit that includes a file; None when it is included already, or has no place."""
        root = self._root
        if root is None or name in _included(root):
            return None
        lines = self._text.split("\n")
        entry = root.entries.get("include")
        if entry is None:
            row = root.keys["trees"].line - 1 if "trees" in root.keys else len(lines)
            return Edit(Span(Place(row, 0), Place(row, 0)), f"include: [{name}]\n")
        row, column = entry.mark.line - 1, entry.mark.column - 1
        if lines[row][column : column + 1] == "[":
            place, text = Place(row, column + 1), name + (", " if entry.items else "")
        elif entry.items:
            place, text = Place(row, column), f"- {name}\n{' ' * column}"
        else:
            return None
        return Edit(Span(place, place), text)

    def hover(self, place: Place) -> tuple[Span, str] | None:
        """Return the documentation of the word at a place."""
        cursor = self._on(place)
        if cursor is None:
            return None
        words = hover(cursor, self._walk(cursor.root))
        return (cursor.word, words) if words else None

    def definition(self, place: Place) -> Mark | None:
        """Return the definition of the file, key, sub-tree or node at a place."""
        cursor = self._on(place)
        if cursor is None:
            return None
        registry = self._registry.copy()
        walk = self._walk(cursor.root, registry)
        return definition(cursor, walk, self._document(cursor.root), self._files, registry)

    def word_at(self, place: Place) -> str:
        """Return the key or text at a place; empty without one."""
        cursor = self._on(place)
        return cursor.written if cursor is not None else ""

    def references(self, place: Place, *, declaration: bool, others: Iterable[OpenFile]) -> list[FileSpan]:
        """Return the uses of the key, sub-tree or node at a place; `declaration`: its definition, too.

        `others`: missions in which uses are looked for, too.
        """
        cursor = self._on(place)
        if cursor is None or self._kind != "mission":
            return []
        walk = self._walk(cursor.root)
        keys = key_references(cursor, walk)
        if keys is not None:
            return self._spans(keys)
        named = cursor.is_key and cursor.path == ("trees",)
        name = cursor.written if named else called_name(cursor, walk)
        if name is None:
            return []
        home = self.tree_home(name)
        found = self.calls_of(name)
        for other in others:
            if other._path != self._path and other.tree_home(name) == home:
                found += other.calls_of(name)
        if declaration and home is not None:
            start = Place(home.line - 1, home.column - 1)
            word = Span(start, Place(start.line, start.character + len(name)))
            found.append(FileSpan(Path(home.file), word))
        return found

    def tree_home(self, name: str) -> Mark | None:
        """Return the definition of a sub-tree of the mission; None for a node, and for an unknown name."""
        root = self._root
        return tree_mark(name, mission_files(self._document(root), self._files)) if root is not None else None

    def calls_of(self, name: str) -> list[FileSpan]:
        """Return the calls of a node or sub-tree in this mission."""
        root = self._root
        if root is None or self._kind != "mission":
            return []
        return self._spans((mark, 0, name) for mark in calls_of(root, self._walk(root), name))

    def _spans(self, places: Iterable[tuple[Mark, int, str]]) -> list[FileSpan]:
        lines = self._text.split("\n")
        spans = (written_span(mark, at, text, lines) for mark, at, text in places)
        return sorted(
            (FileSpan(self._path, span) for span in spans if span is not None),
            key=lambda each: Span.key(each.span.start),
        )

    def symbols(self) -> tuple[DocumentSymbol, ...]:
        root = self._root if self._kind else None
        if root is None:
            return ()
        nodes = self._walk(root).nodes if self._kind == "mission" else ()
        return document_symbols(root, self._text, nodes)

    def renamed_span(self, place: Place) -> Span | None:
        """Return the key of the blackboard at a place."""
        cursor = self._on(place)
        if cursor is None or self._kind != "mission":
            return None
        return renamed_span(cursor, self._walk(cursor.root), self._text)

    def rename(self, place: Place, name: str) -> list[Edit]:
        """Return the edits that rename a key of the blackboard. Raises PicktreeError."""
        cursor = self._on(place)
        if cursor is None or self._kind != "mission":
            raise PicktreeError("there is no key of the blackboard here")
        return rename(cursor, self._walk(cursor.root), name, self._text)

    def keys_of(self, tree: str) -> list[str]:
        """Return the keys of the blackboard that a tree of the text writes or reads, its ports first."""
        root = self._root
        if root is None or self._kind != "mission":
            return []
        walk = self._walk(root)
        places = key_places(root, tree, lambda path: is_expression(walk, path))
        return list(dict.fromkeys(place.key for place in places if place.kind != "name"))

    @cached_property
    def _root(self) -> YamlNode | None:
        """Return the syntax of the readable text; None: no readable text."""
        reading = read_repaired(self._text, str(self._path))
        return reading[0].root if reading is not None else None

    def _on(self, place: Place) -> Cursor | None:
        return cursor_on(self._text, place, str(self._path)) if self._kind else None

    def _document(self, root: YamlNode) -> Document:
        data = root.value if isinstance(root.value, dict) else {}
        return Document(self._path, self._text, self._kind, data, root)

    def _walk(self, root: YamlNode, registry: NodeRegistry | None = None) -> SchemaWalk:
        """Return the schema of the file. The nodes of its plug-ins join the registry."""
        if self._kind != "mission":
            return _other(self._schema_of, self._kind)
        registry = registry or self._registry.copy()
        return SchemaWalk(mission_schema(registry, self._specifics(root, registry)))

    def _specifics(self, root: YamlNode, registry: NodeRegistry) -> MissionSpecifics:
        try:
            found = one_mission(self._document(root), registry, self._files)
        except PicktreeError:
            return any_mission()
        trees = {name: ports for name, ports in found.trees.items() if name.isidentifier() and name != MAIN}
        known = found.known if found.known.all else any_mission().known
        return MissionSpecifics(True, found.scenes, trees, known)


@lru_cache(maxsize=16)
def _other(schema_of: SchemaOf, kind: str) -> SchemaWalk:
    return SchemaWalk(schema_of(kind))


def _included(root: YamlNode) -> tuple[str, ...]:
    entry = root.entries.get("include")
    return tuple(str(item.value) for item in entry.items) if entry is not None else ()
