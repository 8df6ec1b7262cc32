"""What an insertion needs to know before it feels: how the object comes over the hole, and how it leans."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...control.contact.peg_motion import BelievedHole, HeldPeg
from ...world.belief.hole_matching import find_hole, hole_clearance
from ...world.scene.description import Fixture, Hole
from ...world.shapes import Box, Cylinder, Shape, bottom, extents
from ...world.values import Array, Pose

if TYPE_CHECKING:
    from ...cell.world import World
    from ...robots.description import GripperDescription
    from ...world.belief.planning_scene import BeliefObject
    from ..grasp.grasp_candidates import GraspCandidate

ABOVE = 0.012
"""Of the object's underside over the believed mouth where feeling begins, m."""

TURNS = 8
"""Turns about its axis at which an object is tried that fits at any."""
DOWN = math.cos(math.radians(30.0))
"""A tool that points down less than this reaches no hole with what it holds: the fixture is in its way."""
FINE = 0.001
"""Clearance below which contacts want the finer step, m."""
HAND = 0.0015
"""How far beside where it is believed an object may sit in the hand, m."""
TIPS_OVER = 0.0015
"""Of the finger tips over the surface in the end, m."""
LEAST_DEPTH = 0.005
"""An object is put so deep into a hole at least, m."""
FINE_RATE, RATE = 1000, 500
"""Steps a second while in contact, for holes with less and with more clearance than that."""
TOWARDS = 1e-3
"""What leans along the fingers by so little less than another corner is as good, 1."""


@dataclass(frozen=True, slots=True)
class InsertionTask:
    """A held object and the hole into which it is to go, as they are believed to be."""

    hole: Hole
    hole_in_world: Pose
    shape: Shape
    object_in_tcp: Pose
    slack: float
    """How much wider the hole is where it is tightest, both sides together, m."""
    uncertainty: float
    """How far beside its believed place the mouth may be, m."""

    @property
    def rate(self) -> int:
        """Of physics and control in contact, Hz."""
        return FINE_RATE if self.slack < FINE - 1e-9 else RATE

    @property
    def height(self) -> float:
        """Of the object along its axis, m."""
        low, high = extents(self.shape, np.eye(3))
        return float(high[2] - low[2])

    def seen_at(self, hole_in_world: Pose, uncertainty: float) -> InsertionTask:
        """The same, the mouth having been seen."""
        return replace(self, hole_in_world=hole_in_world, uncertainty=uncertainty + HAND)


def fit(fixture: Fixture, hole: Hole, shape: Shape, object_in_tcp: Pose) -> InsertionTask:
    """A fixture stands somewhere within a square, and turns the hole about its own middle."""
    left = hole_clearance(hole, shape)
    assert left is not None, "it was chosen because it fits"
    doubt = fixture.uncertainty
    arm = math.hypot(*hole.pose.position[:2])
    off = math.sqrt(2.0) * doubt.position + arm * doubt.angle + HAND
    return InsertionTask(hole, fixture.pose @ hole.pose, shape, object_in_tcp, min(left), off)


def poses_over(fit: InsertionTask, above: float) -> tuple[Pose, ...]:
    """TCP poses in the world with the object upright over the hole, its underside `above` m over the mouth,
    at each turn at which it fits, the tool pointing down. Empty when it is held so that none does."""
    poses: list[Pose] = []
    for yaw in _turns(fit):
        for roll in (0.0, math.pi):
            upright = Pose.from_rpy((0.0, 0.0, fit.height / 2 + above), (roll, 0.0, yaw))
            tcp = fit.hole_in_world @ upright @ fit.object_in_tcp.inverse()
            if -float(tcp.rotation()[2, 2]) >= DOWN:
                poses.append(tcp)
    return tuple(poses)


def hover_poses(world: World, hole_id: str, shape: Shape, object_in_tcp: Pose) -> tuple[Pose, ...]:
    """`poses_over` for an object that would be held so, where an insertion by feeling begins."""
    fixture, hole = find_hole(world.scene, hole_id)
    return poses_over(fit(fixture, hole, shape, object_in_tcp), ABOVE)


def fingertips_too_low(
    hole: Hole, belief: BeliefObject, grasp: GraspCandidate, gripper: GripperDescription
) -> bool:
    """Whether the finger tips of a grasp would meet the fixture before the object is down in the hole."""
    tips = grasp.tcp_in_world.position[2] - gripper.tip
    return tips - bottom(belief.shape, belief.pose) < hole.depth + TIPS_OVER


def _turns(fit: InsertionTask) -> Sequence[float]:
    match fit.shape:
        case Box((x, y, _)):
            square = fit.hole.form == "square" and abs(x - y) < 1e-6
            along = 0.0 if (x >= y) == (fit.hole.size[0] >= fit.hole.size[1]) else math.pi / 2
            step = math.pi / 2 if square else math.pi
            return [along + k * step for k in range(4 if square else 2)]
        case _:
            return [2 * math.pi * k / TURNS for k in range(TURNS)]


def peg(fit: InsertionTask, tcp_in_world: Pose) -> HeldPeg:
    """The object as it is held with the TCP at that pose over the hole.

    It leans along the closing direction of the fingers, y of the TCP, as nearly as may be: there they hold it
    by their faces, not by friction. What has corners leans over one of them, so that a point goes first.
    """
    up = fit.hole_in_world.rotation()[:, 2]
    down: Array = fit.object_in_tcp.rotation().T @ tcp_in_world.rotation().T @ -up
    end = np.array([0.0, 0.0, math.copysign(fit.height / 2, float(down[2]))])
    foot = fit.object_in_tcp.apply(end)
    turn = fit.object_in_tcp.rotation()
    match fit.shape:
        case Box((x, y, _)):
            corners = [np.array([a * x / 2, b * y / 2, 0.0]) for a in (1, -1) for b in (1, -1)]
            # Over a corner its sides slope alike, however long they are.
            slopes = [turn @ (np.sign(c) / math.sqrt(2.0)) for c in corners]
            best = max(range(4), key=lambda k: (round(float(slopes[k][1]) / TOWARDS), k))
            return HeldPeg(foot, slopes[best], turn @ corners[best], False)
        case Cylinder(radius, _):
            lean = np.array([0.0, 1.0, 0.0])
            return HeldPeg(foot, lean, radius * lean, True)
        case _:
            lean = np.array([0.0, 1.0, 0.0])
            return HeldPeg(foot, lean, lean * float(extents(fit.shape, np.eye(3))[1][0]), True)


def mouth(fit: InsertionTask, depth: float, tip: float) -> BelievedHole:
    """What is believed of the hole. `depth`: how far into it the object is to go, m, at most to its bottom,
    or until the finger tips, `tip` m beyond the TCP, are over the surface: it falls the rest of the way."""
    low = fit.object_in_tcp.position[2] + fit.height / 2
    return BelievedHole(
        np.array(fit.hole_in_world.position),
        fit.hole_in_world.rotation()[:, 2],
        min(fit.hole.size),
        min(depth, fit.hole.depth, max(LEAST_DEPTH, low - tip - TIPS_OVER)),
        fit.uncertainty,
    )


def inserted_pose(fit: InsertionTask, tcp_in_world: Pose) -> Pose:
    """Where the object is believed to be when it was let go at that pose of the TCP: upright, on the
    bottom."""
    held = tcp_in_world @ fit.object_in_tcp
    local = fit.hole_in_world.inverse() @ held
    upright = np.array([0.0, 0.0, math.copysign(1.0, float(local.rotation()[2, 2]))])
    yaw = math.atan2(float(local.rotation()[1, 0]), float(local.rotation()[0, 0]))
    roll = 0.0 if upright[2] > 0 else math.pi
    x, y, _ = held.position
    floor = fit.hole_in_world.position[2] - fit.hole.depth
    placed = fit.hole_in_world @ Pose.from_rpy((0.0, 0.0, 0.0), (roll, 0.0, yaw))
    return Pose((x, y, floor + fit.height / 2), placed.orientation)
