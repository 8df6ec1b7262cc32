"""Self-collision sampling: pairs of links that need no check.

As MoveIt's Setup Assistant does it, configurations are drawn evenly within the joints' limits, and each pair
of links is counted as colliding or not. Adjacent pairs, and those that always or never collide, need no
check. The planner takes each mesh as its hull. Neighbours of which only the hulls collide, as those of an arm
that folds into its own hollow, need no check either. Coleman et al., "Reducing the Barrier to Entry of
Complex Robotic Software: a MoveIt! Case Study", 2014.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import coal
import numpy as np
import pinocchio as pin

from picktree.robot.planning import robot_geometry
from picktree.world import Array
from picktree.world.robot_model import MOVING, RobotModel, urdf_parser

from .link_geometry import LinkGeometry

SAMPLE_COUNT = 10_000
COLLISION_DISTANCE = 0.005
"""Distance below which links count as colliding, m: the planner keeps such a distance."""
ALWAYS_COLLIDING_SHARE = 0.95
"""Share of samples above which a pair always collides, as MoveIt counts it."""

Reason = Literal["adjacent", "default", "always", "never", "hulls"]
REASONS: tuple[Reason, ...] = ("adjacent", "default", "always", "never", "hulls")


@dataclass(frozen=True, slots=True)
class LinkPair:
    """Pair of links that needs no check, the reason, and the number of samples in which it collided."""

    first: str
    second: str
    reason: Reason
    collisions: int


@dataclass(frozen=True, slots=True)
class SelfCollisionReport:
    """Report on all pairs of links that have geometry and move against each other."""

    samples: int
    disabled: tuple[LinkPair, ...]
    """Pairs that need no check, in the order of the links."""
    checked: tuple[tuple[str, str, int], ...]
    """Pairs that sometimes collide: two links, and the number of samples."""
    free: int
    """Number of samples in which no checked pair collides."""


@dataclass(frozen=True, slots=True)
class SamplingTask:
    """Task of the sampling. `draw` returns one configuration of the model, drawn with a random generator."""

    model: pin.Model
    geometry: pin.GeometryModel
    """Hulls of all links; its collision pairs are replaced."""
    draw: Callable[[np.random.Generator], Array]
    neighbours: frozenset[frozenset[str]]
    """Pairs of links that are joined by one joint."""
    rest: Array
    """Configuration in which nothing should collide: pairs of `near` that do become `default`."""
    unchecked: frozenset[frozenset[str]] = frozenset()
    """Pairs that are never checked, as those within a gripper."""
    near: frozenset[frozenset[str]] = frozenset()
    """Pairs that may be `default` or `hulls`; other pairs that collide at `rest` truly collide."""
    meshes: Mapping[str, LinkGeometry] = field(default_factory=dict[str, LinkGeometry])
    """Meshes of the links with their hollows. Pairs of `near` are `hulls` when their hulls collide in some
    samples, and their meshes in none of these."""


def sample(question: SamplingTask, samples: int = SAMPLE_COUNT, seed: int = 0) -> SelfCollisionReport:
    """Sample a task. The result depends on task and seed alone, in any process."""
    model, geometry = question.model, question.geometry
    names = [model.frames[o.parentFrame].name for o in geometry.geometryObjects]
    pairs = _pairs(geometry, names, question)
    chosen = np.zeros((len(names), len(names)), dtype=np.bool_)
    for i, j in pairs:
        chosen[i, j] = True
    geometry.setCollisionPairs(chosen)
    listed = [(pair.first, pair.second) for pair in geometry.collisionPairs]
    data, geometry_data = model.createData(), pin.GeometryData(geometry)
    for request in geometry_data.collisionRequests:
        request.security_margin = COLLISION_DISTANCE
        request.enable_contact = False
        with warnings.catch_warnings():
            # The documented replacement of this deprecated switch does not switch it off.
            warnings.simplefilter("ignore", DeprecationWarning)
            request.enable_cached_gjk_guess = False

    def colliding(q: Array) -> set[frozenset[str]]:
        pin.updateGeometryPlacements(model, data, geometry, geometry_data, q)
        return {
            frozenset((names[i], names[j]))
            for k, (i, j) in enumerate(listed)
            if pin.computeCollision(geometry, geometry_data, k)
        }

    generator = np.random.default_rng([seed, 0])
    at_rest = colliding(question.rest)
    drawn = [question.draw(generator) for _ in range(samples)]
    found = [frozenset(colliding(q)) for q in drawn]
    counts: dict[frozenset[str], int] = {frozenset((names[i], names[j])): 0 for i, j in listed}
    for each in found:
        for pair in each:
            counts[pair] += 1
    order = {name: k for k, name in enumerate(dict.fromkeys(names))}
    disabled: list[LinkPair] = []
    checked: list[tuple[str, str, int]] = []
    for pair in sorted(counts, key=lambda pair: sorted(order[name] for name in pair)):
        first, second = sorted(pair, key=lambda name: order[name])
        reason = _reason(pair, counts[pair], samples, question.neighbours, at_rest & question.near)
        if reason is None and pair in question.near and {first, second} <= question.meshes.keys():
            touching = (q for q, each in zip(drawn, found, strict=True) if pair in each)
            reason = None if _meshes_meet(question, (first, second), touching) else "hulls"
        if reason is None:
            checked.append((first, second, counts[pair]))
        else:
            disabled.append(LinkPair(first, second, reason, counts[pair]))
    kept = {frozenset((first, second)) for first, second, _ in checked}
    free = sum(1 for each in found if not each & kept)
    return SelfCollisionReport(samples, tuple(disabled), tuple(checked), free)


def _pairs(
    geometry: pin.GeometryModel, names: Sequence[str], question: SamplingTask
) -> list[tuple[int, int]]:
    objects = list(geometry.geometryObjects)
    return [
        (i, j)
        for i, a in enumerate(objects)
        for j, b in enumerate(objects[i + 1 :], i + 1)
        if a.parentJoint != b.parentJoint
        and names[i] != names[j]
        and frozenset((names[i], names[j])) not in question.unchecked
    ]


def _reason(
    pair: frozenset[str],
    count: int,
    samples: int,
    neighbours: frozenset[frozenset[str]],
    at_rest: set[frozenset[str]],
) -> Reason | None:
    if pair in neighbours:
        return "adjacent"
    if count > ALWAYS_COLLIDING_SHARE * samples:
        return "always"
    if pair in at_rest:
        return "default"
    return "never" if count == 0 else None


def _meshes_meet(question: SamplingTask, pair: tuple[str, str], configurations: Iterable[Array]) -> bool:
    """Whether the meshes of two links are nearer than COLLISION_DISTANCE in any configuration."""
    model, data = question.model, question.model.createData()
    bodies = [_surface(question.meshes[link]) for link in pair]
    frames = [model.getFrameId(link, pin.BODY) for link in pair]
    request = coal.CollisionRequest()
    request.security_margin = COLLISION_DISTANCE
    for q in configurations:
        pin.framesForwardKinematics(model, data, q)
        one, other = (coal.Transform3s(data.oMf[k].rotation, data.oMf[k].translation) for k in frames)
        if coal.collide(bodies[0], one, bodies[1], other, request, coal.CollisionResult()):
            return True
    return False


def _surface(link: LinkGeometry) -> coal.BVHModelOBBRSS:
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for point in link.points:
        points.append(point)
    for a, b, c in link.triangles.tolist():
        triangles.append(coal.Triangle(a, b, c))
    made = coal.BVHModelOBBRSS()
    made.beginModel(len(link.triangles), len(link.points))
    made.addSubModel(points, triangles)
    made.endModel()
    return made


def summary(found: SelfCollisionReport) -> Mapping[Reason, int]:
    """Return the number of pairs without a check, by reason."""
    return {reason: sum(pair.reason == reason for pair in found.disabled) for reason in REASONS}


def sample_links(
    model: RobotModel, meshes: Mapping[str, LinkGeometry], samples: int, seed: int
) -> SelfCollisionReport:
    """Sample the self-collisions of a robot's links, and return the pairs that need no check."""
    description = model.description
    geometry = pin.GeometryModel()
    for piece in robot_geometry(model):
        geometry.addGeometryObject(piece)
    skeleton = urdf_parser.read_skeleton(Path(description.urdf))
    hand = frozenset(skeleton.below(skeleton.joints[description.flange_joint].child))
    # No joint of the arm moves what is beyond its last one against each other.
    beyond = frozenset(skeleton.below(skeleton.joints[description.joints[-1]].child))
    names = [model.full.frames[o.parentFrame].name for o in geometry.geometryObjects]
    pairs = {frozenset((a, b)) for a in names for b in names if a != b}
    widest = description.gripper.max_width

    def draw(generator: np.random.Generator) -> Array:
        q = generator.uniform(model.lower, model.upper)
        return model.full_q(q, float(generator.uniform(0.0, widest)))

    middle = (model.lower + model.upper) / 2
    near = {pair for pair in pairs if _is_near(skeleton, pair)}
    return sample(
        SamplingTask(
            model.full,
            geometry,
            draw,
            frozenset(
                pair
                for pair in pairs
                if _adjacent(skeleton, pair, frozenset(names)) or (pair <= beyond and not pair <= hand)
            ),
            model.full_q(middle, widest),
            frozenset(pair for pair in pairs if pair <= hand),
            frozenset(near),
            meshes,
        ),
        samples,
        seed,
    )


def _joints_between(skeleton: urdf_parser.UrdfTree, pair: frozenset[str]) -> tuple[str, ...] | None:
    """Return the joints between two links of one chain; None for links on different branches."""
    one, other = sorted(pair, key=lambda link: len(skeleton.joints_to(link)))
    return skeleton.joints_between(one, other)


def _is_near(skeleton: urdf_parser.UrdfTree, pair: frozenset[str]) -> bool:
    """Whether at most two moving joints are between two links of one chain."""
    between = _joints_between(skeleton, pair)
    return between is not None and sum(skeleton.joints[name].type in MOVING for name in between) <= 2


def _adjacent(skeleton: urdf_parser.UrdfTree, pair: frozenset[str], solid: frozenset[str]) -> bool:
    """Whether one moving joint is between two links, and no other link with geometry."""
    between = _joints_between(skeleton, pair)
    if between is None or sum(skeleton.joints[name].type in MOVING for name in between) != 1:
        return False
    return not any(skeleton.joints[name].child in solid for name in between[:-1])
