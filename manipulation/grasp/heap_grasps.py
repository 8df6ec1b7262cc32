"""Grasps of things in a heap, from its height map alone: no shape, no catalogue, no random numbers.

The hand is swept over the map by dilation, for each approach and twelve yaws: finger tips, finger bodies and
palm give the lowest height that the hand reaches at each cell. Profiles between the pads rank what is left.
The search over a depth map is that of Height Accumulated Features and Dex-Net's baselines; see docs/heaps.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...robots.description import GripperDescription
from ...world.belief.height_map import BARRED_RADIUS, Heap, HeightMap
from ...world.values import Array, Pose, cross
from .grasp_candidates import GraspCandidate

YAWS = 12
"""Closing directions over half a turn."""
OPENING_SHARES = (1.0, 0.75, 0.5, 0.32)
"""Openings of the search as shares of the gripper's greatest one."""
TIP_CLEARANCE = 0.002
"""Clearance of the finger tips above what lies below them, m."""
SIDE_CLEARANCE = 0.0015
"""Clearance at the sides of a finger, m."""
PALM_CLEARANCE = 0.005
"""Clearance below and beside the palm, m."""
MIN_OVERLAP = 0.0075
"""Least height of the pads that lies beside the thing, m."""
USEFUL_OVERLAP = 0.020
"""Overlap of the pads from which on more is no better, m."""
CONTACT_LEVEL, DEEP_LEVEL = 0.003, 0.009
"""Heights above the finger tips at which the sides of a thing are compared, m."""
SAME_CONTACT = 0.003
"""Distance of a row's side from the outermost one up to which the pad touches it, m."""
MAX_EXTRA_OPENING = 0.016
"""Greatest distance of a pad from the thing before the fingers close, m."""
KEPT_PER_SWEEP = 28
"""Number of places that are profiled for each yaw and opening."""
BLOCK = 4
"""Edge length of the blocks of cells of which the best cell is kept."""
PROFILE_ROWS, PROFILE_REACH = 5, 34
"""Half-size of a profile, cells: across the pads, and along the closing direction."""
AXIS_REACH = 20
"""Cells before and behind the pads in which the thing's middle is searched."""
FAR_BELOW = np.float32(-1.0)
"""Height of what is outside of the map, m: other checks are made there."""
MAX_CANDIDATES = 120
"""Greatest number of candidates of one call."""

Heights = NDArray[np.float32]
Cells = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Tier:
    """Demands on the profile of a grasp."""

    overlap: float
    """Least overlap of the pads, m."""
    rows: int
    """Least number of rows, of nine, that each pad touches."""
    slope: float
    """Greatest slope of the sides, as distance over height."""
    skew: float
    """Greatest turn of the sides against the pads, as distance over length."""
    room: float
    """Least distance of the open pads from the thing, m."""
    solid: float
    """Least share of the cells between the pads that the thing fills."""


STRICT = Tier(0.010, 5, 0.45, 0.40, 0.004, 0.85)
LOOSE = Tier(0.0075, 3, 1.0, 0.75, 0.002, 0.60)


@dataclass(frozen=True, slots=True)
class Approach:
    """Group of approach directions that are tried together."""

    tilt: float
    """Angle from the vertical, rad."""
    azimuths: int
    """Number of directions into which the hand is tilted."""
    tier: Tier
    name: str


VERTICAL = (Approach(0.0, 1, STRICT, "vertical"),)
TILTED = (Approach(math.radians(25.0), 8, STRICT, "tilted"),)
FALLBACK = (
    Approach(0.0, 1, LOOSE, "vertical loose"),
    Approach(math.radians(25.0), 8, LOOSE, "tilted loose"),
)
LAST_RESORT = (
    Approach(math.radians(20.0), 8, LOOSE, "tilted loose"),
    Approach(math.radians(40.0), 8, LOOSE, "tilted loose"),
)
STAGES: tuple[tuple[Approach, ...], ...] = (VERTICAL, TILTED, FALLBACK, LAST_RESORT)
"""Groups of approaches, from the surest on: the next one is tried when no grasp of the last is left."""


@dataclass(frozen=True, slots=True)
class HandShape:
    """Hand as seen along its approach: boxes about the TCP, m. x across the pads, y the closing direction."""

    tip: float
    """Reach of the finger tips beyond the TCP."""
    max_width: float
    pad: tuple[float, float]
    """Half-length along x and thickness along y of a finger at its pad."""
    body: tuple[float, float, float, float]
    """Finger behind the pad: half-length along x, inner and outer side beyond the pad's face, and height above
    the tip."""
    palm: tuple[tuple[float, float, float], ...]
    """Boxes of the hand: half-lengths along x and y, and height above the tip."""

    @classmethod
    def of(cls, gripper: GripperDescription) -> HandShape:
        pad, pad_in_link = gripper.pads[0]
        palm = tuple(
            (box.size[0] / 2, box.size[1] / 2, gripper.tip - pose.position[2] - box.size[2] / 2)
            for box, pose in gripper.hand
        )
        palm = tuple((x, y, gripper.tip - (z + _.size[2] / 2)) for (x, y, _z), (_, (_, _, z)) in zip(
            palm, ((box, pose.position) for box, pose in gripper.hand), strict=True
        ))
        body = (pad.size[0] / 2, 0.0, pad.size[1], pad.size[2])
        if gripper.finger_bodies:
            box, in_link = gripper.finger_bodies[0]
            face = abs(pad_in_link.position[1]) - pad.size[1] / 2
            middle = abs(in_link.position[1]) - face
            above = pad_in_link.position[2] + pad.size[2] / 2 - in_link.position[2] - box.size[2] / 2
            body = (box.size[0] / 2, middle - box.size[1] / 2, middle + box.size[1] / 2, above)
        return cls(gripper.tip, gripper.max_width, (pad.size[0] / 2, pad.size[1]), body, palm)
