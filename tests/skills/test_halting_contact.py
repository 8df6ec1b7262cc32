"""Skills that touch, halted at their ticks: nothing of the contact remains, and the mission can be done."""

from __future__ import annotations

from dataclasses import replace

from picktree.trees import Mission
from picktree.trees.loading import NodeRegistry, load_mission
from picktree.world.scene import SceneDescription, load_scene

from .cell import EXAMPLES, Cell, Phases, halted_at


def example(name: str) -> Mission:
    return load_mission(EXAMPLES / f"{name}.yaml", NodeRegistry())


def one_peg(kind: str) -> SceneDescription:
    """The scene `pegs` with this one only."""
    scene = load_scene("pegs")
    return replace(scene, spawn=(replace(scene.spawn[0], counts={kind: 1}),))


def test_inserting_in_physics_halted_in_contact() -> None:
    """`benchmarks/halting.py --leaf Insert --each` does it at each of its ticks."""
    mission = example("insert_pegs")
    cell = Cell(mission, one_peg("dowel_30"), "physics", 11)
    feeling = Phases(cell, (40,), ("Insert",))
    answers = halted_at(cell, feeling, mission)
    assert [(a.leaf, a.believed) for a in answers if a.fine] == [("Insert", True)]
