"""Detection of a calibration target's coloured squares in an image: which are seen whole, and their
centroids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.robot.perception import connected_patches, segmentation
from picktree.world import Array, Intrinsics, Pose, RgbdImage
from picktree.world.scene import TargetTile

from .observations import DetectedTile

MIN_TILE_AREA = 16
"""Minimum area of a square, pixels."""
OCCLUSION_MARGIN = 3
"""Width of the border around a square in which a nearer surface may hide a part of it, pixels."""
MIN_OCCLUSION_DEPTH = 0.03
"""Minimum depth by which a surface in front of a square may hide a part of it, m."""
DISTANCE_TOLERANCE = 0.02
"""Tolerance of measured distances between squares, m."""
MAX_OFFSET = 0.012
"""Maximum distance of a square from its place on the target, m."""
AREA_TOLERANCE = 0.15
"""Maximum relative difference between the seen area of a whole square and the area expected from its pose."""
MIN_TILES = 4
"""Minimum number of squares that identify a target."""


@dataclass(frozen=True, slots=True, eq=False)
class _Patch:
    index: int
    seen: DetectedTile
    point: Array
    """Position (3,) in the camera's optical frame, m."""


def detect_tiles(image: RgbdImage, tiles: Sequence[TargetTile]) -> tuple[DetectedTile, ...]:
    """Return the squares that are seen whole; empty when too few are seen to identify the target.

    Items may have the squares' colours: the distances between squares identify the target. A square next to a
    nearer surface, such as the fingers of the hand, counts as partly hidden.
    """
    label = segmentation.labels(image.colour)
    patches: list[_Patch] = []
    for index, tile in enumerate(tiles):
        patches += _patches(image, label, index, tile.colour)
    chosen = _consistent(patches, tiles)
    if len(chosen) < MIN_TILES:
        return ()
    places = np.array([tiles[patch.index].centre for patch in chosen])
    target = align_points(places, np.array([patch.point for patch in chosen]))
    whole = [p for p in chosen if _is_whole(p, tiles[p.index], target, image.intrinsics)]
    return tuple(patch.seen for patch in whole) if len(whole) >= MIN_TILES else ()


def average_tiles(pictures: Sequence[Sequence[DetectedTile]]) -> tuple[DetectedTile, ...]:
    """Return the squares that most of several images from one viewpoint show, averaged."""
    found: list[DetectedTile] = []
    for index in sorted({tile.index for seen in pictures for tile in seen}):
        same = [tile for seen in pictures for tile in seen if tile.index == index]
        if 2 * len(same) <= len(pictures):
            continue
        pixels = np.array([(*tile.pixel, *tile.depth_pixel) for tile in same]).mean(axis=0)
        u, v, at_u, at_v = (float(p) for p in pixels)
        inverse = float(np.mean([1.0 / tile.depth for tile in same]))
        sigma = float(np.sqrt(np.mean([tile.depth_sigma**2 for tile in same]) / len(same)))
        area = round(float(np.mean([tile.area for tile in same])))
        found.append(DetectedTile(index, (u, v), 1.0 / inverse, (at_u, at_v), sigma, area))
    return tuple(found) if len(found) >= MIN_TILES else ()


def _patches(image: RgbdImage, label: NDArray[np.uint8], index: int, colour: str) -> list[_Patch]:
    """Return the regions of that colour that neither the image border nor a nearer surface cuts off."""
    image_height, image_width = label.shape
    found: list[_Patch] = []
    for rows, columns in connected_patches(np.equal(label, segmentation.label_of(colour)), MIN_TILE_AREA):
        upper, left = int(rows.min()), int(columns.min())
        lower, right = int(rows.max()) + 1, int(columns.max()) + 1
        if min(upper, left) == 0 or lower == image_height or right == image_width:
            continue
        window = (
            slice(max(upper - OCCLUSION_MARGIN, 0), lower + OCCLUSION_MARGIN),
            slice(max(left - OCCLUSION_MARGIN, 0), right + OCCLUSION_MARGIN),
        )
        own = np.zeros(label[window].shape, dtype=np.uint8)
        own[rows - window[0].start, columns - window[1].start] = 1
        patch = _measured(image, own, (window[1].start, window[0].start), index)
        if patch is None:
            continue
        around = cv2.dilate(
            own, np.ones((2 * OCCLUSION_MARGIN + 1, 2 * OCCLUSION_MARGIN + 1), dtype=np.uint8)
        ).astype(np.bool_)
        depth = image.depth[window]
        if not (around & (depth > 0) & (depth < patch.seen.depth - MIN_OCCLUSION_DEPTH)).any():
            found.append(patch)
    return found


def _measured(image: RgbdImage, own: NDArray[np.uint8], corner: tuple[int, int], index: int) -> _Patch | None:
    """`own`: 1 where the patch is, in a window of the picture that begins at `corner` (u, v)."""
    rows, columns = np.nonzero(own)
    area = len(rows)
    u, v = float(columns.mean()) + corner[0], float(rows.mean()) + corner[1]
    inner = cv2.erode(own, np.ones((3, 3), dtype=np.uint8)).astype(np.bool_)
    rows, columns = np.nonzero(inner)
    depth = image.depth[rows + corner[1], columns + corner[0]].astype(np.float64)
    known = depth > 0
    if int(known.sum()) < MIN_TILE_AREA // 2:
        return None
    depth, rows, columns = depth[known], rows[known] + corner[1], columns[known] + corner[0]
    # A plane's inverse depth is linear in the pixels, so its mean belongs to their mean.
    inverse = 1.0 / depth
    off = np.abs(inverse - float(np.median(inverse)))
    near = off < 4.0 * max(1e-4, 1.5 * float(np.median(off)))
    inverse, rows, columns = inverse[near], rows[near], columns[near]
    z = float(1.0 / inverse.mean())
    at = (float(columns.mean()), float(rows.mean()))
    design = np.column_stack([np.ones(len(rows)), columns - at[0], rows - at[1]])
    scatter = inverse - design @ np.linalg.lstsq(design, inverse, rcond=None)[0]
    sigma = z * z * float(np.sqrt((scatter**2).sum() / max(1, len(rows) - 3) / len(rows)))
    i = image.intrinsics
    point = z * np.array([(u - i.cx) / i.fx, (v - i.cy) / i.fy, 1.0])
    return _Patch(index, DetectedTile(index, (u, v), z, at, sigma, area), point)


def _consistent(patches: list[_Patch], tiles: Sequence[TargetTile]) -> list[_Patch]:
    """Return the largest set of regions, at most one for each square, whose arrangement is that of the
    target."""
    places = np.array([tile.centre for tile in tiles])
    best: list[_Patch] = []
    for one, other in combinations(patches, 2):
        if not _apart(one, other, places):
            continue
        group = [one, other]
        for patch in patches:
            if all(patch.index != p.index and _apart(patch, p, places) for p in group):
                group.append(patch)
        if len(group) > len(best):
            best = group
    if len(best) < MIN_TILES:
        return []
    target = align_points(places[[p.index for p in best]], np.array([p.point for p in best]))
    return [p for p in best if float(np.linalg.norm(target.apply(places[p.index]) - p.point)) < MAX_OFFSET]


def _apart(one: _Patch, other: _Patch, places: Array) -> bool:
    if one.index == other.index:
        return False
    stated = float(np.linalg.norm(places[one.index] - places[other.index]))
    return abs(float(np.linalg.norm(one.point - other.point)) - stated) < DISTANCE_TOLERANCE


def _is_whole(patch: _Patch, tile: TargetTile, target_in_camera: Pose, intrinsics: Intrinsics) -> bool:
    """Whether the seen area agrees with the pose, give or take a row of pixels on the outline."""
    corners = target_in_camera.apply(tile.corners())
    pixels = corners[:, :2] / corners[:, 2:] * (intrinsics.fx, intrinsics.fy)
    expected = abs(area_and_centroid(pixels[None])[0][0])
    return abs(patch.seen.area - expected) < AREA_TOLERANCE * expected + 1.5 * np.sqrt(expected)


def area_and_centroid(polygons: Array) -> tuple[Array, Array]:
    """Return the signed areas (n,) and centroids (n, 2) of polygons (n, k, 2)."""
    # About a corner: far from the origin the products would cancel.
    origin = polygons[:, :1]
    here = polygons - origin
    there = np.roll(here, -1, axis=1)
    cross = here[..., 0] * there[..., 1] - here[..., 1] * there[..., 0]
    area = cross.sum(axis=1) / 2
    moment = ((here + there) * cross[..., None]).sum(axis=1)
    return area, origin[:, 0] + moment / (6 * area[:, None])


def align_points(places: Array, points: Array) -> Pose:
    """Return the pose that best maps points `places` (n, 3) of a body to `points` (n, 3). Kabsch (1976)."""
    middle, centre = places.mean(axis=0), points.mean(axis=0)
    u, _, vt = np.linalg.svd((points - centre).T @ (places - middle))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return Pose.from_rotation(centre - turn @ middle, turn)


def pixels_of(rays: Array, intrinsics: Intrinsics) -> Array:
    """Return the pixels (…, 2) of points (…, 3) in the camera's optical frame."""
    return rays[..., :2] / rays[..., 2:] * (intrinsics.fx, intrinsics.fy) + (intrinsics.cx, intrinsics.cy)
