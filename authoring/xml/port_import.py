"""Import of the ports of trees: from their models, or inferred from their calls."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from picktree.files import Mark
from picktree.files.yaml import MarkedValue, from_value
from picktree.trees import AUTOREMAP, MAIN, PortType
from picktree.world import world_facts

from . import tree_nodes_model
from .element import Element
from .key_flow import TRUE_WORDS, KeyFlow
from .literal_text import is_pointer, read_value, type_name
from .source import ImportFaults, XmlSource

_PORTS: Mapping[str, Literal["in", "out"]] = {"input_port": "in", "output_port": "out", "inout_port": "in"}


@dataclass(frozen=True, slots=True)
class TreePort:
    """Port in the mission's declaration."""

    key: str
    mark: Mark
    direction: Literal["in", "out"] = "in"
    type: str = "any"
    default: MarkedValue | None = None
    remapped: str = ""
    """Key of the caller, in braces, that applies when a call does not wire the port."""
    doc: str = ""
    unit: str = ""
    choices: MarkedValue | None = None
    initial: MarkedValue | None = None
    """Initial value of an output that a call does not wire."""

    @property
    def kind(self) -> PortType:
        return PortType.parse(self.type)

    def declared(self) -> MarkedValue:
        """Return the declaration under `ports:`."""
        entry = MarkedValue.mapping(self.mark)
        entry.put("type", self.type)
        if self.direction == "out":
            entry.put("direction", "out")
        if self.unit:
            entry.put("unit", self.unit)
        if self.choices is not None:
            entry.put("choices", self.choices)
        if self.default is not None:
            entry.put("default", self.default)
        if self.doc:
            entry.put("doc", self.doc)
        return entry


def fill_in_wires(source: XmlSource) -> None:
    """Write the defaults of the tree models that are keys of callers into the calls without a wire.

    BehaviorTree.CPP does the same.
    """
    if source.said("picktree"):
        return
    wires = {name: dict(_wires(model)) for name, model in source.models.items()}

    def filled(element: Element) -> Element:
        inside = tuple(map(filled, element.children))
        lacking = wires.get(element.get("ID"), {}) if element.name == "SubTree" else {}
        if element.get(AUTOREMAP) in TRUE_WORDS:
            lacking = {}
        lacking = {key: wire for key, wire in lacking.items() if key not in element.attributes}
        return replace(element, children=inside, attributes={**element.attributes, **lacking})

    source.trees = {name: filled(tree) for name, tree in source.trees.items()}


def _wires(model: Element) -> Iterator[tuple[str, str]]:
    for port in model.children:
        default, key = port.get("default").strip(" "), port.get("name")
        usable = port.name in _PORTS and key and not key.startswith("_")
        if usable and is_pointer(default) and not default.startswith("{=") and default != "{}":
            yield key, default


class PortsOfTrees:
    """Finder of the ports of all trees of a source."""

    def __init__(self, source: XmlSource, flow: KeyFlow, faults: ImportFaults) -> None:
        self._source = source
        self._flow = flow
        self._faults = faults
        self._ours = bool(source.said("picktree"))

    def find(self) -> dict[str, tuple[TreePort, ...]]:
        calls = list(self._calls())
        found: dict[str, tuple[TreePort, ...]] = {}
        for name in dict.fromkeys((*self._source.trees, *self._source.included)):
            model = self._source.models.get(name)
            ports = {port.key: port for port in self._declared(name, model)} if model is not None else {}
            mine = [call for call in calls if call.get("ID") == name]
            if model is None or not (self._ours or self._faults.strict):
                ports |= {port.key: port for port in self._inferred(name, mine, ports)}
            if not self._ours:
                ports = {key: self._completed(name, port, mine) for key, port in ports.items()}
            found[name] = tuple(ports.values())
        called = {call.get("ID") for call in calls}
        for name in found if not (self._ours or self._faults.strict) else ():
            if name == self._source.main or name not in called:
                external = self._of_the_program(name, {port.key for port in found[name]})
                # Other trees that call this one know nothing of the program.
                default = MarkedValue(self._source.root.mark, None) if name in called else None
                found[name] = (*found[name], *(replace(port, default=default) for port in external))
        return found

    def _calls(self) -> Iterator[Element]:
        for tree in self._source.trees.values():
            yield from (element for element in tree.iterate() if element.name == "SubTree")

    # From the model.

    def _declared(self, tree: str, model: Element) -> Iterator[TreePort]:
        for element in model.children:
            direction, key = _PORTS.get(element.name), element.get("name")
            if element.name in ("MetadataFields", "description"):
                continue
            if key.startswith("_") and direction is not None:
                message = f"the port {key!r} has no meaning for a run"
                self._faults.note(element.place("name"), tree, message, code="P908")
                continue
            if direction is None or not key:
                message = f"<{element.name}> is no port with a name"
                hint = '<input_port name="…"/>, <output_port/> or <inout_port/>'
                self._faults.fault(element.mark, tree, message, hint, code="P913")
                continue
            yield self._port(tree, element, key, direction)

    def _port(self, tree: str, element: Element, key: str, direction: Literal["in", "out"]) -> TreePort:
        kind = type_name(element.get("type"))
        default, remapped = None, ""
        if "default" in element.attributes:
            text = element.get("default")
            if text.strip().startswith("{=}") or text.strip() == "{}":
                message = f"{text.strip()!r} is not a default: it names no key"
                hint = f"write {{{key}}} for the caller's key of that name"
                self._faults.fault(element.place("default"), tree, message, hint, code="P911")
            elif is_pointer(text):
                remapped = text.strip(" ")
            elif direction == "in":
                default = self._value(tree, element, "default", self._literal_type(tree, key, kind))
        choices = self._value(tree, element, tree_nodes_model.CHOICES, PortType("any"))
        doc = element.get("description") or " ".join(element.text.split())
        return TreePort(
            key,
            element.place("name"),
            direction,
            kind,
            default,
            remapped,
            doc,
            element.get(tree_nodes_model.UNIT),
            choices,
        )

    def _literal_type(self, tree: str, key: str, kind: str) -> PortType:
        declared = PortType.parse(kind)
        return declared if self._ours else literal_type(self._flow, tree, key, declared)

    def _value(self, tree: str, element: Element, attribute: str, kind: PortType) -> MarkedValue | None:
        if attribute not in element.attributes:
            return None
        mark = element.place(attribute)
        try:
            return from_value(read_value(element.get(attribute), kind), mark)
        except ValueError as error:
            message = f"{attribute!r} of {element.get('name')!r}: {error}"
            self._faults.fault(mark, tree, message, code="P911")
            return None

    # From calls and uses.

    def _inferred(self, tree: str, calls: list[Element], known: Mapping[str, TreePort]) -> Iterator[TreePort]:
        """Yield the ports in calls that no model declares; unused ones are left out."""
        used = {*self._flow.reads(tree), *self._flow.writes(tree)}
        seen: set[str] = set(known)
        for call in calls:
            for key in call.attributes:
                if key in seen or key in ("ID", "name") or key.startswith("_"):
                    continue
                seen.add(key)
                if key in used or self._faults.strict:
                    yield TreePort(key, call.place(key))
                else:
                    message = f"no node of the tree {tree!r} uses the port {key!r}; it is left out"
                    self._faults.note(call.place(key), tree, message, code="P918")

    def _completed(self, tree: str, port: TreePort, calls: list[Element]) -> TreePort:
        """Return the port with the direction of its uses, and a default where a call leaves it out."""
        if port.key in self._flow.writes(tree):
            port = replace(port, direction="out", default=None, initial=port.default)
        if port.direction == "out":
            return port
        group = self._flow.group(tree, port.key)
        if port.type == "any" and group.listed is not None and group.listed.name != "any":
            port = replace(port, type=str(group.listed))
        elif port.type == "any" and group.compared_with_text:
            port = replace(port, type="string")
        lacking = [
            call
            for call in calls
            if port.key not in call.attributes and call.get(AUTOREMAP) not in TRUE_WORDS
        ]
        if port.default is None and not port.remapped and lacking and not self._faults.strict:
            if port.key in self._flow.reads(tree):
                message = f"this call of {tree!r} gives no port {port.key!r}; its nodes read null there"
                self._faults.note(lacking[0].mark, tree, message, code="P918")
            port = replace(port, type="any", default=MarkedValue(port.mark, None))
        return port

    def _of_the_program(self, tree: str, known: set[str]) -> Iterator[TreePort]:
        """Yield a port for each key that an uncalled tree reads and no node writes."""
        for key, mark in self._flow.reads(tree).items():
            written = key in world_facts.FACTS or self._flow.group(tree, key).written
            if written or key in known or key in self._flow.watched or key.startswith("_"):
                continue
            main = tree == self._source.main
            of = f"parameter of {MAIN}" if main else f"port of {self._source.called(tree)}"
            message = f"nobody writes the key {key!r}; it becomes a {of}"
            hint = f"`picktree run --set {key}=…` gives it" if main else "what calls the tree gives it"
            if key.isupper():
                hint += f"; if it is an enum of the program, `convert --enum {key}=0` says its number"
            self._faults.note(mark, self._source.called(tree), message, hint, code="P918")
            yield TreePort(key, mark)


def literal_type(flow: KeyFlow, tree: str, key: str, declared: PortType) -> PortType:
    """Return the type with which a literal for a key is read.

    BehaviorTree.CPP keeps a text, and reads it as each port needs it. Here the uses of the key decide once.
    """
    if declared.name != "any" or declared.many:
        return declared
    group = flow.group(tree, key)
    if group.listed is not None:
        return group.listed
    return PortType("string") if group.compared_with_text else declared
