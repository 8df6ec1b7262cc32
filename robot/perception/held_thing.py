"""Thing in the hand, as one picture of a fixed camera shows it: its points, colours and tags."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.world import Array

from . import segmentation
from .camera_geometry import PosedCamera
from .robot_mask import RobotMask
from .tag_reading import read_tags

HELD_REACH = 0.13
"""Distance from the TCP up to which points belong to the thing in the hand, m."""
HAND_MARGIN = 0.006
"""Distance from the hand's model up to which points belong to the hand, m."""
MIN_HELD_PIXELS = 30
"""Least number of pixels of a patch of the thing."""


@dataclass(frozen=True, slots=True, eq=False)
class HeldView:
    """Points of a thing in the hand that one picture shows."""

    points: Array
    """Points (n, 3) in the TCP frame, m."""
    areas: Array
    """Area (n,) of the pixel of each point, across the line of sight, m²."""
    labels: NDArray[np.uint8]
    """Label (n,) of the colour of each point; 0: no colour."""
    patches: NDArray[np.intp]
    """Number (n,) of the connected patch of each point."""
    tags: tuple[int, ...] = ()
    """Numbers of the ArUco tags that were read on it."""
    cut: bool = False
    """Whether the picture's border cuts through it."""


def view_held_thing(
    sight: PosedCamera,
    depth: Array,
    colour: NDArray[np.uint8],
    robot: RobotMask,
    hand: tuple[Array, float],
    *,
    tagged: bool,
) -> HeldView:
    """Return the thing in the hand as a picture shows it. Points of the hand and those far from it are left
    out.

    `depth` (h, w) is in m, 0 for the background and where it is not known. `hand`: the arm's joints (n,) rad,
    and the opening of the fingers, m. `tagged`: whether tags are looked for.
    """
    joints, width = hand
    tcp = robot.tcp(joints)
    rows, columns = np.nonzero(depth > 0)
    pixels = np.column_stack([columns, rows]).astype(np.float64)
    seen = depth[rows, columns]
    points = sight.origin + sight.directions(pixels) * seen[:, None]
    kept = np.linalg.norm(points - np.array(tcp.position), axis=1) < HELD_REACH
    rows, columns, seen, points = rows[kept], columns[kept], seen[kept], points[kept]
    own = ~robot.within(points, joints, width, None, HAND_MARGIN)
    mask = np.zeros(depth.shape, dtype=np.uint8)
    mask[rows[own], columns[own]] = 1
    mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)), dtype=np.uint8)
    patches = np.zeros(depth.shape, dtype=np.intp)
    for number, patch in enumerate(segmentation.connected_patches(mask.astype(np.bool_), MIN_HELD_PIXELS), 1):
        patches[patch] = number
    found = patches[rows, columns]
    thing = found > 0
    rows, columns = rows[thing], columns[thing]
    h, w = depth.shape
    i = sight.intrinsics
    border = (rows <= 1) | (rows >= h - 2) | (columns <= 1) | (columns >= w - 2)
    return HeldView(
        tcp.inverse().apply(points[thing]),
        seen[thing] ** 2 / (i.fx * i.fy),
        segmentation.labels(colour)[rows, columns],
        found[thing],
        _tags_on(sight, depth, colour, patches, np.array(tcp.position)) if tagged else (),
        bool(border.any()),
    )


def _tags_on(
    sight: PosedCamera, depth: Array, colour: NDArray[np.uint8], patches: NDArray[np.intp], hand: Array
) -> tuple[int, ...]:
    """Return the numbers of the tags near the hand (3,), sorted.

    They are looked for in the part of the picture that has patches (h, w).
    """
    left, upper, wide, high = (int(n) for n in cv2.boundingRect((patches > 0).astype(np.uint8)))
    if wide == 0:
        return ()
    window = (slice(upper, upper + high), slice(left, left + wide))
    tags = read_tags(sight, depth[window], np.ascontiguousarray(colour[window]), (left, upper))
    return tuple(sorted({number for number, at in tags if np.linalg.norm(at - hand) < HELD_REACH}))
