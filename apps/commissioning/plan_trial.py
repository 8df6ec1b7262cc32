"""Plan trial: one motion planned in a scene without a mission, and its result."""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from ...analysis.render.viewpoint import PictureView
from ...robot.planning.planning_failures import contact_lines
from ...robot.planning.requests import (
    DEFAULT_CHECK_BUDGET,
    Constraint,
    MotionPlan,
    NamedGoal,
    Request,
    UprightConstraint,
)
from ...robot.world import World
from ...session.assembly import assemble_world
from ...simulation.backends import build_hardware
from ...simulation.truth import TrueBody
from ...world.belief.planning_scene import BeliefObject
from ...world.causes import Failure
from ...world.robot_model.joint_limits import is_hinge
from ...world.robot_model.loading import load_robot
from ...world.scene.scene_loading import load_scene
from .target_syntax import GoalAttempt, ParsedGoal, parse_goal, parse_start
from .trial_picture import draw
from .trial_result import PlanAnswer, PlanFigures, PlanRefusal

EXACT_BELIEF_DEVIATION = 1e-4
"""Standard deviation of exactly believed poses: positions, m, and angles, rad."""


def build(scene: str, robot: str | None, seed: int, *, verify: bool) -> World:
    """Build the world of a shipped scene or a scene file; the belief has all spawned items at their true
    poses.

    `robot`: a shipped robot or a robot file instead of the scene's. Raises PicktreeError.
    """
    description = load_scene(scene, Path.cwd())
    beside = Path.cwd() if robot else Path(description.source).parent
    arm = load_robot(robot or description.robot, beside)
    hardware = build_hardware("kinematic", description, arm, seed)
    world = assemble_world(hardware, description, arm, seed, verify=verify)
    for body in hardware.recent_truth():
        if body.present:
            world.scene.put(_believed(world, body), "believed as it is")
    world.scene.take_changes()
    return world


def _believed(world: World, body: TrueBody) -> BeliefObject:
    """Return the believed object of a true body, named as perception names it."""
    return BeliefObject(
        world.scene.new_id(f"{body.colour}_{body.kind}"),
        "item",
        body.kind,
        body.form,
        body.shape,
        body.colour,
        body.pose,
        EXACT_BELIEF_DEVIATION,
        EXACT_BELIEF_DEVIATION,
        1.0,
        world.clock.now,
    )


TRIAL_NODE = "plan"
"""Node path of the trial: key of the planner's random stream."""
HOME_POSE = "home"
MAX_GRASPS = 12
"""Greatest number of grasps of an object that are tried."""
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class PlanQuery:
    """Request of `picktree plan`; m, rad."""

    scene: str
    to: str
    begin: str = ""
    """Start: named pose or a number for each joint; empty: home."""
    robot: str | None = None
    seed: int = 0
    upright: float | None = None
    """Greatest tilt of a tool that points down, rad; None: any."""
    line: bool = False
    clearance: float = 0.0
    budget: int = DEFAULT_CHECK_BUDGET
    planner: str = ""
    """Name of the planner; empty: that of scene or robot."""
    verify: bool = False
    picture: Path | None = None
    view: PictureView | None = None
    size: tuple[int, int] = (1280, 800)


def plan_in_scene(asked: PlanQuery) -> PlanAnswer:
    """Plan a motion in a scene. Raises PicktreeError for an unknown scene, robot, goal or start."""
    world = build(asked.scene, asked.robot, asked.seed, verify=asked.verify)
    q = parse_start(world, asked.begin) if asked.begin else world.robot.named(HOME_POSE)
    constraints: tuple[Constraint, ...] = () if asked.upright is None else (UprightConstraint(asked.upright),)
    request = Request(
        NamedGoal(HOME_POSE),
        q,
        constraints=constraints,
        clearance=asked.clearance,
        budget=asked.budget,
        planner=asked.planner,
    )
    goal = parse_goal(world, asked.to, request, line=asked.line)
    tried = _first_success(world, goal)
    answer = PlanAnswer(
        asked.scene,
        world.robot.description.name,
        asked.seed,
        goal.words + _constraint_words(asked),
        asked.begin or HOME_POSE,
        grasp="" if tried.attempt is None else tried.attempt.name,
        rejected=_counted((*goal.rejected, *tried.rejected)),
    )
    if isinstance(tried.outcome, MotionPlan):
        answer = replace(answer, found=plan_figures(world, tried.outcome))
        if asked.verify:
            against = [line for one in world.plan.disagreements for line in contact_lines(one.contacts)]
            answer = replace(answer, judged=tuple(against))
    elif tried.outcome is not None:
        answer = replace(answer, refused=PlanRefusal.of(tried.outcome))
    else:
        sentence = f"the hand finds no room at any of {len(goal.rejected)} grasps of {asked.to}"
        if not goal.rejected:
            sentence = f"{asked.to} is wider than the gripper opens"
        refused = PlanRefusal("grasp.no_candidate", sentence, "clear what stands around it", {})
        answer = replace(answer, refused=refused)
    if asked.picture is not None:
        view = asked.view or PictureView()
        draw(world, q, tried.outcome, answer.asked, asked.picture, view, asked.size)
        answer = replace(answer, picture=str(asked.picture))
    return answer


@dataclass(frozen=True, slots=True)
class _Tried:
    """Result of the attempts. `outcome`: the plan, or the failure of the first attempt; None: there was
    nothing to attempt."""

    attempt: GoalAttempt | None
    outcome: MotionPlan | Failure | None
    rejected: tuple[str, ...]


def _first_success(world: World, goal: ParsedGoal) -> _Tried:
    """Plan one attempt after the other, until one succeeds."""
    failures: list[tuple[GoalAttempt, Failure]] = []
    for attempt in goal.attempts[:MAX_GRASPS]:
        steps = (
            world.plan.solve(attempt.legs[0], node=TRIAL_NODE)
            if len(attempt.legs) == 1
            else world.plan.through(attempt.legs, node=TRIAL_NODE)
        )
        try:
            plan = _run_to_end(steps)
        except Failure as failure:
            failures.append((attempt, failure))
            continue
        return _Tried(attempt, plan, _messages(failures))
    if not failures:
        return _Tried(None, None, ())
    attempt, failure = failures[0]
    return _Tried(attempt, failure, _messages(failures[1:]))


def _messages(failures: list[tuple[GoalAttempt, Failure]]) -> tuple[str, ...]:
    return tuple(failure.message for _, failure in failures)


def _counted(reasons: tuple[str, ...]) -> tuple[str, ...]:
    """Return the reasons with their counts, as `12 × the hand would touch red_block_1`, the most frequent
    first."""
    return tuple(f"{count} × {reason}" for reason, count in Counter(reasons).most_common())


def _run_to_end(steps: Generator[None, None, T]) -> T:
    """Run a generator to its end and return its value; the ticks of its thinking are skipped."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def plan_figures(world: World, plan: MotionPlan) -> PlanFigures:
    """Return the figures of a plan in the present belief."""
    quality = world.plan.quality(plan)
    near, own, joint = quality.nearest, quality.itself, quality.joint
    index = world.robot.description.joints.index(joint.joint)
    return PlanFigures(
        plan.planner,
        tuple(leg.planner for leg in plan.legs),
        plan.checks,
        world.thinking.total,
        quality.duration,
        quality.length,
        quality.way,
        None if near is None else (near.contact.a, near.contact.b),
        None if near is None else near.contact.distance,
        None if near is None else near.at,
        None if own is None else (own.contact.a, own.contact.b),
        None if own is None else own.contact.distance,
        quality.singular,
        quality.singular_at,
        joint.joint,
        joint.room,
        joint.at,
        joint_slides=not is_hinge(world.robot.arm.joints[index + 1]),
    )


def _constraint_words(asked: PlanQuery) -> str:
    words = ""
    if asked.line:
        words += ", straight"
    if asked.upright is not None:
        words += f", upright within {np.degrees(asked.upright):.0f} deg"
    if asked.clearance > 0:
        words += f", {asked.clearance * 1000:.0f} mm clear"
    return words
