"""Stubs for the nodes that picktree does not know: their ports, from <TreeNodesModel> and from their uses,
and the plug-in's text.
"""

from __future__ import annotations

import builtins
import json
import keyword
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, cast

from picktree.files import Mark, PicktreeError
from picktree.trees import (
    AUTOREMAP,
    COMMON_KEYS,
    IDENTIFIER,
    REQUIRED,
    ConditionNode,
    ControlNode,
    Decorator,
    In,
    Node,
    NodeDeclaration,
    NodeStatus,
    Out,
    PortDeclaration,
    PortType,
    Skill,
    Steps,
    Takes,
    children,
    convert_literal,
    port,
    references,
    reserved_names,
)
from picktree.trees.loading import NodeRegistry
from picktree.world import Cause, Failure, ObjectId, register_cause

from . import btcpp_vocabulary
from .element import Element, one_line
from .key_flow import Direction, KeyFlow, PortUse, port_type
from .literal_text import is_pointer, read_value
from .renaming import identifier
from .source import ImportFaults, XmlSource

StubKind: TypeAlias = Literal["Action", "Condition", "Decorator", "Control"]
NOT_WRITTEN = register_cause(
    Cause("stub.not_written", "The node is a stub of the import.", "write the node's body in the plug-in")
)
_DIRECTIONS: Mapping[str, Direction | None] = {
    "input_port": "in", "output_port": "out", "inout_port": None,
}  # fmt: skip
PYTHON_TYPES = {
    "string": str, "int": int, "float": float, "bool": bool, "object": ObjectId, "any": object,
}  # fmt: skip
_QUESTION = re.compile(r"(?:Is|Are|Has|Would|Can|Should)[A-Z]")
"""Beginning of the names of conditions, for a node of unknown kind."""
_NO_PORT = ("ID", *COMMON_KEYS)


@dataclass(frozen=True, slots=True)
class StubPort:
    """Port of a stub. `name` is its attribute in XML."""

    name: str
    declared: PortDeclaration
    remapped: str = ""
    """Reference for uses that leave the port out; empty: none."""


@dataclass(frozen=True, slots=True)
class StubNode:
    """Node for which a stub is made. `source` is its ID in XML, `id` that in the mission."""

    source: str
    id: str
    kind: StubKind
    doc: str
    ports: tuple[StubPort, ...]
    mark: Mark
    uses: int

    def port(self, name: str) -> PortDeclaration | None:
        """Return the port of an XML attribute."""
        return next((each.declared for each in self.ports if each.name == name), None)


class StubFinder:
    """Finder of the unknown nodes of a source, with the known properties of their ports."""

    def __init__(
        self,
        source: XmlSource,
        registry: NodeRegistry,
        faults: ImportFaults,
        enums: Mapping[str, int],
        *,
        lenient: bool = False,
    ) -> None:
        """`lenient`: a use that does not fit picktree's own node of that name is one of another node."""
        self._source = source
        self._enums = enums
        self._registry = registry
        self._faults = faults
        self._ours = bool(source.said("picktree"))
        self._lenient = lenient and not self._ours
        self._others = self._misfits(registry) if self._lenient else frozenset[str]()
        self.aliases: dict[str, str] = {}
        """IDs of nodes of plug-ins by the ID in XML, which is no ID in a mission or picktree's own."""
        self._elements: dict[str, list[Element]] = {}
        for tree in source.trees.values():
            for element in tree.iterate():
                if element is not tree and self._unknown(element):
                    self._elements.setdefault(element.identity, []).append(element)

    def find(self) -> tuple[dict[str, StubNode], KeyFlow]:
        """Return the stubs by their ID in XML, and the flow of keys with them."""
        flow = KeyFlow(self._source.trees, self.port_use, self._source.main, self._enums)
        settled: dict[tuple[str, str], Direction] = {}
        for wire in flow.undecided:
            named = _named_direction(wire.port)
            if self._kind(self._source.node_models.get(wire.node), self._elements[wire.node]) == "Condition":
                named = named or "in"
            # The first node that names a key, which nobody writes, writes it.
            known = flow.group(wire.tree, wire.key).written
            direction = settled.setdefault((wire.node, wire.port), named or ("in" if known else "out"))
            flow.decide(wire, direction)
        stubs = {name: self._stub(name, uses, settled) for name, uses in self._elements.items()}
        found = {name: stub for name, stub in stubs.items() if stub is not None}

        def declared(element: Element, key: str) -> PortUse | None:
            stub = found.get(element.identity)
            mine = stub.port(key) if stub is not None else None
            return self.port_use(element, key) if mine is None else PortUse(mine.direction, mine.type)

        return found, KeyFlow(self._source.trees, declared, self._source.main, self._enums)

    def port_use(self, element: Element, key: str) -> PortUse | None:
        """Return the known properties of a port before the stubs are made."""
        identity = element.identity
        if identity in self._elements:
            if key in _NO_PORT or key.startswith("_"):
                return None
            model = self._model_port(identity, key)
            if model is None:
                return PortUse(None)
            return PortUse(_DIRECTIONS[model.name], port_type(model.get("type")))
        node = self._registry.find(identity)
        mine = node.declaration.port(key) if node is not None else None
        if mine is None and identity == "ForEach":  # as MoveIt Pro has it
            return {"vector_in": PortUse("in", PortType("any", many=True)), "index": PortUse("out")}.get(key)
        return PortUse(mine.direction, mine.type) if mine is not None else None

    def _unknown(self, element: Element) -> bool:
        identity = element.identity
        if element.name == "SubTree" or not identity or identity in self._source.trees:
            return False
        if identity in btcpp_vocabulary.BUILT_IN or identity in btcpp_vocabulary.OURS:
            return False
        if btcpp_vocabulary.SWITCH.fullmatch(identity) or identity in btcpp_vocabulary.FOREIGN:
            return False
        node = self._registry.find(identity)
        if node is not None and (self._ours or self._fits(identity, node.declaration, element)):
            return False
        alias = own_identity(identity, known=node is not None)
        other = self._registry.find(alias)
        if other is not None and not other.__module__.startswith("picktree."):
            self.aliases[identity] = alias
            return False
        return node is not None or not self._registry.is_lost(identity)

    def _fits(self, identity: str, declaration: NodeDeclaration, element: Element) -> bool:
        """Whether picktree's node of that name may be the one that the file's model declares."""
        model = self._source.node_models.get(identity)
        if identity in self._others:
            return False
        if model is None or identity == "ForEach":
            return True
        names = {each.get("name") for each in model.children if each.name in _DIRECTIONS}
        return names <= set(declaration.keys) and bool(element.children) == bool(declaration.slots)

    def _misfits(self, registry: NodeRegistry) -> frozenset[str]:
        """Return the IDs of picktree's own nodes that do not fit all of their uses."""
        found: set[str] = set()
        for element in (each for tree in self._source.trees.values() for each in tree.iterate()):
            node = None if element.identity in btcpp_vocabulary.BUILT_IN else registry.find(element.identity)
            if node is None or not node.__module__.startswith("picktree.") or element.identity == "ForEach":
                continue
            needed = {port.key for port in node.declaration.ports if port.required}
            ports = {key for key in element.attributes if key not in _NO_PORT and key[:1] != "_"}
            known = {*node.declaration.keys, *(slot.key for slot in node.declaration.slots)}
            if needed - ports or ports - known or bool(element.children) != bool(node.declaration.slots):
                found.add(element.identity)
        return frozenset(found)

    def _model_port(self, identity: str, key: str) -> Element | None:
        model = self._source.node_models.get(identity)
        ports = model.children if model is not None else ()
        return next((each for each in ports if each.name in _DIRECTIONS and each.get("name") == key), None)

    def _stub(
        self, name: str, uses: list[Element], settled: Mapping[tuple[str, str], Direction]
    ) -> StubNode | None:
        model = self._source.node_models.get(name)
        identity = self._identity(name, uses[0])
        keys = [each.get("name") for each in (model.children if model else ()) if each.name in _DIRECTIONS]
        keys += [key for use in uses for key in use.attributes if key not in _NO_PORT and key[:1] != "_"]
        ports: list[StubPort] = []
        for key in dict.fromkeys(filter(None, keys)):
            taken = {each.declared.key for each in ports}
            found = self._port(name, key, uses, settled.get((name, key)), taken)
            if found is not None:
                ports.append(found)
        description = one_line((model.get("description") or model.text) if model is not None else "")
        doc = description or f"{name} of {uses[0].mark.file.replace(chr(92), '/').rpartition('/')[2]}."
        return StubNode(name, identity, self._kind(model, uses), doc, tuple(ports), uses[0].mark, len(uses))

    def _identity(self, name: str, use: Element) -> str:
        taken = {*self._source.names.values()}
        stem = own_identity(name, known=self._registry.find(name) is not None)
        if self._registry.find(stem) is not None or stem in taken:
            stem = f"Own{stem}"
        new = identifier(stem, taken, "Node") if stem in taken else stem
        if new != name:
            message = f"the node {name!r} is called {new!r} in the mission"
            known = self._registry.find(name) is not None
            hint = f"picktree's own {name!r} has other ports" if known else ""
            self._faults.note(use.place("ID"), "", message, hint, code="P917")
        return new

    def _kind(self, model: Element | None, uses: list[Element]) -> StubKind:
        most, least = max(len(use.children) for use in uses), min(len(use.children) for use in uses)
        for said in (model, *uses):
            if said is not None and said.name in ("Action", "Condition", "Decorator", "Control"):
                kind: StubKind = said.name
                leaf = kind in ("Action", "Condition")
                if leaf == (most == 0) and (kind != "Decorator" or most == 1):
                    return kind
        if most == 0 and _QUESTION.match(uses[0].identity):
            return "Condition"
        return "Action" if most == 0 else "Decorator" if most == least == 1 else "Control"

    def _port(
        self, node: str, name: str, uses: list[Element], settled: Direction | None, taken: set[str]
    ) -> StubPort | None:
        model = self._model_port(node, name)
        texts = [use.get(name) for use in uses if name in use.attributes]
        literals = [text for text in texts if not is_pointer(text)]
        direction = settled or (_DIRECTIONS[model.name] if model is not None else None) or "in"
        if literals and any(literals):
            open_ = settled is not None or model is None or model.name == "inout_port"
            direction = "in" if open_ else direction
        usable = IDENTIFIER.fullmatch(name) and name != "do" and name not in taken
        key = name if usable else identifier(f"{name}_port" if name == "do" else name, taken)
        kind = port_type(model.get("type")) if model is not None else _type_of(literals, len(texts))
        text = (model.get("description") or model.text) if model is not None else ""
        doc = one_line(text) or f"{name} of {node}"
        if direction == "out":
            return StubPort(name, PortDeclaration(key, _attribute(key), "out", kind, doc))
        default = model.attributes.get("default") if model is not None else None
        kind = kind if all(_reads(text, kind) for text in literals) else PortType("any")
        template = any(map(references.REFERENCE_IN_TEXT.search, literals))
        kind = PortType("string") if template else kind
        remapped, value = "", REQUIRED
        if default is not None and is_pointer(default):
            remapped = f"{{{name}}}" if default.strip() == "{=}" else default.strip(" ")
            value, kind = None, replace(kind, optional=True)
        elif default is not None:
            kind = kind if _reads(default, kind) else PortType("any")
            value = convert_literal(read_value(default, kind), kind)
        elif len(texts) < len(uses):
            value, kind = None, replace(kind, optional=True)
        takes: Takes = "template" if template else "value"
        declared = PortDeclaration(key, _attribute(key), "in", kind, doc, default=value, takes=takes)
        return StubPort(name, declared, remapped)


def _attribute(key: str) -> str:
    """Return the name of a port's attribute in the class."""
    reserved = keyword.iskeyword(key) or key in reserved_names(Node) or key == "do"
    return f"{key}_" if reserved else key


def stub_missing_trees(source: XmlSource, faults: ImportFaults) -> None:
    """Treat calls of missing trees as nodes, for which stubs or a plug-in are used."""
    missing: set[str] = set()

    def replaced(element: Element) -> Element:
        inside = tuple(map(replaced, element.children))
        identity = element.get("ID")
        if element.name != "SubTree" or identity in source.trees or not identity:
            return replace(element, children=inside)
        missing.add(identity)
        faults.note(
            element.place("ID"),
            "",
            f"there is no tree {identity!r}; the name is taken for a node",
            code="P913",
        )
        kept = {key: text for key, text in element.attributes.items() if key != AUTOREMAP}
        return replace(element, name="Action", attributes=kept)

    source.trees = {name: replaced(tree) for name, tree in source.trees.items()}
    for name in missing & source.models.keys():
        source.node_models.setdefault(name, replace(source.models[name], name="Action"))


def own_identity(name: str, *, known: bool) -> str:
    """Return the ID of a stub. `known`: whether picktree has another node of that name."""
    stem = name if IDENTIFIER.fullmatch(name) else identifier(name, (), "Node")
    return f"Own{stem}" if known else stem


def _type_of(literals: list[str], uses: int) -> PortType:
    """Return the type that all literals have; `any` where references come in, too."""
    if not literals or len(literals) < uses:
        return PortType("any")
    for name in ("int", "float", "bool"):
        kind = PortType.parse(name)
        if all(_reads(text, kind) for text in literals):
            return kind
    return PortType("string")


def _named_direction(port: str) -> Direction | None:
    """Return the direction in the name of a port, as `input_pose`; None without one."""
    words = port.lower().split("_")
    if {"out", "output"} & {words[0], words[-1]}:
        return "out"
    return "in" if {"in", "input"} & {words[0], words[-1]} else None


def _reads(text: str, kind: PortType) -> bool:
    try:
        convert_literal(read_value(text, kind), kind)
    except ValueError:
        return False
    return True


def stub_class(stub: StubNode) -> type[Node]:
    """Return the node class of a stub, equal to that in the text of the plug-in."""
    base, members = _BASES[stub.kind]
    body: dict[str, object] = {
        "__doc__": stub.doc,
        "__module__": __name__,
        "node_id": stub.id,
        "causes": (NOT_WRITTEN,),
        **members,
    }
    annotations: dict[str, object] = {}
    for each in (every.declared for every in stub.ports):
        way = In if each.direction == "in" else Out
        annotations[each.attribute] = cast("Any", way)[_annotation(each.type)]
        body[each.attribute] = port(each.doc, default=each.default, key=each.key, takes=each.takes)
    body["__annotations__"] = annotations
    try:
        return cast("type[Node]", cast("Any", type(base))(stub.id, (base,), body))
    except PicktreeError as error:  # a port that the text of no model can have
        raise PicktreeError(f"the stub of {stub.source!r}: {error}") from None


def _annotation(kind: PortType) -> object:
    one: Any = PYTHON_TYPES[kind.name]
    whole: Any = list[one] if kind.many else one
    return whole | None if kind.optional else whole


def _run(self: Skill, world: object) -> Steps:
    raise Failure(NOT_WRITTEN, not_written(self.declaration.id))
    yield


def _answer(self: ConditionNode, world: object) -> bool:
    raise Failure(NOT_WRITTEN, not_written(self.declaration.id))


def _on_tick(self: ControlNode) -> NodeStatus:
    return self.fail(NOT_WRITTEN, not_written(self.declaration.id))


def not_written(identity: str) -> str:
    """Return the message with which a stub fails."""
    return f"{identity} is a stub: its body is still to be written"


_BASES: Mapping[StubKind, tuple[type[Node], Mapping[str, object]]] = {
    "Action": (Skill, {"run": _run}),
    "Condition": (ConditionNode, {"answer": _answer}),
    "Decorator": (Decorator, {"on_tick": _on_tick}),
    "Control": (ControlNode, {"on_tick": _on_tick, "parts": children("the children")}),
}
_LINE = 110
_NAMES = {
    "Action": ("Skill", "Steps", "World"),
    "Condition": ("ConditionNode", "World"),
    "Decorator": ("Decorator", "NodeStatus"),
    "Control": ("ControlNode", "NodeStatus", "children"),
}
"""Names that a kind of node needs; the first is its base class."""
_RESERVED_NAMES = (
    "Cause", "Failure", "In", "ObjectId", "Out", "port", "register_cause", "NODES", "NOT_WRITTEN",
    *(name for names in _NAMES.values() for name in names),
)  # fmt: skip


def stub_text(stubs: Iterable[StubNode], origin: str) -> str:
    """Return the text of a Python file. `origin`: name of the XML file, for its docstring."""
    nodes = tuple(stubs)
    names = {"Cause", "register_cause"}
    for node in nodes:
        names.update(_NAMES[node.kind])
        if node.kind in ("Action", "Condition"):
            names.add("Failure")
        ports = [port.declared for port in node.ports]
        names.update(("In" if each.direction == "in" else "Out") for each in ports)
        names.update("port" for _ in ports)
        names.update("ObjectId" for each in ports if each.type.name == "object")
    classes = {node.id: _class_name(node.id) for node in nodes}
    lines = [
        _docstring(f"Stubs of the nodes of {origin}: each fails until its body is written."),
        "",
        *_imports(sorted(names)),
        "",
        "NOT_WRITTEN = register_cause(",
        '    Cause("stub.not_written", "The node is a stub of the import.", '
        '"write the node\'s body in the plug-in")',
        ")",
    ]
    for node in nodes:
        lines += ["", "", *_class(node, classes[node.id])]
    lines += ["", "", "NODES = (", *(f"    {name}," for name in classes.values()), ")", ""]
    return "\n".join(lines)


def _imports(names: list[str]) -> Iterator[str]:
    line = f"from picktree.skills.plugin import {', '.join(names)}"
    if len(line) <= _LINE:
        yield line
    else:
        yield from ("from picktree.skills.plugin import (", *(f"    {name}," for name in names), ")")


def _class_name(identity: str) -> str:
    taken = identity in _RESERVED_NAMES or keyword.iskeyword(identity) or hasattr(builtins, identity)
    return f"{identity}Node" if taken else identity


def _class(node: StubNode, name: str) -> Iterator[str]:
    yield f"class {name}({_NAMES[node.kind][0]}):"
    yield f"    {_docstring(node.doc)}"
    yield ""
    if name != node.id:
        yield f"    node_id = {_quoted(node.id)}"
    yield "    causes = (NOT_WRITTEN,)"
    if node.kind == "Control":
        yield '    parts = children("the children")'
    if node.ports:
        yield ""
    for each in node.ports:
        yield from _port(each.declared)
    yield ""
    message = _quoted(not_written(node.id))
    if node.kind == "Action":
        yield "    def run(self, world: World) -> Steps:"
        yield f"        raise Failure(NOT_WRITTEN, {message})"
        yield "        yield  # each yield is one tick RUNNING"
    elif node.kind == "Condition":
        yield "    def answer(self, world: World) -> bool:"
        yield f"        raise Failure(NOT_WRITTEN, {message})"
    else:
        yield "    def on_tick(self) -> NodeStatus:"
        yield f"        return self.fail(NOT_WRITTEN, {message})"


def _port(port: PortDeclaration) -> Iterator[str]:
    way = "In" if port.direction == "in" else "Out"
    arguments = [_quoted(port.doc)]
    if port.default is not REQUIRED:
        arguments.append(f"default={_value(port.default)}")
    if port.attribute != port.key:
        arguments.append(f"key={_quoted(port.key)}")
    if port.takes == "template":
        arguments.append('takes="template"')
    start = f"    {port.attribute}: {way}[{_type(port.type)}] = port("
    line = f"{start}{', '.join(arguments)})"
    if len(line) <= _LINE:
        yield line
    else:
        yield start
        yield from (f"        {each}," for each in arguments)
        yield "    )"


def _type(kind: PortType) -> str:
    one = PYTHON_TYPES[kind.name].__name__ if kind.name != "object" else "ObjectId"
    whole = f"list[{one}]" if kind.many else one
    return f"{whole} | None" if kind.optional else whole


def _value(value: object) -> str:
    return _quoted(value) if isinstance(value, str) else repr(value)


def _docstring(text: str) -> str:
    plain = re.fullmatch(r'[^"\\\x00-\x1f\x7f]*', text)
    return f'"""{text}"""' if plain else _quoted(text)


def _quoted(text: str) -> str:
    """Return a literal of Python, in double quotes where the text allows."""
    return json.dumps(text, ensure_ascii=False) if text.isprintable() else repr(text)
