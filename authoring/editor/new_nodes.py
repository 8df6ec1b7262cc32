"""Texts of new nodes: what a node needs, with the values of its example in the reference."""

from __future__ import annotations

from ...trees.declaration import NodeDeclaration
from ...trees.node import Node
from ...trees.ports import PortDeclaration, SlotDeclaration
from ..schema.node_reference import required_one_of
from .pieces import Piece, call, key_text, listing, mapping, piece_of, scalar
from .syntax import Source, Syntax

PLACEHOLDER = "AlwaysSuccess"
"""Child of a new node that needs one."""


def new_node(declaration: NodeDeclaration, node: type[Node] | None) -> Piece:
    """Return a node or a call of a sub-tree with what it needs. `node`: its class; None for a sub-tree."""
    entries = dict(needed(declaration, node))
    main = declaration.slot("do")
    if main is not None and main.arity == "many" and not entries:
        return call(declaration.id, _children(declaration, main))
    entries |= {
        slot.key: _children(declaration, slot)
        for slot in declaration.slots
        if slot.required and slot.key not in entries
    }
    order = [key for key in declaration.keys if key in entries]
    return call(declaration.id, mapping([(key, entries[key]) for key in order]) if order else None)


def needed(declaration: NodeDeclaration, node: type[Node] | None) -> list[tuple[str, Piece]]:
    """Return the ports, and other keys but the main children, without which the node is a fault."""
    source, body = _example(declaration)
    entries = [(port.key, _value(port, source, body)) for port in declaration.ports if port.required]
    choice = required_one_of(node) if node is not None else None
    if choice is not None:
        taken = [key for key in choice.keys if body is not None and body.entry(key) is not None]
        one = [slot.key for slot in declaration.slots if slot.arity == "one"]
        key = next((key for key in taken if key in one), (taken or list(choice.keys))[0])
        port = declaration.port(key)
        given = body.child(key) if body is not None else None
        if port is not None:
            piece = _value(port, source, body)
        else:
            piece = (
                piece_of(source, given) if source is not None and given is not None else scalar(PLACEHOLDER)
            )
        entries.append((key, piece))
    return entries


def _example(declaration: NodeDeclaration) -> tuple[Source | None, Syntax | None]:
    if not declaration.example:
        return None, None
    source = Source(f"{declaration.example}\n")
    found = source.root.child(declaration.id) if source.root.kind == "mapping" else None
    return source, found if found is not None and found.kind == "mapping" else None


def _value(port: PortDeclaration, source: Source | None, body: Syntax | None) -> Piece:
    given = body.child(port.key) if body is not None else None
    if source is not None and given is not None:
        return piece_of(source, given)
    if port.choices:
        return scalar(key_text(str(port.choices[0])))
    return scalar(f'"{{{port.key}}}"')


def _children(declaration: NodeDeclaration, slot: SlotDeclaration) -> Piece:
    match slot.arity:
        case "one":
            return scalar(PLACEHOLDER)
        case "many":
            return listing([scalar(PLACEHOLDER)] * max(slot.least, 1))
        case "table":
            source, body = _example(declaration)
            cases = body.child(slot.key) if body is not None else None
            if source is not None and cases is not None and cases.kind == "mapping":
                names = [source.slice(key) for key, _ in cases.entries]
            else:
                names = ["a"]
            return mapping([(name, scalar(PLACEHOLDER)) for name in names])
