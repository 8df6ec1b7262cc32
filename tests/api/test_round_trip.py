"""A tree made in Python is the mission that it is saved as: the same nodes, ports and children."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import picktree as pt
from picktree.authoring import check_mission
from picktree.files.yaml import read_document
from picktree.trees import Node, NodeSpec, PortDeclaration, SlotDeclaration
from picktree.trees.description import python_name
from picktree.trees.loading import NodeRegistry, examine
from picktree.trees.references import Constant, Reference

from ..rooms import ROOT

NODES: dict[str, type[Node]] = {
    node.declaration.id: node for node in map(NodeRegistry().find, NodeRegistry().ids()) if node is not None
}
TEXTS = st.text(st.characters(exclude_categories=("Cs", "Cc")), max_size=12) | st.sampled_from(
    ["{item}", "{item.colour}", "yes", "null", "1e3", "0x1F", ": #", "20 N", "a: b", "- x", "*", "…"]
)
NUMBERS = st.integers(-(10**6), 10**6) | st.floats(allow_nan=False, allow_infinity=False)


def literals(port: PortDeclaration) -> st.SearchStrategy[Any]:
    """Values of any type, also wrong ones: what is wrong is wrong in the file as well."""
    one = TEXTS | NUMBERS | st.booleans() | st.none()
    return st.lists(one, max_size=3) if port.type.many else one


def nodes(depth: int) -> st.SearchStrategy[Node]:
    kinds = [node for node in NODES.values() if depth or not node.declaration.slots]
    return st.sampled_from(kinds).flatmap(lambda node: made(node, depth))


def made(node: type[Node], depth: int) -> st.SearchStrategy[Node]:
    declaration = node.declaration
    required = {python_name(p.key): literals(p) for p in declaration.ports if p.required}
    optional = {python_name(p.key): literals(p) for p in declaration.ports if not p.required}
    optional |= {"name": st.sampled_from(["first", "again"]), "_skipIf": st.just("held")}
    for slot in declaration.slots:
        if slot.key != "do":
            (required if slot.required else optional)[slot.key] = filled(slot, depth)
    children = st.lists(nodes(depth - 1), min_size=1, max_size=3) if declaration.slot("do") else st.just([])
    keys = st.fixed_dictionaries(required, optional=optional)
    return st.builds(lambda below, given: node(*below, **given), children, keys)


def filled(slot: SlotDeclaration, depth: int) -> st.SearchStrategy[Any]:
    one = nodes(depth - 1) | st.lists(nodes(depth - 1), min_size=1, max_size=2)
    return st.dictionaries(TEXTS, one, min_size=1, max_size=2) if slot.arity == "table" else one


@settings(max_examples=60, deadline=None)
@given(nodes(2))
def test_saved_tree_has_the_values_of_the_tree(tmp_path_factory: pytest.TempPathFactory, tree: Node) -> None:
    file = tmp_path_factory.mktemp("trees") / "m.yaml"
    tree.save(file, scene="sort_small")
    assert read_document(file, "mission").data["trees"] == {"Main": tree.description.value()}


@pytest.mark.parametrize("identity", sorted(NODES))
def test_every_kind_of_node_loads_as_it_was_made(identity: str, tmp_path: Path) -> None:
    """With the least that it takes, and references for all its ports."""
    tree = least(NODES[identity])
    tree.save(tmp_path / "m.yaml")
    reading = examine(read_document(tmp_path / "m.yaml", "mission"))
    assert {fault.code for fault in reading.faults} <= SEMANTIC, reading.faults
    same(tree, reading.mission.main.root)


SEMANTIC = {"P220", "P221", "P225", "P226", "P227", "P233", "P234", "P236", "P237", "P238", "P239"}
"""Codes of what only a sensible mission avoids: keys that nobody writes, ports that go together."""


def least(node: type[Node]) -> Node:
    declaration = node.declaration
    ports: dict[str, Any] = {
        python_name(p.key): f"{{{p.key}_key}}"
        for p in declaration.ports
        if p.required or p.direction == "out"
    }
    for slot in declaration.slots:
        if slot.key != "do":
            leaf = pt.nodes.AlwaysSuccess()
            ports[slot.key] = {"*": [leaf, leaf]} if slot.arity == "table" else leaf
    main = declaration.slot("do")
    count = 0 if main is None else max(2, main.least) if main.arity == "many" else 2
    return node(*(pt.nodes.AlwaysFailure(name=f"child {k}") for k in range(count)), **ports)


def same(tree: Node, spec: NodeSpec) -> None:
    declared = type(tree).declaration
    assert spec.node is type(tree)
    given_ports = {key: value for key, value in tree.description.ports.items() if key != "name"}
    assert set(spec.ports) <= set(given_ports)
    for key, bound in spec.ports.items():
        assert isinstance(bound, Reference | Constant)
        assert (bound.text if isinstance(bound, Constant) else str(bound)) == given_ports[key]
    main = declared.slot("do")
    if main is not None:
        below = spec.slots["do"]
        if main.arity == "one":
            ((_, sequence),) = below
            below = sequence.slots["do"]
        assert [child.name for _, child in below] == [f"child {k}" for k in range(len(below))]
    for slot in declared.slots:
        if slot.arity == "table":
            ((label, handler),) = spec.slots[slot.key]
            assert label == "*"
            assert [child.id for child in handler.children] == ["AlwaysSuccess"] * 2


def test_tree_of_the_readme_is_its_yaml(tmp_path: Path) -> None:
    sort_one = pt.Tree(
        "SortOne",
        pt.Recover(
            pt.Sequence(pt.Grasp(object="{item}"), pt.Place(object="{item}", into="{item.destination}")),
            attempts=3,
            when={
                "grasp.missed": [pt.nodes.SafeRetreat(), pt.Observe(camera="overhead")],
                "grasp.slipped": [pt.nodes.SafeRetreat(), pt.Observe(camera="overhead")],
            },
            otherwise=[pt.nodes.SafeRetreat()],
            give_up=[pt.nodes.SafeRetreat(hand="open")],
        ),
        ports={"item": {"type": "object"}},
    )
    main = pt.Sequence(
        pt.Observe(camera="overhead", objects="{items}"),
        pt.ForEach(pt.SubTree(sort_one, item="{item}"), in_="{items}", out="{item}", on_failure="continue"),
        pt.Fallback(pt.nodes.GoTo(pose="home"), pt.nodes.SafeRetreat()),
    )
    mission = pt.Mission(main, scene="sort_small", name="first mission")
    assert not mission.check().faults

    text = (ROOT / "README.md").read_text(encoding="utf-8").split("```yaml\n")[1].split("```")[0]
    (tmp_path / "first.yaml").write_text(text, encoding="utf-8")
    written = read_document(mission.save(tmp_path / "m.yaml"), "mission")
    assert written.data == read_document(tmp_path / "first.yaml", "mission").data
    assert check_mission(written).mission is not None


def test_two_trees_of_one_name_are_refused() -> None:
    one, other = (pt.Tree("One", pt.Observe(camera=camera)) for camera in ("overhead", "wrist"))
    with pytest.raises(pt.PicktreeError, match=r"^two different trees are called 'One'$"):
        pt.Mission(pt.Sequence(pt.SubTree(one), pt.SubTree(other)))
