"""Plan trial: one motion planned in a scene without a mission, its result as text, JSON and picture."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Generator, Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from math import degrees
from pathlib import Path
from typing import TypeVar

import numpy as np

from picktree.analysis.render import (
    Caption,
    CaptionFailure,
    Picture,
    PictureView,
    SceneContent,
    SceneRenderer,
    write,
)
from picktree.files import file_system
from picktree.logs import binary_gltf, log_records
from picktree.logs.recording import belief_record, require_picture_name, write_picture
from picktree.robot import World
from picktree.robot.planning import (
    DEFAULT_CHECK_BUDGET,
    Constraint,
    ContactPair,
    MotionPlan,
    NamedGoal,
    PlanQuality,
    Request,
    UprightConstraint,
    contact_lines,
)
from picktree.session import assemble_world
from picktree.simulation import TrueBody, build_hardware
from picktree.world import Array, BeliefObject, Evidence, Failure, ObjectId, Pose, Sphere
from picktree.world.robot_model import is_hinge, load_robot
from picktree.world.scene import load_scene

from .target_syntax import GoalAttempt, ParsedGoal, parse_goal, parse_start

MILLIMETRE_KEYS = frozenset({"depth", "by", "short", "at", "point", "first"})
"""Keys of evidence in m that the text gives in mm."""
DEGREE_KEYS = frozenset({"turned", "gets"})
"""Keys of evidence in rad that the text gives in deg."""


@dataclass(frozen=True, slots=True)
class PlanFigures:
    """Figures of a plan; SI units."""

    planner: str
    legs: tuple[str, ...]
    """Planners of a motion chain; empty for a single motion."""
    checks: int
    thinking: float
    """Simulated time charged for planning, s."""
    quality: PlanQuality
    joint_slides: bool
    """Whether the joint nearest to one of its limits is a slider."""

    def to_json(self) -> dict[str, object]:
        quality = self.quality
        near, own, joint = quality.nearest, quality.itself, quality.joint
        return {
            "planner": self.planner,
            "legs": self.legs,
            "checks": self.checks,
            "thinking": self.thinking,
            "duration": quality.duration,
            "length": quality.length,
            "way": quality.way,
            "nearest": None if near is None else (near.contact.a, near.contact.b),
            "clearance": None if near is None else near.contact.distance,
            "nearest_at": None if near is None else near.at,
            "itself": None if own is None else (own.contact.a, own.contact.b),
            "itself_clearance": None if own is None else own.contact.distance,
            "singular": quality.singular,
            "singular_at": quality.singular_at,
            "joint": joint.joint,
            "joint_room": joint.room,
            "joint_room_at": joint.at,
            "joint_slides": self.joint_slides,
        }


@dataclass(frozen=True, slots=True)
class PlanRefusal:
    """Refusal of a plan with its reason."""

    cause: str
    message: str
    remedy: str
    evidence: Evidence

    @classmethod
    def of(cls, failure: Failure) -> PlanRefusal:
        """Return the refusal for a failure of the planner."""
        return cls(failure.cause.name, failure.message, failure.cause.remedy, failure.evidence)


@dataclass(frozen=True, slots=True)
class PlanAnswer:
    """Answer of `picktree plan`."""

    scene: str
    robot: str
    seed: int
    asked: str
    begins: str
    grasp: str = ""
    """Grasp of the object in the plan."""
    found: PlanFigures | None = None
    refused: PlanRefusal | None = None
    rejected: tuple[str, ...] = ()
    """Reasons why other grasps of the object were rejected."""
    judged: tuple[str, ...] | None = None
    """Objections of the verifier to the plan, with --verify; None: it was not used."""
    picture: str = ""

    @property
    def good(self) -> bool:
        """Whether there is a plan without objections by the verifier."""
        return self.found is not None and not self.judged

    def to_json_text(self) -> str:
        found = None if self.found is None else self.found.to_json()
        return json.dumps({**asdict(self), "found": found}, indent=2, default=str) + "\n"

    def to_text(self) -> str:
        lines = [
            f"{self.asked}, from {self.begins}",
            f"scene {self.scene}, robot {self.robot}, seed {self.seed}; the belief has everything "
            "at its true place",
            "",
            *self.lines(),
        ]
        if self.picture:
            lines += ["", f"picture: {self.picture}"]
        return "\n".join(lines)

    def lines(self) -> list[str]:
        """Return the figures of the plan, or the reason of its refusal."""
        if self.found is not None:
            return _table(self._figures(self.found))
        return self._why_not(self.refused) if self.refused is not None else []

    def _figures(self, found: PlanFigures) -> Iterator[tuple[str, str]]:
        if self.grasp:
            yield "grasp", self.grasp
        legs = f" of {', '.join(found.legs)}" if found.legs else ""
        yield "planner", found.planner + legs
        yield "checks", f"{found.checks} ({found.thinking * 1000:.0f} ms of thinking)"
        quality = found.quality
        near, own, joint = quality.nearest, quality.itself, quality.joint
        tool = f"the tool {quality.way * 1000:.0f} mm"
        yield "motion", f"{quality.duration:.2f} s, {quality.length:.2f} rad, {tool}"
        if near is None:
            yield "nearest", "nothing within 500 mm"
        else:
            yield "nearest", f"{_distance(near.contact)}, at {near.at:.2f} s"
        if own is not None:
            yield "itself", _distance(own.contact)
        yield "singularity", f"smallest singular value {quality.singular:.3f}, at {quality.singular_at:.2f} s"
        room = f"{joint.room * 1000:.1f} mm" if found.joint_slides else f"{degrees(joint.room):.1f} deg"
        yield "joint limits", f"{joint.joint} comes within {room}, at {joint.at:.2f} s"
        if self.judged is not None:
            yield "judged", "free by the second checker" if not self.judged else "; ".join(self.judged)

    def _why_not(self, refused: PlanRefusal) -> list[str]:
        lines = [f"no plan: {refused.cause}", f"  {refused.message}", f"  to try: {refused.remedy}"]
        rows = list(_rows(refused.evidence))
        if rows:
            lines += ["", *(f"  {line}" for line in _table(rows))]
        if self.rejected:
            lines += ["", "grasps that were not taken:", *(f"  {one}" for one in self.rejected)]
        return lines


def _distance(contact: ContactPair) -> str:
    return f"{contact.distance * 1000:.1f} mm: {contact.a} to {contact.b}"


def _rows(evidence: Evidence) -> Iterator[tuple[str, str]]:
    """Return the evidence as rows of a table, without empty values."""
    for key, value in evidence.items():
        name = key.replace("_", " ")
        if isinstance(value, list):
            if value and isinstance(value[0], str):
                for k, one in enumerate(value):
                    yield (name if k == 0 else "", str(one))
            elif value:
                numbers = [float(one) for one in value]
                if key in MILLIMETRE_KEYS:
                    yield name, ", ".join(f"{one * 1000:.1f}" for one in numbers) + " mm"
                else:
                    yield name, ", ".join(f"{one:.3f}" for one in numbers)
        elif key in MILLIMETRE_KEYS and isinstance(value, float):
            yield name, f"{value * 1000:.1f} mm"
        elif key in DEGREE_KEYS and isinstance(value, float):
            yield name, f"{degrees(value):.1f} deg"
        elif isinstance(value, float):
            yield name, f"{value:.4g}"
        elif value not in ("", None):
            yield name, str(value)


def _table(rows: Iterator[tuple[str, str]] | list[tuple[str, str]]) -> list[str]:
    listed = list(rows)
    wide = max(len(name) for name, _ in listed)
    return [f"{name:<{wide}}  {text}" for name, text in listed]


START_COLOUR = (0.80, 0.86, 0.93)
HAND_COLOUR = (0.90, 0.91, 0.84)
"""Colour of the hand between start and goal."""
COLLISION_COLOUR = (0.85, 0.15, 0.12)
COPY_SCALE = (0.99, 0.99, 0.99)
INTERMEDIATE_HANDS = 3
"""Number of hands that are drawn between start and goal."""


def draw(
    world: World,
    start: Array,
    outcome: MotionPlan | Failure | None,
    query: str,
    output: Path,
    view: PictureView,
    size: tuple[int, int],
) -> None:
    """Write the picture. Raises PicktreeError when it cannot be written."""
    require_picture_name(output)
    picture = plan_picture(world, start, outcome, query, view, size)
    with file_system.whole([output], output) as (beside,):
        output.parent.mkdir(parents=True, exist_ok=True)
        write_picture(str(beside), picture)


def plan_picture(
    world: World,
    start: Array,
    outcome: MotionPlan | Failure | None,
    query: str,
    view: PictureView,
    size: tuple[int, int],
    width: float | None = None,
    time: float = 0.0,
) -> Picture:
    """Return the picture as RGB (h, w, 3).

    `start` is the configuration (n,), rad, `width` the opening of the fingers, m; None: fully open. Without
    an outcome the arm is drawn at the start. `time` is shown, s.
    """
    meshes = binary_gltf.link_meshes(world.robot.description.urdf)
    width = world.robot.description.gripper.max_width if width is None else width
    robots = _Robots(meshes)
    path: tuple[tuple[float, float, float], ...] = ()
    marked: tuple[log_records.BodyRecord, ...] = ()
    point: tuple[log_records.BodyRecord, ...] = ()
    caption = Caption(time, query)
    if isinstance(outcome, MotionPlan):
        q = outcome.trajectory.position
        robots.add("", world.robot.link_poses(q[-1], width))
        robots.add("start", _undrawn(world.robot.link_poses(q[0], width), robots.poses), START_COLOUR)
        hand = {world.robot.description.tcp_link, *world.robot.description.gripper.fingers}
        for k in np.linspace(0, len(q) - 1, INTERMEDIATE_HANDS + 2).astype(int)[1:-1]:
            poses = world.robot.link_poses(q[k], width).items()
            robots.add(f"way {k}", {link: pose for link, pose in poses if link in hand}, HAND_COLOUR)
        path = tuple(world.robot.tcp(one).position for one in q[:: max(1, len(q) // 60)])
        caption = Caption(outcome.trajectory.duration, query, f"by {outcome.planner}")
    elif isinstance(outcome, Failure):
        at, names = _failure_configuration(outcome, start), _named_bodies(outcome)
        robots.add("", world.robot.link_poses(at, width), alarm=names)
        if not np.array_equal(at, start):
            robots.add("start", _undrawn(world.robot.link_poses(start, width), robots.poses), START_COLOUR)
        marked = tuple(_marked(world, names))
        point = _point(outcome)
        caption = replace(caption, trouble=CaptionFailure(outcome.cause.name, outcome.message))
    else:
        robots.add("", world.robot.link_poses(start, width))
    bodies = tuple(belief_record(o) for o in world.scene.objects)
    scene = log_records.Scene((*bodies, *point), tuple(_fixed(world)))
    shown = SceneContent(robots.poses, scene, log_records.Scene(marked, ()), path)
    picture = SceneRenderer(tuple(robots.meshes), view, size, {}).single(shown)
    write(picture, caption)
    return picture


class _Robots:
    """Drawn copies of the robot in several configurations and colours."""

    def __init__(self, meshes: tuple[log_records.LinkMesh, ...]) -> None:
        self._own = {mesh.link: mesh for mesh in meshes}
        self.meshes: list[log_records.LinkMesh] = []
        self.poses: dict[str, Pose] = {}

    def add(
        self,
        name: str,
        links: dict[str, Pose],
        colour: tuple[float, float, float] | None = None,
        alarm: frozenset[str] = frozenset(),
    ) -> None:
        """Add a copy of the robot in its own colours or another; links in `alarm` are red."""
        for link, pose in links.items():
            mesh = self._own.get(link)
            if mesh is None:
                continue
            painted = COLLISION_COLOUR if link in alarm else colour
            glb = mesh.glb
            if painted is not None:
                other = binary_gltf.read_glb(glb).coloured(painted)
                # Slightly smaller, so that surfaces that coincide do not flicker through each
                # other.
                glb = binary_gltf.write_glb(other if colour is None else other.placed(Pose(), COPY_SCALE))
            self.meshes.append(log_records.LinkMesh(f"{name}/{link}", glb))
            self.poses[f"{name}/{link}"] = pose


def _failure_configuration(failure: Failure, start: Array) -> Array:
    """Return the configuration of a failure; the start when it has none."""
    configuration = failure.evidence.get("configuration")
    if isinstance(configuration, list) and len(configuration) == len(start):
        return np.array([float(x) for x in configuration])
    return start


def _point(failure: Failure) -> tuple[log_records.BodyRecord, ...]:
    """Return a red ball at the failure's point: the goal's, or where a line stopped."""
    for key in ("point", "first", "at"):
        value = failure.evidence.get(key)
        if isinstance(value, list) and len(value) == 3:
            x, y, z = (float(c) for c in value)
            return (
                log_records.BodyRecord(
                    "point", "sphere", Sphere(0.012), "red", Pose((x, y, z)), id=ObjectId("point")
                ),
            )
    return ()


def _undrawn(links: dict[str, Pose], drawn: dict[str, Pose]) -> dict[str, Pose]:
    """Return the links that are not drawn at the same pose already."""
    return {link: pose for link, pose in links.items() if drawn.get(f"/{link}") != pose}


def _named_bodies(failure: Failure) -> frozenset[str]:
    """Return the names of all bodies in contact or in the way."""
    names: set[str] = set()
    for key in ("pairs", "in_the_way", "enclosed_by"):
        value = failure.evidence.get(key)
        for line in value if isinstance(value, list) else ():
            names.update(str(line).split())
    return frozenset(names)


def _marked(world: World, names: frozenset[str]) -> Iterable[log_records.BodyRecord]:
    """Return the named bodies of the scene, to be outlined."""
    for o in world.scene.objects:
        if o.id in names:
            yield belief_record(o)
    for part in _fixed(world):
        if part.id.split("/")[0] in names:
            yield log_records.BodyRecord("fixture", "box", part.shape, "red", part.pose, id=ObjectId(part.id))


def _fixed(world: World) -> Iterable[log_records.PartRecord]:
    for f in world.scene.fixtures.values():
        yield log_records.PartRecord(f.id, f.colour, f.shape, f.pose, f.holes)
    for b in world.scene.bins.values():
        for k, (box, pose) in enumerate(b.parts()):
            yield log_records.PartRecord(f"{b.id}/{k}", b.colour, box, pose)


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
            world.scene.put(_believed(world, body), "exact belief")
    world.scene.take_changes()
    return world


def _believed(world: World, body: TrueBody) -> BeliefObject:
    """Return the believed object of a true body, named as perception names it."""
    return BeliefObject(
        body.kind,
        body.form,
        body.shape,
        body.colour,
        body.pose,
        EXACT_BELIEF_DEVIATION,
        EXACT_BELIEF_DEVIATION,
        1.0,
        world.clock.now,
        id=world.scene.new_id(f"{body.colour}_{body.kind}"),
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


def plan_in_scene(query: PlanQuery) -> PlanAnswer:
    """Plan a motion in a scene. Raises PicktreeError for an unknown scene, robot, goal or start."""
    world = build(query.scene, query.robot, query.seed, verify=query.verify)
    q = parse_start(world, query.begin) if query.begin else world.robot.named(HOME_POSE)
    constraints: tuple[Constraint, ...] = () if query.upright is None else (UprightConstraint(query.upright),)
    request = Request(
        NamedGoal(HOME_POSE),
        q,
        constraints=constraints,
        clearance=query.clearance,
        budget=query.budget,
        planner=query.planner,
    )
    goal = parse_goal(world, query.to, request, line=query.line)
    tried = _first_success(world, goal)
    rejected = Counter((*goal.rejected, *tried.rejected)).most_common()
    answer = PlanAnswer(
        query.scene,
        world.robot.description.name,
        query.seed,
        goal.words + _constraint_words(query),
        query.begin or HOME_POSE,
        grasp="" if tried.attempt is None else tried.attempt.name,
        rejected=tuple(f"{count} × {reason}" for reason, count in rejected),
    )
    if isinstance(tried.outcome, MotionPlan):
        answer = replace(answer, found=plan_figures(world, tried.outcome))
        if query.verify:
            against = [line for one in world.plan.disagreements for line in contact_lines(one.contacts)]
            answer = replace(answer, judged=tuple(against))
    elif tried.outcome is not None:
        answer = replace(answer, refused=PlanRefusal.of(tried.outcome))
    else:
        sentence = f"the hand finds no room at any of {len(goal.rejected)} grasps of {query.to}"
        if not goal.rejected:
            sentence = f"{query.to} is wider than the gripper opens"
        refused = PlanRefusal("grasp.no_candidate", sentence, "clear the space around it", {})
        answer = replace(answer, refused=refused)
    if query.picture is not None:
        view = query.view or PictureView()
        draw(world, q, tried.outcome, answer.asked, query.picture, view, query.size)
        answer = replace(answer, picture=str(query.picture))
    return answer


@dataclass(frozen=True, slots=True)
class _Tried:
    """Result of the attempts. `outcome`: the plan, or the first failure; None: nothing was attempted."""

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
        return _Tried(attempt, plan, tuple(failure.message for _, failure in failures))
    if not failures:
        return _Tried(None, None, ())
    (attempt, first), *others = failures
    return _Tried(attempt, first, tuple(failure.message for _, failure in others))


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
    index = world.robot.description.joints.index(quality.joint.joint)
    return PlanFigures(
        plan.planner,
        tuple(leg.planner for leg in plan.legs),
        plan.checks,
        world.thinking.total,
        quality,
        joint_slides=not is_hinge(world.robot.arm.joints[index + 1]),
    )


def _constraint_words(query: PlanQuery) -> str:
    words = ""
    if query.line:
        words += ", straight"
    if query.upright is not None:
        words += f", upright within {np.degrees(query.upright):.0f} deg"
    if query.clearance > 0:
        words += f", {query.clearance * 1000:.0f} mm clear"
    return words
