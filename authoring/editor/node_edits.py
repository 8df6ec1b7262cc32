"""Edits of a mission's text by its nodes: new nodes, add, remove, move, wrap, and change of ports."""

from __future__ import annotations

from dataclasses import dataclass

import yaml

from picktree.authoring.schema import node_reference
from picktree.files import Location
from picktree.trees import IDENTIFIER, Node, NodeDeclaration, PortDeclaration, SlotDeclaration

from .mission_outline import Declarations, Outline, OutlineNode, outline
from .syntax import NotEditable, Source, Syntax, source_of
from .text_edits import (
    Piece,
    call,
    entry_fragment,
    fragment,
    insert_item,
    key_text,
    listing,
    mapping,
    piece_of,
    put_entry,
    remove_entry,
    remove_item,
    rename_key,
    replace_entry,
    replace_value,
    scalar,
)

PLACEHOLDER = "AlwaysSuccess"
"""Placeholder child of a new node that needs a child."""


def new_node(declaration: NodeDeclaration, node: type[Node] | None) -> Piece:
    """Return a node or a call of a sub-tree with its required ports and children. `node`: its class; None for
    a sub-tree."""
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
    """Return the required ports, and other required keys except the main children."""
    source, body = _example(declaration)
    entries = [(port.key, _value(port, source, body)) for port in declaration.ports if port.required]
    choice = node_reference.required_one_of(node) if node is not None else None
    if choice is not None:
        taken = [key for key in choice.keys if body is not None and body.entry(key) is not None]
        one = [slot.key for slot in declaration.slots if slot.arity == "one"]
        key = next((key for key in taken if key in one), (taken or list(choice.keys))[0])
        port = declaration.port(key)
        value = body.child(key) if body is not None else None
        if port is not None:
            entries.append((key, _value(port, source, body)))
        elif source is not None and value is not None:
            entries.append((key, piece_of(source, value)))
        else:
            entries.append((key, scalar(PLACEHOLDER)))
    return entries


def _example(declaration: NodeDeclaration) -> tuple[Source | None, Syntax | None]:
    if not declaration.example:
        return None, None
    source = Source(f"{declaration.example}\n")
    found = source.root.child(declaration.id) if source.root.kind == "mapping" else None
    return source, found if found is not None and found.kind == "mapping" else None


def _value(port: PortDeclaration, source: Source | None, body: Syntax | None) -> Piece:
    present = body.child(port.key) if body is not None else None
    if source is not None and present is not None:
        return piece_of(source, present)
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


@dataclass(frozen=True, slots=True)
class EditedText:
    """Result of an edit: the new text, and the node that it concerns; empty: none."""

    text: str
    selected: str = ""


@dataclass(frozen=True, slots=True)
class Target:
    """Place for a node: index among the children of a slot."""

    parent: str
    index: int = 0
    slot: str = ""
    """Key of the slot; empty: the main one."""
    label: str = ""
    """Key in the slot's table."""


class NodeEditor:
    """Edits of one text. Raises NotEditable when YAML cannot read it."""

    def __init__(self, text: str, known: Declarations) -> None:
        self.text, self.known = text, known
        try:
            self._source = source_of(text)
        except yaml.YAMLError:
            raise NotEditable(
                "the text has a fault of form: mend it first, then its picture can be edited"
            ) from None
        self.outline: Outline = outline(self._source, known)
        self._nodes = self.outline.nodes()

    def node(self, identifier: str) -> OutlineNode:
        found = self._nodes.get(identifier)
        if found is None:
            raise NotEditable(f"the mission has no node {identifier!r}")
        if found.aliased:
            tree = next(tree for tree in self.outline.trees if tree.name == found.loc[1])
            line = self._source.line_of(tree.start + found.start) + 1
            raise NotEditable(f"the text of {found.name} on line {line} is an alias: edit it at its anchor")
        return found

    # Ports.

    def set_port(self, identifier: str, key: str, written: str) -> EditedText:
        """Give a port, name or condition a value. `written`: the value as YAML in one line."""
        node = self.node(identifier)
        if node.listed:
            raise NotEditable(f"{node.name} is a Sequence that is written as a list: it has no ports")
        name, value = key_text(key), scalar(written)
        declaration = self.known(node.identity)
        slots = tuple(slot.key for slot in declaration.slots) if declaration is not None else ("do",)
        if node.body is None:
            return self._done(self._put_node(node, call(node.identity, mapping([(name, value)]))), node.loc)
        body = self._source.at(node.body)
        if body.empty or (body.kind == "mapping" and not body.entries):
            text = replace_value(self.text, node.body, mapping([(name, value)]))
        elif body.kind == "mapping":
            text = put_entry(self.text, node.body, name, value, slots)
        else:
            children = fragment(self._source, node.body)
            together = mapping([(name, value), ("do", children)], block=children.block)
            text = replace_value(self.text, node.body, together)
        return self._done(text, node.loc, node.body)

    def remove_port(self, identifier: str, key: str) -> EditedText:
        """Remove a port, name or condition."""
        node = self.node(identifier)
        body = self._source.at(node.body) if node.body is not None else None
        if node.body is None or body is None or body.kind != "mapping" or body.entry(key) is None:
            raise NotEditable(f"{node.name} has no {key!r} in the text")
        if len(body.entries) == 1 and not node.direct:
            return self._done(self._put_node(node, scalar(node.identity)), node.loc)
        return self._done(remove_entry(self.text, node.body, key), node.loc, node.body)

    def rename_tree(self, name: str, new: str) -> EditedText:
        if not IDENTIFIER.fullmatch(new):
            raise NotEditable(
                f"{new!r} is not a valid name of a tree: write a letter or '_', then letters, digits and '_'"
            )
        if any(tree.name == new for tree in self.outline.trees) or self.known(new) is not None:
            raise NotEditable(f"the name {new!r} is taken")
        text = rename_key(self.text, ("trees", name), new)
        for node in reversed([*self._nodes.values()]):  # children before their parents
            if node.identity == name and not node.aliased:
                loc = tuple(new if at == 1 and step == name else step for at, step in enumerate(node.loc))
                text = (
                    rename_key(text, (*loc, name), new)
                    if node.body
                    else replace_value(text, loc, scalar(new))
                )
        return self._checked(text, new)

    # Children.

    def add(self, target: Target, piece: Piece) -> EditedText:
        """Add a node to the children of another one."""
        text, loc = self._added(self.text, self.node(target.parent), target, piece)
        return self._done(text, loc)

    def remove(self, identifier: str) -> EditedText:
        node = self.node(identifier)
        return self._checked(self._removed(node), identifier.rpartition("/")[0])

    def move(self, identifier: str, target: Target) -> EditedText:
        """Move a node to another place; `index` counts as if the node were still at its old place."""
        node, parent = self.node(identifier), self.node(target.parent)
        if f"{parent.id}/".startswith(f"{node.id}/"):
            raise NotEditable("a node cannot be moved into itself")
        piece = self._fragment(node)
        index = target.index
        if node.id.rpartition("/")[0] == parent.id and isinstance(node.loc[-1], int) and node.loc[-1] < index:
            index -= 1
        text = self._removed(node)
        below = NodeEditor(text, self.known)
        place = _shifted(parent.loc, node)
        same = (n for n in below._nodes.values() if n.loc == place and n.identity == parent.identity)
        found = next(same, None)
        if found is None:
            raise NotEditable(f"{node.name} cannot be moved there")
        text, loc = below._added(text, found, Target(found.id, index, target.slot, target.label), piece)
        return self._done(text, loc)

    def wrap(self, identifier: str, identity: str, entries: tuple[tuple[str, Piece], ...] = ()) -> EditedText:
        """Put a node into a new one; `entries`: ports and further slots of the new one."""
        node = self.node(identifier)
        piece = self._fragment(node)
        declaration = self.known(identity)
        slot = declaration.slot("do") if declaration is not None else None
        if declaration is None or slot is None:
            raise NotEditable(f"{identity!r} takes no child")
        block = piece.block or not self._source.at(node.loc[:-1]).flow
        ports = [entry for entry in entries if declaration.slot(entry[0]) is None]
        others = [entry for entry in entries if declaration.slot(entry[0]) is not None]
        child = piece if slot.arity == "one" else listing([piece], block=block)
        plain = slot.arity == "many" and not ports and not others
        body = child if plain else mapping([*ports, ("do", child), *others], block=block)
        return self._done(self._put_node(node, call(identity, body)), node.loc)

    def unwrap(self, identifier: str) -> EditedText:
        """Put the only child of a node into its place."""
        node = self.node(identifier)
        if len(node.children) != 1:
            raise NotEditable(
                f"{node.name} has {len(node.children)} children; one with a single child can be unwrapped"
            )
        child = node.children[0]
        piece = self._fragment(self.node(child.id))
        if child.listed and (isinstance(node.loc[-1], int) or node.direct):
            piece = call(child.identity, piece)
        return self._done(self._put_node(node, piece), node.loc)

    def replace(self, identifier: str, piece: Piece) -> EditedText:
        """Put another node into the place of one."""
        node = self.node(identifier)
        return self._done(self._put_node(node, piece), node.loc)

    # Places.

    def _fragment(self, node: OutlineNode) -> Piece:
        if node.direct:
            return entry_fragment(self._source, node.loc, node.identity)
        return fragment(self._source, node.loc)

    def _put_node(self, node: OutlineNode, piece: Piece) -> str:
        if node.direct:
            return replace_entry(self.text, node.loc, node.identity, piece)
        old = self._source.at(node.loc)
        parent = self._source.at(node.loc[:-1])
        word = old.kind == "scalar" and not old.empty and piece.inline is not None and not piece.block
        if word and parent.kind == "list" and not parent.flow and piece.kind == "mapping":
            # A word in a line: what stands behind it, as a comment, stays.
            return f"{self.text[: old.start]}{(piece.inline or '')[1:-1]}{self.text[old.end :]}"
        return replace_value(self.text, node.loc, piece)

    def _removed(self, node: OutlineNode) -> str:
        parent = self._nodes.get(node.id.rpartition("/")[0])
        if parent is None:
            raise NotEditable("a tree needs a node: put another one into the place of this one")
        if node.direct:
            return remove_entry(self.text, node.loc, node.identity)
        if node.loc == parent.body:
            return replace_value(self.text, node.loc, scalar("{}"))
        *above, last = node.loc
        if isinstance(last, int):
            return remove_item(self.text, tuple(above), last)
        if node.label and len(self._source.at(tuple(above)).entries) == 1:
            *above, last = above
        return remove_entry(self.text, tuple(above), str(last))

    def _added(self, text: str, parent: OutlineNode, target: Target, piece: Piece) -> tuple[str, Location]:
        source = self._source
        if parent.listed:
            return _joined(source, parent.loc, target.index, piece)
        slot = self._slot(parent, target.slot)
        if parent.body is None or source.at(parent.body).empty:
            body = call(parent.identity, _new_body(slot, target.label, piece))
            return self._put_node(parent, body), self._first(parent, slot, target.label)
        body, at = source.at(parent.body), parent.body
        direct = next((child for child in parent.children if child.direct), None)
        if body.kind == "mapping" and slot.key == "do" and direct is not None:
            old = entry_fragment(source, at, direct.identity)
            both = [piece, old] if target.index == 0 else [old, piece]
            together = listing(both, block=any(each.block for each in both))
            if len(body.entries) == 1:
                return replace_value(text, at, together), (*at, min(target.index, 1))
            text = remove_entry(text, at, direct.identity)
            return put_entry(text, at, "do", together), (*at, "do", min(target.index, 1))
        if body.kind != "mapping":
            if slot.key != "do":
                entries = [("do", fragment(source, at)), *_new_body(slot, target.label, piece).entries]
                first = self._first(parent, slot, target.label)
                return replace_value(text, at, mapping(entries, block=True)), first
            return _joined(source, at, target.index, piece)
        place = (*at, slot.key)
        found = body.entry(slot.key)
        if found is None or found[1].empty:
            if not body.entries and slot.arity == "many":
                return replace_value(text, at, listing([piece], block=piece.block)), (*at, 0)
            ((_, held),) = _new_body(slot, target.label, piece, keyed=True).entries
            before = _slots_after(self.known, parent.identity, slot)
            return put_entry(text, at, slot.key, held, before), self._first(parent, slot, target.label)
        if slot.arity != "table":
            return _joined(source, place, target.index, piece)
        label = target.label or _free_label(slot, found[1].keys)
        if label in found[1].keys:
            return _joined(source, (*place, label), target.index, piece)
        return put_entry(text, place, key_text(label), piece), (*place, label)

    def _first(self, parent: OutlineNode, slot: SlotDeclaration, label: str) -> Location:
        """Return the location of the first node of a slot that was empty."""
        body = parent.body or (*parent.loc, parent.identity)
        match slot.arity:
            case "one":
                return (*body, slot.key)
            case "table":
                return (*body, slot.key, label or _free_label(slot, []))
            case "many":
                keyed = parent.body is not None and bool(self._source.at(parent.body).entries)
                return (*body, slot.key, 0) if keyed else (*body, 0)

    def _slot(self, parent: OutlineNode, key: str) -> SlotDeclaration:
        declaration = self.known(parent.identity) if parent.kind not in ("subtree", "unknown") else None
        slots = declaration.slots if declaration is not None else ()
        slot = next((slot for slot in slots if slot.key == key), None) if key else next(iter(slots), None)
        if slot is None:
            lacks = f"has no slot {key!r}" if key and slots else "takes no children"
            raise NotEditable(f"{parent.identity} {lacks}")
        return slot

    # Results.

    def _done(self, text: str, *places: Location) -> EditedText:
        """Return the text with the ID of the node at one of these locations."""
        editor = self._read_again(text)
        by_place = {node.loc: node.id for node in reversed([*editor._nodes.values()]) if not node.aliased}
        for node in editor._nodes.values():
            if node.direct:
                by_place.setdefault((*node.loc, node.identity), node.id)
        return EditedText(text, next((by_place[place] for place in places if place in by_place), ""))

    def _checked(self, text: str, selected: str) -> EditedText:
        self._read_again(text)
        return EditedText(text, selected)

    def _read_again(self, text: str) -> NodeEditor:
        try:
            return NodeEditor(text, self.known)
        except NotEditable:
            raise NotEditable("this place is written in a way that only its text can be edited") from None


def _joined(source: Source, loc: Location, index: int, piece: Piece) -> tuple[str, Location]:
    """Add a node to the list at a location, or make the node there a list with it."""
    node = source.at(loc)
    if node.kind == "list":
        index = max(0, min(index, len(node.items)))
        return insert_item(source.text, loc, index, piece), (*loc, index)
    if node.empty or (node.kind == "mapping" and not node.entries):
        return replace_value(source.text, loc, piece), loc
    old = fragment(source, loc)
    both = [piece, old] if index == 0 else [old, piece]
    block = any(each.block for each in both)
    return replace_value(source.text, loc, listing(both, block=block)), (*loc, 0 if index == 0 else 1)


def _new_body(slot: SlotDeclaration, label: str, piece: Piece, *, keyed: bool = False) -> Piece:
    """Return the body of a node with its first child."""
    match slot.arity:
        case "one":
            held = piece
        case "many":
            held = listing([piece], block=piece.block)
        case "table":
            written = key_text(label or _free_label(slot, []))
            held = mapping([(written, piece)], block=piece.block)
    if slot.arity == "many" and slot.key == "do" and not keyed:
        return held
    return mapping([(slot.key, held)], block=held.block)


def _free_label(slot: SlotDeclaration, taken: list[str]) -> str:
    """Return an unused key of a table."""
    if slot.of == "cause" and "*" not in taken:
        return "*"
    return next(label for number in range(1, len(taken) + 2) if (label := str(number)) not in taken)


def _slots_after(known: Declarations, identity: str, slot: SlotDeclaration) -> tuple[str, ...]:
    declaration = known(identity)
    keys = [each.key for each in declaration.slots] if declaration is not None else []
    return tuple(keys[keys.index(slot.key) + 1 :]) if slot.key in keys else ()


def _shifted(loc: Location, removed: OutlineNode) -> Location:
    """Return the location of a node after the removal of another one."""
    at = removed.loc
    if not isinstance(at[-1], int) or loc[: len(at) - 1] != at[:-1] or len(loc) < len(at):
        return loc
    step = loc[len(at) - 1]
    return (*at[:-1], step - 1, *loc[len(at) :]) if isinstance(step, int) and step > at[-1] else loc
