"""Sides of an object to push at, and paths of arcs in the plane that a pushed object can follow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...world.belief.planning_scene import BeliefObject
from ...world.planar_geometry import MIN_UPRIGHT_COSINE, PlanarOutline, PlanarPose, outline, wrap_angle
from ...world.robot_model.description import GripperDescription
from ...world.shapes import Cylinder, Sphere, bottom, top

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
    tool: PlanarPose
    """TCP in the carrier."""
    opening: float
    """Opening of the fingers, m."""
    half: float
    """Half of the contact length between fingers and object, m. The force may act anywhere within it."""
    rolls: bool = False
    """Whether the object rolls in front of the fingers: it hardly resists, and no contact is measured."""

    def carrier(self, at: PlanarPose) -> PlanarPose:
        """Return the carrier for a pose of the object."""
        return at @ PlanarPose(0.0, 0.0, self.heading)

    def object(self, carrier: PlanarPose) -> PlanarPose:
        return carrier @ PlanarPose(0.0, 0.0, -self.heading)


def push_sides(belief: BeliefObject, gripper: GripperDescription, towards: float) -> tuple[PushSide, ...]:
    """Return all sides of an object.

    `towards`: wanted direction in its planar frame, rad. A round object has a side for each direction.
    """
    shape = outline(belief.shape, belief.pose)
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
            return abs(float(belief.pose.rotation()[2, 2])) <= MIN_UPRIGHT_COSINE
        case _:
            return False


def _flats(shape: PlanarOutline, depth: float, gripper: GripperDescription) -> Sequence[PushSide]:
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
        found.append(PushSide(f"side {k}", yaw, PlanarPose(-away - depth, -lateral), opening, half))
    return found


def _cradle(radius: float, yaw: float, depth: float, gripper: GripperDescription) -> PushSide:
    opening = min(CRADLE_OPENING_RATIO * radius, gripper.max_width)
    away = (
        math.sqrt((radius + FINGER_EDGE_RADIUS) ** 2 - (opening / 2 + FINGER_EDGE_RADIUS) ** 2)
        - FINGER_EDGE_RADIUS
    )
    name = f"from {math.degrees(yaw + math.pi) % 360:.0f} deg"
    return PushSide(name, yaw, PlanarPose(-away - depth, 0.0), opening, opening / 2)


MAX_STRAIGHT_CURVATURE = 1e-6
"""Curvature below which an arc is a line, 1/m."""


@dataclass(frozen=True, slots=True)
class ArcPath:
    """Path of arcs from `start` along its x axis: lengths, m, and curvatures, 1/m, positive to the left."""

    start: PlanarPose
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

    def at(self, way: float) -> PlanarPose:
        """Return the frame after `way` m, its x axis along the path. Before the start and after the end it is
        straight."""
        frame = self.start
        if way <= 0.0:
            return frame @ PlanarPose(way, 0.0)
        for length, curvature in self.pieces:
            frame = frame @ _arc_frame(min(way, length), curvature)
            way -= length
            if way <= 0.0:
                return frame
        return frame @ PlanarPose(way, 0.0)

    def curvature(self, way: float) -> float:
        """Return the curvature after `way` m, 1/m, positive to the left."""
        if way < 0.0:
            return 0.0
        for length, curvature in self.pieces:
            if way < length:
                return curvature
            way -= length
        return 0.0


def _arc_frame(way: float, curvature: float) -> PlanarPose:
    if abs(curvature) < MAX_STRAIGHT_CURVATURE:
        return PlanarPose(way, 0.0, 0.0)
    turn = way * curvature
    return PlanarPose(math.sin(turn) / curvature, (1.0 - math.cos(turn)) / curvature, turn)


def straight(start: PlanarPose, length: float) -> ArcPath:
    return ArcPath(start, ((length, 0.0),))


def arc_to(start: PlanarPose, x: float, y: float) -> ArcPath | None:
    """Return the arc that ends in a point. None: the point is beside the start or behind it."""
    there = start.inverse() @ PlanarPose(x, y)
    off = math.hypot(there.x, there.y)
    if there.x <= 0.0 or off < 1e-9:
        return None
    curvature = 2.0 * there.y / off**2
    if abs(curvature) < MAX_STRAIGHT_CURVATURE:
        return straight(start, off)
    return ArcPath(start, ((2.0 * math.atan2(there.y, there.x) / curvature, curvature),))


def biarc(start: PlanarPose, end: PlanarPose) -> ArcPath | None:
    """Return two arcs that lead to `end` in its direction. None: the path would begin or end backwards.

    The chords of their control polygon are equal (Bolton, "Biarc curves", Computer-Aided Design 7, 1975).
    """
    goal = start.inverse() @ PlanarPose(end.x, end.y, end.yaw)
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
    first = arc_to(start, *(start @ PlanarPose(float(joint[0]), float(joint[1]))).apply(np.zeros((1, 2)))[0])
    if first is None:
        return None
    second = arc_to(first.at(first.length), end.x, end.y)
    if second is None:
        return None
    whole = ArcPath(start, (*first.pieces, *second.pieces))
    return whole if abs(wrap_angle(whole.at(whole.length).yaw - end.yaw)) < 1e-6 else None


def truncated(way: ArcPath, length: float) -> ArcPath:
    """Return the first `length` m of a path."""
    left, pieces = length, list[tuple[float, float]]()
    for piece, curvature in way.pieces:
        if left <= 0.0:
            break
        pieces.append((min(piece, left), curvature))
        left -= piece
    return ArcPath(way.start, tuple(pieces))
