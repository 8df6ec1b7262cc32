"""Following what is known: where a picture shows objects whose kind, and how they lie, is believed already.

Nothing has to be recognised, so a fit begins where the outline of the right colour is, with the believed face
down and the believed heading: it is sure from so near that half of an object's outline is its side face."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...world.belief.planning_scene import BeliefObject
from ...world.values import Array, ObjectId, Pose
from ..geometry.resting_poses import StablePose
from ..geometry.silhouette_fitting import StandingPose, polygon_area, silhouette
from ..segmentation.blobs import Blob, Pixels, SegmentationInput, connected_patches, label_of, outline_patch
from .item_fitting import Hypothesis, ItemFitter

STEP = 0.008
"""Depth of neighbouring pixels that differs by more than this is of two bodies, m."""
LEAST = 24
"""Fewer pixels than this are no body's."""
GROWTH = 6
"""Pixels by which the parts take back what was cut away between them."""
_SIDES = ((0, 1), (0, -1), (1, 0), (-1, 0))


def split_at_depth_steps(depth: Array, rows: Pixels, columns: Pixels) -> list[tuple[Pixels, Pixels]]:
    """Rows and columns of the parts of a patch; the patch itself where it has no step from side to side."""
    y, x = int(rows.min()) - 1, int(columns.min()) - 1
    size = (int(rows.max()) - y + 2, int(columns.max()) - x + 2)
    inside = np.zeros(size, dtype=np.bool_)
    inside[rows - y, columns - x] = True
    near = np.zeros(size)
    near[rows - y, columns - x] = depth[rows, columns]
    known = inside & (near > 0)
    stepped = np.zeros(size, dtype=np.bool_)
    for side in _SIDES:
        other, beside = np.roll(near, side, (0, 1)), np.roll(known, side, (0, 1))
        stepped |= known & beside & (np.abs(near - other) > STEP)
    cores = connected_patches(known & ~stepped, LEAST)
    if len(cores) < 2:
        return [(rows, columns)]
    owner = np.zeros(size, dtype=np.int32)
    for number, (core_rows, core_columns) in enumerate(cores, start=1):
        owner[core_rows, core_columns] = number
    for _ in range(GROWTH):
        owner = _grown(owner, near, inside)
    parts = [np.nonzero(owner == number) for number in range(1, len(cores) + 1)]
    return [(part_rows + y, part_columns + x) for part_rows, part_columns in parts]


def _grown(owner: NDArray[np.int32], depth: Array, inside: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Each free pixel joins the part beside it whose depth is nearest to its own."""
    grown, best = owner.copy(), np.full(owner.shape, np.inf)
    for side in _SIDES:
        part, other = np.roll(owner, side, (0, 1)), np.roll(depth, side, (0, 1))
        off = np.where((depth > 0) & (other > 0), np.abs(depth - other), STEP)
        joins = inside & (owner == 0) & (part > 0) & (off < best)
        grown[joins], best[joins] = part[joins], off[joins]
    return grown


REACH = 0.045
"""An object is looked for so far from where it is believed, m."""
"""Fewer pixels of its colour than this say nothing."""
ROUGH = 0.0012
"""What is added to the noise of a depth, m: from near it shows that round things are not quite round."""
ROUNDS = 8
"""Steps of a fit at most."""
TURNED = math.radians(20)
"""A heading that differs more than this from the believed one is another's."""
MISFIT = 3.0
"""A fit worse than this shows something else."""
SHOWN = 0.55
"""With less than this share of its silhouette in sight an object is not located."""
BESIDE = 0.3
"""How much more than the silhouette a patch may cover, as a share: more is two objects that touch."""
GRID = 2.5e-4
"""What the grid of pixels costs however many an outline has, m."""
FLAT = math.radians(12)
"""An object that leans more than this from every face of its kind is not followed."""


@dataclass(frozen=True, slots=True)
class TrackedSighting:
    """One patch that may be one object: where the object is if it is."""

    object: ObjectId
    patch: int
    """Number of the patch; the same for all objects that it may be."""
    pose: Pose
    """In the world."""
    sigma_position: float
    """m along each axis"""
    sigma_angle: float
    """rad about the vertical"""
    misfit: float
    """As of a `Hypothesis`; infinite for a patch of the right colour and place that the object does not
    fit."""
    shown: float
    """Share of the silhouette in sight."""


def track_objects(
    picture: SegmentationInput, fitter: ItemFitter, objects: Sequence[BeliefObject]
) -> tuple[TrackedSighting, ...]:
    """For each object all patches that it may be. Patches of its colour within reach that it does not fit are
    told, too: with an infinite misfit."""
    labels = {label_of(o.colour) for o in objects} - {0}
    usable = ~picture.blocked
    patches = [
        picture.claim(*part, label)
        for label in sorted(labels)
        for rows, columns in connected_patches(usable & (picture.label == label), LEAST)
        for part in split_at_depth_steps(picture.depth, rows, columns)
    ]
    blobs = {p.number: outline_patch(picture, p) for p in patches if p.measured >= 4}
    found: list[TrackedSighting] = []
    for one in objects:
        rest = _lies_on(fitter.rests, one)
        if rest is None:
            continue
        for number, blob in blobs.items():
            if blob.patch.label == label_of(one.colour) and _within(picture, blob, one):
                found.append(_sighted(picture, fitter, blob, one, rest, number))
    return tuple(found)


def _lies_on(rests: Sequence[StablePose], one: BeliefObject) -> StablePose | None:
    """The face on which it is believed to lie."""
    rotation = one.pose.rotation()
    leaning = [
        (float((rotation @ rest.rotation.T)[2, 2]), -n) for n, rest in enumerate(rests) if _is_of(rest, one)
    ]
    if not leaning:
        return None
    upright, n = max(leaning)
    return rests[-n] if upright > math.cos(FLAT) else None


def _is_of(rest: StablePose, one: BeliefObject) -> bool:
    return rest.entry.kind == one.kind


def _within(picture: SegmentationInput, blob: Blob, one: BeliefObject) -> bool:
    x, y = picture.sight.at_height(blob.middle, one.pose.position[2])
    return math.hypot(float(x) - one.pose.position[0], float(y) - one.pose.position[1]) < 2 * REACH


def _sighted(
    picture: SegmentationInput,
    fitter: ItemFitter,
    blob: Blob,
    one: BeliefObject,
    rest: StablePose,
    number: int,
) -> TrackedSighting:
    z = one.pose.position[2]
    heading = one.pose.rotation() @ rest.rotation.T
    yaw = math.atan2(float(heading[1, 0]), float(heading[0, 0]))
    at = picture.sight.at_height(blob.middle, z)
    stand = StandingPose(rest, np.array([at[0], at[1], z]), yaw)
    best = fitter.judged(blob, stand, ROUNDS)
    turned = abs(math.remainder(best.stand.yaw - yaw, 2 * math.pi)) if rest.turn else 0.0
    moved = math.dist(best.stand.centre[:2], one.pose.position[:2])
    fits = (
        best.misfit < MISFIT
        and best.shown > SHOWN
        and turned < TURNED
        and moved < REACH
        and not _two(picture, blob, best)
    )
    variance = best.covariance
    loose = math.sqrt(max(1.0, best.misfit)) / max(0.3, best.shown)
    pose = Pose.from_rotation(best.stand.centre, _turned(best.stand, one, yaw))
    return TrackedSighting(
        one.id,
        number,
        pose,
        math.sqrt(max(float(variance[0, 0]), float(variance[1, 1]))) * loose + GRID,
        math.pi if not rest.turn else min(math.pi, math.sqrt(float(variance[2, 2])) * loose + 2e-3),
        best.misfit if fits else math.inf,
        best.shown,
    )


def _two(picture: SegmentationInput, blob: Blob, best: Hypothesis) -> bool:
    """Whether the patch is too large for the object: another of its colour touches it."""
    whole = polygon_area(silhouette(picture.sight, best.stand))
    return blob.area > (1.0 + BESIDE) * whole


def _turned(stand: StandingPose, one: BeliefObject, yaw: float) -> Array:
    """Its orientation: as believed, turned about the vertical by what was seen. What has no heading keeps
    its."""
    rotation = one.pose.rotation()
    if not stand.rest.turn:
        return rotation
    c, s = math.cos(stand.yaw - yaw), math.sin(stand.yaw - yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ rotation, dtype=np.float64)
