"""From the text of a BehaviorTree.CPP 4 file to the text of a mission file."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import cast

from ....errors import PicktreeError
from ....files.marks import Fault, FileError
from ....files.yaml.document import Document, read_document
from ....files.yaml.reader import Value
from ....trees.loading.loader import examine
from ....trees.loading.registry import Registry
from ....trees.mission import MAIN, Mission
from ..export.mission_export import Exporter
from ..format import btcpp_vocabulary as names
from ..format.element import Element
from ..format.marked_values import Marked
from .mission_text import mission_text
from .node_draft import Draft
from .node_import import NodeReader
from .port_import import PortsOfTrees, TreePort
from .source import Source, read_source

_ONE = ("name", "scene", "goal")
_MANY = ("include", "plugins")


def xml_to_mission(text: str, path: Path, registry: Registry | None = None) -> str:
    """The XML text as the text of a mission file; `path` says what lies beside it.

    Raises FileError with all that is wrong with it, or cannot be said in a mission.
    """
    return _Importer(text, path, (registry or Registry()).copy()).text()


class _Importer:
    def __init__(self, text: str, path: Path, registry: Registry) -> None:
        self._text = text
        self._path = path
        self._registry = registry
        self._source: Source = read_source(text, path)
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
        assert read_document(written, self._path, "mission").data == data
        return written

    def _refuse(self, faults: Iterable[Fault]) -> None:
        found = tuple(faults)
        if any(fault.severity == "error" for fault in found):
            raise FileError(found)

    def _document(self) -> Marked:
        source = self._source
        ports = PortsOfTrees(source, self._registry)
        declared = ports.find()
        reader = NodeReader(self._registry, declared, self._called)
        trees = Marked.mapping(source.root.mark)
        for name, element in source.trees.items():
            if name not in source.included and element.children:
                root = reader.node(element.children[0], self._called(name))
                body = _tree(root, declared[name], element)
                trees.put(self._called(name), body, element.place("ID"))
        self._refuse([*self._twice(), *ports.faults, *reader.faults])
        whole = Marked.mapping(source.root.mark)
        whole.comments = source.root.comments
        self._head(whole)
        whole.put("trees", trees)
        return whole

    def _called(self, name: str) -> str:
        """The tree's name in the mission, which begins with `Main`."""
        return MAIN if name == self._source.main else name

    def _twice(self) -> Iterable[Fault]:
        other = self._source.trees.get(MAIN)
        if other is not None and self._source.main not in ("", MAIN):
            message = f"a mission begins with {MAIN!r}, which is {self._source.main!r} here"
            yield Fault(other.place("ID"), MAIN, message, "give this tree another name", "P914")

    def _head(self, whole: Marked) -> None:
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
                items = [Marked(one.mark, one.value) for one in said]
                whole.put(key, Marked(said[0].mark, items=items), said[0].mark)

    def _changed(self, mission: Mission) -> Iterable[Fault]:
        """Trees that the mission takes from other files, where the XML says something else."""
        exporter = Exporter(mission)
        for name in sorted(self._source.included):
            given, tree = self._source.trees.get(name), mission.trees.get(name)
            if given is None:
                continue
            if tree is None:
                message = f"none of the included files holds the tree {name!r}"
                yield Fault(
                    given.place("ID"), name, message, "name its file in the metadata 'include'", "P916"
                )
            elif _bare(exporter.tree(tree)) != _bare(given):
                message = f"the tree {name!r} says something else than the included {tree.mark.file}"
                hint = "change that file, or give the tree another name here"
                yield Fault(given.place("ID"), name, message, hint, "P916")


def _tree(root: Draft, ports: tuple[TreePort, ...], element: Element) -> Marked:
    """What stands under the tree's name."""
    written = root.written()
    if not ports:
        written.comments = (*element.comments, *written.comments)
        return written
    body = Marked.mapping(element.mark)
    body.comments = element.comments
    declared = Marked.mapping(element.mark)
    for port in ports:
        declared.put(port.key, port.declared(), port.mark)
    body.put("ports", declared)
    if written.entries is None:
        body.put(root.id, Marked.mapping(root.mark))
    else:
        body.put(root.id, written.entries[0].value, written.mark)
    return body


def _bare(element: Element) -> Element:
    """Without what Groot2 adds."""
    kept = {
        key: value
        for key, value in element.attributes.items()
        if key not in names.IGNORED and not (key == "name" and value == element.name)
    }
    return dataclasses.replace(element, attributes=kept, children=tuple(map(_bare, element.children)))
