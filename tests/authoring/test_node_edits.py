"""Edits of a mission's text by its nodes: the tree that is meant, and no other line changed."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.authoring.editor import Source, changes, outline, scalar
from picktree.authoring.editor.mission_outline import Outline, OutlineNode
from picktree.authoring.editor.node_edits import EditedText, NodeEditor, Target
from picktree.authoring.editor.text_edits import call, mapping
from picktree.files import Mark
from picktree.files.yaml import from_value, mission_text, read_document
from picktree.trees import LIBRARY, NodeDeclaration
from picktree.trees.loading import NodeRegistry, examine

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


@dataclass(frozen=True)
class Shape:
    """Tree as it is meant, whatever its layout; two parts are never the same one."""

    identity: str
    slot: str
    label: str
    ports: tuple[tuple[str, str], ...] = ()
    children: tuple[Shape, ...] = ()

    def with_exchanged(self, old: Shape, new: Shape) -> Shape:
        """Return the shape with one part, which is found by identity, exchanged."""
        if self is old:
            return new
        return replace(self, children=tuple(child.with_exchanged(old, new) for child in self.children))


def known(identity: str, registry: NodeRegistry = REGISTRY) -> NodeDeclaration | None:
    node = registry.find(identity)
    return node.declaration if node is not None else None


def wild(identity: str) -> NodeDeclaration | None:
    return known(identity, WILD)


def shape(node: OutlineNode) -> Shape:
    ports = tuple(sorted((port.key, port.text) for port in node.ports))
    return Shape(node.identity, node.slot, node.label, ports, tuple(map(shape, node.children)))


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
    key, _ = next(entry for entry in source.at(("trees",)).entries if entry[0].text == node.loc[1])
    start, end = (around.start, around.end) if around.flow else (key.start + node.start, key.start + node.end)
    first, last = source.line_of(start), source.line_of(max(start, end - 1))
    if first and not source.line(first)[: source.column(start)].strip():  # its key is on a line above
        first -= 1
    while first and source.line(first - 1).lstrip().startswith("#"):
        first -= 1
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


def test_an_outline_after_edits_is_that_of_the_whole_text_read_anew() -> None:
    chance = random.Random(7)
    for editor in CORPUS.values():
        for _ in range(4):
            node = some_node(editor, chance)
            if node.listed:
                continue
            text = "\n" * chance.randrange(3) + editor.set_port(node.id, "_skipIf", "{= 1 > 2}").text
            after = NodeEditor(text, known)
            assert repr(after.outline) == repr(outline(Source(text), partial(known)))
            editor = after


def some_node(editor: NodeEditor, chance: random.Random) -> OutlineNode:
    free = [node for node in editor.outline.nodes().values() if not node.aliased]
    return chance.choice(free)


class Shaped:
    """Shape of one tree, and the parts that belong to its nodes."""

    def __init__(self, editor: NodeEditor, node: OutlineNode) -> None:
        self.tree = next(tree for tree in editor.outline.trees if node.id.startswith(f"{tree.name}/"))
        self.parts: dict[str, Shape] = {}
        assert self.tree.root is not None
        self.whole = self._of(self.tree.root)

    def _of(self, node: OutlineNode) -> Shape:
        self.parts[node.id] = replace(shape(node), children=tuple(self._of(child) for child in node.children))
        return self.parts[node.id]

    def after(self, edited: EditedText, editor: NodeEditor) -> Shape:
        again = NodeEditor(edited.text, editor.known).outline
        return shapes(again)[self.tree.name]


def check_port(editor: NodeEditor, node: OutlineNode) -> None:
    shaped = Shaped(editor, node)
    part = shaped.parts[node.id]
    if node.listed or "name" in dict(part.ports):
        return
    named = editor.set_port(node.id, "name", "renamed")
    expected = replace(part, ports=tuple(sorted((*part.ports, ("name", "renamed")))))
    assert shaped.after(named, editor) == shaped.whole.with_exchanged(part, expected)
    assert named.selected.endswith("/renamed")
    assert_local(editor.text, named.text, node)
    assert comments(named.text) == comments(editor.text)
    back = NodeEditor(named.text, editor.known).remove_port(named.selected, "name")
    assert shaped.after(back, editor) == shaped.whole


def check_wrap(editor: NodeEditor, node: OutlineNode) -> None:
    shaped = Shaped(editor, node)
    part = shaped.parts[node.id]
    wrapped = editor.wrap(node.id, "Recover", (("otherwise", scalar("[AlwaysSuccess]")),))
    cure = Shape("Sequence", "otherwise", "", (), (Shape("AlwaysSuccess", "do", ""),))
    around = Shape("Recover", part.slot, part.label, (), (replace(part, slot="do", label=""), cure))
    assert shaped.after(wrapped, editor) == shaped.whole.with_exchanged(part, around)
    assert_local(editor.text, wrapped.text, node)
    assert comments(wrapped.text) == comments(editor.text)
    lone = editor.wrap(node.id, "Inverter")
    again = NodeEditor(lone.text, editor.known).unwrap(lone.selected)
    assert shaped.after(again, editor) == shaped.whole


def check_list(editor: NodeEditor, chance: random.Random) -> None:
    """Add a node to a list, take it away again, and move another one within it."""
    nodes = [node for node in editor.outline.nodes().values() if not node.aliased]
    lists = [node for node in nodes if any(isinstance(child.loc[-1], int) for child in node.children)]
    node = chance.choice(lists)
    shaped = Shaped(editor, node)
    part = shaped.parts[node.id]
    inside = [child for child in node.children if isinstance(child.loc[-1], int)]
    first = node.children.index(inside[0])
    before, behind = part.children[:first], part.children[first + len(inside) :]
    order = [shaped.parts[child.id] for child in inside]
    at = chance.randrange(len(inside) + 1)
    added = editor.add(Target(node.id, at), call("Log", mapping([("message", scalar("here"))])))
    new = Shape("Log", inside[0].slot, "", (("message", "here"),))
    grown = replace(part, children=(*before, *order[:at], new, *order[at:], *behind))
    assert shaped.after(added, editor) == shaped.whole.with_exchanged(part, grown)
    assert_local(editor.text, added.text, node)
    removed = NodeEditor(added.text, editor.known).remove(added.selected)
    assert shaped.after(removed, editor) == shaped.whole
    moved = chance.randrange(len(inside))
    if len(inside) > 1:
        result = editor.move(inside[moved].id, Target(node.id, at))
        order.insert(at - (moved < at), order.pop(moved))
        expected = replace(part, children=(*before, *order, *behind))
        assert shaped.after(result, editor) == shaped.whole.with_exchanged(part, expected)
        assert comments(result.text) == comments(editor.text)


def check_edit(editor: NodeEditor, chance: random.Random) -> None:
    match chance.randrange(3):
        case 0:
            check_port(editor, some_node(editor, chance))
        case 1:
            check_wrap(editor, some_node(editor, chance))
        case _:
            check_list(editor, chance)


@given(name=st.sampled_from(sorted(CORPUS)), chance=st.randoms(use_true_random=False))
def test_edits_of_shipped_missions_make_the_tree_that_is_meant(name: str, chance: random.Random) -> None:
    check_edit(CORPUS[name], chance)


def test_edits_of_random_missions_make_the_tree_that_is_meant() -> None:
    for seed in range(200):
        text = wild_texts(seed)
        editor = NodeEditor(text, wild)
        try:
            check_edit(editor, random.Random(seed))
        except Exception as error:
            raise AssertionError(f"seed {seed}:\n{text}") from error
