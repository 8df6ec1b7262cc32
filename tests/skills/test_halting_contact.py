"""Skills that touch, halted at their ticks: nothing of the contact remains, and the mission can be done."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from picktree.trees.loader import load_mission
from picktree.trees.mission import Mission
from picktree.trees.registry import Registry
from picktree.world.scene.description import SceneDescription
from picktree.world.scene.load import load_scene

from .cell import EXAMPLES, Cell, halted_at


def example(name: str) -> Mission:
    return load_mission(EXAMPLES / f"{name}.yaml", Registry())


def one_peg(kind: str) -> SceneDescription:
    """The scene `pegs` with this one only."""
    scene = load_scene("pegs")
    return replace(scene, spawn=(replace(scene.spawn[0], counts=((kind, 1),)),))


@pytest.mark.slow
def test_inserting_in_physics_halted_at_random_ticks() -> None:
    """`benchmarks/halting.py --leaf Insert --each` does it at each of them."""
    mission = example("insert_pegs")
    chosen = np.random.default_rng([11, 0]).choice(np.arange(60, 150), 8, replace=False)
    answers = halted_at(
        Cell(mission, one_peg("dowel_30"), "physics", 11), lambda tick: tick in chosen, mission
    )
    assert [a for a in answers if not a.fine] == []
    assert {a.leaf for a in answers} == {"Insert"}
