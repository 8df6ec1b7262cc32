"""Every skill halted at its ticks: the arm comes to rest, and the mission can then be completed."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from picktree.world.scene.load import load_scene

from .cell import Cell, halted_at, items, mission, sorting

PASSED_OVER = """\
Sequence:
  - Observe: {camera: overhead, objects: "{items}"}
  - ForEach:
      in: "{items}"
      out: "{item}"
      on_failure: continue
      do:
        Recover:
          attempts: 2
          do: [{Grasp: {object: "{item}"}}, CloseGripper, AlwaysFailure]
          otherwise: [{SafeRetreat: {speed: 1.0}}]
          give_up: [{SafeRetreat: {hand: open, speed: 1.0}}]
  - CloseGripper
  - OpenGripper
"""
"""Grasped, kept through a retreat, and dropped at last: what `sort_by_colour` does not do unless it must."""


def every_second(tick: int) -> bool:
    return tick % 2 == 0


@pytest.mark.slow
def test_sorting_halted_at_every_second_tick() -> None:
    answers = halted_at(Cell(sorting(), items(plate=1)), every_second)
    assert [a for a in answers if not a.fine] == []
    leaves = Counter(a.leaf for a in answers)
    assert set(leaves) - {""} == {"Observe", "Grasp", "Place", "GoTo"}
    assert len(answers) > 45
    assert max(a.to_rest for a in answers) <= 0.5
    assert {a.believed for a in answers} == {True, False}


def test_sorting_what_is_not_flat_halted_at_every_sixth_tick() -> None:
    answers = halted_at(Cell(sorting(), items(block=1)), lambda tick: tick % 6 == 0)
    assert [a for a in answers if not a.fine] == []
    assert len(answers) > 12


@pytest.mark.slow
def test_retreat_and_gripper_halted_at_every_second_tick_within_recover() -> None:
    answers = halted_at(
        Cell(mission(PASSED_OVER), items(block=1)), lambda tick: tick > 52 and every_second(tick)
    )
    assert [a for a in answers if not a.fine] == []
    leaves = Counter(a.leaf for a in answers)
    assert leaves["SafeRetreat"] > 15
    assert leaves["OpenGripper"] > 2
    assert leaves["CloseGripper"] > 2


@pytest.mark.slow
def test_halted_at_random_ticks_in_physics() -> None:
    """`benchmarks/halting.py` does it two hundred times."""
    chosen = np.random.default_rng([5, 0]).choice(250, 8, replace=False) + 1
    answers = halted_at(Cell(sorting(), load_scene("sort_small"), "physics", 5), lambda t: t in chosen)
    assert [a for a in answers if not a.fine] == []
    assert len(answers) == 8
