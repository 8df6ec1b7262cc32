"""Importer: converts the text of a BehaviorTree.CPP 4 file to that of a mission file."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import cast

from ....errors import PicktreeError
from ....files.marks import Diagnostic, FileError
from ....files.value_wording import suggest_name
from ....files.yaml.document import Document, read_document
from ....files.yaml.reader import Value
from ....files.yaml.writer import MarkedValue, mission_text
from ....trees.declaration import AUTOREMAP, NodeDeclaration
from ....trees.loading.loader import examine
from ....trees.loading.registry import NodeRegistry
from ....trees.mission import MAIN, Mission
from ....trees.ports import SlotDeclaration
from ..export.mission_export import XmlExporter
from ..format import btcpp_vocabulary
from ..format.btcpp_vocabulary import SlotRow, read_indexes, read_table
from ..format.element import Element
from .attributes import COMMON, ElementReader, NodeDraft
from .port_import import PortsOfTrees, TreePort
from .source import XmlSource, read_source
from .translations import Translations


class XmlNodeReader(ElementReader):
    """Reader of elements; `trees` are the ports of the sub-trees, `called` their names in the mission."""

    def __init__(
        self, registry: NodeRegistry, trees: Mapping[str, tuple[TreePort, ...]], called: Callable[[str], str]
    ) -> None:
        super().__init__()
        self._registry = registry
        self._trees = trees
        self._called = called
        self._translations = Translations(self)

    def node(self, element: Element, above: str) -> NodeDraft:
        """Read one element and its descendants."""
        identity = element.identity
        if not identity:
            message = f"<{element.name}> needs the attribute 'ID'"
            hint = 'as <ScriptCondition code="…"/>' if element.name == "Condition" else ""
            self.fault(element.mark, above, message, hint, code="P905")
            return NodeDraft.of("AlwaysSuccess", element.mark)
        trail = f"{above}/{element.get('name') or identity}"
        if element.text:
            message = f"the text {element.text[:30]!r} has no meaning here"
            self.fault(element.mark, trail, message, "a comment stands in <!-- -->", code="P905")
        if element.name not in btcpp_vocabulary.ELEMENTS and "ID" in element.attributes:
            message = f"<{element.name}> has no attribute 'ID'"
            hint = "the ID is the element's name, or stands in <Action>, <Condition>, <Control>, <Decorator>"
            self.fault(element.place("ID"), trail, message, hint, code="P908")
        draft = self._draft(element, identity, trail)
        self.common(element, draft, trail)
        return draft

    def _draft(self, element: Element, identity: str, trail: str) -> NodeDraft:
        if element.name == "SubTree":
            return self._subtree(element, identity, trail)
        node = self._registry.find(identity)
        if identity == btcpp_vocabulary.REPEAT_WHILE:
            node = self._registry.find("Repeat")
        translation = self._translations.of(identity)
        # The ID is BehaviorTree.CPP's own: those names are refused for other nodes.
        if translation is not None and (node is None or identity in ("SetBlackboard", "Script")):
            return translation(element, trail)
        if node is not None:
            return self._declared(element, node.declaration, trail)
        self._unknown(element, identity, trail)
        for child in element.children:
            self.node(child, trail)
        return NodeDraft.of("AlwaysSuccess", element.mark)

    def _unknown(self, element: Element, identity: str, trail: str) -> None:
        mark = element.place("ID")
        if identity in btcpp_vocabulary.FOREIGN:
            message = f"{identity!r} has no counterpart"
            self.fault(mark, trail, message, btcpp_vocabulary.FOREIGN[identity], code="P907")
        elif identity in self._trees:
            hint = f'a sub-tree is called by <SubTree ID="{identity}"/>'
            self.fault(mark, trail, f"unknown node {identity!r}", hint, code="P906")
        else:
            known = (*self._registry.ids(), *btcpp_vocabulary.TRANSLATED)
            hint = suggest_name(identity, known)
            self.fault(mark, trail, f"unknown node {identity!r}", hint, code="P906")

    def _declared(self, element: Element, declaration: NodeDeclaration, trail: str) -> NodeDraft:
        draft = NodeDraft.of(declaration.id, element.mark, declaration.keys)
        slots = [slot for slot in declaration.slots if slot.key != "do"]
        for key in element.attributes:
            port = declaration.port(key)
            if port is not None and port.takes == "key":
                draft.put(key, f"{{{element.get(key).strip('{} ')}}}", element.place(key))
            elif port is not None:
                self.port(draft, port.key, port.type, element, key, trail)
            elif key not in (*COMMON, "ID", *(slot.key for slot in slots)):
                known = (*(p.key for p in declaration.ports), *(slot.key for slot in slots), "name")
                self.no_port(element, key, declaration.id, known, trail)
        self._children(draft, element, declaration, slots, trail)
        return draft

    def _children(
        self,
        draft: NodeDraft,
        element: Element,
        declaration: NodeDeclaration,
        slots: list[SlotDeclaration],
        trail: str,
    ) -> None:
        main = declaration.slot("do")
        if main is None and not slots:
            self.count(element, declaration.id, 0, 0, trail)
            return
        children = list(element.children)
        rows = {slot.key: self._rows(element, slot, trail) for slot in slots}
        taken = [row.child for found in rows.values() for row in found]
        if slots and not self._fits(element, taken, len(children), trail):
            return
        free = [child for index, child in enumerate(children) if index not in taken]
        if main is not None and main.arity == "one":
            self.count(element, declaration.id, 1 if main.required else 0, 1, trail, len(free))
            if free:
                draft.put("do", self.node(free[0], trail).written())
        elif main is not None and free:
            items = [self.node(child, trail).written() for child in free]
            draft.put("do", MarkedValue(element.mark, items=items))
        elif free:
            message = "no slot is given for some of the children"
            self.fault(free[0].mark, trail, message, f"'{slots[0].key}' names them", code="P915")
        for slot in slots:
            if rows[slot.key]:
                self._slot(draft, slot, rows[slot.key], element, trail)

    def _rows(self, element: Element, slot: SlotDeclaration, trail: str) -> tuple[SlotRow, ...]:
        """Return the children in the slot, by label and index."""
        if slot.key not in element.attributes:
            return ()
        text = element.get(slot.key)
        try:
            if slot.arity == "table":
                return read_table(text)
            return tuple(SlotRow("", child) for child in read_indexes(text))
        except ValueError as error:
            hint = "as 'grasp.*=1; control.*=2'" if slot.arity == "table" else "children are counted from 0"
            self.fault(element.place(slot.key), trail, f"{slot.key!r}: {error}", hint, code="P915")
            return ()

    def _fits(self, element: Element, taken: list[int], children: int, trail: str) -> bool:
        wrong = [child for child in taken if child >= children or taken.count(child) > 1]
        if wrong:
            what = "is named twice" if wrong[0] < children else f"is not there; there are {children}"
            message = f"the child {wrong[0]} {what}"
            self.fault(element.mark, trail, message, "children are counted from 0", code="P915")
        return not wrong

    def _slot(
        self, draft: NodeDraft, slot: SlotDeclaration, rows: tuple[SlotRow, ...], element: Element, trail: str
    ) -> None:
        mark = element.place(slot.key)
        if slot.arity == "one":
            draft.put(slot.key, self.slot_value(element.children[rows[0].child], slot.key, trail), mark)
        elif slot.arity == "many":
            items = [self.node(element.children[row.child], trail).written() for row in rows]
            draft.put(slot.key, MarkedValue(mark, items=items), mark)
        else:
            table = MarkedValue.mapping(mark)
            for row in rows:
                if table.get(row.label) is not None:
                    self.fault(mark, trail, f"{slot.key!r} names {row.label!r} twice", code="P915")
                child = element.children[row.child]
                table.put(row.label, self.slot_value(child, row.label, trail), child.mark)
            draft.put(slot.key, table, mark)

    def _subtree(self, element: Element, identity: str, trail: str) -> NodeDraft:
        self.count(element, "SubTree", 0, 0, trail)
        if identity not in self._trees:
            hint = suggest_name(identity, self._trees)
            self.fault(element.place("ID"), trail, f"there is no tree {identity!r}", hint, code="P913")
            return NodeDraft.of("AlwaysSuccess", element.mark)
        ports = {port.key: port for port in self._trees[identity]}
        left_out = element.get(btcpp_vocabulary.LEFT_OUT).split()
        draft = NodeDraft.of(self._called(identity), element.mark)
        for key in element.attributes:
            if key in ports and key not in left_out:
                self.port(draft, key, ports[key].kind, element, key, trail)
            elif key not in (*COMMON, *ports, "ID", AUTOREMAP, btcpp_vocabulary.LEFT_OUT):
                self.no_port(element, key, f"the tree {identity!r}", (*ports, "name"), trail)
        remapping = element.get(AUTOREMAP) in ("true", "1")
        if remapping:
            draft.put(AUTOREMAP, True, element.place(AUTOREMAP))
        for key, port in ports.items():
            if key not in element.attributes and port.remapped and not remapping:
                draft.put(key, port.remapped, element.mark)
        return draft


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
                model = source.models.get(name)
                doc = model.get("description") or "" if model is not None else ""
                body = _tree(root, declared[name], element, doc)
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


def _tree(root: NodeDraft, ports: tuple[TreePort, ...], element: Element, doc: str) -> MarkedValue:
    """Return the body under the tree's name."""
    written = root.written()
    if not ports and not doc:
        written.comments = (*element.comments, *written.comments)
        return written
    body = MarkedValue.mapping(element.mark)
    body.comments = element.comments
    if doc:
        body.put("doc", MarkedValue(element.mark, doc))
    declared = MarkedValue.mapping(element.mark)
    for port in ports:
        declared.put(port.key, port.declared(), port.mark)
    if ports:
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
