"""The gate: what a trajectory must be so that the arm begins to follow it."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import TypeVar

import numpy as np
import pytest

from picktree.robot.planning import (
    HeldObject,
    JointGoal,
    MotionPlan,
    NamedGoal,
    PoseGoal,
    Request,
    TrajectoryGate,
)
from picktree.session import assemble_world
from picktree.session.execution import TICK_LENGTH
from picktree.simulation import Backend, build_hardware
from picktree.world import Array, BeliefObject, Box, Failure, ObjectId, Pose, Trajectory
from picktree.world.robot_model import load_robot
from picktree.world.scene import load_scene

from ..control.control_cell import DOWN, HOME, MODEL, swing

T = TypeVar("T")


class Cell:
    """The world that a session assembles, and the checks that were charged."""

    def __init__(self, backend: Backend = "kinematic", *, verify: bool = False) -> None:
        scene, robot = load_scene("sort_small"), load_robot("panda")
        self.world = assemble_world(build_hardware(backend, scene, robot, 3), scene, robot, 3, verify=verify)

    def run(self, doing: Generator[None, None, T]) -> T:
        for _ in range(400):
            try:
                next(doing)
            except StopIteration as end:
                return end.value
            self.world.control.step_tick(TICK_LENGTH)
        raise AssertionError("not done after 400 ticks")

    def checks(self, doing: Generator[None, None, object]) -> int:
        """How many collision checks it takes."""
        collision = self.world.plan.solver.collision
        before = collision.checks
        self.run(doing)
        return collision.checks - before

    def refused(self, trajectory: Trajectory) -> Failure:
        """The failure with which the arm does not move."""
        at = self.world.control.held_position
        with pytest.raises(Failure) as caught:
            self.run(self.world.move.along(trajectory, node="test"))
        assert np.array_equal(self.world.control.held_position, at)
        assert self.world.control.monitor.stopped is None
        return caught.value

    def put(self, x: float, y: float, z: float, size: float = 0.08, name: str = "crate") -> None:
        shape = Box((size, size, size))
        pose = Pose((x, y, z))
        thing = BeliefObject("box", "box", shape, "red", pose, 0.001, 0.01, 1.0, 0.0, id=ObjectId(name))
        self.world.scene.put(thing, "test")

    def plan(self) -> MotionPlan:
        """From home to the side, over the table."""
        return self.run(self.world.plan.to(PoseGoal((Pose((0.45, -0.35, 0.25), DOWN),)), node="test"))


def away(joint: int, way: float, duration: float = 2.0) -> Trajectory:
    goal = HOME.copy()
    goal[joint] += way
    return swing(HOME, goal, duration)


@pytest.mark.parametrize("backend", ["kinematic", "physics"])
def test_a_plan_that_was_just_made_is_not_paid_for_again(backend: Backend) -> None:
    cell = Cell(backend)
    plan = cell.plan()
    assert cell.checks(cell.world.move.along(plan.trajectory)) == 0
    assert cell.world.control.tcp.distance(Pose((0.45, -0.35, 0.25))) < 2e-3


def test_what_no_planner_made_is_checked_and_charged() -> None:
    cell = Cell()
    owed = cell.world.thinking.total
    checks = cell.checks(cell.world.move.along(away(0, 0.8)))
    assert checks >= 50  # 25 cm of the tool
    assert cell.world.thinking.total - owed == pytest.approx(checks * 25e-6)


def test_a_changed_belief_is_paid_for_and_what_stands_in_the_way_is_named() -> None:
    cell = Cell()
    plan = cell.plan()
    cell.put(0.8, 0.3, 0.04)
    middle = MODEL.tcp(plan.trajectory.sample(0.6 * plan.trajectory.duration)[0]).position
    assert (
        cell.checks(
            TrajectoryGate(MODEL, cell.world.plan, cell.world.description.limits.workspace).passes(
                plan.trajectory
            )
        )
        > 50
    )
    cell.put(*middle, name="intruder")
    refused = cell.refused(plan.trajectory)
    assert str(refused.cause) == "planning.blocked"
    assert "intruder" in refused.message
    assert 0.1 < float(str(refused.evidence["fraction"])) < 0.7
    cell.world.scene.remove("intruder", "test")
    cell.run(cell.world.move.along(plan.trajectory))


def test_pairs_that_were_allowed_when_it_was_planned_are_not_any_more() -> None:
    cell = Cell()
    cell.put(0.45, -0.35, 0.25)
    with cell.world.scene.allow(("gripper", "crate"), ("arm", "crate")):
        plan = cell.plan()
        gate = TrajectoryGate(MODEL, cell.world.plan, cell.world.description.limits.workspace)
        assert cell.checks(gate.passes(plan.trajectory)) == 0
    assert str(cell.refused(plan.trajectory).cause) == "planning.blocked"


def test_what_its_request_supposes_is_supposed_again() -> None:
    """Planned as if it were held, followed with the object in the hand, a little off."""
    cell = Cell()
    world = cell.world
    tcp = world.control.tcp
    world.scene.put(replace(_thing(), pose=tcp @ Pose((0.0, 0.0, 0.02))), "test")
    holding = HeldObject(ObjectId("brick"), Pose((0.0, 0.0, 0.02)))
    aside = HOME + np.array([0.5, 0, 0, 0, 0, 0, 0])
    plan = cell.run(world.plan.solve(Request(JointGoal(aside), holding=holding, width=0.04), node="test"))
    world.scene.attach("brick", Pose((0.0, 0.0, 0.021)))
    assert cell.checks(world.move.along(plan.trajectory)) > 20


def test_what_comes_into_the_belief_on_the_way_stops_the_arm_before_it() -> None:
    cell = Cell()
    world = cell.world
    trajectory = away(0, 1.2, 3.0)
    doing = world.move.along(trajectory)
    for _ in range(15):
        next(doing)
        world.control.step_tick(TICK_LENGTH)
    before = world.plan.solver.collision.checks
    cell.put(0.8, -0.4, 0.04)
    next(doing)
    assert world.plan.solver.collision.checks - before > 20
    world.control.step_tick(TICK_LENGTH)
    x, y, z = MODEL.tcp(trajectory.end).position
    cell.put(x, y, z, 0.2, "intruder")
    with pytest.raises(
        Failure, match=r"^planning.blocked: the way is not free: .*intruder.* after \d\.\d+ s"
    ) as caught:
        cell.run(doing)
    assert world.control.at_rest
    assert world.control.tcp.position[1] < y - 0.1
    assert float(str(caught.value.evidence["fraction"])) > 0.4


def test_verify_judges_what_is_checked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = Cell(verify=True)
    seen: list[Trajectory] = []
    verify = cell.world.plan.verify

    def watched(request: Request, trajectory: Trajectory) -> None:
        seen.append(trajectory)
        verify(request, trajectory)

    monkeypatch.setattr(cell.world.plan, "verify", watched)
    trajectory = away(0, 0.4)
    cell.run(cell.world.move.along(trajectory))
    assert len(seen) == 1
    assert np.array_equal(seen[0].position, trajectory.position)
    assert cell.world.plan.disagreements == ()


def test_the_way_back_out_of_a_believed_collision_is_open_but_not_further_in() -> None:
    cell = Cell()
    trajectory = away(0, 0.6)
    cell.run(cell.world.move.along(trajectory))
    x, y, z = cell.world.control.tcp.position
    cell.put(x, y, z - 0.035)
    back = cell.world.move.way_back()
    assert back is not None
    on = swing(cell.world.control.held_position, HOME + np.array([0.6, 0.15, 0, 0, 0, 0, 0]))
    assert str(cell.refused(on).cause) == "planning.blocked"
    cell.put(x, y, z - 0.047, 0.08)
    up = swing(cell.world.control.held_position, HOME + np.array([0.6, -0.25, 0, 0.1, 0, 0, 0]))
    cell.run(cell.world.move.along(up))


def _rows(trajectory: Trajectory, **changed: Array) -> Trajectory:
    rows = {"position": trajectory.position, "velocity": trajectory.velocity} | changed
    return Trajectory(trajectory.times, rows["position"], rows["velocity"], trajectory.acceleration)


def test_each_limit_is_told_with_joint_time_and_amount() -> None:
    cell = Cell()
    cases = [
        (
            away(5, 2.5, 4.0),
            "safety.joint_limit: the trajectory is refused: panda_joint6 would be 18.2 deg beyond its limit "
            "after 4.00 s, 100 % of the way",
        ),
        (
            away(0, 2.0, 1.5),
            "safety.speed_limit: the trajectory is refused: panda_joint1 would be 0.325 rad/s above its "
            "speed limit after 0.75 s, 50 % of the way",
        ),
        (
            away(1, 0.15, 0.3),
            "safety.acceleration_limit: the trajectory is refused: panda_joint2 would be 2.121 rad/s² above "
            "its acceleration limit after 0.24 s, 79 % of the way",
        ),
    ]
    for trajectory, text in cases:
        assert str(cell.refused(trajectory)) == text


def test_an_unsound_trajectory() -> None:
    cell = Cell()
    sound = away(0, 0.3)
    hole = sound.position.copy()
    hole[50, 2] = np.nan
    backwards = sound.times.copy()
    backwards[30] = backwards[29]
    moving = sound.velocity.copy()
    moving[-1, 0] = 0.2
    cases = [
        (_rows(sound, position=hole), "it holds a number that is not finite"),
        (replace(sound, times=backwards), "its times do not rise from 0"),
        (_rows(sound, velocity=moving), "it does not end at rest"),
        (
            _rows(sound, position=sound.position[:, :6]),
            "(201,) times do not fit rows of (201, 6), (201, 7), (201, 7); 7 joints are wanted",
        ),
    ]
    for trajectory, text in cases:
        assert str(cell.refused(trajectory)) == f"safety.trajectory: the trajectory is refused: {text}"


def _thing() -> BeliefObject:
    return BeliefObject(
        "box", "box", Box((0.04, 0.04, 0.04)), "red", Pose(), 0.001, 0.01, 1.0, 0.0, id=ObjectId("brick")
    )


def test_a_plan_keeps_every_limit_between_its_samples_too() -> None:
    """The gate's own arithmetic on what the planner makes: none is refused."""
    cell = Cell()
    for goal in ("observe", "rest", "home"):
        plan = cell.run(cell.world.plan.to(NamedGoal(goal), node="test"))
        cell.run(cell.world.move.along(plan.trajectory))
        np.testing.assert_allclose(cell.world.control.held_position, MODEL.named(goal), atol=1e-6)
