"""Grasps: poses of the TCP from which a parallel gripper can close on an object from above.

The closing direction is the y axis of the TCP, z points down onto the object. Candidates come in two tiers:
first with room to spare, then tighter ones for dense scenes (less opening, beside the centre, higher). Before
a grasp the fingers open wider than it needs, where neighbours leave room. The hand is boxes in the view along
its approach, with dimensions from the robot's model.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from picktree.robot.planning import WORKSPACE_MARGIN
from picktree.world import (
    MIN_DIRECTION,
    Array,
    BeliefObject,
    Box,
    CompoundMesh,
    ConvexMesh,
    Cylinder,
    PadContacts,
    Pose,
    Sphere,
    corners,
    cross,
    extents,
    pad_contacts,
)
from picktree.world.robot_model import GripperDescription, fingers_of

if TYPE_CHECKING:
    from picktree.robot.planning import SceneQueries


@dataclass(frozen=True, slots=True)
class Block:
    """Box of the hand in the view along its approach. x lies across the pads, y along their motion, m."""

    half_x: float
    inner: float
    outer: float
    """Sides along y, beyond the pad's face for a finger, or from the middle of the hand."""
    above: float
    """Height of its underside above the finger tips."""


@dataclass(frozen=True, slots=True)
class HandShape:
    """Hand in the view along its approach."""

    tip: float
    """Reach of the finger tips beyond the TCP, m."""
    max_width: float
    fingers: tuple[Block, ...]
    """Parts of one finger, from the pad's face outwards."""
    palm: tuple[Block, ...]

    @classmethod
    def of(cls, gripper: GripperDescription) -> HandShape:
        pad, pad_in_link = gripper.pads[0]
        fingers = [Block(pad.size[0] / 2, 0.0, pad.size[1], 0.0)]
        face = abs(pad_in_link.position[1]) - pad.size[1] / 2
        for box, in_link in gripper.bodies_of(0):
            middle = abs(in_link.position[1]) - face
            end = pad_in_link.position[2] + pad.size[2] / 2
            above = end - in_link.position[2] - box.size[2] / 2
            half = box.size[1] / 2
            fingers.append(Block(box.size[0] / 2, middle - half, middle + half, max(0.0, above)))
        palm = [
            Block(
                box.size[0] / 2 + abs(pose.position[0]),
                0.0,
                box.size[1] / 2 + abs(pose.position[1]),
                gripper.tip - pose.position[2] - box.size[2] / 2,
            )
            for box, pose in gripper.hand
        ]
        return cls(gripper.tip, gripper.max_width, tuple(fingers), tuple(palm))


def contacts_at(
    mesh: CompoundMesh, mesh_in_tcp: Pose, gripper: GripperDescription, opening: float
) -> PadContacts | None:
    """Return where the gripper's pads that close from an opening, m, meet a body; None: nothing is between
    them."""
    width, _, height = gripper.pads[0][0].size
    return pad_contacts(mesh, mesh_in_tcp, opening, width / 2, (gripper.tip - height, gripper.tip))


ROOMY_EXCESS, TIGHT_EXCESS = 0.020, 0.010
"""Greatest and least excess of the opening over the object's width, m, for the two tiers."""
MIN_SPARE_OPENING = 0.6 * TIGHT_EXCESS
"""Least excess of the full opening over the width of an object that is grasped with it, m."""
NEIGHBOUR_MARGIN = {ROOMY_EXCESS: 0.003, TIGHT_EXCESS: 0.001}
"""Free distance demanded between the open hand and everything else, m."""
TIP_CLEARANCE = 0.002
"""Clearance of the finger tips above the object's support, m."""
PALM_CLEARANCE = 0.006
"""Clearance of the palm above the object, m."""
MAX_FLAT_HEIGHT = 0.014
"""Height of an object below which the hand descends until contact, m."""
SLIDE_SHARES = (0.0, 0.25, -0.25)
"""Places along the object's free axis, as shares of its length beyond one finger width."""
SECOND_GRASP_RISE = 0.010
"""Height of the second grasp above the best one, m."""
MIN_UPRIGHT_COSINE = 0.98
"""Least cosine of the angle between a cylinder's axis and the vertical for an upright cylinder."""
LEAN_ANGLES, LEAN_SCORE = tuple(map(math.radians, (15.0, 30.0, 45.0))), 2.0
"""Leans of the hand where it does not fit upright, rad, and their score for each radian."""
GRASP_YAWS, LEANING_YAWS = 8, 16
"""Closing directions for an object without a preferred one, over half a turn: upright, leaning."""
WALL_CLEARANCE, OPEN_SHARE = 0.02, 0.75
"""Clearance of the finger tips above walls at the pre-grasp, m, along the hand's way. Share of the way above
walls within which a path may cut the corner."""


@dataclass(frozen=True, slots=True)
class GraspCandidate:
    """Grasp candidate: TCP pose at closing, opening before, expected width after."""

    name: str
    tcp_in_world: Pose
    opening: float
    """Opening between the pads during the descent, m."""
    expected_width: float
    """Width of the object along the closing direction, m."""
    margin: float
    """Least clearance around the open hand, m."""
    flat: bool
    """Whether the descent ends by contact, not by position."""
    score: float
    """Score of the candidate; lower is better."""
    tilted: bool = False
    """Whether the hand comes along its own axis instead of straight down."""
    enclosed: float = 0.0
    """Last part of the straight way to the grasp that lies between walls around the object, m."""
    narrow: bool = False
    """Whether a finger may come down on the object when its place is wrong by some mm."""

    def pre_grasp(self, height: float) -> Pose:
        """Return the TCP pose in the world from which the hand comes straight, at least `height` m before the
        grasp, and above the walls."""
        return self.before(max(height, self.enclosed + WALL_CLEARANCE if self.enclosed else 0.0))

    def before(self, distance: float) -> Pose:
        """Return the TCP pose in the world on the straight way, `distance` m before the grasp."""
        if self.tilted:
            return self.tcp_in_world @ Pose((0.0, 0.0, -distance))
        return self.tcp_in_world.shifted((0.0, 0.0, distance))

    def rounded(self, height: float, most: float) -> float:
        """Return the length of the way, at most `most` m, within which a path may cut the corner at the
        pre-grasp.

        No part of it lies between walls. `height` as for `pre_grasp`.
        """
        if not self.enclosed:
            return most
        return min(most, max(height - self.enclosed, WALL_CLEARANCE) * OPEN_SHARE)


@dataclass(frozen=True, slots=True)
class _Span:
    """A closing direction: yaw of the TCP's y axis, width along it, free length across it."""

    yaw: float
    width: float
    length: float


def grasp_candidates(
    belief: BeliefObject, gripper: GripperDescription, yaws: int = GRASP_YAWS
) -> list[GraspCandidate]:
    """Return the grasp candidates of the object, best first; empty when it is wider than the gripper opens.

    `yaws`: closing directions of an object without a preferred one.
    """
    rotation = belief.pose.rotation()
    low, high = extents(belief.shape, rotation)
    x, y, z = belief.pose.position
    bottom, top = z + float(low[2]), z + float(high[2])
    height = top - bottom
    lowest = bottom + gripper.tip + TIP_CLEARANCE
    best_z = max(z, lowest, top - gripper.palm + PALM_CLEARANCE)
    heights = [best_z]
    if best_z + SECOND_GRASP_RISE < top - 0.004:
        heights.append(best_z + SECOND_GRASP_RISE)
    finger = gripper.pads[0][0].size[0]

    found: list[GraspCandidate] = []
    for span in _spans(belief, rotation, yaws):
        slack = max(0.0, span.length - finger)
        for tier, opening in _openings(span.width, gripper.max_width):
            for slide in SLIDE_SHARES if slack > 0.02 else SLIDE_SHARES[:1]:
                along = np.array([math.sin(span.yaw), -math.cos(span.yaw)]) * slide * slack
                place = x + float(along[0]), y + float(along[1])
                score = span.width * 4 + (0.5 if tier == TIGHT_EXCESS else 0.0) + abs(slide)
                for (k, tcp_z), turn in itertools.product(enumerate(heights), (0.0, math.pi)):
                    yaw = span.yaw + turn
                    found.append(
                        GraspCandidate(
                            name=f"yaw {math.degrees(yaw):.0f} width {opening * 1000:.0f} "
                            f"slide {slide:+.2f} high {k}",
                            tcp_in_world=_from_above((*place, tcp_z), yaw),
                            opening=opening,
                            expected_width=span.width,
                            margin=NEIGHBOUR_MARGIN[tier],
                            flat=height < MAX_FLAT_HEIGHT,
                            score=score + 0.3 * k,
                        )
                    )
    return sorted(found, key=lambda c: (c.score, c.name))


def leaning_grasps(belief: BeliefObject, gripper: GripperDescription) -> list[GraspCandidate]:
    """Return the grasps with the hand leaning about its closing direction, to either side, best first.

    The pads stay flat on the object, and the palm comes away from a wall beside it. A flat object has none.
    """
    rotation, centre = belief.pose.rotation(), np.array(belief.pose.position)
    low, high = extents(belief.shape, rotation)
    bottom, top = centre[2] + low[2], centre[2] + high[2]
    edge = gripper.pads[0][0].size[0] / 2
    found: list[GraspCandidate] = []
    for grasp, most, side in itertools.product(
        grasp_candidates(belief, gripper, LEANING_YAWS), LEAN_ANGLES, (1, -1)
    ):
        lean, reach = side * most, gripper.tip * math.cos(most) + edge * math.sin(most)
        tcp = grasp.tcp_in_world @ Pose.from_rpy((0.0, 0.0, 0.0), (0.0, lean, 0.0))
        turned = tcp.rotation()
        before_palm = float(extents(belief.shape, turned.T @ rotation)[0][2])
        before_palm += float(turned[:, 2] @ (centre - tcp.position)) + gripper.palm - PALM_CLEARANCE
        rise = max(bottom + reach + TIP_CLEARANCE - tcp.position[2], -before_palm / math.cos(most), 0.0)
        if not grasp.flat and tcp.position[2] + rise < top:
            name, tcp = f"{grasp.name} lean {math.degrees(lean):+.0f}", tcp.shifted((0.0, 0.0, float(rise)))
            score = grasp.score + LEAN_SCORE * most
            found.append(replace(grasp, name=name, tcp_in_world=tcp, score=score, tilted=True))
    return sorted(found, key=lambda c: (c.score, c.name))


def distinct_grasps(grasps: Iterable[GraspCandidate]) -> list[GraspCandidate]:
    """Return the first of each two grasps for which the hand looks the same after half a turn."""
    found: dict[tuple[float, ...], GraspCandidate] = {}
    for grasp in grasps:
        turn = grasp.tcp_in_world.rotation()[:2, 1]
        key = (
            *(round(c, 4) for c in (*grasp.tcp_in_world.position, grasp.opening)),
            round(abs(float(turn[0])), 3),
            round(float(turn[0] * turn[1]), 3),
        )
        found.setdefault(key, grasp)
    return list(found.values())


def _openings(width: float, max_width: float) -> Iterator[tuple[float, float]]:
    """Yield tiers with their openings, m; a gripper that opens less has one, unless it is too tight."""
    for tier in (ROOMY_EXCESS, TIGHT_EXCESS):
        if width + tier <= max_width:
            yield tier, width + tier
        elif tier == ROOMY_EXCESS and max_width - width >= MIN_SPARE_OPENING:
            yield tier, max_width


def _from_above(position: tuple[float, float, float], yaw: float) -> Pose:
    """Return the TCP pose with z down and its y axis at `yaw` from the world's x axis, rad."""
    closing = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    down = np.array([0.0, 0.0, -1.0])
    rotation = np.column_stack([cross(closing, down), closing, down])
    return Pose.from_rotation(position, rotation)


def _spans(belief: BeliefObject, rotation: Array, yaws: int) -> list[_Span]:
    match belief.shape:
        case Box(size):
            return _box_spans(size, rotation)
        case Cylinder(radius, height):
            axis = rotation[:, 2]
            if abs(float(axis[2])) > MIN_UPRIGHT_COSINE:
                return _round_spans(2 * radius, belief.pose, yaws)
            # Lying or leaning: across the axis.
            yaw = math.atan2(float(axis[1]), float(axis[0])) + math.pi / 2
            return [_Span(yaw, 2 * radius, height * math.hypot(float(axis[0]), float(axis[1])))]
        case Sphere(radius):
            return _round_spans(2 * radius, belief.pose, yaws)
        case ConvexMesh():
            return _hull_spans(belief.shape, belief.pose, yaws)


def _round_spans(width: float, pose: Pose, yaws: int) -> list[_Span]:
    """Return equal closing directions; the one across the line from the robot's base comes first."""
    first = math.atan2(pose.position[1], pose.position[0]) + math.pi / 2
    return [_Span(first + k * math.pi / yaws, width + 1e-4 * min(k, yaws - k), 0.0) for k in range(yaws)]


def _box_spans(size: tuple[float, float, float], rotation: Array) -> list[_Span]:
    """Return the two pairs of upright faces of a box that rests, nearly, on a face."""
    up = int(np.argmax(np.abs(rotation[2])))
    a, b = (k for k in range(3) if k != up)
    spans: list[_Span] = []
    for closing, free in ((a, b), (b, a)):
        direction = rotation[:, closing]
        yaw = math.atan2(float(direction[1]), float(direction[0]))
        spans.append(_Span(yaw, size[closing], size[free]))
    return spans


MIN_EDGE = 0.008
"""Length of an outline's edge from which a pad lies flat on it, m."""
NARROWING_TURN = math.radians(20.0)
"""Turn of the hand after which a body must not be much narrower, rad: else closing pads turn it."""
MAX_NARROWING = 5e-4
"""Greatest decrease of a body's width after that turn, m: that of fine facets."""
ROUND_EXCESS = 1e-3
"""Greatest difference of the widths of a round outline, m."""


def _hull_spans(shape: ConvexMesh, pose: Pose, yaws: int) -> list[_Span]:
    """Return directions across which an upright hull's outline is steady, narrow ones first (rotating
    calipers).

    Pads lie flat on long edges. On short ones, as those of a round mesh, they hold where turned pads would
    not come nearer to each other.
    """
    outline = _outline(shape, pose)
    widths = np.array([_width(outline, k * math.pi / 36) for k in range(36)])
    if float(np.ptp(widths)) < ROUND_EXCESS:
        return _round_spans(float(widths.max()), pose, yaws)
    spans: list[_Span] = []
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        edge = end - start
        length = float(np.linalg.norm(edge))
        if length < MIN_DIRECTION:
            continue
        yaw = math.atan2(float(edge[0]), float(-edge[1])) % math.pi
        width = _width(outline, yaw)
        if length < MIN_EDGE and any(
            _width(outline, yaw + turn) < width - MAX_NARROWING for turn in (-NARROWING_TURN, NARROWING_TURN)
        ):
            continue
        if all(abs(yaw - s.yaw) > 0.05 for s in spans):
            spans.append(_Span(yaw, width, length))
    return sorted(spans, key=lambda s: s.width)[:4]


def heading_of(shape: ConvexMesh, pose: Pose) -> float:
    """Return the direction in the world of the longest edge of a hull's outline from above, rad."""
    outline = _outline(shape, pose)
    edges = np.roll(outline, -1, axis=0) - outline
    x, y = edges[int(np.argmax((edges**2).sum(axis=1)))]
    return math.atan2(float(y), float(x))


def _outline(shape: ConvexMesh, pose: Pose) -> Array:
    """Return the corners (k, 2) of a hull's outline from above, about its centre, m."""
    import cv2

    points = (corners(shape) @ pose.rotation().T)[:, :2].astype(np.float32)
    return cv2.convexHull(points)[:, 0, :].astype(np.float64)


def _width(outline: Array, yaw: float) -> float:
    """Return the width of an outline (k, 2) along a direction, m."""
    reach = outline @ np.array([math.cos(yaw), math.sin(yaw)])
    return float(reach.max() - reach.min())


WIDE_EXCESSES = (0.036, 0.028)
"""Excesses of the opening over the object's width, m, the widest first. A finger comes down next to an object
whose place is wrong by up to half of the excess. A camera mounted 8 mm beside its believed place, along both
axes of the table, moves objects by 11 mm."""
MIN_TIP_REACH = WORKSPACE_MARGIN + 0.002
"""Least reach of the finger tips beyond the TCP beside a flat object, m. The tips meet the support of the
object before the TCP reaches the edge of the workspace, which may be at the same height."""
OUTER_ROOM = 0.007
"""Distance beyond the margin that each finger of a wider hand keeps from bodies outside of it, m."""


def widened(
    queries: SceneQueries, belief: BeliefObject, grasp: GraspCandidate, gripper: GripperDescription
) -> GraspCandidate:
    """Return the grasp of an object with the fingers opened further, as far as other bodies allow.

    The wider hand keeps the margin of the grasp, and `OUTER_ROOM` more outside of its fingers. Otherwise a
    finger would only come nearer to a neighbour than to the object. Hinged fingers retract their tips as they
    open: beside a flat object these stay ahead of the TCP. Without room the grasp is `narrow`. The grasps of
    a heap, and of a body that is not convex, do not change: a map shows where the fingers fit.
    """
    if belief.role == "heap" or isinstance(belief.shape, CompoundMesh):
        return grasp
    for excess in WIDE_EXCESSES:
        opening = min(grasp.expected_width + excess, gripper.max_width)
        if opening < grasp.expected_width + WIDE_EXCESSES[-1]:
            break
        if grasp.flat and fingers_of(gripper).reach(opening) < MIN_TIP_REACH:
            continue
        if not any(
            queries.hand_contacts(grasp.tcp_in_world, width, (belief.id,), grasp.margin)
            for width in (opening, opening + 2 * OUTER_ROOM)
        ):
            return replace(grasp, opening=opening)
    return replace(grasp, narrow=True)
