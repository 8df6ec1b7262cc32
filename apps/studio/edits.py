"""Edits of a mission that the page may ask for, as values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import yaml

from ...authoring.editor.new_nodes import needed, new_node
from ...authoring.editor.node_edits import EditedText, NodeEditor, Target, scalar_of
from ...authoring.editor.syntax import NotEditable, source_of
from ...trees.declaration import COMMON_KEYS, NodeDeclaration
from ...trees.node import Node
from ...trees.ports import PortDeclaration
from .context import MissionContext


@dataclass(frozen=True, slots=True)
class Place:
    """Place for a node among the children of a slot; `label`: key in the slot's table."""

    parent: str
    index: int = 0
    slot: str = ""
    label: str = ""


@dataclass(frozen=True, slots=True)
class SetPort:
    do: Literal["set"]
    node: str
    key: str
    value: str
    """Value as it is typed in a form: quotes are added where YAML needs them. Empty: it is taken away."""


@dataclass(frozen=True, slots=True)
class AddNode:
    do: Literal["add"]
    place: Place
    identity: str
    include: str = ""
    """File that the mission must include for it; empty: none."""


@dataclass(frozen=True, slots=True)
class RemoveNode:
    do: Literal["remove"]
    node: str


@dataclass(frozen=True, slots=True)
class MoveNode:
    do: Literal["move"]
    node: str
    place: Place


@dataclass(frozen=True, slots=True)
class WrapNode:
    do: Literal["wrap"]
    node: str
    identity: str


@dataclass(frozen=True, slots=True)
class UnwrapNode:
    do: Literal["unwrap"]
    node: str


@dataclass(frozen=True, slots=True)
class ReplaceNode:
    do: Literal["replace"]
    node: str
    identity: str


@dataclass(frozen=True, slots=True)
class RenameTree:
    do: Literal["rename_tree"]
    tree: str
    name: str


Edit: TypeAlias = SetPort | AddNode | RemoveNode | MoveNode | WrapNode | UnwrapNode | ReplaceNode | RenameTree


Trees: TypeAlias = Mapping[str, NodeDeclaration]
"""Trees of a text as nodes that can be called, by name."""


def edited(text: str, edit: Edit, context: MissionContext, own: Trees) -> EditedText:
    """Return the text after an edit. Raises PicktreeError when it cannot be done.

    `own`: the text's own trees.
    """
    editor = NodeEditor(text, context.known)
    match edit:
        case SetPort(node=node, key=key, value=value):
            if not value.strip():
                return editor.remove_port(node, key)
            declaration = _declared(editor.node(node).identity, context, own)
            port = declaration.port(key) if declaration is not None else None
            return editor.set_port(node, key, written(value, key, port))
        case AddNode(place=place, identity=identity):
            return editor.add(_target(place), new_node(*_new(identity, context, own)))
        case RemoveNode(node=node):
            return editor.remove(node)
        case MoveNode(node=node, place=place):
            return editor.move(node, _target(place))
        case WrapNode(node=node, identity=identity):
            entries = needed(*_new(identity, context, own))
            return editor.wrap(node, identity, tuple(entries))
        case UnwrapNode(node=node):
            return editor.unwrap(node)
        case ReplaceNode(node=node, identity=identity):
            return editor.replace(node, new_node(*_new(identity, context, own)))
        case RenameTree(tree=tree, name=name):
            return editor.rename_tree(tree, name)


def needs_trees(edit: Edit, context: MissionContext, text: str) -> bool:
    """Whether an edit needs the declarations of the text's own trees, which take time to read."""
    match edit:
        case SetPort(node=node):
            found = NodeEditor(text, context.known).outline.nodes().get(node)
            return found is not None and context.known(found.identity) is None
        case AddNode(identity=identity) | WrapNode(identity=identity) | ReplaceNode(identity=identity):
            return context.known(identity) is None
        case _:
            return False


def _target(place: Place) -> Target:
    return Target(place.parent, place.index, place.slot, place.label)


def _declared(identity: str, context: MissionContext, own: Trees) -> NodeDeclaration | None:
    return own.get(identity) or context.known(identity)


def _new(identity: str, context: MissionContext, own: Trees) -> tuple[NodeDeclaration, type[Node] | None]:
    found = _declared(identity, context, own)
    if found is None:
        raise NotEditable(f"there is no node {identity!r}")
    return found, context.registry.find(identity)


def written(value: str, key: str, port: PortDeclaration | None) -> str:
    """Return a value that was typed in a form as YAML in one line.

    A text stays a text where the port takes texts; elsewhere a number is a number and a list a list.
    """
    text = " ".join(value.split())
    if text[:1] in ('"', "'") and _reads(text):
        return text
    if text.startswith("{") or key in COMMON_KEYS:
        return scalar_of(text)
    textual = port is not None and port.type.name in _TEXTS and not port.type.many
    return text if not textual and _reads(text) else scalar_of(text)


_TEXTS = ("string", "object", "expression")
"""Types of ports whose values are texts."""


def _reads(text: str) -> bool:
    """Whether YAML reads it as one value in a line."""
    try:
        node = source_of(f"[{text}]").root
    except yaml.YAMLError:
        return False
    return node.kind == "list" and len(node.items) == 1 and node.items[0].kind != "mapping"
