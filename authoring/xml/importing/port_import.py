"""Import of the ports of trees: from their models, or inferred from their calls."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

from ....files.expressions.syntax_tree import Name, walk
from ....files.marks import Diagnostic, Mark
from ....files.yaml.writer import MarkedValue, from_value
from ....trees.loading.registry import NodeRegistry
from ....trees.values.port_types import PortType
from ....trees.values.references import Reference
from ..format import btcpp_vocabulary, tree_nodes_model
from ..format.element import Element
from ..format.literal_text import is_pointer, read_value, type_name
from .script_import import ScriptError, read_expression, read_statements
from .source import XmlSource

_PORTS: Mapping[str, Literal["in", "out"]] = {"input_port": "in", "output_port": "out", "inout_port": "in"}
_CONDITIONS = ("_failureIf", "_successIf", "_skipIf", "_while")
_ASSIGNMENTS = ("_onHalted", "_onFailure", "_onSuccess", "_post")


@dataclass(frozen=True, slots=True)
class TreePort:
    """Port as the mission declares it."""

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


class PortsOfTrees:
    """Finder of the ports of all trees of a source."""

    def __init__(self, source: XmlSource, registry: NodeRegistry) -> None:
        self._source = source
        self._registry = registry
        self.faults: list[Diagnostic] = []

    def find(self) -> dict[str, tuple[TreePort, ...]]:
        calls = list(self._calls())
        found: dict[str, tuple[TreePort, ...]] = {}
        for name in dict.fromkeys((*self._source.trees, *self._source.included)):
            model = self._source.models.get(name)
            ports = {port.key: port for port in self._declared(name, model)} if model is not None else {}
            mine = [call for call in calls if call.get("ID") == name]
            if model is None:
                ports |= {port.key: port for port in self._inferred(name, mine)}
            found[name] = tuple(ports.values())
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
            if direction is None or not key:
                message = f"<{element.name}> is no port with a name"
                hint = '<input_port name="…"/>, <output_port/> or <inout_port/>'
                self.faults.append(Diagnostic(element.mark, tree, message, hint, "P913"))
                continue
            yield self._port(tree, element, key, direction)

    def _port(self, tree: str, element: Element, key: str, direction: Literal["in", "out"]) -> TreePort:
        kind = type_name(element.get("type"))
        default, remapped = None, ""
        if "default" in element.attributes:
            text = element.get("default")
            if text.strip(" ").startswith("{="):
                message = f"'default' of {key!r}: {text.strip(' ')!r} is no default"
                hint = "a default is a value, or a '{key}'"
                self.faults.append(Diagnostic(element.place("default"), tree, message, hint, "P911"))
            elif is_pointer(text):
                remapped = text.strip(" ")
            elif direction == "in":
                default = self._value(tree, element, "default", PortType.parse(kind))
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

    def _value(self, tree: str, element: Element, attribute: str, kind: PortType) -> MarkedValue | None:
        if attribute not in element.attributes:
            return None
        mark = element.place(attribute)
        try:
            return from_value(read_value(element.get(attribute), kind), mark)
        except ValueError as error:
            self.faults.append(
                Diagnostic(mark, tree, f"{attribute!r} of {element.get('name')!r}: {error}", code="P911")
            )
            return None

    # From calls and uses.

    def _inferred(self, tree: str, calls: Iterable[Element]) -> Iterator[TreePort]:
        used = self._used(tree)
        seen: set[str] = set()
        for call in calls:
            for key in call.attributes:
                if key not in seen and key not in ("ID", "name") and not key.startswith("_"):
                    seen.add(key)
                    yield TreePort(key, call.place(key), used.direction(key))

    def _used(self, tree: str) -> _Used:
        found = _Used([], [])
        if tree in self._source.trees:
            for element in self._source.trees[tree].iterate():
                self._uses(element, found)
        return found

    def _uses(self, element: Element, found: _Used) -> None:
        node = self._registry.find(element.identity) if element.name != "SubTree" else None
        for key, text in element.attributes.items():
            condition = key in (*_CONDITIONS, "code", "if") and element.identity not in btcpp_vocabulary.OURS
            if condition or key in _ASSIGNMENTS:
                found.script(text)
            elif element.identity == "SetBlackboard" and key == "output_key":
                found.written.append(text.strip("{} "))
            elif is_pointer(text):
                found.pointer(key if text == "{=}" else text, _writes(node, key))


@dataclass(slots=True)
class _Used:
    """Blackboard keys that the nodes of a tree read, and those that they write."""

    read: list[str]
    written: list[str]

    def direction(self, key: str) -> Literal["in", "out"]:
        return "out" if key in self.written and key not in self.read else "in"

    def pointer(self, text: str, writes: bool) -> None:
        try:
            reference = Reference.parse(text.strip(" "))
        except ValueError:
            return
        key = reference.key if reference is not None else text
        (self.written if writes else self.read).append(key)

    def script(self, text: str) -> None:
        try:
            statements = read_statements(text)
        except ScriptError:
            statements = ()
        try:
            values = [statement.value for statement in statements] or [read_expression(text)]
        except ScriptError:
            return
        self.written += [statement.key for statement in statements]
        self.read += [part.name for value in values for part in walk(value) if isinstance(part, Name)]


def _writes(node: object, key: str) -> bool:
    declaration = getattr(node, "declaration", None)
    port = declaration.port(key) if declaration is not None else None
    return port is not None and port.direction == "out"
