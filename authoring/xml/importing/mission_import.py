"""Importer: converts the text of a BehaviorTree.CPP 4 file to that of a mission file."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import cast

from ....errors import PicktreeError
from ....files.marks import Diagnostic, FileError
from ....files.yaml.document import Document, read_document
from ....files.yaml.reader import Value
from ....files.yaml.writer import MarkedValue, mission_text
from ....trees.loading.loader import examine
from ....trees.loading.registry import NodeRegistry
from ....trees.mission import MAIN, Mission
from ..export.mission_export import XmlExporter
from ..format import btcpp_vocabulary
from ..format.element import Element
from .attributes import NodeDraft
from .node_import import XmlNodeReader
from .port_import import PortsOfTrees, TreePort
from .source import XmlSource, read_source

_ONE = ("name", "scene", "goal")
_MANY = ("include", "plugins")


def xml_to_mission(text: str, path: Path, registry: NodeRegistry | None = None) -> str:
    """Convert XML text to the text of a mission file; `path` is the place of the file.

    Raises FileError with all errors, and with everything that a mission cannot express.
    """
    return _Importer(text, path, (registry or NodeRegistry()).copy()).text()


class _Importer:
    def __init__(self, text: str, path: Path, registry: NodeRegistry) -> None:
        self._text = text
        self._path = path
        self._registry = registry
        self._source: XmlSource = read_source(text, path)
        self._refuse(self._source.faults)

    def text(self) -> str:
        for plugin in self._source.said("plugins"):
            try:
                self._registry.add_plugin(plugin.value, self._path.parent)
            except PicktreeError:
                continue  # the loader tells it with its place
        whole = self._document()
        root = whole.node()
        data = cast("dict[str, Value]", root.value)
        document = Document(self._path, self._text, "mission", data, root)
        reading = examine(document, self._registry)
        self._refuse(reading.faults)
        self._refuse(self._changed(reading.mission))
        written = mission_text(whole)
        assert read_document(self._path, "mission", written).data == data
        return written

    def _refuse(self, faults: Iterable[Diagnostic]) -> None:
        found = tuple(faults)
        if any(fault.severity == "error" for fault in found):
            raise FileError(found)

    def _document(self) -> MarkedValue:
        source = self._source
        ports = PortsOfTrees(source, self._registry)
        declared = ports.find()
        reader = XmlNodeReader(self._registry, declared, self._called)
        trees = MarkedValue.mapping(source.root.mark)
        for name, element in source.trees.items():
            if name not in source.included and element.children:
                root = reader.node(element.children[0], self._called(name))
                body = _tree(root, declared[name], element)
                trees.put(self._called(name), body, element.place("ID"))
        self._refuse([*self._twice(), *ports.faults, *reader.faults])
        whole = MarkedValue.mapping(source.root.mark)
        whole.comments = source.root.comments
        self._head(whole)
        whole.put("trees", trees)
        return whole

    def _called(self, name: str) -> str:
        """Return the tree's name in the mission, whose first tree is `Main`."""
        return MAIN if name == self._source.main else name

    def _twice(self) -> Iterable[Diagnostic]:
        other = self._source.trees.get(MAIN)
        if other is not None and self._source.main not in ("", MAIN):
            message = f"a mission begins with {MAIN!r}, which is {self._source.main!r} here"
            yield Diagnostic(other.place("ID"), MAIN, message, "give this tree another name", "P914")

    def _head(self, whole: MarkedValue) -> None:
        whole.put("picktree", 1)
        whole.put("kind", "mission")
        if self._source.main == "":
            whole.put("library", True)
        for key in _ONE:
            for said in self._source.said(key)[:1]:
                whole.put(key, said.value, said.mark)
        for key in _MANY:
            said = self._source.said(key)
            if said:
                items = [MarkedValue(one.mark, one.value) for one in said]
                whole.put(key, MarkedValue(said[0].mark, items=items), said[0].mark)

    def _changed(self, mission: Mission) -> Iterable[Diagnostic]:
        """Report trees of other mission files for which the XML differs."""
        exporter = XmlExporter(mission)
        for name in sorted(self._source.included):
            given, tree = self._source.trees.get(name), mission.trees.get(name)
            if given is None:
                continue
            if tree is None:
                message = f"none of the included files holds the tree {name!r}"
                yield Diagnostic(
                    given.place("ID"), name, message, "name its file in the metadata 'include'", "P916"
                )
            elif _bare(exporter.tree(tree)) != _bare(given):
                message = f"the tree {name!r} says something else than the included {tree.mark.file}"
                hint = "change that file, or give the tree another name here"
                yield Diagnostic(given.place("ID"), name, message, hint, "P916")


def _tree(root: NodeDraft, ports: tuple[TreePort, ...], element: Element) -> MarkedValue:
    """Return the body under the tree's name."""
    written = root.written()
    if not ports:
        written.comments = (*element.comments, *written.comments)
        return written
    body = MarkedValue.mapping(element.mark)
    body.comments = element.comments
    declared = MarkedValue.mapping(element.mark)
    for port in ports:
        declared.put(port.key, port.declared(), port.mark)
    body.put("ports", declared)
    if written.entries is None:
        body.put(root.id, MarkedValue.mapping(root.mark))
    else:
        body.put(root.id, written.entries[0].value, written.mark)
    return body


def _bare(element: Element) -> Element:
    """Return the element without the attributes that Groot2 adds."""
    kept = {
        key: value
        for key, value in element.attributes.items()
        if key not in btcpp_vocabulary.IGNORED and not (key == "name" and value == element.name)
    }
    return dataclasses.replace(element, attributes=kept, children=tuple(map(_bare, element.children)))
