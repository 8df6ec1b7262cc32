"""The missions that come with picktree load with the nodes that come with picktree."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, cast

import py_trees
import pytest

from picktree.trees import NodeStatus, build
from picktree.trees.loading import NodeRegistry, load_mission

from .scripted import FakeWorld, start

if TYPE_CHECKING:
    from picktree.robot import World

FOLDER = Path(__file__).parents[2] / "examples"
EXAMPLES = [f for f in sorted(FOLDER.glob("*.yaml")) if "\nkind: mission\n" in f.read_text("utf-8")]


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_an_example_loads_and_builds(file: Path) -> None:
    mission = load_mission(file)
    tree = build(mission, cast("World", FakeWorld()))
    assert tree.status is NodeStatus.IDLE
    assert mission.scene is not None


def test_the_sample_of_the_design_has_the_paths_that_people_will_read() -> None:
    file = next(f for f in EXAMPLES if f.stem == "sort_by_colour")
    tree = build(load_mission(file), cast("World", FakeWorld()))
    sort_one = "Main/Repeat/Sequence/ForEach/SortOne/Recover"
    assert [node.path.removeprefix(sort_one) for node in tree.nodes if node.path.startswith(sort_one)] == [
        "",
        "/Sequence",
        "/Sequence/Grasp",
        "/Sequence/Place",
        "/grasp.no_candidate",
        "/grasp.no_candidate/Fallback",
        "/grasp.no_candidate/Fallback/Push",
        "/grasp.no_candidate/Fallback/SafeRetreat",
        "/grasp.no_candidate/Observe",
        "/world.disturbed",
        "/world.disturbed/SafeRetreat",
        "/world.disturbed/Observe",
        "/grasp.missed",
        "/grasp.missed/SafeRetreat",
        "/grasp.missed/Observe",
        "/grasp.slipped",
        "/grasp.slipped/SafeRetreat",
        "/grasp.slipped/Observe",
        "/world.unknown_object",
        "/world.unknown_object/Observe",
        "/control.*",
        "/control.*/SafeRetreat",
        "/otherwise",
        "/otherwise/SafeRetreat",
        "/give_up",
        "/give_up/SafeRetreat",
    ]


def test_every_installed_node_is_told_apart_and_explained() -> None:
    registry = NodeRegistry()
    assert registry.problems == ()
    assert {"Observe", "Grasp", "Place", "GoTo", "SafeRetreat", "Recover", "Sequence"} <= set(registry.ids())
    for declaration in registry.declarations():
        assert declaration.doc
        assert all(port.doc for port in declaration.ports), declaration.id
        assert all(slot.doc for slot in declaration.slots), declaration.id


def test_the_tools_of_py_trees_work_on_our_trees() -> None:
    run = start("Main: {Sequence: [AlwaysSuccess, {Scripted: {name: arm, script: RR}}, AlwaysSuccess]}")
    ticked = [node.name for node in run.tree.root.tick()]
    assert ticked == ["AlwaysSuccess", "arm", "Sequence", "Main"]
    shown = py_trees.display.unicode_tree(run.tree.root, show_status=True)
    assert "arm" in shown and "AlwaysSuccess#2" in shown
    assert run.tree.root.tip() is run.tree.root
    run.tree.root.stop(py_trees.common.Status.INVALID)
    assert run.trace[-1] == "leave arm"
    assert run.tree.status is NodeStatus.IDLE
