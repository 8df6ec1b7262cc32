"""Strokes that bring an object nearer to where it is to be: which side, which way, how far."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...robots.description import GripperDescription
from ...world.belief.planning_scene import BeliefObject
from ...world.planar_geometry import PlanarOutline, PlanarPose, outline, planar, wrap_angle
from ...world.values import ObjectId, Pose
from .push_arcs import ArcPath, PushSide, arc_to, biarc, push_sides, straight, truncated

GAP = 0.008
"""Between the fingers and the object where a stroke begins, m; and so many standard deviations of where the
object is believed to be."""
SIGMAS = 2.0
SQUARED = math.radians(12.0)
"""An object that is turned by less is squared up by the flat of the fingers on the way, rad."""
STEADY = 2.0
"""Turns while it is pushed are wider by this factor than an object would follow at most."""
TURNED = math.radians(100.0)
"""Greatest turn of one way, rad."""
ASIDE = 0.012
"""Way on which what is turned by some degrees is squared up, m."""
TINY = 4e-4
"""A push by less is none, m."""
RADIAN = 0.05
"""What a radian of heading that is left is worth, m."""
WAY, TURN = 0.05, 0.01
"""What a metre of way costs, and a radian of turning, m: of two strokes that leave the same error the
shorter one is made."""


@dataclass(frozen=True, slots=True)
class PushGoal:
    """Where an object is to be, in the plane: m, and rad if its heading matters."""

    x: float
    y: float
    yaw: float | None = None

    def off(self, at: PlanarPose, turn: float) -> tuple[float, float]:
        """Distance, m, and difference of heading, rad, of what looks the same turned by `turn`."""
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
    """Where the object is expected to come to."""
    cost: float
    """Error that is left and effort, m; lower is better."""

    @property
    def name(self) -> str:
        x, y = self.way.start.direction
        return f"{self.side.name} {math.degrees(math.atan2(y, x)):.0f} deg {self.way.length * 1000:.0f} mm"

    def object_at(self, way: float) -> PlanarPose:
        """The object when the carrier has gone so far, m."""
        return self.side.object(self.way.at(max(0.0, way)))

    def tcp_at(self, way: float, height: float, flipped: bool) -> Pose:
        """The TCP in the world, pointing down; flipped by half a turn the fingers look the same."""
        return tool_pose(self.way.at(way) @ self.side.tool, height, flipped)


def tool_pose(at: PlanarPose, height: float, flipped: bool) -> Pose:
    """The TCP pointing down with its x axis along `at`, or against it."""
    sign = -1.0 if flipped else 1.0
    x = np.array([sign * math.cos(at.yaw), sign * math.sin(at.yaw), 0.0])
    z = np.array([0.0, 0.0, -1.0])
    return Pose.from_rotation((at.x, at.y, height), np.column_stack([x, np.cross(z, x), z]))


def push_strokes(
    belief: BeliefObject, aim: PushGoal, gripper: GripperDescription, longest: float
) -> tuple[PushStroke, ...]:
    """Strokes towards the aim, the best first; none of them is longer than `longest` m."""
    at, shape = planar(belief.shape, belief.pose), outline(belief.shape, belief.pose)
    towards = math.atan2(aim.y - at.y, aim.x - at.x) - at.yaw
    found: list[PushStroke] = []
    for side in push_sides(belief, gripper, towards):
        for way in _ways(side, at, aim, shape):
            found.append(_stroke(side, way, belief, at, aim, shape, longest))
    return tuple(sorted(found, key=lambda s: (s.cost, s.side.name)))


def turning_room_strokes(belief: BeliefObject, gripper: GripperDescription) -> tuple[PushStroke, ...]:
    """Short pushes away from where an object is: it is where it should be, but turned, and only on a way can
    it be squared up."""
    if outline(belief.shape, belief.pose).round:
        return ()
    return tuple(
        straight_stroke(side, belief, ASIDE) for side in push_sides(belief, gripper, 0.0) if not side.rolls
    )


def straight_stroke(side: PushSide, belief: BeliefObject, length: float) -> PushStroke:
    """Straight along one side's push."""
    way = straight(side.carrier(planar(belief.shape, belief.pose)), length)
    gap = GAP + SIGMAS * belief.sigma_position
    return PushStroke(belief.id, side, way, gap, side.object(way.at(length)), _effort(way))


def _ways(side: PushSide, at: PlanarPose, aim: PushGoal, shape: PlanarOutline) -> Sequence[ArcPath]:
    """Ways of the carrier that lead to the aim, or as near to it as a push at this side leads."""
    here = side.carrier(at)
    if aim.yaw is None or shape.round:
        found = [_ahead(PlanarPose(at.x, at.y, here.yaw), aim)]
        if not shape.round and not side.rolls:
            found.append(arc_to(here, aim.x, aim.y))
    else:
        off = wrap_angle(aim.yaw - at.yaw, shape.turn)
        there = PlanarPose(aim.x, aim.y, here.yaw + off)
        found = [] if side.rolls else [biarc(here, there), _turning(here, off, side, shape, aim)]
        if abs(off) < SQUARED:
            found.append(_ahead(PlanarPose(at.x, at.y, there.yaw), aim, squares=abs(off) > math.radians(0.3)))
    sharpest = math.inf if shape.round else side.half / (STEADY * shape.inertia())
    return [way for way in found if way is not None and way.sharpest <= sharpest and way.turning <= TURNED]


def _ahead(start: PlanarPose, aim: PushGoal, *, squares: bool = False) -> ArcPath | None:
    """Straight on until the aim is abreast; a push that squares an object up may be as good as no way."""
    along = float(np.array([aim.x - start.x, aim.y - start.y]) @ start.direction)
    if along < (-TINY if squares else TINY):
        return None
    return straight(start, max(along, 0.0))


def _turning(
    here: PlanarPose, off: float, side: PushSide, shape: PlanarOutline, aim: PushGoal
) -> ArcPath | None:
    """Turned to the heading that is wanted as tightly as the object follows, and on until the aim is
    abreast."""
    if abs(off) < SQUARED:
        return None
    curvature = math.copysign(0.9 * side.half / (STEADY * shape.inertia()), off)
    turn = ArcPath(here, ((off / curvature, curvature),))
    on = _ahead(turn.at(turn.length), aim)
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
    """The way as one stroke, or its first part where it takes several."""
    away, turned = aim.off(_ended(side, way, at, shape), shape.turn)
    cost = away + RADIAN * turned + _effort(way)
    parts = max(1, math.ceil(way.length / longest - 1e-6))
    first = truncated(way, way.length / parts) if parts > 1 else way
    askew = abs(wrap_angle(way.start.yaw - side.carrier(at).yaw))
    gap = GAP + SIGMAS * belief.sigma_position + side.half * math.sin(min(askew, 1.0))
    return PushStroke(belief.id, side, first, gap, _ended(side, first, at, shape), cost)


def _ended(side: PushSide, way: ArcPath, at: PlanarPose, shape: PlanarOutline) -> PlanarPose:
    """Where the object comes to: one that the way does not begin square to turns at a corner on the way, and
    is squared up only when that is long enough."""
    end = side.object(way.at(way.length))
    askew = wrap_angle(way.start.yaw - side.carrier(at).yaw)
    if shape.round or askew == 0.0:
        return end
    turned = way.length * side.half / (shape.inertia() + side.half**2)
    return PlanarPose(end.x, end.y, end.yaw - math.copysign(max(0.0, abs(askew) - turned), askew))


def _effort(way: ArcPath) -> float:
    return WAY * way.length + TURN * way.turning
