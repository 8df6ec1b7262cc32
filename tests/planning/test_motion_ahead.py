"""Planning ahead: ready at a fixed simulated time, checked again when the belief has changed."""

from __future__ import annotations

import fcntl
import gc
import multiprocessing
import os
import signal
import tempfile
from collections.abc import Generator
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.robot.planning import JointGoal, LineGoal, MotionPlan, PlannerOverrides, PoseGoal, Request
from picktree.robot.planning.lookahead_planning import ChainAnswer, ChainOrder, ChainSolver, PlanningWorker
from picktree.world import Box, Failure, Plan, Pose, planning

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


DEAR = (Request(PoseGoal((Pose.from_rpy((0.6, -0.17, 0.4), (0.0, np.pi / 2, 0.0)),))),)
"""A motion whose plan costs several ticks of thinking."""


def over(x: float, y: float, z: float) -> tuple[Request, ...]:
    return (Request(PoseGoal((down(x, y, z),))),)


def costly_cell(*, worker: bool = False) -> Cell:
    cell = Cell(shelf_scene(), verify=False, worker=worker, cost=1e-3)
    cell.at = run(cell.plan.to(PoseGoal((Pose.from_rpy((0.6, 0.17, 0.4), (0.0, np.pi / 2, 0.0)),))))[
        0
    ].trajectory.end
    cell.thinking.owed = 0.0
    return cell


def test_a_plan_is_ready_when_its_thinking_has_passed_and_is_the_one_made_by_waiting() -> None:
    cell, patient = costly_cell(), costly_cell()
    plan, ticks = timed(patient, patient.plan.through(DEAR))
    assert ticks > 3
    prepared = cell.plan.ahead(DEAR)
    assert prepared.ready == pytest.approx(prepared.cost)
    taken, waited = timed(cell, cell.plan.take(prepared))
    assert waited == int(np.ceil(prepared.cost / TICK - 1e-9))
    assert taken is not None and np.array_equal(taken.trajectory.position, plan.trajectory.position)
    assert cell.thinking.owed == 0.0


def test_nothing_is_waited_for_when_the_time_has_passed() -> None:
    cell = costly_cell()
    prepared = cell.plan.ahead(DEAR)
    cell.now = prepared.ready
    assert timed(cell, cell.plan.take(prepared))[1] == 0


def test_one_thing_is_thought_after_the_other() -> None:
    cell = costly_cell()
    cell.now = 2.0
    first = cell.plan.ahead(DEAR)
    second = cell.plan.ahead(DEAR)
    assert first.ready == pytest.approx(2.0 + first.cost)
    assert second.ready == pytest.approx(2.0 + first.cost + second.cost)
    cell.now = 50.0
    assert cell.plan.ahead(DEAR).ready > 50.0


def test_what_was_owed_before_is_still_owed() -> None:
    cell = costly_cell()
    cell.thinking.spend(0.03)
    cell.plan.ahead(DEAR)
    assert cell.thinking.owed == 0.03


def test_a_failure_is_raised_when_it_is_ready() -> None:
    cell = Cell(table_scene(), verify=False, cost=1e-3)
    prepared = cell.plan.ahead(over(3.0, 0.0, 0.5))
    with pytest.raises(Failure, match=r"^planning\.no_ik: "):
        timed(cell, cell.plan.take(prepared))
    assert cell.now >= prepared.ready


def test_a_changed_belief_lets_a_plan_hold_that_is_still_free() -> None:
    cell = Cell(table_scene(), cost=1e-3)
    prepared = cell.plan.ahead(over(0.5, 0.0, 0.3))
    cell.scene.put(item("aside", Box((0.04, 0.04, 0.04)), Pose((0.3, 0.3, 0.02))), "seen")
    cell.now = prepared.ready
    before = cell.thinking.total
    plan, _ = timed(cell, cell.plan.take(prepared))
    assert plan is not None
    assert cell.thinking.total > before


def test_a_plan_that_is_no_longer_free_has_to_be_made_again() -> None:
    cell = Cell(table_scene(), cost=1e-3)
    prepared = cell.plan.ahead(over(0.5, 0.0, 0.1))
    cell.scene.put(item("grown", Box((0.1, 0.1, 0.3)), Pose((0.5, 0.0, 0.15))), "seen")
    assert timed(cell, cell.plan.take(prepared))[0] is None


def test_a_failure_in_another_belief_says_nothing_about_this_one() -> None:
    cell = Cell(table_scene(item("there", Box((0.1, 0.1, 0.3)), Pose((0.5, 0.0, 0.15)))), cost=1e-3)
    prepared = cell.plan.ahead(over(0.5, 0.0, 0.1))
    cell.scene.remove("there", "taken away")
    assert timed(cell, cell.plan.take(prepared))[0] is None


def test_every_leg_of_a_chain_is_checked_again_as_what_it_supposes() -> None:
    block = item("block", Box((0.04, 0.04, 0.04)), Pose((0.5, 0.0, 0.02)))
    legs = [
        Request(PoseGoal((down(0.5, 0.0, 0.14),))),
        Request(LineGoal(down(0.5, 0.0, 0.02)), allowed=(("gripper", "block"),)),
    ]
    cell = Cell(table_scene(block), cost=1e-3)
    prepared = cell.plan.ahead(legs)
    cell.scene.put(item("aside", Box((0.04, 0.04, 0.04)), Pose((0.3, 0.3, 0.02))), "seen")
    assert timed(cell, cell.plan.take(prepared))[0] is not None
    cell.scene.put(item("beside", Box((0.04, 0.04, 0.04)), Pose((0.5, 0.055, 0.02))), "seen")
    assert timed(cell, cell.plan.take(prepared))[0] is None


def test_a_checkpoint_forgets_what_was_prepared() -> None:
    cell = costly_cell()
    prepared = cell.plan.ahead(DEAR)
    cell.plan.forget()
    assert timed(cell, cell.plan.take(prepared)) == (None, 0)
    again = cell.plan.ahead(DEAR)
    assert again.ready == pytest.approx(again.cost)


def noted(cell: Cell) -> list[Plan]:
    return [entry for entry in cell.journal.take() if isinstance(entry, Plan)]


def test_a_worker_gives_the_same_plans_at_the_same_simulated_times() -> None:
    block = item("block", Box((0.04, 0.04, 0.04)), Pose((0.5, 0.0, 0.02)))
    outcomes: list[object] = []
    for worker in (False, True):
        cell = Cell(table_scene(block), verify=False, worker=worker, cost=1e-3)
        first = cell.plan.ahead(over(0.5, 0.0, 0.14), node="first")
        cell.scene.remove("block", "taken away")
        cell.at = HOME + 0.1
        with cell.plan.in_manner(PlannerOverrides(seed=5)):
            second = cell.plan.ahead([*over(0.4, 0.2, 0.3), Request(LineGoal(down(0.4, 0.2, 0.1)))])
        third = cell.plan.ahead(over(3.0, 0.0, 0.5))
        cell.now = third.ready
        plan, answer = second.answer, third.answer
        assert isinstance(plan, MotionPlan) and isinstance(answer, Failure)
        assert answer.cause is planning.WORKSPACE or answer.cause is planning.NO_IK
        trajectory = plan.trajectory.position.tolist(), plan.passes
        told = answer.cause, str(answer), answer.evidence
        outcomes.append((first.ready, second.ready, third.ready, trajectory, told, noted(cell)))
        assert len(noted(cell)) == 0
        assert cell.plan.made.of(plan.trajectory) is not None
    assert outcomes[0] == outcomes[1]


def test_a_worker_takes_no_time_of_the_run_before_it_is_asked() -> None:
    cell = costly_cell(worker=True)
    prepared = cell.plan.ahead(DEAR)
    assert prepared.outcome is None
    assert not noted(cell)[1:], "the plan is noted when it is asked for"
    assert prepared.ready > 0.0
    assert [entry.outcome for entry in noted(cell)] == ["found"]


def planned_ahead(cell: Cell, *, killed: bool) -> list[list[list[float]]]:
    """Plan the same motion three times; the worker dies while it is at the first."""
    paths: list[list[list[float]]] = []
    for k in range(3):
        prepared = cell.plan.ahead(DEAR)
        if killed and k == 0:
            (child,) = planning_workers()
            assert child.pid is not None
            os.kill(child.pid, signal.SIGKILL)
            child.join()
        plan, _ = timed(cell, cell.plan.take(prepared))
        assert plan is not None
        paths.append(plan.trajectory.position.tolist())
    return paths


def planning_workers() -> list[BaseProcess]:
    return [each for each in multiprocessing.active_children() if each.name == "planning"]


def test_a_worker_that_died_is_replaced_by_this_process() -> None:
    gc.collect()  # ends the workers of cells that are gone
    for left in planning_workers():
        left.join()
    assert planned_ahead(costly_cell(worker=True), killed=True) == planned_ahead(costly_cell(), killed=False)


class Refusing(ChainSolver):
    """Solver that refuses each order, as a plug-in's planner may."""

    def __init__(self) -> None:
        pass

    def solve(self, order: ChainOrder) -> ChainAnswer:
        raise PicktreeError("refused")


def test_an_error_of_the_worker_is_told_by_this_process_alone(capfd: pytest.CaptureFixture[str]) -> None:
    worker, order = PlanningWorker(Refusing), costly_cell().plan.ahead(DEAR).order
    assert worker.send(order)
    with pytest.raises(PicktreeError, match=r"^refused$"):
        worker.receive(order)
    for each in planning_workers():
        each.join(30.0)
    assert capfd.readouterr() == ("", "")


def test_a_worker_ends_with_the_process_that_it_plans_for() -> None:
    with tempfile.TemporaryDirectory() as folder, (Path(folder) / "log").open("w") as log:
        fcntl.flock(log, fcntl.LOCK_EX)
        before = set(planning_workers())
        cell = costly_cell(worker=True)
        assert cell.plan.ahead(DEAR).ready > 0.0  # an answer: the worker is at work
        (child,) = set(planning_workers()) - before
        held = {os.path.realpath(f"/proc/{child.pid}/fd/{n}") for n in os.listdir(f"/proc/{child.pid}/fd")}
        del cell
        gc.collect()
        child.join(30.0)
        # By itself, that is by no signal: 1 where other tests left threads, whose files are closed in it.
        assert child.exitcode in (0, 1)
        assert str(Path(folder, "log").resolve()) not in held


def test_a_plan_says_what_it_was_for() -> None:
    cell = Cell(table_scene(), verify=False)
    plan, _ = run(cell.plan.to(JointGoal(HOME + 0.1)))
    assert plan.request is not None and plan.request.start is not None
    assert np.array_equal(plan.request.start, HOME)
