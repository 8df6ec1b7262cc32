"""Why a request was not planned: scenes whose reason is known because they were built so; sentence and
evidence must name it."""

from __future__ import annotations

from math import degrees, radians

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.robot.planning import (
    BoxConstraint,
    HeldObject,
    JointGoal,
    LineGoal,
    NamedGoal,
    OffsetGoal,
    PoseGoal,
    RegionGoal,
    Request,
    RequestSolver,
    Scaling,
    UprightConstraint,
)
from picktree.world import Array, Bounds, Box, Failure, ObjectId, PlanningScene, Pose, planning
from picktree.world.scene import Fixture

from .motion_cell import HOME, MODEL, down, item, table_scene

TALL = item("tall", Box((0.1, 0.1, 0.5)), Pose((0.5, 0.2, 0.25)))
REACHED = MODEL.tcp(HOME)


def failure(
    scene: PlanningScene, request: Request, *, at: Array = HOME, box: Bounds | None = None
) -> Failure:
    solver = RequestSolver(MODEL, scene, configuration=lambda: at, width=lambda: 0.08, workspace=box)
    with pytest.raises(Failure) as raised:
        solver.solve(request, 1)
    return raised.value


def over(pose: Pose) -> Array:
    """A configuration whose TCP is at a pose."""
    q = RequestSolver(MODEL, table_scene(), configuration=lambda: HOME, width=lambda: 0.08).ik.descend(
        pose, HOME
    )
    assert q is not None
    return q


def number(failure: Failure, key: str) -> float:
    value = failure.evidence[key]
    assert isinstance(value, float)
    return value


def several(failure: Failure, key: str) -> list[str]:
    value = failure.evidence[key]
    assert isinstance(value, list)
    return [str(one) for one in value]


def board(name: str, size: tuple[float, float, float], at: tuple[float, float, float]) -> Fixture:
    """Placed from where the TCP is at home."""
    x, y, z = (a + b for a, b in zip(REACHED.position, at, strict=True))
    return Fixture(ObjectId(name), Box(size), Pose((x, y, z)))


def trap() -> PlanningScene:
    """Around the hand at home, which is wider than the slot in the lid that the wrist passes through."""
    return PlanningScene(
        [
            board("trap_left", (0.21, 0.01, 0.18), (0.0, 0.125, 0.06)),
            board("trap_right", (0.21, 0.01, 0.18), (0.0, -0.125, 0.06)),
            board("trap_front", (0.01, 0.24, 0.13), (0.1, 0.0, 0.03)),
            board("trap_back", (0.01, 0.24, 0.13), (-0.1, 0.0, 0.03)),
            board("trap_floor", (0.2, 0.26, 0.01), (0.0, 0.0, -0.035)),
            board("trap_lid_left", (0.21, 0.04, 0.01), (0.0, 0.105, 0.15)),
            board("trap_lid_right", (0.21, 0.04, 0.01), (0.0, -0.105, 0.15)),
        ],
        [],
    )


def test_1_the_start_is_in_a_body() -> None:
    # The tips are 7.2 mm ahead of the TCP: a block that ends 2.8 mm above the TCP holds 10 mm of them.
    x, y, z = REACHED.position
    block = item("block", Box((0.1, 0.3, 0.1)), Pose((x, y, z - 0.05 + 0.0028)))
    found = failure(table_scene(block), Request(NamedGoal("observe")))
    assert found.cause == planning.START_IN_COLLISION
    finger = found.message.split()[4]
    assert finger in ("panda_leftfinger", "panda_rightfinger")
    assert found.message == f"where the arm is, {finger} is 10.0 mm deep in block"
    assert number(found, "depth") == pytest.approx(0.01, abs=2e-4)
    assert {pair.split()[0] for pair in several(found, "pairs")} == {"panda_leftfinger", "panda_rightfinger"}
    given = failure(table_scene(block), Request(NamedGoal("observe"), start=HOME))
    assert given.message == f"where the motion starts, {finger} is 10.0 mm deep in block"


def test_2_the_goal_is_in_a_body_in_every_posture() -> None:
    found = failure(table_scene(TALL), Request(PoseGoal((down(0.5, 0.2, 0.2),))))
    assert found.cause == planning.GOAL_IN_COLLISION
    assert found.message.startswith("at the goal panda_")
    assert found.message.endswith(" mm deep in tall (the best of 4 solutions)")
    rejected = several(found, "rejected")
    assert len(rejected) == found.evidence["solutions"] == 4
    assert all(one.endswith("deep in tall") for one in rejected)


def test_3_the_goal_is_free_but_nearer_than_the_clearance_that_is_asked_for() -> None:
    # The tips are 4.8 mm over a cube, 3 mm are kept from it, and 20 mm more are asked for.
    scene = table_scene(item("cube", Box((0.1, 0.1, 0.1)), Pose((0.5, 0.0, 0.1))))
    goal = PoseGoal((down(0.5, 0.0, 0.15 + 0.0072 + 0.0048),))
    found = failure(scene, Request(goal, clearance=0.02))
    assert found.cause == planning.GOAL_IN_COLLISION
    assert " is only 4.8 mm from cube (23.0 mm to keep) (the best of 4 solutions)" in found.message
    RequestSolver(MODEL, scene, configuration=lambda: HOME, width=lambda: 0.08).solve(Request(goal), 1)


def test_4_the_pose_is_too_far_away() -> None:
    found = failure(table_scene(), Request(PoseGoal((Pose((2.0, 0.0, 0.333)),))))
    assert found.cause == planning.NO_IK
    # At the height of the shoulder the arm is straight: 0.316 + 0.384 m, and from the wrist on 0.088 m
    # across and 0.107 + 0.105 m along, which it turns so that they add to the rest.
    straight = 0.333 + 2.0
    assert 1.0 < number(found, "short") < straight
    assert found.message == (
        f"the pose is out of reach: the tool ends {number(found, 'short') * 1000:.0f} mm short of it"
    )
    assert found.evidence["obstacle"] == "position"


def test_5_the_point_is_in_reach_but_not_turned_like_that() -> None:
    # Stretched out to the front, the hand cannot look back at the robot.
    found = failure(
        table_scene(), Request(PoseGoal((Pose.from_rpy((0.75, 0.0, 0.5), (0.0, -np.pi / 2, 0.0)),)))
    )
    assert found.cause == planning.NO_IK
    assert found.evidence["obstacle"] == "orientation"
    assert found.message.startswith("the pose is out of reach: the tool gets there, but not turned so: ")
    assert number(found, "turned") > 0.1 and number(found, "short") < 1e-3


def test_6_a_joint_would_have_to_go_beyond_its_limit() -> None:
    folded = np.array([0.0, -0.785, 0.0, MODEL.lower[3] - 0.2, 0.0, 1.571, 0.785])
    found = failure(table_scene(), Request(PoseGoal((MODEL.tcp(folded),))))
    assert found.cause == planning.NO_IK
    assert found.evidence["joints"] == ["panda_joint4"]
    assert found.message.startswith("the pose is out of reach: panda_joint4 would have to go ")
    assert found.message.endswith(" deg beyond its limit of -176.0 deg")


def test_7_a_configuration_beyond_the_limits_of_two_joints() -> None:
    q = HOME.copy()
    q[3], q[6] = MODEL.upper[3] + radians(15), MODEL.lower[6] - radians(5)
    found = failure(table_scene(), Request(JointGoal(q)))
    assert found.cause == planning.NO_IK
    assert found.message == (
        "the configuration lies outside the joint limits: panda_joint4 at 11.0 deg is 15.0 deg beyond its "
        "limit of -4.0 deg (and 1 more)"
    )
    assert several(found, "joints")[1].startswith("panda_joint7 at -171.0 deg is 5.0 deg beyond its limit")


def test_8_the_goal_is_outside_of_the_workspace() -> None:
    box = Bounds((0.2, -0.5, 0.0), (0.6, 0.5, 0.8))
    found = failure(table_scene(), Request(PoseGoal((down(0.7, 0.0, 0.2),))), box=box)
    assert found.cause == planning.WORKSPACE
    assert (
        found.message
        == "at the goal the tool is 100.0 mm outside of the workspace (x = 700 mm, at most 600 mm)"
    )
    near = failure(table_scene(), Request(PoseGoal((down(0.599, 0.0, 0.2),))), box=box)
    assert near.message == (
        "at the goal the tool is only 1.0 mm from the edge of the workspace (x = 599 mm, at most 600 mm)"
    )


@pytest.mark.parametrize("where", ["at the goal", "where the motion starts"])
def test_9_the_tool_is_not_upright(where: str) -> None:
    leant = Pose.from_rpy((0.5, 0.0, 0.3), (np.pi + radians(25), 0.0, 0.0))
    upright = (UprightConstraint(radians(10)),)
    if where == "at the goal":
        found = failure(table_scene(), Request(PoseGoal((leant,)), constraints=upright))
    else:
        found = failure(table_scene(), Request(NamedGoal("home"), constraints=upright), at=over(leant))
    assert found.cause == planning.CONSTRAINT
    assert found.message == f"{where} the tool tilts by 25.0 deg, 10.0 deg are allowed"


def test_10_the_goal_is_outside_of_the_box_to_stay_in() -> None:
    box = BoxConstraint(Bounds((0.2, -0.2, 0.1), (0.7, 0.2, 0.8)))
    found = failure(table_scene(), Request(PoseGoal((down(0.5, 0.23, 0.3),)), constraints=(box,)))
    assert found.cause == planning.CONSTRAINT
    assert found.message == "at the goal the tool is 30.0 mm outside of the box that it must stay in"


def test_11_a_body_stands_on_the_line() -> None:
    # The hand is 104 mm wide to the left of the TCP, which comes from the right.
    cube = item("cube", Box((0.1, 0.1, 0.1)), Pose((0.5, 0.2, 0.4)))
    found = failure(table_scene(cube), Request(LineGoal(down(0.5, 0.3, 0.3))), at=over(down(0.5, -0.1, 0.3)))
    assert found.cause == planning.NO_PATH
    assert found.evidence["ended_by"] == "collision"
    (pair,) = several(found, "pairs")
    assert pair.startswith("panda_hand ") and " cube" in pair
    stopped = found.evidence["at"]
    assert isinstance(stopped, list) and stopped[1] == pytest.approx(0.15 - 0.104, abs=0.009)
    assert found.message == (
        "only 35% of the line is free (after 140 of 400 mm), 100% are asked for: panda_hand would be only "
        "1.0 mm from cube (3.0 mm to keep)"
    )


def test_12_the_arm_is_stretched_out_on_the_line() -> None:
    found = failure(table_scene(), Request(OffsetGoal((1.0, 0.0, 0.0))))
    assert found.cause == planning.NO_PATH
    assert found.evidence["ended_by"] == "reach"
    assert number(found, "singular") < 0.03
    assert found.message.startswith(
        "only 40% of the line is free (after 400 of 1000 mm), 100% are asked for: "
    )
    assert "the arm is stretched out or folded, in a singularity" in found.message


def test_13_a_joint_is_at_its_limit_on_the_line() -> None:
    # Down and back: the elbow folds.
    found = failure(PlanningScene([], []), Request(OffsetGoal((-0.1, 0.0, -0.5))))
    assert found.cause == planning.NO_PATH
    assert found.evidence["joint"] == "panda_joint4"
    assert found.message.endswith("panda_joint4 is at its limit of -176.0 deg")


def test_14_the_line_leans_too_far() -> None:
    leant = Pose.from_rpy(REACHED.position, (np.pi + radians(25), 0.0, 0.0))
    found = failure(table_scene(), Request(LineGoal(leant), constraints=(UprightConstraint(radians(10)),)))
    assert found.cause == planning.CONSTRAINT
    assert found.message.startswith("on the line, at ") and found.message.endswith("10.0 deg are allowed")


def test_15_what_is_held_is_in_the_way_at_the_goal() -> None:
    cube = item("cube", Box((0.1, 0.1, 0.1)), Pose((0.5, 0.0, 0.1)))
    small = item("small", Box((0.04, 0.04, 0.04)), Pose((0.5, 0.3, 0.05)))
    held = HeldObject(ObjectId("small"), Pose((0.0, 0.0, 0.04)))
    # The small cube ends 60 mm below the TCP, the large one 50 mm.
    found = failure(table_scene(cube, small), Request(PoseGoal((down(0.5, 0.0, 0.2),)), holding=held))
    assert found.cause == planning.GOAL_IN_COLLISION
    assert found.message == "at the goal small is 10.0 mm deep in cube (the best of 4 solutions)"


@pytest.mark.parametrize("where", ["goal", "start"])
def test_16_start_or_goal_is_enclosed(where: str) -> None:
    out = MODEL.named("observe")
    begin, goal = (out, "home") if where == "goal" else (HOME, "observe")
    found = failure(trap(), Request(NamedGoal(goal), budget=1500), at=begin)
    assert found.cause == planning.NO_PATH
    assert found.evidence["enclosed"] == where
    by = several(found, "enclosed_by")
    assert all(name.startswith("trap_") for name in by) and len(by) >= 4
    far = number(found, "gets")
    assert far < 1.0
    assert found.message == (
        f"no path within 1500 collision checks: the {where} seems enclosed by panda_link7 at {by[0]}, "
        f"panda_link7 at {by[1]}, panda_hand at {by[2]} and panda_hand at {by[3]}, a search from there "
        f"gets no further than {degrees(far):.0f} deg"
    )


def test_17_a_wall_divides_the_cell() -> None:
    turn = 0.95
    wall = Fixture(
        ObjectId("wall"),
        Box((1.6, 0.02, 2.6)),
        Pose.from_rpy((0.95 * np.cos(turn), 0.95 * np.sin(turn), 1.2), (0.0, 0.0, turn)),
    )
    out = MODEL.named("observe").copy()
    out[0] = 2.2
    found = failure(PlanningScene([wall], []), Request(NamedGoal("home"), budget=1500), at=out)
    assert found.cause == planning.BUDGET
    assert found.message == (
        "no path within 1500 collision checks: in the way of the straight motion is panda_link5 at wall"
    )
    assert found.evidence["in_the_way"] == ["wall"]
    assert found.evidence["enclosed"] == ""


def test_18_an_object_that_is_not_there_is_supposed_to_be_held() -> None:
    found = failure(
        table_scene(), Request(NamedGoal("observe"), holding=HeldObject(ObjectId("ghost"), Pose()))
    )
    assert str(found) == "world.unknown_object: no object 'ghost' in the planning scene"


@pytest.mark.parametrize(
    ("request_", "sentence"),
    [
        (Request(NamedGoal("nowhere")), "no pose 'nowhere' in the robot file; known: home, observe, rest"),
        (Request(JointGoal(np.zeros(6))), "the goal has 6 numbers, panda has 7 joints"),
        (Request(JointGoal(HOME * np.nan)), "the goal has numbers that are not finite"),
        (Request(NamedGoal("home"), start=np.zeros(3)), "the start has 3 numbers, panda has 7 joints"),
        (Request(PoseGoal(())), "the goal names no pose"),
        (Request(OffsetGoal((0.0, 0.0, float("nan")))), "the goal has numbers that are not finite"),
        (
            Request(RegionGoal(Pose(), yaw=-1.0)),
            "a region's turn, tilt and reach must not be negative",
        ),
        (
            Request(NamedGoal("home"), constraints=(UprightConstraint(0.1, (0.0, 0.0, 0.0)),)),
            "upright: needs an axis that is not zero, and a tilt of 0 to 180 deg",
        ),
        (
            Request(
                NamedGoal("home"), constraints=(BoxConstraint(Bounds((1.0, 0.0, 0.0), (0.0, 1.0, 1.0))),)
            ),
            "within: the box must not have its least corner beyond its greatest one",
        ),
        (Request(NamedGoal("home"), clearance=-0.01), "a clearance of -10 mm: it must not be negative"),
        (Request(NamedGoal("home"), budget=0), "a budget of 0 checks: at least one is needed"),
        (
            Request(NamedGoal("home"), scaling=Scaling(0.0, 1.0)),
            "a scaling of 0 and 1: both must be above 0, at most 1",
        ),
    ],
)
def test_what_makes_no_sense_is_bad_input(request_: Request, sentence: str) -> None:
    solver = RequestSolver(MODEL, table_scene(), configuration=lambda: HOME, width=lambda: 0.08)
    with pytest.raises(PicktreeError) as raised:
        solver.solve(request_, 1)
    assert str(raised.value) == sentence
