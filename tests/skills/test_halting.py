"""Every skill halted at its ticks: the arm comes to rest, and the mission can then be completed."""

from __future__ import annotations

from .cell import Cell, Halted, Phases, halted_at, items, mission, sorting

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


SORTED = {"Observe", "Grasp", "Place", "GoTo"}


def checked(answers: list[Halted]) -> set[str]:
    """The leaves that ran when they were halted. Whatever ran, the arm rests soon and all is sorted."""
    assert [a for a in answers if not a.fine] == []
    assert max(a.to_rest for a in answers) <= 0.5
    assert {a.believed for a in answers} == {True, False}
    return {a.leaf for a in answers}


def test_sorting_what_is_flat_halted_in_each_phase() -> None:
    """`benchmarks/halting.py` halts at random ticks, or at each."""
    cell = Cell(sorting(), items(plate=1))
    assert checked(halted_at(cell, Phases(cell, (1, 6)))) >= SORTED


def test_sorting_in_physics_halted_in_each_phase() -> None:
    cell = Cell(sorting(), items(block=1), "physics", 5)
    assert checked(halted_at(cell, Phases(cell, (2,)))) >= SORTED


def test_retreat_and_gripper_halted_in_each_phase_within_recover() -> None:
    cell = Cell(mission(PASSED_OVER), items(block=1))
    wanted = Phases(cell, (1, 4), ("SafeRetreat", "OpenGripper", "CloseGripper"))
    assert checked(halted_at(cell, wanted)) == {"SafeRetreat", "OpenGripper", "CloseGripper"}
