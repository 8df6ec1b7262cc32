"""Pushing and supporting contacts of the kinematic backend: fingers push items aside, tops carry feet.

Pushed items follow `world.quasi_static_pushing`, the model that the planner of push strokes uses too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ...robots.description import GripperDescription, tool_outline
from ...world.planar_geometry import PlanarOutline, PlanarPose, moved, outline, planar
from ...world.quasi_static_pushing import PlanarPushModel
from ...world.values import GRAVITY, Array, ObjectId
from .bodies import KinematicBodies, Prism

MAX_FIRST_CONTACT_DEPTH = 0.005
"""Depth below a top up to which a foot of unknown origin counts as standing on it, m."""
MAX_ENTRY_DEPTH = 5e-4
"""Depth below a top up to which a foot came from above, m."""


class KinematicContacts:
    """Supports of each foot: a foot is a finger tip, or the bottom of the held item.

    A foot stands on a body that it entered from above, until it leaves the outline. A body that it entered
    from the side, as fingers do that open next to it, moves aside and pushes nothing up.
    """

    def __init__(self) -> None:
        self._height: dict[str, float] = {}
        self._upon: dict[str, frozenset[str]] = {}

    def forget(self, *feet: str) -> None:
        """Forget feet (default: all) that are far from everything, or were placed elsewhere."""
        for foot in feet or tuple(self._height):
            self._height.pop(foot, None)
            self._upon.pop(foot, None)

    def top(self, foot: str, height: float, tops: Iterable[tuple[str, float]]) -> float | None:
        """Return the highest of `tops` (names and heights at the foot, m) that carries the foot or is below
        it; None: there is none."""
        before, upon = self._height.get(foot), self._upon.get(foot, frozenset[str]())
        entered = height + MAX_FIRST_CONTACT_DEPTH if before is None else before + MAX_ENTRY_DEPTH
        carrying = {name: top for name, top in tops if top <= max(height, entered) or name in upon}
        self._height[foot] = height
        self._upon[foot] = frozenset(name for name, top in carrying.items() if top > height)
        return max(carrying.values(), default=None)


MAX_STANDING_TIP_DEPTH = 0.0015
"""Depth below the top of an item up to which finger tips stand on it, m."""
MIN_DOWNWARD_COSINE = 0.98
"""Least cosine of the tilt of a hand that points down."""
MIN_PUSH_TRAVEL = 1e-7
"""Least travel in a control period with which the hand pushes, m."""


class KinematicPushing:
    """Pushing: moves the items of `bodies` out of the way of the finger pads."""

    def __init__(self, gripper: GripperDescription, bodies: KinematicBodies) -> None:
        self._gripper = gripper
        self._bodies = bodies
        self._high = gripper.pads[0][0].size[2]
        self._before: Array | None = None

    def forget(self) -> None:
        """Forget the last position after the hand was placed elsewhere."""
        self._before = None

    def step(self, rotation: Array, position: Array, width: float, tip: float) -> tuple[float, float]:
        """Push items that the fingers reach, and return the friction force (x, y) of what slides, in the
        world, N.

        `rotation` (3, 3) and `position` (3,) are the TCP's in the world. The fingers are `width` m open and
        reach `tip` m beyond the TCP.
        """
        before, self._before = self._before, position.copy()
        if before is None or float(rotation[2, 2]) > -MIN_DOWNWARD_COSINE:
            return 0.0, 0.0
        low = float(position[2]) - tip
        dx, dy, dz = (position - before).tolist()
        way = math.hypot(dx, dy)
        if low > self._bodies.highest or way < MIN_PUSH_TRAVEL or way < abs(dz):
            return 0.0, 0.0
        return self._push(rotation, position, width, low, (dx / way, dy / way))

    def _push(
        self, rotation: Array, position: Array, width: float, low: float, along: tuple[float, float]
    ) -> tuple[float, float]:
        here = [
            (body, prism)
            for body, prism in self._bodies.standing()
            if prism.high[2] > low + MAX_STANDING_TIP_DEPTH
            and prism.low[2] < low + self._high
            and self._bodies.in_hole(body) is None
        ]
        reach = width + 0.2
        if not any(math.dist(b.pose.position[:2], position[:2].tolist()) < reach for b, _ in here):
            return 0.0, 0.0
        at = PlanarPose(
            float(position[0]), float(position[1]), math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))
        )
        sliding = PlanarPushModel(
            {b.id: (outline(b.entry.shape, b.pose), planar(b.entry.shape, b.pose)) for b, _ in here},
            [
                _static_outline(prism)
                for prism in self._bodies.fixed
                if low < prism.high[2] - MAX_STANDING_TIP_DEPTH
            ],
        )
        pushed = sliding.press([(finger, at) for finger in tool_outline(self._gripper, width)])
        force = 0.0
        for body, _ in here:
            if body.id in pushed:
                there = moved(body.entry.shape, body.pose, sliding.where(body.id))
                self._bodies.put(replace(body, pose=there))
                force += body.friction * body.entry.mass * GRAVITY
        if pushed:
            self._settle(pushed)
        return -force * along[0], -force * along[1]

    def _settle(self, pushed: frozenset[str]) -> None:
        """Let items come down that were pushed over an edge, with those on them."""
        for name in sorted(pushed):
            body = self._bodies[ObjectId(name)]
            prism = Prism.of(name, body.entry.shape, body.pose)
            surface = self._bodies.below(prism)
            if surface is None or abs(surface - prism.low[2]) > 1e-6:
                self._bodies.settle()
                return


def _static_outline(prism: Prism) -> tuple[PlanarOutline, PlanarPose]:
    """Return a static prism's outline and its pose in the plane."""
    x, y = prism.outline.centre
    return PlanarOutline(np.array(prism.outline.polygon), prism.outline.radius), PlanarPose(x, y)
