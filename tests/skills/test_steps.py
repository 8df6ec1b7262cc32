"""A skill shows its steps: in its message while they run, as events when they have ended."""

from __future__ import annotations

from itertools import pairwise

import pytest

from picktree.trees import NodeStatus
from picktree.world import Failure, grasp
from picktree.world.event_types import StepEvent

from .cell import Cell, items, mission, sorting
from .test_insert import inserting, pegs


def steps(cell: Cell) -> list[StepEvent]:
    return [event for event in cell.events if isinstance(event, StepEvent)]


def running(cell: Cell) -> str:
    """Message of the skill that runs; empty when none does."""
    return next((n.feedback_message for n in cell.tree.nodes if not n.children and n.feedback_message), "")


def test_a_pick_and_a_place_tell_their_steps_in_order() -> None:
    cell = Cell(sorting(), items(block=1))
    shown = [""]
    while cell.tick().root_status == "RUNNING":
        shown += [running(cell)] if running(cell) != shown[-1] else []
    told = steps(cell)
    assert [step.step for step in told] == [
        "choose", "approach", "close", "lift", "transfer", "lower", "release"
    ]  # fmt: skip
    assert {step.outcome for step in told} == {"success"}
    assert all(a.start <= b.start for a, b in pairwise(told))
    assert {"approach", "close", "lift", "transfer"} <= set(shown) <= {"", *(step.step for step in told)}
    assert shown[-1] == "", "an ended skill shows no step"


def test_a_halted_step_is_told_as_halted() -> None:
    cell = Cell(sorting(), items(block=1))
    while running(cell) != "approach":
        cell.tick()
    cell.halt()
    assert [(step.step, step.outcome) for step in steps(cell)][-1] == ("approach", "halted")
    assert cell.world.running_steps == {}


def test_a_failed_step_has_the_cause() -> None:
    cell = Cell(sorting(), items(block=1))
    with pytest.raises(Failure), cell.world.step("Main/Polish", "wipe"):
        raise Failure(grasp.SLIPPED, "it slipped")
    cell.halt()
    (step,) = steps(cell)
    assert (step.node, step.step, step.outcome, step.cause) == (
        "Main/Polish", "wipe", "failure", "grasp.slipped"
    )  # fmt: skip


def test_a_program_fault_within_a_step_is_its_cause() -> None:
    cell = Cell(sorting(), items(block=1))
    with pytest.raises(ZeroDivisionError), cell.world.step("Main/Polish", "wipe"):
        raise ZeroDivisionError
    cell.halt()
    (step,) = steps(cell)
    assert (step.outcome, step.cause) == ("failure", "internal.error")


def test_a_step_within_a_step_takes_its_place_meanwhile() -> None:
    cell = Cell(sorting(), items(block=1))
    world = cell.world
    with world.step("Main/Polish", "outer"):
        with world.step("Main/Polish", "inner"):
            assert world.running_steps == {"Main/Polish": "inner"}
        assert world.running_steps == {"Main/Polish": "outer"}
    assert world.running_steps == {}
    cell.halt()
    assert [step.step for step in steps(cell)] == ["inner", "outer"]


def test_an_insertion_tells_its_stages() -> None:
    cell = Cell(mission(inserting()), pegs(post_30=1))
    assert cell.finish() is NodeStatus.SUCCESS
    told = [step for step in steps(cell) if step.node.endswith("Insert")]
    names = [step.step for step in told]
    assert names[:3] == ["transfer", "touch", "search"]
    assert names[-3:] == ["press", "release", "withdraw"]
    assert set(names) == {"transfer", "touch", "search", "press", "release", "withdraw"}
    assert all(a.start <= b.start for a, b in pairwise(told))
