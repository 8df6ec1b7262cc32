"""Push strokes that bring an object nearer to its goal: sides to push at, paths of arcs, length."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from picktree.world import BeliefObject, Cylinder, ObjectId, Pose, Sphere, bottom, planar_geometry, top
from picktree.world.robot_model import GripperDescription

MIN_SIDE_LENGTH = 0.012
"""Least length of a side to push at, m."""
SIDE_END_MARGIN = 0.003
"""Distance of the fingers from the ends of a side, m."""
CRADLE_OPENING_RATIO = 1.2
"""Opening of the fingers that push a round object, over its radius. Between them it cannot leave sideways."""
FINGER_EDGE_RADIUS = 0.001
"""Radius of the fingers' edges, which a round object touches, m."""
ROUND_PUSH_TURNS = (0.0, 0.5, -0.5, 1.0, -1.0)
"""Directions of a push at a round object, relative to the straight one, rad."""
TIP_SUPPORT_CLEARANCE = 0.002
"""Height of the finger tips above the support, m."""
PALM_PUSH_CLEARANCE = 0.004
"""Height of the palm above the top of the pushed object, m."""


@dataclass(frozen=True, slots=True)
class PushSide:
    """Side of an object with the tool at it. `heading`: direction of the push in the object's planar frame,
    rad.

    The *carrier* is the frame at the object's origin with its x axis along the push. Without slip, object and
    tool are at rest in it.
    """

    name: str
    heading: float
    tool: planar_geometry.PlanarPose
    """TCP in the carrier."""
    opening: float
    """Opening of the fingers, m."""
    half: float
    """Half of the contact length between fingers and object, m. The force may act anywhere within it."""
    rolls: bool = False
    """Whether the object rolls in front of the fingers: it hardly resists, and no contact is measured."""

    def carrier(self, at: planar_geometry.PlanarPose) -> planar_geometry.PlanarPose:
        """Return the carrier for a pose of the object."""
        return at @ planar_geometry.PlanarPose(0.0, 0.0, self.heading)

    def object(self, carrier: planar_geometry.PlanarPose) -> planar_geometry.PlanarPose:
        return carrier @ planar_geometry.PlanarPose(0.0, 0.0, -self.heading)


def push_sides(belief: BeliefObject, gripper: GripperDescription, towards: float) -> tuple[PushSide, ...]:
    """Return all sides of an object.

    `towards`: wanted direction in its planar frame, rad. A round object has a side for each direction.
    """
    shape = planar_geometry.outline(belief.shape, belief.pose)
    depth = _touching_depth(belief, gripper)
    if shape.round:
        return tuple(_cradle(shape.radius, towards + turn, depth, gripper) for turn in ROUND_PUSH_TURNS)
    lies = curved(belief)  # A cylinder's planar frame has its axis along x: pushed across it, it rolls.
    return tuple(
        replace(side, rolls=lies and abs(math.cos(side.heading)) < 0.5)
        for side in _flats(shape, depth, gripper)
    )


def _touching_depth(belief: BeliefObject, gripper: GripperDescription) -> float:
    """Return the distance from the TCP to the part of the fingers that touches the object, m.

    An object that reaches above the pads is touched by the bodies of the fingers, where these are wider.
    """
    pads_end = bottom(belief.shape, belief.pose) + TIP_SUPPORT_CLEARANCE + gripper.pads[0][0].size[2]
    return gripper.finger_depth(whole=not curved(belief) and top(belief.shape, belief.pose) > pads_end)


def height(belief: BeliefObject, gripper: GripperDescription, tip: float) -> float:
    """Return the height of the TCP in the world during a push, m.

    It is low, with the palm above the object, and at the middle of an object with a curved side. `tip`: reach
    of the finger tips beyond the TCP, m.
    """
    low, high = bottom(belief.shape, belief.pose), top(belief.shape, belief.pose)
    least = max(low + tip + TIP_SUPPORT_CLEARANCE, high - gripper.palm + PALM_PUSH_CLEARANCE)
    if curved(belief):
        middle = (low + high) / 2
        return max(least, middle - (gripper.pads[0][0].size[2] / 2 - tip))
    return least


def curved(belief: BeliefObject) -> bool:
    """Return whether the object has a curved side and may roll."""
    match belief.shape:
        case Sphere():
            return True
        case Cylinder():
            return abs(float(belief.pose.rotation()[2, 2])) <= planar_geometry.MIN_UPRIGHT_COSINE
        case _:
            return False


def _flats(
    shape: planar_geometry.PlanarOutline, depth: float, gripper: GripperDescription
) -> Sequence[PushSide]:
    thick = gripper.pads[0][0].size[1]
    found: list[PushSide] = []
    for k, (a, b) in enumerate(zip(shape.corners, np.roll(shape.corners, -1, axis=0), strict=True)):
        edge = b - a
        length = float(np.hypot(*edge))
        if length < MIN_SIDE_LENGTH:
            continue
        along = edge / length
        inwards = np.array([-along[1], along[0]])
        away = float(-(a @ inwards))
        # The foot of the perpendicular from the origin, limited to the side.
        lateral = float(np.clip(-(a @ along), 0.0, length)) + float(a @ along)
        room = min(float(b @ along) - lateral, lateral - float(a @ along))
        opening = min(max(0.0, 2 * (room - SIDE_END_MARGIN - thick)), gripper.max_width)
        half = min(room, opening / 2 + thick)
        yaw = math.atan2(float(inwards[1]), float(inwards[0]))
        # Along the push, the side runs from left to right: `along` is the carrier's -y.
        found.append(
            PushSide(f"side {k}", yaw, planar_geometry.PlanarPose(-away - depth, -lateral), opening, half)
        )
    return found


def _cradle(radius: float, yaw: float, depth: float, gripper: GripperDescription) -> PushSide:
    opening = min(CRADLE_OPENING_RATIO * radius, gripper.max_width)
    away = (
        math.sqrt((radius + FINGER_EDGE_RADIUS) ** 2 - (opening / 2 + FINGER_EDGE_RADIUS) ** 2)
        - FINGER_EDGE_RADIUS
    )
    name = f"from {math.degrees(yaw + math.pi) % 360:.0f} deg"
    return PushSide(name, yaw, planar_geometry.PlanarPose(-away - depth, 0.0), opening, opening / 2)


MAX_STRAIGHT_CURVATURE = 1e-6
"""Curvature below which an arc is a line, 1/m."""


@dataclass(frozen=True, slots=True)
class ArcPath:
    """Path of arcs from `start` along its x axis: lengths, m, and curvatures, 1/m, positive to the left."""

    start: planar_geometry.PlanarPose
    pieces: tuple[tuple[float, float], ...]

    @property
    def length(self) -> float:
        return sum(length for length, _ in self.pieces)

    @property
    def sharpest(self) -> float:
        """Greatest absolute curvature, 1/m."""
        return max((abs(curvature) for length, curvature in self.pieces if length > 1e-6), default=0.0)

    @property
    def turning(self) -> float:
        """Sum of all absolute rotations, rad."""
        return sum(abs(length * curvature) for length, curvature in self.pieces)

    def at(self, way: float) -> planar_geometry.PlanarPose:
        """Return the frame after `way` m, its x axis along the path. Before the start and after the end it is
        straight."""
        frame = self.start
        if way <= 0.0:
            return frame @ planar_geometry.PlanarPose(way, 0.0)
        for length, curvature in self.pieces:
            frame = frame @ _arc_frame(min(way, length), curvature)
            way -= length
            if way <= 0.0:
                return frame
        return frame @ planar_geometry.PlanarPose(way, 0.0)

    def curvature(self, way: float) -> float:
        """Return the curvature after `way` m, 1/m, positive to the left."""
        if way < 0.0:
            return 0.0
        for length, curvature in self.pieces:
            if way < length:
                return curvature
            way -= length
        return 0.0


def _arc_frame(way: float, curvature: float) -> planar_geometry.PlanarPose:
    if abs(curvature) < MAX_STRAIGHT_CURVATURE:
        return planar_geometry.PlanarPose(way, 0.0, 0.0)
    turn = way * curvature
    return planar_geometry.PlanarPose(math.sin(turn) / curvature, (1.0 - math.cos(turn)) / curvature, turn)


def straight(start: planar_geometry.PlanarPose, length: float) -> ArcPath:
    return ArcPath(start, ((length, 0.0),))


def arc_to(start: planar_geometry.PlanarPose, x: float, y: float) -> ArcPath | None:
    """Return the arc that ends in a point. None: the point is beside the start or behind it."""
    there = start.inverse() @ planar_geometry.PlanarPose(x, y)
    off = math.hypot(there.x, there.y)
    if there.x <= 0.0 or off < 1e-9:
        return None
    curvature = 2.0 * there.y / off**2
    if abs(curvature) < MAX_STRAIGHT_CURVATURE:
        return straight(start, off)
    return ArcPath(start, ((2.0 * math.atan2(there.y, there.x) / curvature, curvature),))


def biarc(start: planar_geometry.PlanarPose, end: planar_geometry.PlanarPose) -> ArcPath | None:
    """Return two arcs that lead to `end` in its direction. None: the path would begin or end backwards.

    The chords of their control polygon are equal (Bolton, "Biarc curves", Computer-Aided Design 7, 1975).
    """
    goal = start.inverse() @ planar_geometry.PlanarPose(end.x, end.y, end.yaw)
    v = np.array([goal.x, goal.y])
    t1, t2 = np.array([1.0, 0.0]), np.array([math.cos(goal.yaw), math.sin(goal.yaw)])
    both = float(v @ (t1 + t2))
    denominator = 2.0 * (1.0 - float(t1 @ t2))
    square = float(v @ v)
    if square < 1e-12 or both <= 0.0:
        return None
    if denominator < 1e-12:
        d = square / (2.0 * both)
    else:
        d = (-both + math.sqrt(both**2 + denominator * square)) / denominator
    if d <= 0.0:
        return None
    joint = (v + d * (t1 - t2)) / 2.0
    first = arc_to(
        start,
        *(start @ planar_geometry.PlanarPose(float(joint[0]), float(joint[1]))).apply(np.zeros((1, 2)))[0],
    )
    if first is None:
        return None
    second = arc_to(first.at(first.length), end.x, end.y)
    if second is None:
        return None
    whole = ArcPath(start, (*first.pieces, *second.pieces))
    return whole if abs(planar_geometry.wrap_angle(whole.at(whole.length).yaw - end.yaw)) < 1e-6 else None


def truncated(way: ArcPath, length: float) -> ArcPath:
    """Return the first `length` m of a path."""
    left, pieces = length, list[tuple[float, float]]()
    for piece, curvature in way.pieces:
        if left <= 0.0:
            break
        pieces.append((min(piece, left), curvature))
        left -= piece
    return ArcPath(way.start, tuple(pieces))


START_GAP = 0.008
"""Distance between fingers and object where a stroke begins, m; `START_GAP_SIGMAS` standard deviations of
its place are
added."""
START_GAP_SIGMAS = 2.0
MAX_ALIGNED_TURN = math.radians(12.0)
"""Rotation of an object below which the flat fingers align it during the push, rad."""
PATH_RADIUS_FACTOR = 2.0
"""Factor of the pushed path's least radius over the least radius that an object can follow."""
MAX_PATH_TURN = math.radians(100.0)
"""Greatest rotation along one path, rad."""
ALIGNING_TRAVEL = 0.012
"""Travel on which an object that is turned by some degrees is aligned, m."""
MIN_PUSH_TRAVEL = 4e-4
"""Least travel of a push, m."""
HEADING_ERROR_COST = 0.05
"""Cost of the remaining heading error, m for each radian."""
STROKE_TRAVEL_COST, STROKE_ROTATION_COST = 0.05, 0.01
"""Costs of travel, m for each metre, and of rotation, m for each radian: of equal errors the shorter stroke
wins."""


@dataclass(frozen=True, slots=True)
class PushGoal:
    """Goal of an object in the plane: place, m, and heading, rad. None: the heading does not matter."""

    x: float
    y: float
    yaw: float | None = None

    def deviation(self, at: planar_geometry.PlanarPose, turn: float) -> tuple[float, float]:
        """Return distance, m, and heading error, rad, of an object with rotational symmetry `turn`, rad."""
        away = math.hypot(self.x - at.x, self.y - at.y)
        return away, 0.0 if self.yaw is None else abs(planar_geometry.wrap_angle(self.yaw - at.yaw, turn))


@dataclass(frozen=True, slots=True, eq=False)
class PushStroke:
    """One push: the carrier follows `way` with the tool, which begins `gap` m before."""

    object: ObjectId
    side: PushSide
    way: ArcPath
    gap: float
    ends: planar_geometry.PlanarPose
    """Expected pose of the object at the end."""
    cost: float
    """Cost of remaining error and effort, m; lower is better."""

    @property
    def name(self) -> str:
        x, y = self.way.start.direction
        return f"{self.side.name} {math.degrees(math.atan2(y, x)):.0f} deg {self.way.length * 1000:.0f} mm"

    def object_at(self, way: float) -> planar_geometry.PlanarPose:
        """Return the object's pose after `way` m of the carrier."""
        return self.side.object(self.way.at(max(0.0, way)))

    def tcp_at(self, way: float, height: float, flipped: bool) -> Pose:
        """Return the TCP pose in the world, pointing down. Flipped by half a turn the fingers look the
        same."""
        return tool_pose(self.way.at(way) @ self.side.tool, height, flipped)


def tool_pose(at: planar_geometry.PlanarPose, height: float, flipped: bool) -> Pose:
    """Return the TCP pose that points down with its x axis along `at`, or against it."""
    sign = -1.0 if flipped else 1.0
    x = np.array([sign * math.cos(at.yaw), sign * math.sin(at.yaw), 0.0])
    z = np.array([0.0, 0.0, -1.0])
    return Pose.from_rotation((at.x, at.y, height), np.column_stack([x, np.cross(z, x), z]))


def push_strokes(
    belief: BeliefObject, aim: PushGoal, gripper: GripperDescription, longest: float
) -> tuple[PushStroke, ...]:
    """Return strokes towards the goal, best first, each at most `longest` m long."""
    at, shape = (
        planar_geometry.planar(belief.shape, belief.pose),
        planar_geometry.outline(belief.shape, belief.pose),
    )
    towards = math.atan2(aim.y - at.y, aim.x - at.x) - at.yaw
    found: list[PushStroke] = []
    for side in push_sides(belief, gripper, towards):
        for way in _carrier_paths(side, at, aim, shape):
            found.append(_stroke(side, way, belief, at, aim, shape, longest))
    return tuple(sorted(found, key=lambda s: (s.cost, s.side.name)))


def turning_room_strokes(belief: BeliefObject, gripper: GripperDescription) -> tuple[PushStroke, ...]:
    """Return short pushes away from a place that is right while the heading is not: only a push aligns the
    object."""
    if planar_geometry.outline(belief.shape, belief.pose).round:
        return ()
    return tuple(
        straight_stroke(side, belief, ALIGNING_TRAVEL)
        for side in push_sides(belief, gripper, 0.0)
        if not side.rolls
    )


def straight_stroke(side: PushSide, belief: BeliefObject, length: float) -> PushStroke:
    """Return the straight stroke along a side's push."""
    way = straight(side.carrier(planar_geometry.planar(belief.shape, belief.pose)), length)
    gap = START_GAP + START_GAP_SIGMAS * belief.sigma_position
    return PushStroke(belief.id, side, way, gap, side.object(way.at(length)), _effort(way))


def _carrier_paths(
    side: PushSide, at: planar_geometry.PlanarPose, aim: PushGoal, shape: planar_geometry.PlanarOutline
) -> Sequence[ArcPath]:
    """Return paths of the carrier to the goal, or as near to it as a push at this side leads."""
    here = side.carrier(at)
    if aim.yaw is None or shape.round:
        found = [_straight_path(planar_geometry.PlanarPose(at.x, at.y, here.yaw), aim)]
        if not shape.round and not side.rolls:
            found.append(arc_to(here, aim.x, aim.y))
    else:
        off = planar_geometry.wrap_angle(aim.yaw - at.yaw, shape.turn)
        there = planar_geometry.PlanarPose(aim.x, aim.y, here.yaw + off)
        found = [] if side.rolls else [biarc(here, there), _turning_path(here, off, side, shape, aim)]
        if abs(off) < MAX_ALIGNED_TURN:
            found.append(
                _straight_path(
                    planar_geometry.PlanarPose(at.x, at.y, there.yaw),
                    aim,
                    squares=abs(off) > math.radians(0.3),
                )
            )
    sharpest = math.inf if shape.round else side.half / (PATH_RADIUS_FACTOR * shape.inertia())
    return [
        way for way in found if way is not None and way.sharpest <= sharpest and way.turning <= MAX_PATH_TURN
    ]


def _straight_path(
    start: planar_geometry.PlanarPose, aim: PushGoal, *, squares: bool = False
) -> ArcPath | None:
    """Return the straight path until the goal is abreast. None: too short; a push that aligns the object may
    be shorter."""
    along = float(np.array([aim.x - start.x, aim.y - start.y]) @ start.direction)
    if along < (-MIN_PUSH_TRAVEL if squares else MIN_PUSH_TRAVEL):
        return None
    return straight(start, max(along, 0.0))


def _turning_path(
    here: planar_geometry.PlanarPose,
    off: float,
    side: PushSide,
    shape: planar_geometry.PlanarOutline,
    aim: PushGoal,
) -> ArcPath | None:
    """Return the path that turns to the goal's heading as tightly as the object follows, then leads on until
    abreast."""
    if abs(off) < MAX_ALIGNED_TURN:
        return None
    curvature = math.copysign(0.9 * side.half / (PATH_RADIUS_FACTOR * shape.inertia()), off)
    turn = ArcPath(here, ((off / curvature, curvature),))
    on = _straight_path(turn.at(turn.length), aim)
    return turn if on is None else ArcPath(here, (*turn.pieces, *on.pieces))


def _stroke(
    side: PushSide,
    way: ArcPath,
    belief: BeliefObject,
    at: planar_geometry.PlanarPose,
    aim: PushGoal,
    shape: planar_geometry.PlanarOutline,
    longest: float,
) -> PushStroke:
    """Return the path as one stroke, or its first part if it takes several."""
    away, turned = aim.deviation(_expected_pose(side, way, at, shape), shape.turn)
    cost = away + HEADING_ERROR_COST * turned + _effort(way)
    parts = max(1, math.ceil(way.length / longest - 1e-6))
    first = truncated(way, way.length / parts) if parts > 1 else way
    askew = abs(planar_geometry.wrap_angle(way.start.yaw - side.carrier(at).yaw))
    gap = START_GAP + START_GAP_SIGMAS * belief.sigma_position + side.half * math.sin(min(askew, 1.0))
    return PushStroke(belief.id, side, first, gap, _expected_pose(side, first, at, shape), cost)


def _expected_pose(
    side: PushSide, way: ArcPath, at: planar_geometry.PlanarPose, shape: planar_geometry.PlanarOutline
) -> planar_geometry.PlanarPose:
    """Return the expected pose of the object.

    An object that the path does not meet squarely turns about a corner, and is aligned only by a long enough
    path.
    """
    end = side.object(way.at(way.length))
    askew = planar_geometry.wrap_angle(way.start.yaw - side.carrier(at).yaw)
    if shape.round or askew == 0.0:
        return end
    turned = way.length * side.half / (shape.inertia() + side.half**2)
    return planar_geometry.PlanarPose(
        end.x, end.y, end.yaw - math.copysign(max(0.0, abs(askew) - turned), askew)
    )


def _effort(way: ArcPath) -> float:
    return STROKE_TRAVEL_COST * way.length + STROKE_ROTATION_COST * way.turning
