"""Trajectory verifier: an independent check of whole trajectories with python-fcl, on geometry of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from picktree.world import Array, BeliefObject, PlanningScene, Trajectory
from picktree.world.robot_model import TCP_FRAME, RobotModel, joint_frame, link_frame, pose_of

from .collision_model import CollisionMargins, GeometryOwner, fixed_bodies, movable_bodies
from .motion_plans import ContactPair
from .scene_queries import (
    place,
    solid,
)
from .swept_volumes import LinkSolid, Pairs, RobotSweep, moments_of
from .trajectory_check import APPROACH_SLACK, START_ZONE, START_ZONE_OF_OBJECTS

PENETRATION_ROUNDING = 0.0001
"""Penetration that is put down to rounding, m."""


FCL_DISTANCE_ERROR = 0.0015
"""Greatest error upwards of a python-fcl distance, m. Whether bodies touch is reported correctly.

Of 3019 pairs at their margin its search ended early in 27, by 0.02 to 1.3 mm; exact distances show it.
"""


@dataclass(frozen=True, slots=True)
class _Thing:
    """Body of the robot or of the scene, without its pose."""

    name: str
    part: GeometryOwner


@dataclass(frozen=True, slots=True)
class TightestPair:
    """Pair of one configuration that is closest to its margin, or deepest within it."""

    a: str
    b: str
    distance: float
    """Signed distance, m; negative: depth."""
    margin: float
    """Least distance that the pair must keep, m."""


class TrajectoryVerifier:
    """Independent verifier of trajectories of one robot. The hulls of its links are built once.

    A trajectory is sampled every 5 mm of the TCP. Distances are measured at few of these moments: between
    them a distance changes by no more than the travel of both bodies.
    """

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        self._margins = CollisionMargins()
        beyond = _links_beyond(model)
        fingers = model.description.gripper.fingers
        self._limbs: list[LinkSolid] = []
        self._things: list[_Thing] = []
        for element in model.collision_shapes():
            frame = model.full.frames[link_frame(model.full, element.link)]
            if element.link in fingers:
                part = GeometryOwner.FINGER
            elif element.link in beyond:
                part = GeometryOwner.HAND
            else:
                part = GeometryOwner.BASE if frame.parentJoint == 0 else GeometryOwner.ARM
            pose_in_joint = pose_of(frame.placement) @ element.pose_in_link
            self._limbs.append(LinkSolid(solid(element.shape), frame.parentJoint, pose_in_joint))
            self._things.append(_Thing(element.link, part))
        disabled = {frozenset(pair) for pair in model.description.disabled_pairs}
        gripper = (GeometryOwner.HAND, GeometryOwner.FINGER)
        self._self_pairs = [
            (i, j)
            for i, a in enumerate(self._things)
            for j, b in enumerate(self._things[i + 1 :], i + 1)
            # Bodies on one joint do not move against each other.
            if self._limbs[i].joint != self._limbs[j].joint
            and frozenset((a.name, b.name)) not in disabled
            and not (a.part in gripper and b.part in gripper)
        ]
        # The held object cannot reach the links that carry the hand.
        carriers = _links_carrying_hand(model)
        self._held_against = [
            k for k, a in enumerate(self._things) if a.part not in gripper and a.name not in carriers
        ]
        tcp = model.full.frames[model.full.getFrameId(TCP_FRAME, pin.OP_FRAME)]
        self._tcp_joint, self._tcp_in_joint = tcp.parentJoint, pose_of(tcp.placement)

    def judge(
        self, trajectory: Trajectory, scene: PlanningScene, width: float, *, excuse_start: bool = True
    ) -> tuple[ContactPair, ...]:
        """Return every pair that penetrates on the way, at its deepest. Empty: the trajectory is free.

        Pairs that the scene allows to touch do not count, nor does the permitted penetration of a held object
        into a board. With `excuse_start` contacts at the start do not count near it, unless they get deeper.
        """
        view = self._among(moments_of(self._model, trajectory).configurations, scene, width)
        from_start = np.abs(view.configurations - trajectory.start).max(axis=1)
        pairs = view.sweep.near(view.pairs, 0.0)
        bounds, travel = view.sweep.bounds(pairs), view.sweep.travel(pairs)
        worst: dict[tuple[str, str], ContactPair] = {}
        at_start: dict[tuple[str, str], float] = {}

        def look(column: int, moment: int) -> float:
            """Return the distance of the pair beyond its limit at that moment, m, and record a contact."""
            i, j = (int(k) for k in pairs[column])
            a, b = view.things[i], view.things[j]
            between = view.sweep.gap(moment, i, j)
            usual = least = min(0.0, self._margins.between(a.part, b.part))
            key = (a.name, b.name)
            if excuse_start and moment == 0 and between.distance < least:
                at_start[key] = min(between.distance, at_start.get(key, 0.0))
            if key in at_start and from_start[moment] <= (
                START_ZONE if scene.find(b.name) is None else START_ZONE_OF_OBJECTS
            ):
                least = min(least, at_start[key] - APPROACH_SLACK)
            if between.distance < min(
                least - PENETRATION_ROUNDING, worst[key].distance if key in worst else 0.0
            ):
                worst[key] = ContactPair(a.name, b.name, between.distance, between.point)
            return between.distance - usual

        # The start comes first: contacts there are excused near it. Then the unproven rest is halved
        # repeatedly.
        unknown = bounds < 0.0
        for column in np.flatnonzero(unknown[0]):
            look(int(column), 0)
        unknown[0] = False
        for column in range(len(pairs)):
            left = np.flatnonzero(unknown[:, column])
            while len(left):
                moment = int(left[len(left) // 2])
                room = max(look(column, moment) - FCL_DISTANCE_ERROR, 0.0)
                away = np.abs(travel[left, column] - travel[moment, column])
                left = left[(away >= room) & (left != moment)]
        return tuple(sorted(worst.values(), key=lambda contact: contact.distance))

    def tightest(
        self,
        configurations: Array,
        scene: PlanningScene,
        width: float,
        margins: CollisionMargins | None = None,
        reach: float = 0.001,
    ) -> list[TightestPair | None]:
        """Return for each configuration (m, n) the pair that keeps its margin by least.

        None where every pair is further away than its margin plus `reach` m.
        """
        view = self._among(configurations, scene, width)
        margin_between = (margins or self._margins).between
        parts = [thing.part for thing in view.things]
        keep: Array = np.array(
            [margin_between(parts[int(pair[0])], parts[int(pair[1])]) for pair in view.pairs]
        )
        bounds = view.sweep.bounds(view.pairs)
        found: list[TightestPair | None] = []
        for moment in range(len(configurations)):
            least: TightestPair | None = None
            for column in np.flatnonzero(bounds[moment] < keep + reach):
                i, j = (int(k) for k in view.pairs[column])
                distance, margin = view.sweep.gap(moment, i, j).distance, float(keep[column])
                if abs(distance - margin) < reach + FCL_DISTANCE_ERROR:
                    distance = min(distance, *view.sweep.remeasure(moment, i, j))
                so_far = reach if least is None else least.distance - least.margin
                if distance - margin < so_far:
                    least = TightestPair(view.things[i].name, view.things[j].name, distance, margin)
            found.append(least)
        return found

    def _among(self, configurations: Array, scene: PlanningScene, width: float) -> _View:
        bodies = (*fixed_bodies(scene), *movable_bodies(scene.objects))
        around = [place(solid(body.shape), body.pose) for body in bodies]
        carried, things = list(self._limbs), list(self._things)
        held = scene.held
        if held is not None:
            carried.append(self._held(held))
            things.append(_Thing(held.id, GeometryOwner.HELD))
        robots = len(things)
        things += [
            _Thing(b.name, GeometryOwner.SUPPORT if b.support else GeometryOwner.OBSTACLE) for b in bodies
        ]
        sweep = RobotSweep(self._model, carried, around, configurations, width)
        pairs = self._pairs(scene, things, robots)
        return _View(configurations, sweep, things, pairs)

    def _held(self, held: BeliefObject) -> LinkSolid:
        assert held.object_in_tcp is not None
        return LinkSolid(solid(held.shape), self._tcp_joint, self._tcp_in_joint @ held.object_in_tcp)

    def _pairs(self, scene: PlanningScene, things: list[_Thing], robots: int) -> Pairs:
        """Return the pairs (pairs, 2) that may not touch."""
        pairs = list(self._self_pairs)
        if robots > len(self._limbs):
            pairs += [(k, robots - 1) for k in self._held_against]
        for i, a in enumerate(things[:robots]):
            if a.part is GeometryOwner.BASE:
                continue
            side = "arm" if a.part is GeometryOwner.ARM else "gripper"
            for j, b in enumerate(things[robots:], robots):
                if not (scene.allowed(side, b.name) or scene.allowed(a.name, b.name)):
                    pairs.append((i, j))
        return np.array(pairs, dtype=np.intp).reshape(-1, 2)


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """Configurations in one scene, prepared for measurements."""

    configurations: Array
    sweep: RobotSweep
    things: list[_Thing]
    pairs: Pairs


def _links_beyond(model: RobotModel) -> set[str]:
    """Return the links beyond the flange joint."""
    frames = model.full.frames
    beyond = {joint_frame(model.full, model.description.flange_joint)}
    for index, frame in enumerate(frames):
        if frame.parentFrame in beyond and index > 0:
            beyond.add(index)
    return {frames[index].name for index in beyond if frames[index].type == pin.BODY}


def _links_carrying_hand(model: RobotModel) -> set[str]:
    """Return the links that do not move against the hand."""
    flange = model.full.frames[joint_frame(model.full, model.description.flange_joint)]
    links = (frame for frame in model.full.frames if frame.type == pin.BODY)
    return {link.name for link in links if link.parentJoint == flange.parentJoint}
