"""Starts beyond soft limits or the workspace: the way back in, and the failure where there is none."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from math import degrees, radians, tau

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from picktree.robot.planning import (
    Constraint,
    JointGoal,
    LineGoal,
    MotionPlan,
    NamedGoal,
    Request,
    RequestSolver,
    Target,
    TrajectoryGate,
    UprightConstraint,
)
from picktree.robot.planning.limits import start_excess
from picktree.robot.planning.penetration_escape import EscapeSearch
from picktree.robot.planning.return_path import ReturnSearch
from picktree.robot.planning.trajectory_check import StartTolerance
from picktree.world import Array, Bounds, Box, Failure, PlanningScene, Pose, planning
from picktree.world.robot_model import RobotModel, load_robot

from .motion_cell import HOME, MODEL, Cell, item, littered, run, table_scene

EVERYWHERE = Bounds((-2.0, -2.0, -1.0), (2.0, 2.0, 2.0))


@cache
def robot(name: str) -> RobotModel:
    return RobotModel(load_robot(name))


def solver(
    q: Array, workspace: Bounds = EVERYWHERE, model: RobotModel = MODEL, scene: PlanningScene | None = None
) -> RequestSolver:
    return RequestSolver(
        model,
        table_scene() if scene is None else scene,
        configuration=lambda: q,
        width=lambda: 0.04,
        workspace=workspace,
    )


def answer(one: RequestSolver, target: Target, *constraints: Constraint) -> MotionPlan | Failure:
    try:
        return one.solve(Request(target, constraints=constraints), 1)
    except Failure as failure:
        return failure


def leads_in(one: RequestSolver, plan: MotionPlan) -> None:
    """No excess grows on the way, and none is left. Cut corners may take a millimetre, or a milliradian."""
    one.look()
    way = StartTolerance(one.collision, plan.trajectory.start)
    excess = np.array([way.excess_at(q) for q in plan.trajectory.position])
    assert (excess <= excess[0] + 1e-4).all()
    assert (excess <= np.minimum.accumulate(excess) + 1e-3).all()
    assert not excess[-1].any()


def one_of(name: str) -> RobotModel:
    return MODEL if name == "panda" else robot(name)


@settings(max_examples=6, deadline=None)
@given(
    st.sampled_from(["panda", "xarm6", "iiwa"]),
    st.integers(0, 5),
    st.booleans(),
    st.floats(1e-3, 3.0),
    st.integers(0, 2**32 - 1),
)
def test_a_joint_beyond_its_limit_by_any_amount_comes_back_or_is_named(
    name: str, joint: int, above: bool, by: float, seed: int
) -> None:
    model = one_of(name)
    home = model.named("home")
    q = home + 0.3 * (np.random.default_rng(seed).uniform(model.lower, model.upper) - home)
    limit = float(model.upper[joint] if above else model.lower[joint])
    q[joint] = limit + (by if above else -by)
    one = solver(q, model=model)
    found = answer(one, NamedGoal("home"))
    if isinstance(found, MotionPlan):
        leads_in(one, found)
        return
    assert found.cause == planning.START_OUTSIDE
    assert found.evidence["joints"] == [model.description.joints[joint]]
    assert found.evidence["beyond"] == [pytest.approx(by)]
    assert found.message.startswith(
        f"where the arm is, {model.description.joints[joint]} at {degrees(q[joint]):.1f} deg is "
        f"{degrees(abs(q[joint] - limit)):.1f} deg beyond its limit of {degrees(limit):.1f} deg; "
    )


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from([0, 1, 2]),
    st.booleans(),
    st.floats(1e-4, 0.4),
    st.integers(0, 2**32 - 1),
)
def test_a_tool_beyond_any_side_by_any_amount_comes_back_or_is_named(
    axis: int, above: bool, by: float, seed: int
) -> None:
    q = HOME + 0.2 * np.random.default_rng(seed).uniform(-1.0, 1.0, 7)
    tool = MODEL.tcp(q).position
    low, high = list(EVERYWHERE.min), list(EVERYWHERE.max)
    if above:
        high[axis] = tool[axis] - by
    else:
        low[axis] = tool[axis] + by
    workspace = Bounds((low[0], low[1], low[2]), (high[0], high[1], high[2]))
    goal = next(
        (
            g
            for g in np.random.default_rng(seed).uniform(0.7 * MODEL.lower, 0.7 * MODEL.upper, (400, 7))
            if start_excess(MODEL, workspace, g) is None and solver(g).collision.free(g)
        ),
        None,
    )
    assert goal is not None
    one = solver(q, workspace, scene=PlanningScene([], []))
    found = answer(one, JointGoal(goal))
    if isinstance(found, MotionPlan):
        leads_in(one, found)
        return
    assert found.cause == planning.START_OUTSIDE
    assert found.evidence["axis"] == "xyz"[axis]
    assert found.evidence["by"] == pytest.approx(by)
    bound = f"at {'most' if above else 'least'} {(high if above else low)[axis] * 1000:.0f} mm)"
    assert (
        f"the tool is {by * 1000:.1f} mm outside of the workspace "
        f"({'xyz'[axis]} = {tool[axis] * 1000:.0f} mm, {bound}"
    ) in found.message


def far_outside() -> tuple[Array, Bounds]:
    """The tool 250 mm above a low workspace."""
    return HOME.copy(), Bounds((-0.8, -0.8, 0.0), (0.8, 0.8, MODEL.tcp(HOME).position[2] - 0.25))


def below() -> Array:
    """A configuration with the tool low over the table."""
    return np.array([0.0, 0.35, 0.0, -2.2, 0.0, 2.55, 0.785])


def test_from_far_outside_a_plan_leads_back_in_and_the_gate_lets_it_pass() -> None:
    q, workspace = far_outside()
    one = solver(q, workspace)
    found = answer(one, JointGoal(below()))
    assert isinstance(found, MotionPlan)
    leads_in(one, found)
    cell = Cell(table_scene())
    cell.at = q
    run(TrajectoryGate(MODEL, cell.plan, workspace).passes(found.trajectory))


@pytest.mark.parametrize("seed", [2, 19])
def test_around_obstacles_no_excess_grows_on_the_way_in_either(seed: int) -> None:
    q, workspace = far_outside()
    one = solver(q, workspace, scene=littered(seed, 60, 0.45))
    one.look()
    way = StartTolerance(one.collision, q)
    search = ReturnSearch(MODEL, one.collision, one.ik, way, q, lambda _: True)
    assert search.straight([HOME]) is None
    path = search.around(1, 20000)
    assert path is not None
    points = np.concatenate([np.linspace(a, b, 50) for a, b in pairwise(path)])
    excess = np.array([way.excess_at(at) for at in points])
    assert (excess <= np.minimum.accumulate(excess) + 1e-4).all()
    assert not excess[-1].any()
    assert all(map(way.free, points))


def test_the_gate_names_the_side_on_which_a_trajectory_would_leave_the_workspace() -> None:
    workspace = far_outside()[1]
    out = answer(solver(below()), JointGoal(HOME))
    assert isinstance(out, MotionPlan)
    cell = Cell(table_scene())
    cell.at = below()
    with pytest.raises(Failure) as refused:
        run(TrajectoryGate(MODEL, cell.plan, workspace).passes(out.trajectory))
    top = workspace.max[2] * 1000
    assert refused.value.message.startswith(
        f"the trajectory is refused: the tool would be 250 mm outside the workspace (z = {top + 250:.0f} mm, "
        f"at most {top:.0f} mm) after "
    )


def test_a_chain_that_begins_outside_leads_back_in_as_one_motion() -> None:
    q, workspace = far_outside()
    cell = Cell(table_scene())
    cell.at = q
    cell.plan.solver = solver(q, workspace)
    up = MODEL.tcp(below()).shifted((0.0, 0.0, 0.02))
    plan, _ = run(cell.plan.through([Request(JointGoal(below())), Request(LineGoal(up))]))
    leads_in(cell.plan.solver, plan)


def test_a_constraint_holds_on_the_way_back_in() -> None:
    q, workspace = far_outside()
    one = solver(q, workspace)
    upright = UprightConstraint(radians(20))
    found = answer(one, JointGoal(below()), upright)
    assert isinstance(found, MotionPlan)
    leads_in(one, found)
    for at in found.trajectory.position:
        assert -MODEL.tcp(at).rotation()[2, 2] >= np.cos(radians(20)) - 1e-6


def test_a_line_may_come_in_and_not_go_further_out() -> None:
    q, workspace = far_outside()
    here = MODEL.tcp(q)
    one = solver(q, workspace)
    found = answer(one, LineGoal(here.shifted((0.0, 0.0, -0.3))))
    assert isinstance(found, MotionPlan)
    leads_in(one, found)
    out = answer(one, LineGoal(here.shifted((0.0, 0.0, 0.05))))
    assert isinstance(out, Failure)
    assert out.cause == planning.START_OUTSIDE
    top = workspace.max[2] * 1000
    assert out.message.startswith(
        f"where the arm is, the tool is 250.0 mm outside of the workspace (z = {top + 250:.0f} mm, at most "
        f"{top:.0f} mm); no straight motion leads back in, a free one may: only 0% of the line is free"
    )


def test_a_start_more_than_a_turn_beyond_asks_for_degrees() -> None:
    q = np.array([0.0, -45.0, 0.0, -2.3, 0.0, 1.5, 0.7])
    for over, asked in ((tau - 0.01, False), (tau + 0.01, True)):
        turned = HOME.copy()
        turned[6] = MODEL.upper[6] + over
        found = answer(solver(turned), NamedGoal("observe"))
        assert asked is (isinstance(found, Failure) and "degrees?" in found.message)
    found = answer(solver(HOME), JointGoal(q))
    assert isinstance(found, Failure)
    assert found.message == (
        "the configuration lies outside the joint limits: panda_joint2 at -2578.3 deg is 2477.3 deg beyond "
        "its limit of -101.0 deg; degrees? Numbers without a unit are in rad"
    )


def test_a_start_in_collision_beyond_a_limit_names_both_bodies() -> None:
    q = HOME.copy()
    q[1] = MODEL.upper[1] + radians(30)
    found = answer(solver(q), NamedGoal("home"))
    assert isinstance(found, Failure)
    assert found.cause == planning.START_OUTSIDE
    limit = degrees(float(MODEL.upper[1]))
    begun = (
        f"where the arm is, panda_joint2 at {limit + 30:.1f} deg is 30.0 deg beyond its limit of 101.0 deg; "
    )
    assert found.message.startswith(begun + "panda_link")
    assert found.message.endswith(" mm deep in table")


def test_a_goal_that_is_the_trouble_keeps_its_cause() -> None:
    q, workspace = far_outside()
    found = answer(solver(q, workspace), NamedGoal("home"))
    assert isinstance(found, Failure)
    assert found.cause == planning.WORKSPACE


def test_an_escape_from_outside_of_the_workspace_ends_free_and_no_further_out() -> None:
    q, workspace = far_outside()
    x, y, z = MODEL.tcp(q).position
    scene = table_scene(item("ghost", Box((0.08, 0.08, 0.08)), Pose((x + 0.02, y + 0.06, z + 0.03))))
    one = solver(q, workspace, scene=scene)
    one.look()
    assert one.collision.contacts(q)
    search = EscapeSearch(MODEL, one.collision, q)
    ways = [search.way(direction, 0.4) for direction in ("out", "back", "inwards", "left", "right", "down")]
    assert any(way.free for way in ways)
    heights = [MODEL.tcp(at).position[2] for way in ways for at in way.path]
    assert max(heights) <= z + 1e-6
