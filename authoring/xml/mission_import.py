"""Import of missions from BehaviorTree.CPP XML, with checks; labels of Switches over truth values."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Final, cast

from picktree.authoring import check_mission
from picktree.files import Diagnostic, FileError, Mark, PicktreeError
from picktree.files.yaml import Document, MarkedValue, Value, mission_text, read_document
from picktree.trees import Mission, references
from picktree.trees.loading import MissionReadResult, NodeRegistry, examine, foreign_word

from . import btcpp_vocabulary
from .attributes import NodeDraft, alone
from .element import Element, one_line
from .mission_export import XmlExporter
from .node_import import ImportContext, XmlNodeReader
from .port_import import PortsOfTrees, TreePort, fill_in_wires
from .renaming import rename_keys, rename_trees
from .source import ImportFaults, XmlText, read_source
from .stubs import StubFinder, StubNode, stub_missing_trees, stub_text

_LABELS = {"1": "true", "0": "false"}


def label_switches(
    reading: MissionReadResult, tables: Mapping[Mark, MarkedValue], faults: ImportFaults
) -> bool:
    """Rename the cases 1 and 0 of Switches over truth values; return whether any was renamed.

    `tables`: the cases by the place of the Switch. A case `true` is never chosen by BehaviorTree.CPP.
    """
    changed = False
    if reading.circuit is None:
        return False
    for keys in reading.circuit.keys.values():
        for placed in keys.places.values():
            table, bound = tables.get(placed.spec.mark), placed.spec.ports.get("variable")
            if placed.spec.id != "Switch" or table is None or not isinstance(bound, references.Reference):
                continue
            kinds = {source.type.kind for source in keys.reference(bound)}
            if kinds != {"bool"}:
                continue
            for entry in table.entries or ():
                if entry.key in _LABELS:
                    entry.key, changed = _LABELS[entry.key], True
                elif entry.key in _LABELS.values():
                    message = f"{bound} is a truth value, which is never {entry.key!r} in BehaviorTree.CPP"
                    number = "1" if entry.key == "true" else "0"
                    faults.fault(entry.value.mark, placed.path, message, f"write {number!r}", code="P911")
    return changed


_ONE = ("name", "scene", "goal")
_MANY = ("include", "plugins")
_NEAR: Final = 0.75
"""Similarity of names from which an unknown one is taken for a typing error, 0 … 1."""
_FOLLOWS = ("P219", "P227", "P237", "P239")
"""Codes of the loader for faults that may only follow from an error of the import."""


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """Choices of an import."""

    strict: bool = False
    """Whether everything without a meaning for a run is an error."""
    main: str = ""
    """ID of the first tree; empty: the one that the files name."""
    plugins: tuple[str, ...] = ()
    """Further plug-ins, by their names in the mission."""
    folder: Path | None = None
    """Folder of the mission, from which its plug-ins count; None: that of the first file."""
    stubs: str = ""
    """Name of the plug-in with stubs in the mission; empty: unknown nodes are an error."""
    enums: Mapping[str, int] = field(default_factory=dict[str, int])
    """Numbers by their names in scripts, as a program registers enums."""


@dataclass(frozen=True, slots=True)
class ImportedMission:
    """Result of an import. `stubs`: text of the plug-in with stubs; empty where none is needed."""

    text: str
    notes: tuple[Diagnostic, ...]
    stubs: str = ""


def import_xml(
    files: Sequence[XmlText], registry: NodeRegistry | None = None, options: ImportOptions | None = None
) -> ImportedMission:
    """Convert XML files that belong together. Raises FileError with all errors and notes."""
    return _Importer(files, (registry or NodeRegistry()).copy(), options or ImportOptions()).imported()


def check_xml(text: str, path: Path) -> tuple[Diagnostic, ...]:
    """Return all faults of an XML file, as the check of a mission does."""
    try:
        return _Importer([XmlText(text, path)], NodeRegistry(), ImportOptions()).checked()
    except FileError as error:
        return error.faults


class _Importer:
    def __init__(self, files: Sequence[XmlText], registry: NodeRegistry, options: ImportOptions) -> None:
        self._text = files[0].text
        self._path = files[0].path
        self._registry = registry
        self._options = options
        self._faults = ImportFaults(strict=options.strict)
        self._source = read_source(files, self._faults, options.main)

    def imported(self) -> ImportedMission:
        """Return the mission. Raises FileError."""
        whole, reading, stubs = self._read()
        self._refuse(self._changed(reading.mission))
        self._name_plugins(whole, stubbed=bool(stubs))
        written = mission_text(whole)
        if not (stubs or self._options.plugins):
            assert read_document(self._path, "mission", written).data == whole.node().value
        notes = [*self._faults.all(), *(f for f in reading.faults if f.severity == "warning")]
        return ImportedMission(
            written,
            tuple(sorted(notes, key=lambda note: note.mark)),
            stub_text(stubs, self._path.name) if stubs else "",
        )

    def checked(self) -> tuple[Diagnostic, ...]:
        """Return all faults and notes, those of the linter included. Raises FileError for errors."""
        whole, reading, _ = self._read()
        found = [*self._faults.all(), *self._changed(reading.mission)]
        return (*found, *check_mission(self._document_of(whole), self._registry).faults)

    def _read(self) -> tuple[MarkedValue, MissionReadResult, tuple[StubNode, ...]]:
        """Return the mission's content, the loaded mission, and the stubs. Raises FileError."""
        self._load_plugins()
        if self._options.stubs or self._options.plugins:
            stub_missing_trees(self._source, self._faults)
        fill_in_wires(self._source)
        rename_trees(self._source, self._registry, self._faults)
        rename_keys(self._source, self._faults)
        enums, lenient = self._options.enums, bool(self._options.stubs)
        finder = StubFinder(self._source, self._registry, self._faults, enums, lenient=lenient)
        stubs, flow = finder.find()
        ports = PortsOfTrees(self._source, flow, self._faults).find()
        context = ImportContext(
            self._source,
            self._registry,
            self._faults,
            flow,
            stubs,
            ports,
            finder.aliases,
            self._options.enums,
        )
        reader = XmlNodeReader(context)
        whole = self._document(reader, ports)
        if stubs and not self._options.stubs:
            self._unknown(tuple(stubs.values()), context.trails)
        reading = examine(self._document_of(whole), self._registry)
        if label_switches(reading, reader.switches, self._faults):
            reading = examine(self._document_of(whole), self._registry)
        if self._faults.errors and not self._source.trees:
            raise FileError(self._faults.all())
        if self._faults.errors:
            reported = {fault.where for fault in self._faults.all() if fault.severity == "error"}
            wrong = [f for f in reading.faults if f.code not in _FOLLOWS and f.where not in reported]
            raise FileError([*self._faults.all(), *wrong])
        self._refuse([*self._faults.all(), *reading.faults])
        return whole, reading, tuple(stubs.values())

    def _load_plugins(self) -> None:
        for plugin in self._source.said("plugins"):
            try:
                self._registry.add_plugin(plugin.value, self._path.parent)
            except PicktreeError:
                continue  # the loader tells it with its place
        for plugin in self._options.plugins:
            self._registry.add_plugin(plugin, self._options.folder or self._path.parent)

    def _document_of(self, whole: MarkedValue) -> Document:
        root = whole.node()
        return Document(self._path, self._text, "mission", cast("dict[str, Value]", root.value), root)

    def _refuse(self, faults: Iterable[Diagnostic]) -> None:
        found = tuple(faults)
        if any(fault.severity == "error" for fault in found):
            raise FileError(found)

    def _document(self, reader: XmlNodeReader, ports: Mapping[str, tuple[TreePort, ...]]) -> MarkedValue:
        source = self._source
        trees = MarkedValue.mapping(source.root.mark)
        for name, element in source.trees.items():
            if name not in source.included and element.children:
                root = reader.tree_root(name, element)
                body = _tree(root, ports[name], element, self._doc(name, element))
                trees.put(source.called(name), body, element.place("ID"))
        whole = MarkedValue.mapping(source.root.mark)
        whole.comments = source.root.comments
        whole.end_comments = (*source.root.end_comments, *source.root.comments_below)
        self._head(whole)
        whole.put("trees", trees)
        return whole

    def _doc(self, name: str, element: Element) -> str:
        """Return the description of a tree, from its model or the attribute of Groot2."""
        model = self._source.models.get(name)
        description = model.get("description") if model is not None else ""
        return description or one_line(element.get(btcpp_vocabulary.DESCRIPTION))

    def _unknown(self, stubs: Sequence[StubNode], trails: Mapping[str, str]) -> None:
        """Report the unknown nodes: those with a near name each, the others together."""
        made = {stub.id for stub in stubs}
        known = [*(each for each in self._registry.ids() if each not in made), *btcpp_vocabulary.TRANSLATED]
        lost: list[StubNode] = []
        for stub in stubs:
            near = get_close_matches(stub.source, known, 1, _NEAR)
            hint = foreign_word(stub.source) or (f"did you mean {near[0]!r}?" if near else "")
            if stub.source not in self._source.node_models and hint:
                message = f"unknown node {stub.source!r}"
                self._faults.fault(stub.mark, trails.get(stub.source, ""), message, hint, code="P906")
            else:
                lost.append(stub)
        if not lost:
            return
        first, count = lost[0], len(lost)
        words = f"the node {first.source!r} is unknown" if count == 1 else f"{count} nodes are unknown"
        hint = (
            "`picktree convert --stubs nodes.py` writes a plug-in with them; `--plugin FILE` names one that "
            "has them"
        )
        detail = "\n".join(
            f"{stub.source}: {stub.kind}, line {stub.mark.line}"
            + (f" and {stub.uses - 1} more" if stub.uses > 1 else "")
            for stub in lost
        )
        self._faults.add(Diagnostic(first.mark, "", words, hint, "P906", detail=detail if count > 1 else ""))

    def _head(self, whole: MarkedValue) -> None:
        whole.put("picktree", 1)
        whole.put("kind", "mission")
        if self._source.main == "":
            whole.put("library", True)
        for key in _ONE:
            for entry in self._source.said(key)[:1]:
                whole.put(key, entry.value, entry.mark)
        for key in _MANY:
            entry = self._source.said(key)
            if entry:
                items = [MarkedValue(one.mark, one.value) for one in entry]
                whole.put(key, MarkedValue(entry[0].mark, items=items), entry[0].mark)

    def _name_plugins(self, whole: MarkedValue, *, stubbed: bool) -> None:
        """Name the plug-ins of the command line in the head."""
        more = [*self._options.plugins, *([self._options.stubs] if stubbed else [])]
        if not more:
            return
        mark = self._source.root.mark
        known = whole.get("plugins")
        if known is not None and known.items is not None:
            known.items += [MarkedValue(mark, name) for name in more]
            return
        assert whole.entries is not None
        trees = whole.entries.pop()
        whole.put("plugins", MarkedValue(mark, items=[MarkedValue(mark, name) for name in more]))
        whole.entries.append(trees)

    def _changed(self, mission: Mission) -> Iterable[Diagnostic]:
        """Report trees of other mission files for which the XML differs."""
        exporter = XmlExporter(mission)
        for name in sorted(self._source.included):
            element, tree = self._source.trees.get(name), mission.trees.get(name)
            if element is None:
                continue
            if tree is None:
                message = f"none of the included files holds the tree {name!r}"
                yield Diagnostic(
                    element.place("ID"), name, message, "name its file in the metadata 'include'", "P916"
                )
            elif _bare(exporter.tree(tree)) != _bare(element):
                message = f"the tree {name!r} says something else than the included {tree.mark.file}"
                hint = "change that file, or give the tree another name here"
                yield Diagnostic(element.place("ID"), name, message, hint, "P916")


def _tree(root: NodeDraft, ports: tuple[TreePort, ...], element: Element, doc: str) -> MarkedValue:
    """Return the body under the tree's name."""
    written = root.written()
    if not ports and not doc:
        written = alone(written)
        written.comments = element.comments
        written.end_comments = (*written.end_comments, *element.end_comments)
        return written
    body = MarkedValue.mapping(element.mark)
    body.comments = element.comments
    body.end_comments = element.end_comments
    if doc:
        body.put("doc", MarkedValue(element.mark, doc))
    declared = MarkedValue.mapping(element.mark)
    for port in ports:
        declared.put(port.key, port.declared(), port.mark)
    if ports:
        body.put("ports", declared)
    if written.entries is None:
        body.put(root.id, MarkedValue.mapping(root.mark))
        body.end_comments = (*written.comments, *body.end_comments)
    else:
        written.entries[0].value.comments = (*written.comments, *written.entries[0].value.comments)
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
