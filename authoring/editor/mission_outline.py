"""Outline of a mission's text: its trees for a picture, even while the text has faults.

A tree is read once while its text stays the same. Places of its nodes are therefore places in the tree's
text, which begins with its name.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final, Literal, TypeAlias

from picktree.files import Location
from picktree.trees import AUTOREMAP, COMMON_KEYS, Kind, NodeDeclaration, Sequence, SlotDeclaration
from picktree.trees.loading import NAME_PATTERN, ChildNames

from .syntax import Source, Syntax

OutlineKind: TypeAlias = Literal["unknown"] | Kind
Declarations: TypeAlias = Callable[[str], NodeDeclaration | None]
"""Declaration of a node or sub-tree by its ID; None for an unknown ID."""


@dataclass(frozen=True, slots=True)
class OutlinePort:
    """Key of a node with its value in the text."""

    key: str
    text: str
    """Value without quotes."""
    start: int
    end: int


@dataclass(slots=True)
class OutlineNode:
    """Node of a tree; places count in code points from the beginning of the tree's text."""

    id: str
    """Path in its tree, as in logs, faults and rehearsals."""
    loc: Location
    identity: str
    name: str
    kind: OutlineKind
    start: int
    end: int
    body: Location | None = None
    """Location of the content under its ID; None for a bare ID or list."""
    slot: str = ""
    """Slot of the parent that contains it."""
    label: str = ""
    """Key in the slot's table."""
    shown: str = ""
    """Label of its branch: `when grasp.missed`, `otherwise`; empty for a plain child."""
    listed: bool = False
    """Whether it is a Sequence that is written as a bare list."""
    aliased: bool = False
    """Whether its text is at an anchor elsewhere."""
    direct: bool = False
    """Whether it is a key beside the ports of its parent: `Inverter: {Condition: …}`, and a tree's root."""
    ports: tuple[OutlinePort, ...] = ()
    children: list[OutlineNode] = field(default_factory=list["OutlineNode"])

    def iterate(self) -> Iterator[OutlineNode]:
        """Yield this node and its descendants, parents first."""
        todo: list[OutlineNode] = [self]
        while todo:
            node = todo.pop()
            yield node
            todo.extend(reversed(node.children))


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class TreeBody:
    """Content of a tree: one object for all outlines in which the tree's text is the same."""

    doc: str
    ports: tuple[OutlinePort, ...]
    root: OutlineNode | None
    """Root node; None for a tree without a node."""


@dataclass(frozen=True, slots=True)
class OutlineTree:
    """Tree of the text; its places count in code points from the beginning of the text."""

    name: str
    start: int
    end: int
    body: TreeBody

    @property
    def root(self) -> OutlineNode | None:
        return self.body.root


@dataclass(frozen=True, slots=True)
class Outline:
    """Trees of a text in its order."""

    name: str
    scene: str
    trees: tuple[OutlineTree, ...]

    def nodes(self) -> Mapping[str, OutlineNode]:
        return {node.id: node for tree in self.trees if tree.root for node in tree.root.iterate()}


_MAX_CACHED_TREES: Final = 1024
_bodies: OrderedDict[tuple[Declarations, frozenset[str], str], TreeBody] = OrderedDict()


@lru_cache(maxsize=8)
def outline(source: Source, known: Declarations) -> Outline:
    """Return the outline of a text, made once. `known` may lack the trees of the text itself."""
    root = source.root
    trees = root.child("trees")
    body = trees.value if trees is not None else None
    names = frozenset(body.keys) if body is not None else frozenset[str]()
    found = [
        _tree(source, known, names, key, value)
        for key, value in (body.entries if body is not None and body.kind == "mapping" else [])
    ]
    return Outline(_word(root, "name"), _word(root, "scene"), tuple(found))


def _tree(
    source: Source, known: Declarations, names: frozenset[str], key: Syntax, value: Syntax
) -> OutlineTree:
    start, end = key.start, max(value.end, key.end)
    reader = _OutlineReader(source, known, names, start)
    if source.has_aliases:  # a tree may then depend on what stands elsewhere
        return OutlineTree(key.text, start, end, reader.tree(key, value))
    kept = known, names, source.text[start:end]
    body = _bodies.get(kept)
    if body is None:
        body = _bodies[kept] = reader.tree(key, value)
        if len(_bodies) > _MAX_CACHED_TREES:
            _bodies.popitem(last=False)
    _bodies.move_to_end(kept)
    return OutlineTree(key.text, start, end, body)


def _word(node: Syntax, key: str) -> str:
    found = node.child(key)
    return (found.word or "") if found is not None else ""


class _OutlineReader:
    """Reader of nodes by the rules of the grammar; refused nodes are kept as far as possible."""

    def __init__(self, source: Source, known: Declarations, trees: frozenset[str], start: int) -> None:
        self._source, self._known, self._trees = source, known, trees
        self._start = start
        """Beginning of the tree in the text."""

    def tree(self, key: Syntax, body: Syntax) -> TreeBody:
        loc: Location = ("trees", key.text)
        ports: tuple[OutlinePort, ...] = ()
        doc, root = "", None
        content = body.value
        if content.kind == "mapping":
            declared = content.child("ports")
            ports = (
                tuple(self._port(*entry) for entry in declared.value.entries) if declared is not None else ()
            )
            doc = _word(content, "doc")
            nodes = [(name, value) for name, value in content.entries if name.text not in ("ports", "doc")]
            if nodes:
                name, value = nodes[0]
                root = self._keyed(name, value, loc, key.text, ChildNames(), aliased=body is not content)
                root.direct = True
        elif not content.empty:
            root = self._node(body, loc, key.text, ChildNames())
        return TreeBody(" ".join(doc.split()), ports, root)

    def _at(self, place: int) -> int:
        return place - self._start

    def _node(
        self, node: Syntax, loc: Location, above: str, names: ChildNames, *, aliased: bool = False
    ) -> OutlineNode:
        value = node.value
        aliased = aliased or value is not node
        if value.kind == "mapping" and value.entries:
            key, body = value.entries[0]
            found = self._keyed(key, body, loc, above, names, aliased=aliased)
            if len(value.entries) > 1:
                found.kind = "unknown"
        elif value.kind == "list":
            found = self._list(node, loc, above, names, "")
        else:
            identity = value.word if value.word is not None else value.text
            declaration = self._declaration(identity)
            name = names.take(identity[:60])
            kind: OutlineKind = declaration.kind if declaration is not None else "unknown"
            kind = "subtree" if identity in self._trees else kind
            found = OutlineNode(f"{above}/{name}", loc, identity, name, kind, 0, 0)
        found.start, found.end = self._at(node.start), self._at(max(node.end, node.start))
        found.aliased = aliased
        return found

    def _keyed(
        self, key: Syntax, node: Syntax, loc: Location, above: str, names: ChildNames, *, aliased: bool
    ) -> OutlineNode:
        """Read `ID: body`."""
        identity, body = key.text, node.value
        aliased = aliased or body is not node
        name_value = body.child("name") if body.kind == "mapping" else None
        own = name_value.value.word if name_value is not None else None
        name = names.take(own if own is not None and NAME_PATTERN.fullmatch(own) else identity[:60])
        path, at = f"{above}/{name}", (*loc, identity)
        start, end = self._at(key.start), self._at(max(node.end, key.end))
        found = OutlineNode(path, loc, identity, name, "unknown", start, end, at, aliased=aliased)
        declaration = self._declaration(identity)
        if identity in self._trees or (declaration is not None and declaration.kind == "subtree"):
            found.kind = "subtree"
            found.ports = self._ports(body, ())
        elif declaration is not None:
            found.kind = declaration.kind
            self._known_body(found, declaration, body, at, aliased)
        else:
            self._unknown_body(found, body, at, aliased)
        return found

    def _declaration(self, identity: str) -> NodeDeclaration | None:
        return None if identity in self._trees else self._known(identity)

    def _ports(self, body: Syntax, slots: tuple[str, ...]) -> tuple[OutlinePort, ...]:
        if body.kind != "mapping":
            return ()
        return tuple(self._port(key, value) for key, value in body.entries if key.text not in slots)

    def _port(self, key: Syntax, value: Syntax) -> OutlinePort:
        held = value.value
        text = held.text if held.kind == "scalar" else " ".join(self._source.slice(held).split())
        return OutlinePort(key.text, text, self._at(key.start), self._at(max(value.end, key.end)))

    def _known_body(
        self, found: OutlineNode, declaration: NodeDeclaration, body: Syntax, at: Location, aliased: bool
    ) -> None:
        main = declaration.slot("do")
        names = ChildNames()
        if body.kind == "list" or (body.kind == "scalar" and not body.empty and main is not None):
            if main is not None:
                found.children = self._slot(main, body, at, found.id, names, aliased)
            return
        if body.kind != "mapping":
            return
        keys = declaration.keys
        strange = [key.text for key, _ in body.entries if key.text not in keys]
        child = strange[0] if len(strange) == 1 and main is not None and "do" not in body.keys else None
        if child is not None and not self._is_node(child):
            child = None
        slots = tuple(slot.key for slot in declaration.slots)
        found.ports = self._ports(body, (*slots, *([child] if child is not None else [])))
        for key, value in body.entries:
            slot = declaration.slot(key.text)
            if slot is not None:
                found.children += self._slot(slot, value, (*at, key.text), found.id, names, aliased)
            elif key.text == child and main is not None:
                node = self._keyed(key, value, at, found.id, names, aliased=aliased)
                node.slot, node.direct = main.key, True
                found.children.append(node)
        order = {slot.key: number for number, slot in enumerate(declaration.slots)}
        found.children.sort(key=lambda node: order.get(node.slot, 0))

    def _is_node(self, key: str) -> bool:
        return key in self._trees or self._known(key) is not None or key[:1].isupper()

    def _slot(
        self, slot: SlotDeclaration, node: Syntax, at: Location, above: str, names: ChildNames, aliased: bool
    ) -> list[OutlineNode]:
        value = node.value
        aliased = aliased or value is not node
        found: list[OutlineNode] = []
        if slot.arity == "table":
            for key, body in value.entries:
                label = f"{slot.key} {key.text}" if slot.of == "cause" else key.text
                child = self._one(body, (*at, key.text), above, names, key.text, aliased)
                child.slot, child.label, child.shown = slot.key, key.text, label
                found.append(child)
            return found
        if slot.arity == "many" and value.kind == "list":
            found = [
                self._node(item, (*at, n), above, names, aliased=aliased)
                for n, item in enumerate(value.items)
            ]
            for index, child in enumerate(found):
                child.slot = slot.key
                child.shown = slot.labels[index] if index < len(slot.labels) else ""
            return found
        if value.empty:
            return []
        label = "" if slot.key == "do" else slot.key
        child = self._one(node, at, above, names, label, aliased)
        child.slot, child.shown = slot.key, label
        return [child]

    def _one(
        self, node: Syntax, at: Location, above: str, names: ChildNames, label: str, aliased: bool
    ) -> OutlineNode:
        if node.value.kind == "list":
            return self._list(node, at, above, names, label, aliased=aliased)
        return self._node(node, at, above, names, aliased=aliased)

    def _list(
        self, node: Syntax, at: Location, above: str, names: ChildNames, label: str, *, aliased: bool = False
    ) -> OutlineNode:
        """Read a list in the place of one node: a Sequence with the name of its slot."""
        value = node.value
        identity = Sequence.declaration.id
        name = names.take(label or identity)
        inner = ChildNames()
        path, aliased = f"{above}/{name}", aliased or value is not node
        start, end = self._at(node.start), self._at(node.end)
        found = OutlineNode(path, at, identity, name, "control", start, end, listed=True, aliased=aliased)
        found.children = [
            self._node(item, (*at, n), path, inner, aliased=aliased) for n, item in enumerate(value.items)
        ]
        for child in found.children:
            child.slot = "do"
        return found

    def _unknown_body(self, found: OutlineNode, body: Syntax, at: Location, aliased: bool) -> None:
        """Read the children of an unknown node: those of a list, or under `do`."""
        inner, place = (body.child("do"), (*at, "do")) if body.kind == "mapping" else (body, at)
        found.ports = self._ports(body, ("do",))
        names = ChildNames()
        if inner is None or (inner.kind == "scalar" and place == at):
            return
        held = inner.value
        if held.kind == "list":
            found.children = [
                self._node(item, (*place, n), found.id, names, aliased=aliased)
                for n, item in enumerate(held.items)
            ]
        elif not held.empty:
            found.children = [self._node(inner, place, found.id, names, aliased=aliased)]
        for child in found.children:
            child.slot = "do"


COMMON: tuple[str, ...] = (*COMMON_KEYS, AUTOREMAP)
"""Keys of conditions, names and breakpoints, which are no ports."""
