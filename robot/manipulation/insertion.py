"""Geometry of an insertion: poses over the hole, the peg as it is held, its lean, and its place
afterwards."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...world.belief.hole_matching import find_hole, hole_clearance
from ...world.scene.description import Fixture, Hole
from ...world.shapes import Box, Cylinder, Shape, bottom, extents
from ...world.values import Array, Pose
from ..control.peg_motion import BelievedHole, HeldPeg

if TYPE_CHECKING:
    from ...world.belief.planning_scene import BeliefObject
    from ...world.robot_model.description import GripperDescription
    from ..world import World
    from .grasp_candidates import GraspCandidate

SEARCH_HEIGHT = 0.012
"""Height of the object's underside over the believed mouth where the search begins, m."""

ROUND_PEG_TURNS = 8
"""Rotations about its axis at which a round object is tried."""
MIN_DOWNWARD_COSINE = math.cos(math.radians(30.0))
"""Least downward part of the tool's axis, 1. With less, the fixture is in the way of the hand."""
FINE_CLEARANCE = 0.001
"""Clearance below which contacts need the finer step, m."""
MAX_HELD_OFFSET = 0.0015
"""Greatest error of an object's believed place in the hand, m."""
MIN_TIP_HEIGHT = 0.0015
"""Height of the finger tips over the surface at the end, m."""
MIN_INSERTION_DEPTH = 0.005
"""Least insertion depth, m."""
FINE_CONTACT_RATE, COARSE_CONTACT_RATE = 1000, 500
"""Control periods a second in contact, for holes with less and with more clearance than `FINE_CLEARANCE`."""
LEAN_TOLERANCE = 1e-3
"""Difference of lean along the fingers below which two corners are equal, 1."""


@dataclass(frozen=True, slots=True)
class InsertionTask:
    """Insertion task: a held object and its hole, as believed."""

    hole: Hole
    hole_in_world: Pose
    shape: Shape
    object_in_tcp: Pose
    slack: float
    """Least difference between hole and object, both sides together, m."""
    uncertainty: float
    """Greatest distance of the mouth from its believed place, m."""

    @property
    def rate(self) -> int:
        """Rate of physics and control in contact, Hz."""
        return FINE_CONTACT_RATE if self.slack < FINE_CLEARANCE - 1e-9 else COARSE_CONTACT_RATE

    @property
    def height(self) -> float:
        """Height of the object along its axis, m."""
        low, high = extents(self.shape, np.eye(3))
        return float(high[2] - low[2])

    def seen_at(self, hole_in_world: Pose, uncertainty: float) -> InsertionTask:
        """Return the task with the observed pose of the mouth."""
        return replace(self, hole_in_world=hole_in_world, uncertainty=uncertainty + MAX_HELD_OFFSET)


def fit(fixture: Fixture, hole: Hole, shape: Shape, object_in_tcp: Pose) -> InsertionTask:
    """Return the insertion task. The uncertainty covers the fixture's position, its rotation and the object
    in the hand."""
    left = hole_clearance(hole, shape)
    assert left is not None, "it was chosen because it fits"
    doubt = fixture.uncertainty
    arm = math.hypot(*hole.pose.position[:2])
    off = math.sqrt(2.0) * doubt.position + arm * doubt.angle + MAX_HELD_OFFSET
    return InsertionTask(hole, fixture.pose @ hole.pose, shape, object_in_tcp, min(left), off)


def poses_over(fit: InsertionTask, above: float) -> tuple[Pose, ...]:
    """Return TCP poses in the world, pointing down, with the upright object over the hole at each angle at
    which it fits.

    `above`: height of its underside over the mouth, m. Empty: no such pose exists for this grasp.
    """
    poses: list[Pose] = []
    for yaw in _turns(fit):
        for roll in (0.0, math.pi):
            upright = Pose.from_rpy((0.0, 0.0, fit.height / 2 + above), (roll, 0.0, yaw))
            tcp = fit.hole_in_world @ upright @ fit.object_in_tcp.inverse()
            if -float(tcp.rotation()[2, 2]) >= MIN_DOWNWARD_COSINE:
                poses.append(tcp)
    return tuple(poses)


def hover_poses(world: World, hole_id: str, shape: Shape, object_in_tcp: Pose) -> tuple[Pose, ...]:
    """Return `poses_over` for an object in this grasp, at the height where the search begins."""
    fixture, hole = find_hole(world.scene, hole_id)
    return poses_over(fit(fixture, hole, shape, object_in_tcp), SEARCH_HEIGHT)


def fingertips_too_low(
    hole: Hole, belief: BeliefObject, grasp: GraspCandidate, gripper: GripperDescription
) -> bool:
    """Return whether the finger tips of a grasp would meet the fixture before the object is down in the
    hole."""
    tips = grasp.tcp_in_world.position[2] - gripper.tip
    return tips - bottom(belief.shape, belief.pose) < hole.depth + MIN_TIP_HEIGHT


def _turns(fit: InsertionTask) -> Sequence[float]:
    match fit.shape:
        case Box((x, y, _)):
            square = fit.hole.form == "square" and abs(x - y) < 1e-6
            along = 0.0 if (x >= y) == (fit.hole.size[0] >= fit.hole.size[1]) else math.pi / 2
            step = math.pi / 2 if square else math.pi
            return [along + k * step for k in range(4 if square else 2)]
        case _:
            return [2 * math.pi * k / ROUND_PEG_TURNS for k in range(ROUND_PEG_TURNS)]


def peg(fit: InsertionTask, tcp_in_world: Pose) -> HeldPeg:
    """Return the held object as a peg, with the TCP at that pose over the hole.

    It leans, as nearly as possible, along the closing direction of the fingers, y of the TCP. There the
    fingers' faces hold it, not friction. A box leans over one of its corners, so that a point leads.
    """
    up = fit.hole_in_world.rotation()[:, 2]
    down: Array = fit.object_in_tcp.rotation().T @ tcp_in_world.rotation().T @ -up
    end = np.array([0.0, 0.0, math.copysign(fit.height / 2, float(down[2]))])
    foot = fit.object_in_tcp.apply(end)
    turn = fit.object_in_tcp.rotation()
    match fit.shape:
        case Box((x, y, _)):
            corners = [np.array([a * x / 2, b * y / 2, 0.0]) for a in (1, -1) for b in (1, -1)]
            # Over a corner the sides have equal slopes, whatever their length.
            slopes = [turn @ (np.sign(c) / math.sqrt(2.0)) for c in corners]
            best = max(range(4), key=lambda k: (round(float(slopes[k][1]) / LEAN_TOLERANCE), k))
            return HeldPeg(foot, slopes[best], turn @ corners[best], False)
        case Cylinder(radius, _):
            lean = np.array([0.0, 1.0, 0.0])
            return HeldPeg(foot, lean, radius * lean, True)
        case _:
            lean = np.array([0.0, 1.0, 0.0])
            return HeldPeg(foot, lean, lean * float(extents(fit.shape, np.eye(3))[1][0]), True)


def mouth(fit: InsertionTask, depth: float, tip: float) -> BelievedHole:
    """Return the believed hole.

    `depth`: wanted depth, m. It is limited to the hole's bottom, and to where the finger tips, `tip` m beyond
    the TCP, are over the surface. The object falls the rest of the way.
    """
    low = fit.object_in_tcp.position[2] + fit.height / 2
    return BelievedHole(
        np.array(fit.hole_in_world.position),
        fit.hole_in_world.rotation()[:, 2],
        min(fit.hole.size),
        min(depth, fit.hole.depth, max(MIN_INSERTION_DEPTH, low - tip - MIN_TIP_HEIGHT)),
        fit.uncertainty,
    )


def inserted_pose(fit: InsertionTask, tcp_in_world: Pose) -> Pose:
    """Return the believed pose of the object after its release at that TCP pose: upright, on the bottom."""
    held = tcp_in_world @ fit.object_in_tcp
    local = fit.hole_in_world.inverse() @ held
    upright = np.array([0.0, 0.0, math.copysign(1.0, float(local.rotation()[2, 2]))])
    yaw = math.atan2(float(local.rotation()[1, 0]), float(local.rotation()[0, 0]))
    roll = 0.0 if upright[2] > 0 else math.pi
    x, y, _ = held.position
    floor = fit.hole_in_world.position[2] - fit.hole.depth
    placed = fit.hole_in_world @ Pose.from_rpy((0.0, 0.0, 0.0), (roll, 0.0, yaw))
    return Pose((x, y, floor + fit.height / 2), placed.orientation)
