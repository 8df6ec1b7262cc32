"""Text of a plug-in with stubs: what is known of each node, and a body that is still to be written."""

from __future__ import annotations

import builtins
import json
import keyword
import re
from collections.abc import Iterable, Iterator

from ...trees.port_types import PortType
from ...trees.ports import REQUIRED
from .stubs import PYTHON_TYPES, StubNode, StubPort, not_written

_LINE = 110
_NAMES = {
    "Action": ("Skill", "Steps", "World"),
    "Condition": ("ConditionNode", "World"),
    "Decorator": ("Decorator", "NodeStatus"),
    "Control": ("ControlNode", "NodeStatus", "children"),
}
"""Names that a kind of node needs; the first is its base class."""
_TAKEN = ("Cause", "Failure", "In", "ObjectId", "Out", "port", "register_cause", "NODES", "NOT_WRITTEN",
          *(name for names in _NAMES.values() for name in names))  # fmt: skip


def stub_text(stubs: Iterable[StubNode], origin: str) -> str:
    """Return the text of a Python file. `origin`: name of the XML file, for its docstring."""
    nodes = tuple(stubs)
    names = {"Cause", "register_cause"}
    for node in nodes:
        names.update(_NAMES[node.kind])
        if node.kind in ("Action", "Condition"):
            names.add("Failure")
        names.update(("In" if each.direction == "in" else "Out") for each in node.ports)
        names.update("port" for _ in node.ports)
        names.update("ObjectId" for each in node.ports if each.type.name == "object")
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
    taken = identity in _TAKEN or keyword.iskeyword(identity) or hasattr(builtins, identity)
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
        yield from _port(each)
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


def _port(port: StubPort) -> Iterator[str]:
    way = "In" if port.direction == "in" else "Out"
    given = [_quoted(port.doc)]
    if port.default is not REQUIRED and port.direction == "in":
        given.append(f"default={_value(port.default)}")
    if port.attribute != port.key:
        given.append(f"key={_quoted(port.key)}")
    if port.template:
        given.append('takes="template"')
    start = f"    {port.attribute}: {way}[{_type(port.type)}] = port("
    line = f"{start}{', '.join(given)})"
    if len(line) <= _LINE:
        yield line
    else:
        yield start
        yield from (f"        {each}," for each in given)
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
