"""Plans: free by the second judge, within all limits, honest about failure, the same bits again."""

from __future__ import annotations

import hashlib
import logging
from dataclasses import replace

import numpy as np
import pytest

from picktree.robot.planning import (
    CollisionChecker,
    JointGoal,
    MotionPlan,
    NamedGoal,
    OffsetGoal,
    PoseGoal,
    Scaling,
)
from picktree.world import Array, Box, Failure, Plan, Pose, planning

from ..other_process import OtherProcess
from .motion_cell import HOME, MODEL, TICK, Cell, down, item, littered, run, shelf_scene, table_scene

IN_LEFT = Pose.from_rpy((0.6, 0.17, 0.4), (0.0, np.pi / 2, 0.0))
IN_RIGHT = Pose.from_rpy((0.6, -0.17, 0.4), (0.0, np.pi / 2, 0.0))


def respects_limits(plan: MotionPlan, scaling: Scaling = Scaling()) -> None:  # noqa: B008
    t = plan.trajectory
    assert t.times[0] == 0.0 and np.all(np.diff(t.times) > 0)
    assert np.diff(t.times).max() < 0.0201
    assert np.all(t.velocity[0] == 0) and np.all(t.velocity[-1] == 0)
    assert np.all(np.abs(t.velocity) <= MODEL.velocity_limit * scaling.velocity * (1 + 1e-9))
    steps = np.diff(t.velocity, axis=0) / np.diff(t.times)[:, None]
    assert np.all(np.abs(steps) <= MODEL.acceleration_limit * scaling.acceleration * (1 + 1e-9))
    assert np.all(t.position >= MODEL.lower - 1e-6) and np.all(t.position <= MODEL.upper + 1e-6)
    moved = t.position[0] + np.concatenate(
        [
            np.zeros((1, 7)),
            np.cumsum((t.velocity[1:] + t.velocity[:-1]) / 2 * np.diff(t.times)[:, None], axis=0),
        ]
    )
    np.testing.assert_allclose(moved, t.position, atol=2e-3)


def test_from_one_compartment_of_a_shelf_to_the_other() -> None:
    cell = Cell(shelf_scene())
    planners = list[str]()
    for pose in (IN_LEFT, IN_RIGHT, IN_LEFT):
        plan, _ = run(cell.plan.to(PoseGoal((pose,)), node="a"))
        planners.append(plan.planner)
        respects_limits(plan)
        np.testing.assert_allclose(plan.trajectory.start, cell.at, atol=1e-9)
        assert MODEL.tcp(plan.trajectory.end).distance(pose) < 2e-5
        cell.at = plan.trajectory.end
    assert planners[1:] == ["RRTConnect", "RRTConnect"]
    assert cell.plan.disagreements == ()


def test_on_a_littered_table() -> None:
    cell = Cell(littered(11))
    rng = np.random.default_rng(4)
    found = 0
    for _ in range(12):
        x, y, yaw = rng.uniform([0.35, -0.3, -1.5], [0.65, 0.3, 1.5])
        try:
            plan, _ = run(cell.plan.to(PoseGoal((down(x, y, 0.1, yaw),)), node="a"))
        except Failure as failure:
            assert failure.cause == planning.GOAL_IN_COLLISION
            continue
        found += 1
        respects_limits(plan)
        cell.at = plan.trajectory.end
    assert found > 6
    assert cell.plan.disagreements == ()


def test_the_torques_suffice() -> None:
    cell = Cell(table_scene())
    for goal in (NamedGoal("observe"), PoseGoal((down(0.65, -0.3, 0.3),)), PoseGoal((down(0.4, 0.3, 0.5),))):
        t = run(cell.plan.to(goal))[0].trajectory
        cell.at = t.end
        for q, v, a in zip(t.position, t.velocity, t.acceleration, strict=True):
            assert np.all(np.abs(MODEL.inverse_dynamics(q, v, a)) <= MODEL.torque_limit)


def test_scaling_slows_down() -> None:
    cell = Cell(table_scene())
    goal = PoseGoal((down(0.5, -0.2, 0.2),))
    fast, _ = run(cell.plan.to(goal))
    scaling = Scaling(velocity=0.3, acceleration=0.2)
    slow, _ = run(cell.plan.to(goal, scaling=scaling))
    respects_limits(slow, scaling)
    assert slow.trajectory.duration > 2 * fast.trajectory.duration


def test_goal_index_says_which_pose_was_reached() -> None:
    cell = Cell(table_scene(item("tall", Box((0.1, 0.1, 0.5)), Pose((0.5, 0.2, 0.25)))))
    poses = (Pose((2.0, 0.0, 0.5)), down(0.5, 0.2, 0.2), down(0.5, -0.2, 0.2))
    plan, _ = run(cell.plan.to(PoseGoal(poses)))
    assert plan.goal_index == 2
    assert MODEL.tcp(plan.trajectory.end).distance(poses[2]) < 2e-5


def test_named_and_joint_goals() -> None:
    cell = Cell(table_scene())
    plan, _ = run(cell.plan.to(NamedGoal("observe")))
    np.testing.assert_allclose(plan.trajectory.end, MODEL.named("observe"), atol=1e-9)
    plan, _ = run(cell.plan.to(JointGoal(HOME)))
    assert plan.trajectory.duration < 0.011


def test_a_goal_nearer_to_a_limit_than_plans_go_is_reached_around_an_obstacle() -> None:
    cell = Cell(table_scene(item("tall", Box((0.1, 0.1, 0.7)), Pose((0.35, 0.0, 0.35)))))
    cell.at = MODEL.named("observe")
    q = MODEL.named("observe") * np.array([-1, 1, 1, 1, 1, 1, 1])
    q[6] = MODEL.upper[6] - 0.001
    plan, _ = run(cell.plan.to(JointGoal(q)))
    assert plan.planner == "RRTConnect"
    np.testing.assert_allclose(plan.trajectory.end, q, atol=1e-6)
    assert cell.plan.disagreements == ()


def test_thinking_is_charged_in_ticks_and_the_rest_is_carried_over() -> None:
    cell = Cell(table_scene())
    total = 0
    for k in range(40):
        goal = NamedGoal("observe" if k % 2 == 0 else "home")
        plan, ticks = run(cell.plan.to(goal))
        cell.at = plan.trajectory.end
        total += ticks
    assert cell.thinking.total > 2 * TICK
    assert total == int(cell.thinking.total / TICK)
    assert cell.thinking.owed == pytest.approx(cell.thinking.total - total * TICK)
    notes = [note for note in cell.journal.take() if isinstance(note, Plan)]
    assert sum(note.thinking for note in notes) == pytest.approx(cell.thinking.total)
    before = cell.thinking.total
    assert cell.plan.reachable(down(0.5, 0.0, 0.2)) is not None
    assert cell.thinking.total == pytest.approx(before + 2 * 25e-6)


def test_reachable_is_free_and_close() -> None:
    cell = Cell(table_scene(item("tall", Box((0.1, 0.1, 0.5)), Pose((0.5, 0.2, 0.25)))))
    q = cell.plan.reachable(down(0.5, -0.2, 0.2), near=HOME)
    assert q is not None and cell.plan.contacts(q) == ()
    assert cell.plan.reachable(down(0.5, 0.2, 0.2)) is None
    assert cell.plan.reachable(down(1.5, 0.2, 0.2)) is None


def tcp_way(plan: MotionPlan) -> Array:
    return np.array([MODEL.tcp(q).position for q in plan.trajectory.position])


def test_a_line_is_straight_and_keeps_its_orientation() -> None:
    cell = Cell(table_scene())
    cell.at = run(cell.plan.to(PoseGoal((down(0.45, -0.1, 0.25),))))[0].trajectory.end
    plan, _ = run(cell.plan.line(OffsetGoal((0.1, 0.15, -0.1)), scaling=Scaling(0.5, 0.5)))
    assert (plan.planner, plan.fraction) == ("line", 1.0)
    respects_limits(plan, Scaling(0.5, 0.5))
    begin = MODEL.tcp(cell.at)
    way = tcp_way(plan) - np.array(begin.position)
    along = np.array([0.1, 0.15, -0.1]) / np.linalg.norm([0.1, 0.15, -0.1])
    assert np.linalg.norm(way - np.outer(way @ along, along), axis=1).max() < 2e-4
    assert way[-1] @ along == pytest.approx(np.linalg.norm([0.1, 0.15, -0.1]), abs=2e-5)
    assert max(MODEL.tcp(q).angle(begin) for q in plan.trajectory.position) < 1e-3
    assert cell.plan.disagreements == ()


def test_a_line_says_how_far_it_is_free() -> None:
    cell = Cell(table_scene(item("block", Box((0.1, 0.1, 0.1)), Pose((0.5, 0.0, 0.05)))))
    cell.at = run(cell.plan.to(PoseGoal((down(0.5, 0.0, 0.21),))))[0].trajectory.end
    plan, _ = run(cell.plan.line(OffsetGoal((0.0, 0.0, -0.2), least_fraction=0.3)))
    # The tips, 7.2 mm ahead of the TCP, stop 3 mm above the block: 99.8 mm, in steps of 5 mm.
    assert plan.fraction == pytest.approx(0.475)
    with pytest.raises(Failure) as raised:
        run(cell.plan.line(OffsetGoal((0.0, 0.0, -0.2))))
    assert raised.value.cause == planning.NO_PATH
    begun, _, rest = raised.value.message.partition(" panda_")
    assert begun == "only 48% of the line is free (after 95 of 200 mm), 100% are asked for:"
    assert rest.endswith("finger would be only 2.8 mm from block (3.0 mm to keep)")


def test_a_plan_starts_within_the_margin_of_what_the_hand_has_just_released() -> None:
    cell = Cell(table_scene(item("cube", Box((0.04, 0.04, 0.04)), Pose((0.5, 0.0, 0.02)))), width=0.044)
    with cell.scene.allow(("gripper", "cube")):
        cell.at = run(cell.plan.to(PoseGoal((down(0.5, 0.0, 0.03),))))[0].trajectory.end
    plan, _ = run(cell.plan.line(OffsetGoal((0.0, 0.0, 0.1))))
    assert plan.fraction == 1.0
    assert cell.plan.disagreements == ()


def test_the_judge_catches_a_blind_planner(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    cell = Cell(table_scene(item("tall", Box((0.2, 0.2, 0.7)), Pose((0.35, 0.0, 0.35)))))

    def blind(_: CollisionChecker, __: Array, ___: object = None) -> bool:
        return True

    monkeypatch.setattr(CollisionChecker, "free", blind)
    monkeypatch.setattr(CollisionChecker, "nearly_free", blind)
    monkeypatch.setattr(CollisionChecker, "count_free", lambda _, several: len(several))
    cell.at = MODEL.named("observe")
    with caplog.at_level(logging.ERROR):
        plan, _ = run(cell.plan.to(JointGoal(MODEL.named("observe") * np.array([-1, 1, 1, 1, 1, 1, 1]))))
    assert plan.planner == "direct"
    (disagreement,) = cell.plan.disagreements
    assert {contact.b for contact in disagreement.contacts} == {"tall"}
    assert caplog.records[0].message.startswith("to a configuration: judged to collide: panda_")


def test_another_node_or_seed_plans_otherwise_and_the_same_one_alike() -> None:
    def end(seed: int, node: str) -> bytes:
        cell = Cell(shelf_scene(), seed=seed, verify=False)
        cell.at = run(cell.plan.to(PoseGoal((IN_LEFT,)), node="first"))[0].trajectory.end
        plan, _ = run(cell.plan.to(JointGoal(MODEL.named("observe")), node=node))
        assert plan.planner == "RRTConnect"
        return plan.trajectory.position.tobytes()

    assert end(1, "a") == end(1, "a")
    assert end(1, "a") != end(1, "b")
    assert end(1, "a") != end(2, "a")


def plans_in_turn(*, verify: bool, curious: bool) -> str:
    """A digest of plans in a shelf. A curious cell is asked other things in between."""
    digest = hashlib.sha256()
    cell = Cell(shelf_scene(), verify=verify)
    rng, rng_of_its_own = np.random.default_rng(0), np.random.default_rng(1)
    for _ in range(6):
        x, y, z = rng.uniform([0.5, -0.25, 0.3], [0.62, 0.25, 0.5])
        pose = Pose.from_rpy((float(x), float(y), float(z)), (0.0, np.pi / 2, 0.0))
        if curious:
            supposed = cell.scene.supposing(allowed=[("gripper", "roof")])
            cell.plan.solver.collision.update(supposed, 0.01, clearance=0.02)
            for other in rng_of_its_own.uniform(-1.5, 1.5, (20, 7)):
                cell.plan.solver.collision.free(other)
                cell.plan.contacts(other)
        try:
            plan, ticks = run(cell.plan.to(PoseGoal((pose,)), node="a"))
        except Failure as failure:
            digest.update(f"{failure} {failure.evidence}".encode())
            continue
        cell.at = plan.trajectory.end
        digest.update(plan.trajectory.position.tobytes() + plan.trajectory.times.tobytes())
        digest.update(f"{plan.planner} {plan.checks} {ticks} {cell.thinking.owed!r}".encode())
    return digest.hexdigest()


def test_the_same_bits_in_another_process_with_another_hash_seed(elsewhere: OtherProcess) -> None:
    """The one here is verified, the one there is asked other things in between."""
    there = elsewhere.call(plans_in_turn, verify=False, curious=True)
    assert there == plans_in_turn(verify=True, curious=False)


def test_the_hand_leaves_a_neighbour_that_is_believed_a_little_too_near() -> None:
    """Where the finger is, the neighbour is not: as deep as the belief may be wrong, the hand goes up."""
    half = 0.02 + MODEL.description.gripper.tip
    cell = Cell(table_scene(), width=0.05)
    cell.at = run(cell.plan.to(PoseGoal((down(0.5, 0.0, half),))))[0].trajectory.end

    def beside(depth: float, sigma: float, height: float = 0.06) -> None:
        # The outer face of the finger that opens along y.
        face = max(corner for corner in finger_faces(cell) if corner > 0.0)
        place = Pose((0.5, face - depth + 0.03, height / 2))
        neighbour = replace(item("near", Box((0.03, 0.06, height)), place), sigma_position=sigma)
        cell.scene.put(neighbour, "test")

    beside(0.003, 0.001)
    plan, _ = run(cell.plan.line(OffsetGoal((0.0, 0.0, 0.1))))
    assert plan.fraction == 1.0
    with pytest.raises(Failure):
        run(cell.plan.line(OffsetGoal((0.0, 0.03, 0.0))))
    beside(0.003, 0.0001)
    assert cause_of(cell, OffsetGoal((0.0, 0.0, 0.1))) == planning.START_IN_COLLISION
    beside(0.008, 0.01)
    assert cause_of(cell, OffsetGoal((0.0, 0.0, 0.1))) == planning.START_IN_COLLISION
    assert cell.plan.disagreements == ()


def cause_of(cell: Cell, line: OffsetGoal) -> object:
    with pytest.raises(Failure) as raised:
        run(cell.plan.line(line))
    return raised.value.cause


def finger_faces(cell: Cell) -> list[float]:
    """How far the fingers reach to both sides, y in the world, m, by probing with a thin wall."""
    reach: list[float] = []
    for side in (-1.0, 1.0):
        inside, outside = 0.0, 0.15
        for _ in range(20):
            middle = (inside + outside) / 2
            wall = item("wall", Box((0.03, 0.001, 0.06)), Pose((0.5, side * (middle + 0.0005), 0.03)))
            cell.scene.put(wall, "probe")
            touching = any(c.b == "wall" and c.distance < 0.0 for c in cell.plan.contacts())
            inside, outside = (middle, outside) if touching else (inside, middle)
        cell.scene.remove("wall", "probe")
        reach.append(side * inside)
    return reach
