"""Edits of a mission's text by its nodes: the tree that is meant, and no other line changed."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.authoring.editing.node_edits import EditedText, NodeEditor, Target, changes, piece_from
from picktree.authoring.editing.outline import Outline, OutlineNode, outline
from picktree.authoring.editing.pieces import scalar
from picktree.authoring.editing.syntax import NotEditable, Source
from picktree.files.marks import FileError, Mark
from picktree.files.yaml.document import read_document
from picktree.files.yaml.writer import from_value, mission_text
from picktree.trees.declaration import NodeDeclaration
from picktree.trees.loading.loader import examine
from picktree.trees.loading.registry import NodeRegistry
from picktree.trees.mission import LIBRARY

from ..rooms import ROOT
from .wild_leaves import registry as wild_registry
from .wild_missions import wild_mission

SHIPPED = [
    path
    for folder in (ROOT / "examples", ROOT / "tests" / "authoring", LIBRARY)
    for path in sorted(folder.glob("*.yaml"))
    if re.search(r"^kind: mission", path.read_text(), re.MULTILINE)
]
REGISTRY = NodeRegistry()
WILD = wild_registry()
Shape: TypeAlias = tuple[object, ...]


def known(identity: str, registry: NodeRegistry = REGISTRY) -> NodeDeclaration | None:
    node = registry.find(identity)
    return node.declaration if node is not None else None


def wild(identity: str) -> NodeDeclaration | None:
    return known(identity, WILD)


def shape(node: OutlineNode) -> Shape:
    ports = tuple(sorted((port.key, port.text) for port in node.ports))
    return node.identity, node.slot, node.label, ports, tuple(map(shape, node.children))


def shapes(found: Outline) -> dict[str, Shape]:
    return {tree.name: shape(tree.root) for tree in found.trees if tree.root is not None}


def comments(text: str) -> list[str]:
    return sorted(re.findall(r"(?<=[ \n])#.*", text))


def wild_texts(seed: int) -> str:
    """Return a random mission: in brackets in one line, or laid out as the examples are."""
    text = wild_mission(seed)
    return text if seed % 4 == 0 else mission_text(from_value(json.loads(text), Mark("", 1, 1)))


def own_lines(text: str, node: OutlineNode) -> range:
    """Return the lines of a node and its key, or of the outermost brackets around it, with their comments."""
    source = Source(text)
    loc = (*node.loc, node.identity) if node.direct else node.loc
    around = next(value for place, value in source.trail(loc) if value.flow or place == loc)
    start, end = (around.start, around.end) if around.flow else (node.start, node.end)
    first = source.line_of(start)
    while first and (source.line(first - 1).strip()[:1] in ("#", "") or ":" not in source.line(first)[: start]):
        first -= 1
    blank_key = source.line(first).strip().startswith("-") or source.line(first)[: source.column(start)].strip()
    first -= 0 if blank_key or not first else 1
    last = source.line_of(max(start, end - 1))
    while last + 1 < source.line_count and source.line(last + 1).lstrip().startswith("#"):
        last += 1
    return range(max(first, 0), last + 1)


def assert_local(old: str, new: str, *nodes: OutlineNode) -> None:
    """Only lines of these nodes differ, and the replacements are what makes the new text of the old one."""
    allowed = {line for node in nodes for line in own_lines(old, node)}
    made = old
    for change in reversed(changes(old, new)):
        first, last = old.count("\n", 0, change.start), old.count("\n", 0, max(change.start, change.end - 1))
        inserted = change.start == change.end and (first in allowed or first - 1 in allowed)
        assert inserted or set(range(first, last + 1)) <= allowed, (change, sorted(allowed))
        made = made[: change.start] + change.text + made[change.end :]
    assert made == new


def editors() -> Iterator[tuple[str, NodeEditor]]:
    for path in SHIPPED:
        yield path.name, NodeEditor(path.read_text(encoding="utf-8"), known)


CORPUS = dict(editors())


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.name)
def test_nodes_have_the_paths_that_a_run_gives_them(path: Path) -> None:
    document = read_document(path, "mission")
    found = CORPUS[path.name].outline
    expected: set[tuple[str, str]] = set()
    for tree in examine(document, REGISTRY).mission.trees.values():
        if tree.mark.file == str(path):
            todo = [(f"{tree.name}/{tree.root.name}", tree.root)]
            while todo:
                trail, spec = todo.pop()
                expected.add((trail, spec.id))
                todo += [(f"{trail}/{child.name}", child) for child in spec.children]
    assert {(node.id, node.identity) for node in found.nodes().values()} == expected


def some_node(editor: NodeEditor, chance: random.Random) -> OutlineNode:
    free = [node for node in editor.outline.nodes().values() if not node.aliased]
    return chance.choice(free)


def put(root: Shape, old: Shape, new: Shape) -> Shape:
    """Return the shape with a part, which is found by identity, exchanged."""
    if root is old:
        return new
    *head, below = root
    assert isinstance(below, tuple)
    return (*head, tuple(put(child, old, new) for child in below))


class Shaped:
    """Shape of one tree, and the parts that belong to its nodes."""

    def __init__(self, editor: NodeEditor, node: OutlineNode) -> None:
        self.tree = next(tree for tree in editor.outline.trees if node.id.startswith(f"{tree.name}/"))
        self.parts: dict[str, Shape] = {}
        assert self.tree.root is not None
        self.whole = self._of(self.tree.root)

    def _of(self, node: OutlineNode) -> Shape:
        children = tuple(self._of(child) for child in node.children)
        self.parts[node.id] = (*shape(node)[:-1], children)
        return self.parts[node.id]

    def after(self, edited: EditedText, editor: NodeEditor) -> Shape:
        again = NodeEditor(edited.text, editor.known).outline
        return shapes(again)[self.tree.name]


def check_edits(editor: NodeEditor, chance: random.Random) -> None:
    node = some_node(editor, chance)
    shaped = Shaped(editor, node)
    part = shaped.parts[node.id]
    identity, slot, label, ports, children = part
    assert isinstance(ports, tuple)
    assert isinstance(children, tuple)

    # A port.
    if not node.listed and "name" not in dict(ports):
        named = editor.set_port(node.id, "name", "renamed")
        expected = (identity, slot, label, tuple(sorted((*ports, ("name", "renamed")))), children)
        assert shaped.after(named, editor) == put(shaped.whole, part, expected)
        assert named.selected.endswith("/renamed")
        assert_local(editor.text, named.text, node)
        assert comments(named.text) == comments(editor.text)
        back = NodeEditor(named.text, editor.known).remove_port(named.selected, "name")
        assert shaped.after(back, editor) == shaped.whole

    # A node around it.
    wrapped = editor.wrap(node.id, "Recover", (("otherwise", scalar("[AlwaysSuccess]")),))
    inner = (identity, "do", "", ports, children)
    cure = ("Sequence", "otherwise", "", (), (("AlwaysSuccess", "do", "", (), ()),))
    around = ("Recover", slot, label, (), (inner, cure))
    assert shaped.after(wrapped, editor) == put(shaped.whole, part, around)
    assert_local(editor.text, wrapped.text, node)
    assert comments(wrapped.text) == comments(editor.text)
    lone = editor.wrap(node.id, "Inverter")
    again = NodeEditor(lone.text, editor.known).unwrap(lone.selected)
    assert shaped.after(again, editor) == shaped.whole

    # A place in a list.
    if children and any(child.loc[-1:] == (0,) for child in node.children) and not node.children[0].aliased:
        inside = [child for child in node.children if isinstance(child.loc[-1], int)]
        at = chance.randrange(len(inside) + 1)
        added = editor.add(Target(node.id, at), piece_from("Log: {message: here}"))
        new = ("Log", inside[0].slot, "", (("message", "here"),), ())
        first = node.children.index(inside[0])
        grown = (*children[: first + at], new, *children[first + at :])
        assert shaped.after(added, editor) == put(shaped.whole, part, (*part[:-1], grown))
        assert_local(editor.text, added.text, node)
        removed = NodeEditor(added.text, editor.known).remove(added.selected)
        assert shaped.after(removed, editor) == shaped.whole
        if len(inside) > 1:
            moved = chance.choice(inside)
            target = Target(node.id, at)
            number = inside.index(moved)
            result = editor.move(moved.id, target)
            order = [shaped.parts[child.id] for child in inside]
            order.insert(at - (number < at), order.pop(number))
            moved_shape = (*part[:-1], (*children[:first], *order, *children[first + len(inside) :]))
            assert shaped.after(result, editor) == put(shaped.whole, part, moved_shape)
            assert comments(result.text) == comments(editor.text)


@given(name=st.sampled_from(sorted(CORPUS)), chance=st.randoms(use_true_random=False))
def test_edits_of_shipped_missions_make_the_tree_that_is_meant(name: str, chance: random.Random) -> None:
    check_edits(CORPUS[name], chance)


def test_edits_of_500_random_missions_make_the_tree_that_is_meant() -> None:
    for seed in range(500):
        text = wild_texts(seed)
        editor = NodeEditor(text, wild)
        try:
            check_edits(editor, random.Random(seed))
        except Exception as error:
            raise AssertionError(f"seed {seed}:\n{text}") from error
