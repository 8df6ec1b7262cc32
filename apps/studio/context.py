"""Declarations that a mission's text may use: nodes, plug-ins where they are trusted, and sub-trees."""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import yaml

from picktree.authoring import file_schema, mission_chart
from picktree.authoring.editor import (
    OpenFile,
    Source,
    Syntax,
    mission_outline,
    outline,
    read_repaired,
    source_of,
)
from picktree.authoring.schema import Schema
from picktree.files import FileError, PicktreeError
from picktree.files.yaml import Document, read_document
from picktree.trees import (
    LIBRARY,
    MAIN,
    FilesOnDisk,
    MissionDiagnostics,
    NodeDeclaration,
    library_trees,
    path_of,
)
from picktree.trees.loading import PLUGINS_VARIABLE, IncludeReader, NodeRegistry, TreePorts, installed_entries

_MAX_CACHED_CONTEXTS: Final = 16


@dataclass(frozen=True, slots=True)
class ReadText:
    """Readable part of a text. `whole` is false when a fault of form had to be repaired."""

    source: Source
    whole: bool


def read_text(text: str, file: str) -> ReadText | None:
    """Read a text that is being edited; None when it cannot be read at all."""
    try:
        return ReadText(source_of(text), True)
    except yaml.YAMLError:
        pass
    repaired = read_repaired(text, file)
    if repaired is None:
        return None
    try:
        return ReadText(source_of(repaired[1]), False)
    except yaml.YAMLError:
        return None


class MissionContext:
    """Nodes and sub-trees of one mission, its own trees left out."""

    def __init__(
        self, registry: NodeRegistry, included: Mapping[str, NodeDeclaration], left_out: str
    ) -> None:
        self.registry = registry
        self.included = included
        self.left_out = left_out
        """Reason for missing nodes of plug-ins; empty: none is missing."""
        self._symbols: dict[str, str] = {}
        self._known: dict[str, NodeDeclaration | None] = {}

    def known(self, identity: str) -> NodeDeclaration | None:
        """Return the declaration of a node, or of a sub-tree of another file."""
        if identity not in self._known:  # the registry looks at the disk for each
            node = self.registry.find(identity)
            self._known[identity] = node.declaration if node is not None else self.included.get(identity)
        return self._known[identity]

    def symbol(self, identity: str) -> str:
        """Return the symbol of a node in pictures."""
        if identity not in self._symbols:
            declaration = self.known(identity)
            symbol = mission_chart.symbol_of(declaration) if declaration is not None else "unknown"
            self._symbols[identity] = symbol
        return self._symbols[identity]

    def outline(self, source: Source) -> mission_outline.Outline:
        return outline(source, self.known)


class MissionContexts:
    """Contexts by what a text includes, read once while the files stay the same."""

    def __init__(self) -> None:
        self._registry = NodeRegistry()
        self._kept: OrderedDict[tuple[object, ...], MissionContext] = OrderedDict()

    def of(self, path: Path, source: Source) -> MissionContext:
        """Return the context of a text. `path`: its file."""
        included, plugins = _words(source.root, "include"), _words(source.root, "plugins")
        folder = path.parent
        files = [path_of(name, folder) for name in included] + [folder / name for name in plugins]
        trusted = os.environ.get(PLUGINS_VARIABLE) != "refuse"
        changes = (*installed_entries(), *(_changed(file) for file in files))
        key = (folder, included, plugins, trusted, changes)
        found = self._kept.get(key)
        if found is None:
            found = self._kept[key] = self._made(path, included, plugins)
            while len(self._kept) > _MAX_CACHED_CONTEXTS:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return found

    def _made(self, path: Path, included: tuple[str, ...], plugins: tuple[str, ...]) -> MissionContext:
        registry = self._registry.copy()
        problems: list[str] = []
        documents = _included(path, included)
        named = [(plugin, path.parent) for plugin in plugins]
        for document in documents:
            plugin_names = document.data.get("plugins")
            if isinstance(plugin_names, list):
                named += [
                    (plugin, document.path.parent) for plugin in plugin_names if isinstance(plugin, str)
                ]
        for plugin, folder in named:
            try:
                registry.add_plugin(plugin, folder)
            except PicktreeError as error:
                problems.append(str(error))
        trees = {
            tree.id: tree for document in documents for tree in tree_declarations(document) if tree.id != MAIN
        }
        return MissionContext(registry, trees, "; ".join(problems))


def library_declarations() -> dict[str, tuple[NodeDeclaration, str]]:
    """Return the sub-trees that come with picktree, each with the name under which it is included."""
    files = FilesOnDisk(LIBRARY)
    found: dict[str, tuple[NodeDeclaration, str]] = {}
    for file in dict.fromkeys(file for _, file in library_trees()):
        for tree in tree_declarations(files.document(file)):
            found[tree.id] = tree, file
    return found


def tree_declarations(document: Document) -> list[NodeDeclaration]:
    """Return the trees of a document as nodes that can be called."""
    bodies = document.data.get("trees")
    declared = TreePorts(document, MissionDiagnostics())
    return [
        NodeDeclaration(
            name,
            declared.doc(name, body) or f"A sub-tree of {document.path.name}.",
            "subtree",
            declared.of(name, body),
        )
        for name, body in (bodies if isinstance(bodies, dict) else {}).items()
    ]


def _included(path: Path, names: tuple[str, ...]) -> tuple[Document, ...]:
    """Return the files that a mission includes, as far as they can be read."""
    if not names:
        return ()
    text = "".join(["picktree: 1\nkind: mission\ninclude:\n", *(f"  - {name}\n" for name in names)])
    try:
        head = read_document(path, "mission", text)
    except FileError:
        return ()
    return IncludeReader(FilesOnDisk(path.parent), MissionDiagnostics()).of(head)


def _words(root: Syntax, key: str) -> tuple[str, ...]:
    found = root.child(key)
    return (
        tuple(item.text for item in found.value.items if item.kind == "scalar") if found is not None else ()
    )


def _changed(file: Path) -> int:
    try:
        return file.stat().st_mtime_ns
    except OSError:
        return 0


class MissionTexts:
    """Readers of texts, with the contexts and nodes that the texts share."""

    def __init__(self) -> None:
        self._contexts = MissionContexts()
        self._registry = NodeRegistry()

    def context(self, path: Path, reading: ReadText) -> MissionContext:
        return self._contexts.of(path, reading.source)

    def read(self, path: Path, text: str) -> tuple[MissionContext, ReadText]:
        """Read a text. Raises PicktreeError when nothing of it can be read."""
        reading = read_text(text, str(path))
        if reading is None:
            raise PicktreeError("the text cannot be read: mend its syntax first")
        return self.context(path, reading), reading

    def file(self, path: Path, text: str) -> OpenFile:
        return OpenFile(path, text, self._registry, _schema_of)


def own_trees(path: Path, text: str) -> list[NodeDeclaration]:
    """Return the trees of a text itself as nodes that can be called."""
    try:
        document = read_document(path, "mission", text)
    except PicktreeError:
        return []
    return [tree for tree in tree_declarations(document) if tree.id != MAIN]


def _schema_of(kind: str) -> Schema:
    match kind:
        case "scene" | "robot" | "faults" | "cases":
            return file_schema(kind)
        case _:
            return {}
