"""Push strokes that bring an object nearer to its goal: side, path, length."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...world.belief.planning_scene import BeliefObject
from ...world.planar_geometry import PlanarOutline, PlanarPose, outline, planar, wrap_angle
from ...world.robot_model.description import GripperDescription
from ...world.values import ObjectId, Pose
from .push_arcs import ArcPath, PushSide, arc_to, biarc, push_sides, straight, truncated

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

    def off(self, at: PlanarPose, turn: float) -> tuple[float, float]:
        """Return distance, m, and heading error, rad, of an object with rotational symmetry `turn`, rad."""
        away = math.hypot(self.x - at.x, self.y - at.y)
        return away, 0.0 if self.yaw is None else abs(wrap_angle(self.yaw - at.yaw, turn))


@dataclass(frozen=True, slots=True, eq=False)
class PushStroke:
    """One push: the carrier follows `way` with the tool, which begins `gap` m before."""

    object: ObjectId
    side: PushSide
    way: ArcPath
    gap: float
    ends: PlanarPose
    """Expected pose of the object at the end."""
    cost: float
    """Cost of remaining error and effort, m; lower is better."""

    @property
    def name(self) -> str:
        x, y = self.way.start.direction
        return f"{self.side.name} {math.degrees(math.atan2(y, x)):.0f} deg {self.way.length * 1000:.0f} mm"

    def object_at(self, way: float) -> PlanarPose:
        """Return the object's pose after `way` m of the carrier."""
        return self.side.object(self.way.at(max(0.0, way)))

    def tcp_at(self, way: float, height: float, flipped: bool) -> Pose:
        """Return the TCP pose in the world, pointing down. Flipped by half a turn the fingers look the
        same."""
        return tool_pose(self.way.at(way) @ self.side.tool, height, flipped)


def tool_pose(at: PlanarPose, height: float, flipped: bool) -> Pose:
    """Return the TCP pose that points down with its x axis along `at`, or against it."""
    sign = -1.0 if flipped else 1.0
    x = np.array([sign * math.cos(at.yaw), sign * math.sin(at.yaw), 0.0])
    z = np.array([0.0, 0.0, -1.0])
    return Pose.from_rotation((at.x, at.y, height), np.column_stack([x, np.cross(z, x), z]))


def push_strokes(
    belief: BeliefObject, aim: PushGoal, gripper: GripperDescription, longest: float
) -> tuple[PushStroke, ...]:
    """Return strokes towards the goal, best first, each at most `longest` m long."""
    at, shape = planar(belief.shape, belief.pose), outline(belief.shape, belief.pose)
    towards = math.atan2(aim.y - at.y, aim.x - at.x) - at.yaw
    found: list[PushStroke] = []
    for side in push_sides(belief, gripper, towards):
        for way in _carrier_paths(side, at, aim, shape):
            found.append(_stroke(side, way, belief, at, aim, shape, longest))
    return tuple(sorted(found, key=lambda s: (s.cost, s.side.name)))


def turning_room_strokes(belief: BeliefObject, gripper: GripperDescription) -> tuple[PushStroke, ...]:
    """Return short pushes away from a place that is right while the heading is not: only a push aligns the
    object."""
    if outline(belief.shape, belief.pose).round:
        return ()
    return tuple(
        straight_stroke(side, belief, ALIGNING_TRAVEL)
        for side in push_sides(belief, gripper, 0.0)
        if not side.rolls
    )


def straight_stroke(side: PushSide, belief: BeliefObject, length: float) -> PushStroke:
    """Return the straight stroke along a side's push."""
    way = straight(side.carrier(planar(belief.shape, belief.pose)), length)
    gap = START_GAP + START_GAP_SIGMAS * belief.sigma_position
    return PushStroke(belief.id, side, way, gap, side.object(way.at(length)), _effort(way))


def _carrier_paths(side: PushSide, at: PlanarPose, aim: PushGoal, shape: PlanarOutline) -> Sequence[ArcPath]:
    """Return paths of the carrier to the goal, or as near to it as a push at this side leads."""
    here = side.carrier(at)
    if aim.yaw is None or shape.round:
        found = [_straight_path(PlanarPose(at.x, at.y, here.yaw), aim)]
        if not shape.round and not side.rolls:
            found.append(arc_to(here, aim.x, aim.y))
    else:
        off = wrap_angle(aim.yaw - at.yaw, shape.turn)
        there = PlanarPose(aim.x, aim.y, here.yaw + off)
        found = [] if side.rolls else [biarc(here, there), _turning_path(here, off, side, shape, aim)]
        if abs(off) < MAX_ALIGNED_TURN:
            found.append(
                _straight_path(PlanarPose(at.x, at.y, there.yaw), aim, squares=abs(off) > math.radians(0.3))
            )
    sharpest = math.inf if shape.round else side.half / (PATH_RADIUS_FACTOR * shape.inertia())
    return [
        way for way in found if way is not None and way.sharpest <= sharpest and way.turning <= MAX_PATH_TURN
    ]


def _straight_path(start: PlanarPose, aim: PushGoal, *, squares: bool = False) -> ArcPath | None:
    """Return the straight path until the goal is abreast. None: too short; a push that aligns the object may
    be shorter."""
    along = float(np.array([aim.x - start.x, aim.y - start.y]) @ start.direction)
    if along < (-MIN_PUSH_TRAVEL if squares else MIN_PUSH_TRAVEL):
        return None
    return straight(start, max(along, 0.0))


def _turning_path(
    here: PlanarPose, off: float, side: PushSide, shape: PlanarOutline, aim: PushGoal
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
    at: PlanarPose,
    aim: PushGoal,
    shape: PlanarOutline,
    longest: float,
) -> PushStroke:
    """Return the path as one stroke, or its first part if it takes several."""
    away, turned = aim.off(_expected_pose(side, way, at, shape), shape.turn)
    cost = away + HEADING_ERROR_COST * turned + _effort(way)
    parts = max(1, math.ceil(way.length / longest - 1e-6))
    first = truncated(way, way.length / parts) if parts > 1 else way
    askew = abs(wrap_angle(way.start.yaw - side.carrier(at).yaw))
    gap = START_GAP + START_GAP_SIGMAS * belief.sigma_position + side.half * math.sin(min(askew, 1.0))
    return PushStroke(belief.id, side, first, gap, _expected_pose(side, first, at, shape), cost)


def _expected_pose(side: PushSide, way: ArcPath, at: PlanarPose, shape: PlanarOutline) -> PlanarPose:
    """Return the expected pose of the object.

    An object that the path does not meet squarely turns about a corner, and is aligned only by a long enough
    path.
    """
    end = side.object(way.at(way.length))
    askew = wrap_angle(way.start.yaw - side.carrier(at).yaw)
    if shape.round or askew == 0.0:
        return end
    turned = way.length * side.half / (shape.inertia() + side.half**2)
    return PlanarPose(end.x, end.y, end.yaw - math.copysign(max(0.0, abs(askew) - turned), askew))


def _effort(way: ArcPath) -> float:
    return STROKE_TRAVEL_COST * way.length + STROKE_ROTATION_COST * way.turning
