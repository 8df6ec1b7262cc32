"""Several motions as one trajectory: no stop between them, every leg's own limits and suppositions."""

from __future__ import annotations

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.robot.planning import (
    HeldObject,
    JointGoal,
    LineGoal,
    MotionPlan,
    NamedGoal,
    OffsetGoal,
    PoseGoal,
    Request,
    Scaling,
)
from picktree.robot.planning.motion_chain import split_into_legs
from picktree.robot.planning.time_parameterization import ACCELERATION_RISE_TIME
from picktree.world import Array, Box, Failure, ObjectId, Plan, Pose, Sphere, Trajectory, planning

from .motion_cell import HOME, MODEL, Cell, down, item, littered, run, shelf_scene, table_scene

BLOCK = item("block", Box((0.04, 0.04, 0.04)), Pose((0.5, 0.0, 0.02)))
TOUCHING = (("gripper", "block"),)
IN_HAND = HeldObject(ObjectId("block"), Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)))
PICK = (
    Request(PoseGoal((down(0.5, 0.0, 0.12),))),
    Request(LineGoal(down(0.5, 0.0, 0.02)), allowed=TOUCHING, scaling=Scaling(0.4, 0.4)),
)
CARRY = (
    Request(OffsetGoal((0.0, 0.0, 0.12)), allowed=TOUCHING, holding=IN_HAND, scaling=Scaling(0.5, 0.5)),
    Request(PoseGoal((down(0.35, 0.4, 0.3),)), holding=IN_HAND),
    Request(OffsetGoal((0.0, 0.0, -0.08)), holding=IN_HAND, scaling=Scaling(0.3, 0.3)),
)


def at_the_block() -> Cell:
    cell = Cell(table_scene(BLOCK))
    cell.at = run(cell.plan.through(PICK))[0].trajectory.end
    return cell


def respects(trajectory: Trajectory, scaling: Scaling) -> None:
    """Limits of velocity, acceleration and jerk, from the samples themselves."""
    velocity = MODEL.velocity_limit * scaling.velocity * (1 + 1e-9)
    acceleration = MODEL.acceleration_limit * scaling.acceleration * (1 + 1e-9)
    dt = np.diff(trajectory.times)[:, None]
    assert (dt > 0).all() and dt.max() < 0.0201
    assert (np.abs(trajectory.velocity) <= velocity).all()
    assert (np.abs(np.diff(trajectory.velocity, axis=0)) <= acceleration * dt).all()
    assert (np.abs(trajectory.acceleration) <= acceleration).all()
    assert (
        np.abs(np.diff(trajectory.acceleration, axis=0)) <= acceleration / ACCELERATION_RISE_TIME * dt
    ).all()


def requests_of(plan: MotionPlan) -> list[Request]:
    """Requests of a chain's legs, each with its start."""
    return [leg.request for leg in plan.legs if leg.request is not None]


def inner(plan: MotionPlan, slack: int = 3) -> list[Trajectory]:
    """Each leg's part, without the samples beside its ends, where the slower neighbour's limits hold."""
    cut = [
        (p.times[slack:-slack], p.position[slack:-slack], p.velocity[slack:-slack])
        for p in split_into_legs(plan)
    ]
    return [Trajectory(t, q, v, np.zeros_like(v)) for t, q, v in cut]


def off_the_line(positions: Array, a: Pose, b: Pose) -> Array:
    """Distance of the TCP (m,) from the straight line through two poses, m."""
    at = np.array([MODEL.tcp(q).position for q in positions])
    along = np.subtract(b.position, a.position) / a.distance(b)
    offset = at - np.array(a.position)
    return np.linalg.norm(offset - (offset @ along)[:, None] * along, axis=1)


def test_pick_and_carry_are_one_motion_each_without_a_stop() -> None:
    cell = at_the_block()
    with cell.scene.allow(*TOUCHING):
        plan, _ = run(cell.plan.through(CARRY))
    assert plan.planner == "chain"
    assert len(plan.passes) == 3 and plan.passes[-1] == plan.trajectory.duration
    assert list(plan.passes) == sorted(plan.passes)
    speed = np.linalg.norm(plan.trajectory.velocity, axis=1)
    moving = (plan.trajectory.times > 0.1) & (plan.trajectory.times < plan.trajectory.duration - 0.1)
    assert speed[moving].min() > 0.1
    with cell.scene.allow(*TOUCHING):
        alone = [run(cell.plan.solve(leg))[0].trajectory for leg in requests_of(plan)]
    assert plan.trajectory.duration < sum(leg.duration for leg in alone) - 0.05
    assert MODEL.tcp(plan.trajectory.end).distance(down(0.35, 0.4, 0.22)) < 2e-5
    assert cell.plan.disagreements == ()


def test_each_leg_keeps_its_own_scaling() -> None:
    cell = at_the_block()
    with cell.scene.allow(*TOUCHING):
        plan, _ = run(cell.plan.through(CARRY))
    respects(plan.trajectory, Scaling())
    for part, leg in zip(inner(plan), CARRY, strict=True):
        limit = MODEL.velocity_limit * leg.scaling.velocity
        assert (np.abs(part.velocity) <= limit * (1 + 1e-9)).all()
    fast = np.abs(split_into_legs(plan)[1].velocity / MODEL.velocity_limit).max()
    assert fast > 0.6


def test_a_line_stays_straight_but_for_its_rounded_ends() -> None:
    cell = Cell(table_scene(BLOCK))
    above, below = down(0.5, 0.0, 0.12), down(0.5, 0.0, 0.02)
    for rounded in (0.01, 0.03):
        plan, _ = run(cell.plan.through(PICK, rounded=rounded))
        line = split_into_legs(plan)[1].position
        high = np.array([MODEL.tcp(q).position[2] for q in line])
        straight = high < 0.12 - rounded - 1e-3
        assert straight.sum() > 20
        assert off_the_line(line[straight], above, below).max() < 3e-4
        assert off_the_line(line, above, below).max() < rounded


def test_where_the_way_turns_back_the_arm_stops() -> None:
    cell = Cell(table_scene())
    by = (0.0, 0.0, -0.1)
    plan, _ = run(cell.plan.through([Request(OffsetGoal(by)), Request(OffsetGoal((0.0, 0.0, 0.1)))]))
    k = int(np.searchsorted(plan.trajectory.times, plan.passes[0] - 1e-9))
    assert not plan.trajectory.velocity[k].any()
    assert np.abs(plan.trajectory.end - HOME).max() < 1e-3


def test_a_corner_is_rounded_less_where_something_stands_inside_it() -> None:
    shelf = item("shelf", Box((0.1, 0.3, 0.02)), Pose((0.55, 0.0, 0.19)))
    legs = [Request(OffsetGoal((0.0, 0.0, 0.043))), Request(OffsetGoal((0.06, 0.0, 0.0)))]
    corner, nearest = down(0.4862, 0.0, 0.2105), list[float]()
    for cell in (Cell(table_scene()), Cell(table_scene(shelf))):
        beside = cell.plan.reachable(corner.shifted((0.0, 0.0, -0.043)), near=HOME)
        assert beside is not None
        cell.at = beside
        plan, _ = run(cell.plan.through(legs, rounded=0.05))
        nearest.append(min(MODEL.tcp(q).distance(corner) for q in plan.trajectory.position))
        assert np.linalg.norm(plan.trajectory.velocity, axis=1)[5:-5].min() > 0.05
        assert cell.plan.disagreements == ()
    assert nearest[1] < 0.8 * nearest[0]


def test_nothing_of_a_line_is_rounded_when_the_caller_says_so() -> None:
    cell = Cell(table_scene(BLOCK), verify=False)
    plan, _ = run(cell.plan.through(PICK, rounded=0.0))
    k = int(np.searchsorted(plan.trajectory.times, plan.passes[0] - 1e-9))
    assert not plan.trajectory.velocity[k].any()


def test_a_leg_that_does_not_move_takes_no_time() -> None:
    cell = Cell(table_scene())
    plan, _ = run(
        cell.plan.through(
            [Request(NamedGoal("home")), Request(JointGoal(HOME + 0.2)), Request(JointGoal(HOME + 0.2))]
        )
    )
    assert plan.passes[0] == 0.0 and plan.passes[1] == plan.passes[2] == plan.trajectory.duration
    still, _ = run(cell.plan.through([Request(NamedGoal("home"))]))
    assert still.passes == (0.0,) and still.trajectory.duration < 0.011


def test_the_leg_that_fails_is_named() -> None:
    cell = Cell(table_scene())
    with pytest.raises(Failure) as caught:
        run(cell.plan.through([Request(NamedGoal("home")), Request(PoseGoal((down(3.0, 0.0, 0.2),)))]))
    assert caught.value.cause == planning.NO_IK
    assert caught.value.message.startswith("motion 2 of 2 (to (3.000, 0.000, 0.200)): ")
    assert caught.value.evidence["leg"] == 1
    made = [entry for entry in cell.journal.take() if isinstance(entry, Plan)]
    assert [(entry.request, entry.outcome) for entry in made] == [
        ("to home, then to (3.000, 0.000, 0.200)", "planning.no_ik")
    ]


def test_only_the_first_leg_says_where_it_starts() -> None:
    cell = Cell(table_scene())
    for legs in ([], [Request(NamedGoal("home")), Request(NamedGoal("home"), start=HOME)]):
        with pytest.raises(PicktreeError) as caught:
            run(cell.plan.through(legs))
        assert str(caught.value) == "a chain needs legs, of which only the first may say where it starts"
    plan, _ = run(cell.plan.through([Request(NamedGoal("home"), start=HOME + 0.1)]))
    assert np.array_equal(plan.trajectory.start, HOME + 0.1)


def test_what_a_chain_costs_is_charged_and_noted_once() -> None:
    cell = Cell(table_scene(BLOCK), cost=1e-3)
    plan, ticks = run(cell.plan.through(PICK))
    made = [entry for entry in cell.journal.take() if isinstance(entry, Plan)]
    assert [(m.request, m.planner, m.outcome, m.duration) for m in made] == [
        (
            "to (0.500, 0.000, 0.120), then straight to (0.500, 0.000, 0.020)",
            "chain",
            "found",
            plan.trajectory.duration,
        )
    ]
    assert made[0].checks >= plan.checks > 0
    assert ticks == int(made[0].thinking / 0.05)


@pytest.mark.parametrize("seed", range(3))
def test_random_chains_keep_all_limits_and_touch_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cell = Cell(littered(seed, 8))
    for _ in range(2):
        x, y = rng.uniform([0.35, -0.3], [0.6, 0.3])
        over = down(float(x), float(y), float(rng.uniform(0.2, 0.35)))
        scalings = [Scaling(*(float(s) for s in rng.uniform(0.2, 1.0, 2))) for _ in range(4)]
        way = [float(w) for w in rng.uniform(-0.1, 0.1, 3)]
        legs = [
            Request(PoseGoal((over,)), scaling=scalings[0]),
            Request(OffsetGoal((0.0, 0.0, -0.05), least_fraction=0.3), scaling=scalings[1]),
            Request(OffsetGoal((way[0], way[1], 0.08), least_fraction=0.3), scaling=scalings[2]),
            Request(NamedGoal("home"), scaling=scalings[3]),
        ]
        plan, _ = run(cell.plan.through(legs))
        respects(plan.trajectory, Scaling())
        for part, leg in zip(inner(plan), legs, strict=True):
            limit = MODEL.velocity_limit * leg.scaling.velocity * (1 + 1e-9)
            assert (np.abs(part.velocity) <= limit).all()
        assert (plan.trajectory.position >= MODEL.lower).all()
        assert (plan.trajectory.position <= MODEL.upper).all()
    assert cell.plan.disagreements == ()


def test_a_leg_with_one_corner_gives_up_more_of_it_than_one_with_two() -> None:
    """Blends take 70 % of a 10 cm line at the last leg's only corner, 45 % at each of two; none overlap."""
    up, aside = Request(OffsetGoal((0.0, 0.0, 0.1))), Request(OffsetGoal((0.0, 0.1, 0.0)))
    low, nearest = down(0.5, 0.0, 0.15), list[float]()
    for legs in ((up, aside), (up, aside, up)):
        cell = Cell(table_scene())
        begin = cell.plan.reachable(low, near=HOME)
        assert begin is not None
        cell.at = begin
        plan, _ = run(cell.plan.through(legs, rounded=0.1))
        corner = low.shifted((0.0, 0.0, 0.1))
        nearest.append(min(MODEL.tcp(q).distance(corner) for q in plan.trajectory.position))
        assert np.linalg.norm(plan.trajectory.velocity, axis=1)[5:-5].min() > 0.05
        assert cell.plan.disagreements == ()
    assert nearest[0] > 1.3 * nearest[1]


@pytest.mark.parametrize("length", [0.002, 0.006, 0.02])
def test_a_last_line_of_millimetres_keeps_a_part_that_is_not_rounded(length: float) -> None:
    """It has so few steps that its only corner took all of it."""
    cell = Cell(table_scene())
    legs = [Request(PoseGoal((down(0.5, 0.1, 0.3),))), Request(OffsetGoal((0.0, 0.0, -length)))]
    plan, _ = run(cell.plan.through(legs))
    end = MODEL.tcp(plan.trajectory.end)
    assert end.distance(down(0.5, 0.1, 0.3 - length)) < 1e-3
    assert plan.passes[0] < plan.passes[1] == plan.trajectory.duration


def test_a_leg_that_touches_something_between_the_steps_of_its_search_is_planned_again() -> None:
    """A bead that the straight edge's steps miss, and its trajectory does not."""
    cell = Cell(table_scene(item("bead", Sphere(0.002), Pose((0.417, 0.165, 0.442)))))
    over = cell.plan.reachable(down(0.5, 0.3, 0.3), near=HOME)
    assert over is not None
    legs = [Request(JointGoal(over)), Request(OffsetGoal((0.0, 0.0, -0.1)))]
    assert cell.plan.solver.path(legs[0], 1).planner == "direct"
    plan, _ = run(cell.plan.through(legs))
    assert plan.legs[0].planner == "RRTConnect"
    assert np.array_equal(plan.legs[0].path[-1], over)
    assert cell.plan.disagreements == ()


def test_a_leg_that_is_refused_is_not_searched_twice() -> None:
    """The leg before it is checked by itself, and ends where it did."""
    cell = Cell(shelf_scene())
    before = HOME + 0.05
    inside = cell.plan.reachable(Pose.from_rpy((0.6, 0.15, 0.4), (0.0, np.pi / 2, 0.0)), near=HOME)
    assert inside is not None
    into = Request(JointGoal(inside), budget=150)
    with pytest.raises(Failure) as caught:
        run(cell.plan.through([Request(JointGoal(before)), into]))
    assert caught.value.cause == planning.BUDGET and caught.value.evidence["leg"] == 1
    cell.at = before
    with pytest.raises(Failure):
        run(cell.plan.solve(into))
    chain, alone = (entry.checks for entry in cell.journal.take() if isinstance(entry, Plan))
    assert alone < chain < 1.5 * alone
