"""Trajectory verifier: an independent check of whole trajectories with python-fcl, on geometry of its own.

Swept volumes: the solids of a robot along a trajectory, and their distances at each moment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from picktree.world import Array, BeliefObject, PlanningScene, Pose, Trajectory
from picktree.world.robot_model import TCP_FRAME, RobotModel, joint_frame, link_frame, pose_of

from .collision_model import CollisionMargins, GeometryOwner, fixed_bodies, movable_bodies
from .requests import ContactPair
from .scene_queries import (
    FclDistance,
    FclMovedSolid,
    FclPlacedSolid,
    FclSolid,
    distance_between,
    place,
    solid,
)
from .trajectory_check import APPROACH_SLACK, START_ZONE, START_ZONE_OF_OBJECTS

MAX_TCP_STEP = 0.005
"""Greatest travel of the TCP between two moments, m."""
MAX_JOINT_STEP = 0.03
"""Greatest distance in joint space between two moments, rad: the elbow may move while the TCP does not."""
Pairs = NDArray[np.intp]
_CHECK_ROTATIONS = tuple(
    Pose.from_rpy((0.0, 0.0, 0.0), rpy).rotation() for rpy in ((0.7, 1.1, 2.3), (-1.3, 0.4, 0.9))
)


class LinkSolid:
    """Solid on a joint of the whole robot (0: fixed part), at a pose in that joint's frame."""

    def __init__(self, solid: FclSolid, joint: int, pose_in_joint: Pose) -> None:
        self.solid = solid
        self.joint = joint
        self.rotation: Array = pose_in_joint.rotation()
        self.position: Array = np.array(pose_in_joint.position)
        low, high = solid.corners.min(axis=0), solid.corners.max(axis=0)
        self.centre: Array = 0.5 * (low + high)
        self.half: Array = 0.5 * (high - low)


@dataclass(frozen=True, slots=True, eq=False)
class TrajectorySamples:
    """Samples of a trajectory: times (t,) s and configurations (t, n) rad."""

    times: Array
    configurations: Array


def moments_of(model: RobotModel, trajectory: Trajectory) -> TrajectorySamples:
    """Sample a trajectory evenly, at most STEP of the TCP and TURN of the joints apart, from start to end."""
    q = trajectory.position
    data, frame = model.arm.createData(), model.tcp_frame
    points: Array = np.empty((len(q), 3))
    for k, configuration in enumerate(q):
        pin.forwardKinematics(model.arm, data, configuration)
        points[k] = pin.updateFramePlacement(model.arm, data, frame).translation
    ways = np.maximum(
        np.linalg.norm(np.diff(points, axis=0), axis=1) / MAX_TCP_STEP,
        np.linalg.norm(np.diff(q, axis=0), axis=1) / MAX_JOINT_STEP,
    )
    along = np.concatenate([[0.0], np.cumsum(ways)])
    total = float(along[-1])
    # Between samples the travel is taken to be even in time, which is not exact.
    marks: Array = np.linspace(0.0, total, max(2, int(np.ceil(1.1 * total)) + 1))
    times: Array = np.interp(marks, along, trajectory.times)
    return TrajectorySamples(times, _at(trajectory, times))


def _at(trajectory: Trajectory, times: Array) -> Array:
    """Return the configurations (t, n) at those times: between samples the arm follows their polynomials."""
    q = trajectory.position
    k = np.clip(np.searchsorted(trajectory.times, times, side="right") - 1, 0, len(q) - 2)
    u = (times - trajectory.times[k])[:, None]
    powers = trajectory.polynomials()[k]
    configurations = powers[:, -1]
    for power in range(powers.shape[1] - 2, -1, -1):
        configurations = configurations * u + powers[:, power]
    configurations[0], configurations[-1] = q[0], q[-1]
    return configurations


class RobotSweep:
    """Solids on a robot at a number of moments, among bodies that stand still.

    Pairs (p, 2) are numbers: of carried solids and, from their count on, of the bodies around.
    """

    def __init__(
        self,
        model: RobotModel,
        carried: Sequence[LinkSolid],
        around: Sequence[FclPlacedSolid],
        configurations: Array,
        width: float,
    ) -> None:
        self._around = around
        turn, at = _joints(model, [c.joint for c in carried], configurations, width)
        self._rotation: Array = turn @ np.array([c.rotation for c in carried])
        self._position: Array = at + _rotate_points(turn, np.array([c.position for c in carried]))
        centre, half = np.array([c.centre for c in carried]), np.array([c.half for c in carried])
        middle = self._position + _rotate_points(self._rotation, centre)
        reach = _rotate_points(np.abs(self._rotation), half)
        self._low: Array = middle - reach
        self._high: Array = middle + reach
        self._around_low: Array = np.array([b.low for b in around]).reshape(-1, 3)
        self._around_high: Array = np.array([b.high for b in around]).reshape(-1, 3)
        self._travel = self._travelled(centre, half)
        self._moved = [FclMovedSolid(c.solid) for c in carried]

    def _travelled(self, centre: Array, half: Array) -> Array:
        """Return (moments, carried): the travel of the fastest point of each solid up to each moment, m.

        The displacement of a rigid motion is affine in the point: over a box it is greatest at a corner.
        """
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
        corners = centre[:, None] + signs * half[:, None]
        points = np.einsum("tcij,ckj->tcki", self._rotation, corners) + self._position[:, :, None]
        ways = np.linalg.norm(np.diff(points, axis=0), axis=3).max(axis=2)
        return np.concatenate([np.zeros((1, len(centre))), np.cumsum(ways, axis=0)])

    def near(self, pairs: Pairs, reach: float) -> Pairs:
        """Select the pairs whose bounding boxes over the whole motion come within `reach` m of each other."""
        low = np.concatenate([self._low.min(axis=0), self._around_low])
        high = np.concatenate([self._high.max(axis=0), self._around_high])
        a, b = pairs[:, 0], pairs[:, 1]
        return pairs[((low[a] <= high[b] + reach) & (low[b] <= high[a] + reach)).all(axis=1)]

    def bounds(self, pairs: Pairs) -> Array:
        """Return lower bounds (moments, pairs) of distances by bounding boxes, m; -inf where they overlap."""
        low, high = (
            [_rows_of(moving, still, pairs[:, k]) for k in (0, 1)]
            for moving, still in ((self._low, self._around_low), (self._high, self._around_high))
        )
        apart = np.maximum(np.maximum(low[0] - high[1], low[1] - high[0]), 0.0)
        distance = np.sqrt(np.einsum("tpk,tpk->tp", apart, apart))
        return np.where(distance > 0.0, distance, -np.inf)

    def travel(self, pairs: Pairs) -> Array:
        """Return (moments, pairs): the sum of both bodies' travel up to each moment, m.

        Between two moments their distance changes by no more than the difference.
        """
        still = np.zeros((len(self._travel), len(self._around)))
        ways = np.concatenate([self._travel, still], axis=1)
        return ways[:, pairs[:, 0]] + ways[:, pairs[:, 1]]

    def gap(self, moment: int, i: int, j: int) -> FclDistance:
        """Return the signed distance of a pair at a moment, by python-fcl."""
        return distance_between(self._body(moment, i), self._body(moment, j))

    def again(self, moment: int, i: int, j: int) -> tuple[float, ...]:
        """Measure the same distance in other ways, m: in reverse order, and with both bodies turned about the
        origin.

        Each is the distance of two points of the bodies, so that the least shows an error upwards.
        """
        a, b = self._body(moment, i), self._body(moment, j)
        found = [distance_between(b, a).distance]
        for turn in _CHECK_ROTATIONS:
            one, other = (_turned_copy(body, turn) for body in (a, b))
            found += [distance_between(one, other).distance, distance_between(other, one).distance]
        return tuple(found)

    def _body(self, moment: int, i: int) -> FclMovedSolid:
        if i >= len(self._moved):
            return self._around[i - len(self._moved)]
        body = self._moved[i]
        body.move(self._rotation[moment, i], self._position[moment, i])
        return body


def _turned_copy(body: FclMovedSolid, turn: Array) -> FclMovedSolid:
    turned = FclMovedSolid(body.solid)
    turned.move(turn @ body.object.getRotation(), turn @ body.object.getTranslation())
    return turned


def _rows_of(moving: Array, still: Array, numbers: NDArray[np.intp]) -> Array:
    """Select the rows of numbered bodies: (moments, numbers, 3)."""
    picked: Array = np.empty((len(moving), len(numbers), 3))
    moves = numbers < moving.shape[1]
    picked[:, moves] = moving[:, numbers[moves]]
    picked[:, ~moves] = still[numbers[~moves] - moving.shape[1]]
    return picked


def _joints(
    model: RobotModel, wanted: Sequence[int], configurations: Array, width: float
) -> tuple[Array, Array]:
    """Return rotations (moments, wanted, 3, 3) and positions (moments, wanted, 3) of joints in the world."""
    joints = sorted(set(wanted))
    full, data = model.full, model.full.createData()
    whole = model.full_q(configurations[0], width)
    arm = [full.joints[full.getJointId(name)].idx_q for name in model.description.joints]
    at: Array = np.empty((len(configurations), len(joints), 4, 4))
    for moment, q in enumerate(configurations):
        whole[arm] = q
        pin.forwardKinematics(full, data, whole)
        for column, joint in enumerate(joints):
            at[moment, column] = data.oMi[joint].homogeneous
    each = at[:, [joints.index(joint) for joint in wanted]]
    return each[..., :3, :3], each[..., :3, 3]


def _rotate_points(rotations: Array, points: Array) -> Array:
    """Turn points (c, 3) by rotations (t, c, 3, 3): (t, c, 3)."""
    return np.einsum("tcij,cj->tci", rotations, points)


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

        Pairs that the scene allows to touch, and what a held object may sink into a board, do not count. With
        `excuse_start` contacts at the start do not count near it, unless they get deeper.
        """
        view = self._among(moments_of(self._model, trajectory).configurations, scene, width)
        from_start = np.abs(view.configurations - trajectory.start).max(axis=1)
        pairs = view.sweep.near(view.pairs, 0.0)
        bounds, travel = view.sweep.bounds(pairs), view.sweep.travel(pairs)
        worst: dict[tuple[str, str], ContactPair] = {}
        at_start: dict[tuple[str, str], float] = {}

        def look(column: int, moment: int) -> float:
            """Return the distance beyond what the pair may do at that moment, m, and note a contact."""
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
        asked = (margins or self._margins).between
        parts = [thing.part for thing in view.things]
        keep: Array = np.array([asked(parts[int(pair[0])], parts[int(pair[1])]) for pair in view.pairs])
        bounds = view.sweep.bounds(view.pairs)
        found: list[TightestPair | None] = []
        for moment in range(len(configurations)):
            least: TightestPair | None = None
            for column in np.flatnonzero(bounds[moment] < keep + reach):
                i, j = (int(k) for k in view.pairs[column])
                distance, margin = view.sweep.gap(moment, i, j).distance, float(keep[column])
                if abs(distance - margin) < reach + FCL_DISTANCE_ERROR:
                    distance = min(distance, *view.sweep.again(moment, i, j))
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
