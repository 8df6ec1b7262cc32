"""Our scenes: the plans that a pick asks for, in every shipped scene, beside OMPL as a reference."""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path

import picktree.world
from _motion_tables import Column, Part, Table, Value, median, p95, share
from _ompl_reference import OmplReference
from picktree.apps.commissioning.plan_trial import build
from picktree.robot import World
from picktree.robot.manipulation import grasp_candidates, release_poses
from picktree.robot.manipulation.release_poses import free_cells, heap_heights
from picktree.robot.planning import HeldObject, LineGoal, MotionPlan, OffsetGoal, PoseGoal, Request
from picktree.robot.planning.trajectory_verifier import TrajectoryVerifier
from picktree.world import Array, BeliefObject, Failure
from picktree.world.scene import SceneDescription

ABOVE = 0.1
"""Of the pre-grasp over the grasp, and of the lift, m."""
KINDS = ("to the pre-grasp", "line down", "lift", "over the bin")
MEANING = """
What is spawned is believed exactly as it is; for each item, from where the arm was left: over its best
grasp that neighbours leave free, straight down onto it, straight up with it, and over its bin. ms: from
request to timed trajectory, re-checked. direct: answered by a straight edge in joint space. OMPL: its
RRT-Connect and simplification from the same start to the same end, with our checks, margins and timing.
clashes: trajectories in which the judge (python-fcl) finds penetration.
"""

COLUMNS = (
    Column("scene and motion"),
    Column("found"),
    Column("direct", "d"),
    Column("ms", ".1f"),
    Column("p95", ".1f"),
    Column("OMPL", ".1f"),
    Column("ms / OMPL", ".2f"),
    Column("clashes", "d"),
    Column("judge, ms", ".1f"),
)


@dataclass
class _Tally:
    """Counts of one kind of request in one scene."""

    asked: int = 0
    found: int = 0
    direct: int = 0
    clashes: int = 0
    ms: list[float] = field(default_factory=list[float])
    reference: list[float] = field(default_factory=list[float])
    ratios: list[float] = field(default_factory=list[float])
    judging: list[float] = field(default_factory=list[float])
    """CPU milliseconds of the judge."""
    causes: Counter[str] = field(default_factory=Counter[str])


def scenes() -> list[str]:
    """The shipped ones in which items stand when a run begins."""
    assert picktree.world.__file__ is not None
    folder = Path(picktree.world.__file__).parent / "scenes"
    return sorted(file.stem for file in folder.glob("*.yaml"))


def _requests(world: World, item: BeliefObject, at: Array) -> Generator[tuple[str, Request], Array, None]:
    """One after the other, each from where the one before ended: `send` its end."""
    for grasp in grasp_candidates(item, world.robot.description.gripper):
        if not world.queries.hand_contacts(grasp.tcp_in_world, grasp.opening, (item.id,), grasp.margin):
            break
    else:
        return
    over = PoseGoal((grasp.tcp_in_world.shifted((0.0, 0.0, ABOVE)),))
    at = yield KINDS[0], Request(over, at, width=grasp.opening)
    allowed = (("gripper", str(item.id)),)
    at = yield KINDS[1], Request(LineGoal(grasp.tcp_in_world), at, width=grasp.opening, allowed=allowed)
    holding = HeldObject(item.id, grasp.tcp_in_world.inverse() @ item.pose)
    width = grasp.expected_width
    lift = OffsetGoal((0.0, 0.0, ABOVE), least_fraction=0.3)
    neighbours = world.queries.hand_contacts(grasp.tcp_in_world, width, (item.id,), 0.01)
    near = tuple(("gripper", contact.b) for contact in neighbours)
    at = yield KINDS[2], Request(lift, at, width=width, holding=holding, allowed=near)
    to = world.scene.destination(item.id)
    bin_ = None if to is None else world.scene.bins.get(to)
    if bin_ is not None:
        spot = free_cells(bin_, heap_heights(bin_, (), None), item.shape, item.pose.rotation())[0]
        poses = release_poses(bin_, spot, item.shape, holding.object_in_tcp)
        yield KINDS[3], Request(PoseGoal(poses), at, width=width, holding=holding)


def _reference(world: World, plan: MotionPlan, request: Request) -> float | None:
    """Return the reference's CPU milliseconds from the plan's start to its end; None: no motion was found."""
    solver, reference = world.plan.solver, OmplReference(world.robot)
    scene, (width,) = solver.scene(request), solver.widths(request)
    begun = time.process_time()
    found = reference.plan(scene, width, plan.trajectory.start, plan.trajectory.end, 1)
    return None if found is None or found.trajectory is None else (time.process_time() - begun) * 1e3


def _pick(
    world: World, item: BeliefObject, at: Array, judge: TrajectoryVerifier, tallies: dict[str, _Tally]
) -> Array:
    """Ask for one item's plans; where the arm is left (n,)."""
    solver = world.plan.solver
    requests = _requests(world, item, at)
    try:
        kind, request = next(requests)
        while True:
            tally = tallies[kind]
            tally.asked += 1
            begun = time.process_time()
            try:
                plan = solver.solve(request, 1 + tally.asked)
            except Failure as failure:
                tally.causes[failure.cause.name] += 1
                return at
            spent = (time.process_time() - begun) * 1e3
            tally.found += 1
            tally.direct += plan.planner == "direct"
            tally.ms.append(spent)
            (width,) = solver.widths(request)
            begun = time.process_time()
            tally.clashes += bool(judge.judge(plan.trajectory, solver.scene(request), width))
            tally.judging.append((time.process_time() - begun) * 1e3)
            if isinstance(request.target, PoseGoal):
                other = _reference(world, plan, request)
                if other is not None:
                    tally.reference.append(other)
                    tally.ratios.append(spent / other)
            at = plan.trajectory.end
            kind, request = requests.send(at)
    except StopIteration:
        return at


def _same(one: SceneDescription, other: SceneDescription) -> bool:
    """Whether scenes ask for the same plans: they may differ in what the camera sees."""
    return (one.fixtures, one.bins, one.catalogue, one.spawn, one.destinations) == (
        other.fixtures,
        other.bins,
        other.catalogue,
        other.spawn,
        other.destinations,
    )


def measure(runs: int, seed: int) -> list[Table]:
    rows: list[tuple[Value, ...]] = []
    failures: Counter[str] = Counter()
    known: list[SceneDescription] = []
    left_out: list[str] = []
    ungrasped = 0
    for scene in scenes():
        tallies: dict[str, _Tally] = defaultdict(_Tally)
        for spawn in range(seed, seed + runs):
            world = build(scene, None, spawn, verify=False)
            if spawn == seed:
                twin = next((other for other in known if _same(other, world.description)), None)
                if twin is not None:
                    left_out.append(f"{scene} (the same plans as {twin.name})")
                    break
                known.append(world.description)
            judge, at = TrajectoryVerifier(world.robot), world.robot.named("home")
            for item in [o for o in world.scene.objects if o.role == "item"]:
                asked = sum(tally.asked for tally in tallies.values())
                at = _pick(world, item, at, judge, tallies)
                ungrasped += asked == sum(tally.asked for tally in tallies.values())
        else:
            if not tallies:
                left_out.append(f"{scene} (nothing stands there when a run begins)")
        rows += [_row(scene, kind, tallies[kind]) for kind in KINDS if kind in tallies]
        for kind, tally in tallies.items():
            failures.update({f"{scene}, {kind}: {cause}": n for cause, n in tally.causes.items()})
    told = "; ".join(f"{what} {n}" for what, n in failures.most_common())
    left_out.append(f"{ungrasped} items that neighbours leave no grasp of")
    notes = (MEANING, f"not found: {told or 'none'}", f"left out: {'; '.join(left_out)}")
    return [Table("Plans of a pick in our scenes", COLUMNS, rows, notes)]


def _row(scene: str, kind: str, tally: _Tally) -> tuple[Value, ...]:
    return (
        f"{scene}, {kind}",
        share(tally.found, tally.asked),
        tally.direct,
        median(tally.ms),
        p95(tally.ms),
        median(tally.reference),
        median(tally.ratios),
        tally.clashes,
        median(tally.judging),
    )


PART = Part("scenes", "the plans of a pick in every shipped scene", "spawns of each scene", 3, 20.0, measure)
