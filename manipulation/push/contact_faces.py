"""Where a tool touches what it pushes: the flat of the closed or opened fingers, or the gap between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...robots.description import GripperDescription
from ...world.belief.planning_scene import BeliefObject
from ...world.planar_geometry import UPRIGHT, Outline, Planar, outline
from ...world.shapes import Cylinder, Sphere, bottom, top

SHORTEST = 0.012
"""Of a side that is pushed at, m."""
EDGE = 0.003
"""The fingers stay so far from the ends of a side, m."""
CRADLE = 1.2
"""Opening of the fingers that push what is round between them, over its radius: it cannot leave sideways."""
ROUNDED = 0.001
"""Radius of the fingers' edges, on which what is round comes to lie, m."""
FAN = (0.0, 0.5, -0.5, 1.0, -1.0)
"""Turns of the push of something round away from the straight way, rad."""
TIP = 0.002
"""Of the finger tips above the support, m."""
PALM = 0.004
"""Of the palm above the top of what is pushed, m."""


@dataclass(frozen=True, slots=True)
class Side:
    """One way to push: `heading` is the direction of the push in the object's planar frame, rad. The
    *carrier* is the frame at the object's origin with its x axis along the push: while nothing slips, object
    and tool stand still in it."""

    name: str
    heading: float
    tool: Planar
    """The TCP in the carrier."""
    opening: float
    """Of the fingers, m."""
    half: float
    """Half of the length over which fingers and object touch, m: the force may act anywhere within it."""
    rolls: bool = False
    """The object rolls before the fingers: it hardly resists, and is not felt."""

    def carrier(self, at: Planar) -> Planar:
        """With the object at a place."""
        return at @ Planar(0.0, 0.0, self.heading)

    def object(self, carrier: Planar) -> Planar:
        return carrier @ Planar(0.0, 0.0, -self.heading)


def sides(belief: BeliefObject, gripper: GripperDescription, towards: float) -> tuple[Side, ...]:
    """All ways to push an object. `towards`: the direction in its planar frame that is wanted, rad; what is
    round has a side for each."""
    shape = outline(belief.shape, belief.pose)
    if shape.round:
        return tuple(_cradle(shape.radius, towards + turn, gripper) for turn in FAN)
    lies = curved(belief)  # A cylinder's planar frame has its axis along x: pushed across it, it rolls.
    return tuple(
        replace(side, rolls=lies and abs(math.cos(side.heading)) < 0.5) for side in _flats(shape, gripper)
    )


def height(belief: BeliefObject, gripper: GripperDescription, tip: float) -> float:
    """Of the TCP in the world while it pushes, m: low, but with the palm above the object, and at the middle
    of what curves upwards. `tip`: how far the finger tips reach beyond the TCP, m."""
    low, high = bottom(belief.shape, belief.pose), top(belief.shape, belief.pose)
    least = max(low + tip + TIP, high - gripper.palm + PALM)
    if curved(belief):
        middle = (low + high) / 2
        return max(least, middle - (gripper.pads[0][0].size[2] / 2 - tip))
    return least


def curved(belief: BeliefObject) -> bool:
    """Whether it is round from the side, and may roll."""
    match belief.shape:
        case Sphere():
            return True
        case Cylinder():
            return abs(float(belief.pose.rotation()[2, 2])) <= UPRIGHT
        case _:
            return False


def tool_outline(gripper: GripperDescription, opening: float) -> tuple[Outline, Outline]:
    """Of the two finger pads from above, in the TCP's planar frame with y across the fingers."""
    depth, thick = gripper.pads[0][0].size[0] / 2, gripper.pads[0][0].size[1]
    near, far = opening / 2, opening / 2 + thick
    one = np.array([[-depth, near], [depth, near], [depth, far], [-depth, far]])
    other = np.array([[-depth, -far], [depth, -far], [depth, -near], [-depth, -near]])
    return Outline(one), Outline(other)


def _flats(shape: Outline, gripper: GripperDescription) -> Sequence[Side]:
    depth, thick = gripper.pads[0][0].size[0] / 2, gripper.pads[0][0].size[1]
    found: list[Side] = []
    for k, (a, b) in enumerate(zip(shape.corners, np.roll(shape.corners, -1, axis=0), strict=True)):
        edge = b - a
        length = float(np.hypot(*edge))
        if length < SHORTEST:
            continue
        along = edge / length
        inwards = np.array([-along[1], along[0]])
        away = float(-(a @ inwards))
        # The foot of the perpendicular from the origin, as far as it lies within the side.
        lateral = float(np.clip(-(a @ along), 0.0, length)) + float(a @ along)
        room = min(float(b @ along) - lateral, lateral - float(a @ along))
        opening = min(max(0.0, 2 * (room - EDGE - thick)), gripper.max_width)
        half = min(room, opening / 2 + thick)
        yaw = math.atan2(float(inwards[1]), float(inwards[0]))
        # Seen along the push, the side runs from left to right: `along` is the carrier's -y.
        found.append(Side(f"side {k}", yaw, Planar(-away - depth, -lateral), opening, half))
    return found


def _cradle(radius: float, yaw: float, gripper: GripperDescription) -> Side:
    depth = gripper.pads[0][0].size[0] / 2
    opening = min(CRADLE * radius, gripper.max_width)
    away = math.sqrt((radius + ROUNDED) ** 2 - (opening / 2 + ROUNDED) ** 2) - ROUNDED
    name = f"from {math.degrees(yaw + math.pi) % 360:.0f} deg"
    return Side(name, yaw, Planar(-away - depth, 0.0), opening, opening / 2)
