"""TreeNodesModel: nodes besides BehaviorTree.CPP's own, and the ports of sub-trees."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Final

from picktree.trees import Mission, NodeDeclaration, PortDeclaration, PortType, TreeSpec

from . import btcpp_vocabulary
from .element import Element
from .literal_text import JSON, default_text, type_text

UNIT: Final = "unit"
CHOICES: Final = "choices"
INCLUDED: Final = "included"
"""Metadata key of a tree that the mission includes from another file."""
_TEXT: Final = PortType("string")


def node_model(declaration: NodeDeclaration, loose: Collection[str] = ()) -> Element:
    """Return the model of a node that a program registers under its own ID; `loose` ports are of any type."""
    slots = [slot for slot in declaration.slots if slot.key != "do"]
    kind = {"action": "Action", "condition": "Condition", "decorator": "Decorator"}.get(
        declaration.kind, "Control"
    )
    if slots and kind == "Decorator":
        kind = "Control"
    ports = [_node_port(port, loose) for port in declaration.ports]
    for slot in slots:
        form = {"one": "the child", "many": "children, as 1;2", "table": "as name=child"}[slot.arity]
        text = f"{slot.doc}: {form}, counted from 0"
        ports.append(_port("input_port", slot.key, _TEXT, "", text))
    return Element(kind, {"ID": declaration.id}, tuple(ports))


def check_model() -> Element:
    text = "an expression of picktree, which scripts cannot say"
    return _text_model("Condition", btcpp_vocabulary.CHECK, {"if": text})


def assign_model() -> Element:
    text = "assignments of picktree, which scripts cannot say"
    return _text_model("Action", btcpp_vocabulary.ASSIGN, {"code": text})


def guarded_model() -> Element:
    ending = "of the child, in the words of picktree"
    ports = {port: f"{condition} {ending}" for condition, port in btcpp_vocabulary.GUARDS.items()}
    return _text_model("Decorator", btcpp_vocabulary.GUARDED, ports)


def repeat_while_model(declaration: NodeDeclaration, loose: Collection[str] = ()) -> Element:
    ports = tuple(_node_port(port, loose) for port in declaration.ports)
    return Element("Decorator", {"ID": btcpp_vocabulary.REPEAT_WHILE}, ports)


def switch_model(cases: int) -> Element:
    """Return the model of SwitchNode<cases>; BehaviorTree.CPP registers only those for 2 to 6 cases."""
    keys = ["variable", *(f"case_{index}" for index in range(1, cases + 1))]
    return _text_model("Control", f"Switch{cases}", dict.fromkeys(keys, ""))


def _text_model(kind: str, identity: str, ports: Mapping[str, str]) -> Element:
    """Return the model of a node with inputs that are texts. `ports`: descriptions by name."""
    inputs = tuple(_port("input_port", key, _TEXT, "", text) for key, text in ports.items())
    return Element(kind, {"ID": identity}, inputs)


def tree_model(
    tree: TreeSpec,
    metadata: Iterable[Mapping[str, str]],
    default: Callable[[TreeSpec, PortDeclaration], str],
) -> Element:
    """Return the ports of a tree, for `Main` the mission's parameters. The metadata hold the file's head.

    `default` returns the text of a port's default.
    """
    parts = [
        _tree_port(port, default(tree, port) if _has_default(port) else "")
        for port in tree.ports
        if not port.remapped
    ]
    fields = tuple(Element("Metadata", field) for field in metadata)
    if fields:
        parts.append(Element("MetadataFields", {}, fields))
    description = {"description": tree.doc} if tree.doc else {}
    return Element("SubTree", {"ID": tree.name, **description}, tuple(parts))


def head(mission: Mission) -> list[dict[str, str]]:
    """Return the entries at the top of the mission file."""
    data = mission.document.data
    fields = [{"picktree": "1"}]
    if mission.library:
        fields.append({"library": "true"})
    for key in ("name", "scene", "goal"):
        value = data.get(key)
        if isinstance(value, str):
            fields.append({key: value})
    for key in ("include", "plugins"):
        entries = data.get(key)
        if isinstance(entries, list):
            fields += [{key: str(entry)} for entry in entries]
    return fields


def _node_port(port: PortDeclaration, loose: Collection[str]) -> Element:
    what = "output_port" if port.direction == "out" else "input_port"
    text = port.doc + (f" [{port.unit}]" if port.unit else "")
    # A list of `any` takes the type of its values.
    kind = PortType("any") if port.type.name == "any" or port.key in loose else port.type
    return _port(what, port.key, kind, default_text(port), text)


def _port(what: str, key: str, kind: PortType, default: str, text: str) -> Element:
    attributes = {"name": key, "type": type_text(kind)}
    if default:
        attributes["default"] = default
    return Element(what, attributes, text=text)


def _has_default(port: PortDeclaration) -> bool:
    return port.direction == "in" and not port.required


def _tree_port(port: PortDeclaration, default: str) -> Element:
    """Return a port of a tree. BehaviorTree.CPP reads `default` and `description`, the import the rest."""
    what = "output_port" if port.direction == "out" else "input_port"
    attributes = {"name": port.key, "type": type_text(port.type)}
    if _has_default(port):
        attributes["default"] = default
    if port.doc:
        attributes["description"] = port.doc
    if port.unit is not None:
        attributes[UNIT] = port.unit
    if port.choices is not None:
        attributes[CHOICES] = JSON + json.dumps(list(port.choices), ensure_ascii=False)
    return Element(what, attributes)
