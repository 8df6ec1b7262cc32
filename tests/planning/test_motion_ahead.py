"""Planning ahead: ready at a fixed simulated time, checked again when the belief has changed."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeVar

import numpy as np
import pytest

from picktree.errors import PicktreeError
from picktree.planning.requests import JointGoal, LineGoal, MotionPlan, NamedGoal, PoseGoal, Request
from picktree.world.causes import Failure
from picktree.world.shapes import Box
from picktree.world.values import Pose

from .motion_cell import HOME, TICK, Cell, down, item, run, shelf_scene, table_scene

T = TypeVar("T")


def timed(cell: Cell, steps: Generator[None, None, T]) -> tuple[T, int]:
    """What a generator returns and its ticks; the clock goes on with each."""
    ticks = 0
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value, ticks
        ticks += 1
        cell.now += TICK


def dear(cell: Cell) -> Generator[None, None, MotionPlan]:
    """A plan that costs several ticks of thinking."""
    return cell.plan.to(PoseGoal((Pose.from_rpy((0.6, -0.17, 0.4), (0.0, np.pi / 2, 0.0)),)), node="dear")


def costly_cell() -> Cell:
    cell = Cell(shelf_scene(), verify=False, cost=1e-3)
    cell.at = run(cell.plan.to(PoseGoal((Pose.from_rpy((0.6, 0.17, 0.4), (0.0, np.pi / 2, 0.0)),))))[
        0
    ].trajectory.end
    cell.thinking.owed = 0.0
    return cell


def test_a_plan_is_ready_when_its_thinking_has_passed_and_is_the_one_made_by_waiting() -> None:
    cell, patient = costly_cell(), costly_cell()
    plan, ticks = timed(patient, dear(patient))
    assert ticks > 3
    prepared = cell.plan.ahead(dear(cell))
    assert prepared.ready == pytest.approx(prepared.cost)
    taken, waited = timed(cell, cell.plan.take(prepared))
    assert waited == int(np.ceil(prepared.cost / TICK - 1e-9))
    assert taken is not None and np.array_equal(taken.trajectory.position, plan.trajectory.position)
    assert cell.thinking.owed == 0.0


def test_nothing_is_waited_for_when_the_time_has_passed() -> None:
    cell = costly_cell()
    prepared = cell.plan.ahead(dear(cell))
    cell.now = prepared.ready
    assert timed(cell, cell.plan.take(prepared))[1] == 0


def test_one_thing_is_thought_after_the_other() -> None:
    cell = costly_cell()
    cell.now = 2.0
    first = cell.plan.ahead(dear(cell))
    second = cell.plan.ahead(dear(cell))
    assert first.ready == pytest.approx(2.0 + first.cost)
    assert second.ready == pytest.approx(2.0 + first.cost + second.cost)
    cell.now = 50.0
    assert cell.plan.ahead(dear(cell)).ready > 50.0


def test_what_was_owed_before_is_still_owed() -> None:
    cell = costly_cell()
    cell.thinking.spend(0.03)
    cell.plan.ahead(dear(cell))
    assert cell.thinking.owed == 0.03


def test_a_failure_is_raised_when_it_is_ready() -> None:
    cell = Cell(table_scene(), verify=False, cost=1e-3)
    prepared = cell.plan.ahead(cell.plan.to(PoseGoal((down(3.0, 0.0, 0.5),))))
    with pytest.raises(Failure, match=r"^planning\.no_ik: "):
        timed(cell, cell.plan.take(prepared))
    assert cell.now >= prepared.ready


def test_a_changed_belief_lets_a_plan_hold_that_is_still_free() -> None:
    cell = Cell(table_scene(), cost=1e-3)
    prepared = cell.plan.ahead(cell.plan.to(PoseGoal((down(0.5, 0.0, 0.3),))))
    cell.scene.put(item("aside", Box((0.04, 0.04, 0.04)), Pose((0.3, 0.3, 0.02))), "seen")
    cell.now = prepared.ready
    before = cell.thinking.total
    plan, _ = timed(cell, cell.plan.take(prepared))
    assert plan is not None
    assert cell.thinking.total > before


def test_a_plan_that_is_no_longer_free_has_to_be_made_again() -> None:
    cell = Cell(table_scene(), cost=1e-3)
    prepared = cell.plan.ahead(cell.plan.to(PoseGoal((down(0.5, 0.0, 0.1),))))
    cell.scene.put(item("grown", Box((0.1, 0.1, 0.3)), Pose((0.5, 0.0, 0.15))), "seen")
    assert timed(cell, cell.plan.take(prepared))[0] is None


def test_a_failure_in_another_belief_says_nothing_about_this_one() -> None:
    cell = Cell(table_scene(item("there", Box((0.1, 0.1, 0.3)), Pose((0.5, 0.0, 0.15)))), cost=1e-3)
    prepared = cell.plan.ahead(cell.plan.to(PoseGoal((down(0.5, 0.0, 0.1),))))
    cell.scene.remove("there", "taken away")
    assert timed(cell, cell.plan.take(prepared))[0] is None


def test_every_leg_of_a_chain_is_checked_again_as_what_it_supposes() -> None:
    block = item("block", Box((0.04, 0.04, 0.04)), Pose((0.5, 0.0, 0.02)))
    legs = [
        Request(PoseGoal((down(0.5, 0.0, 0.14),))),
        Request(LineGoal(down(0.5, 0.0, 0.02)), allowed=(("gripper", "block"),)),
    ]
    cell = Cell(table_scene(block), cost=1e-3)
    prepared = cell.plan.ahead(cell.plan.through(legs))
    cell.scene.put(item("aside", Box((0.04, 0.04, 0.04)), Pose((0.3, 0.3, 0.02))), "seen")
    assert timed(cell, cell.plan.take(prepared))[0] is not None
    cell.scene.put(item("beside", Box((0.04, 0.04, 0.04)), Pose((0.5, 0.055, 0.02))), "seen")
    assert timed(cell, cell.plan.take(prepared))[0] is None


def test_other_answers_are_asked_about_when_the_belief_has_changed() -> None:
    cell = Cell(table_scene(), cost=1e-3)

    def number() -> Generator[None, None, int]:
        yield from cell.plan.to(NamedGoal("home"))
        return 3

    prepared = cell.plan.ahead(number())
    assert timed(cell, cell.plan.take(prepared))[0] == 3
    cell.scene.put(item("aside", Box((0.04, 0.04, 0.04)), Pose((0.3, 0.3, 0.02))), "seen")
    assert timed(cell, cell.plan.take(prepared))[0] is None
    assert timed(cell, cell.plan.take(prepared, lambda n: n == 3))[0] == 3


def test_a_checkpoint_forgets_what_was_prepared() -> None:
    cell = costly_cell()
    prepared = cell.plan.ahead(dear(cell))
    cell.plan.forget()
    assert timed(cell, cell.plan.take(prepared)) == (None, 0)
    again = cell.plan.ahead(dear(cell))
    assert again.ready == pytest.approx(again.cost)


def test_only_thinking_can_be_done_ahead() -> None:
    cell = Cell(table_scene(), verify=False)

    def waits() -> Generator[None, None, None]:
        while True:
            yield

    with pytest.raises(PicktreeError) as caught:
        cell.plan.ahead(waits())
    assert str(caught.value) == "only planning can be done ahead: these steps wait for something else"


def test_a_plan_says_what_it_was_for() -> None:
    cell = Cell(table_scene(), verify=False)
    plan, _ = run(cell.plan.to(JointGoal(HOME + 0.1)))
    assert plan.request is not None and plan.request.start is not None
    assert np.array_equal(plan.request.start, HOME)
