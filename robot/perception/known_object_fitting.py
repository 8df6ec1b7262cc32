"""Known object fitting: locates objects in a picture whose kind and stable pose are believed already.

Nothing has to be recognised. A fit begins where the outline of the correct colour is, with the believed face
down and the believed heading. It is reliable even from so near that half of an object's outline is its side
face.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.world import Array, BeliefObject, ObjectId, Pose, world_facts

from .backdrop import SupportSurface
from .item_fitting import (
    GOOD_MISFIT,
    MAX_PARTS,
    OUTSIDE_COST,
    POOR_MISFIT,
    POOR_MISFIT_IN_BIN,
    Hypothesis,
    ItemFitter,
    is_clear,
    item_costs,
)
from .resting_poses import StablePose, covered_area
from .segmentation import (
    Blob,
    PixelPatch,
    Pixels,
    SegmentationInput,
    connected_patches,
    label_of,
    outline_patch,
)
from .silhouette_fitting import StandingPose, silhouette

DEPTH_STEP = 0.008
"""Difference in depth of neighbouring pixels from which they belong to two bodies, m."""
MIN_BODY_PIXELS = 24
"""Least number of pixels of a body."""
PART_GROWTH_PIXELS = 6
"""Number of pixels by which the parts grow back into the cut between them."""
_SIDES = ((0, 1), (0, -1), (1, 0), (-1, 0))


def split_at_depth_steps(depth: Array, rows: Pixels, columns: Pixels) -> list[tuple[Pixels, Pixels]]:
    """Return rows and columns of the parts of a patch. A patch that no step in depth divides is returned
    whole."""
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
        stepped |= known & beside & (np.abs(near - other) > DEPTH_STEP)
    cores = connected_patches(known & ~stepped, MIN_BODY_PIXELS)
    if len(cores) < 2:
        return [(rows, columns)]
    owner = np.zeros(size, dtype=np.int32)
    for number, (core_rows, core_columns) in enumerate(cores, start=1):
        owner[core_rows, core_columns] = number
    for _ in range(PART_GROWTH_PIXELS):
        owner = _grow_parts(owner, near, inside)
    parts = [np.nonzero(owner == number) for number in range(1, len(cores) + 1)]
    return [(part_rows + y, part_columns + x) for part_rows, part_columns in parts]


def _grow_parts(owner: NDArray[np.int32], depth: Array, inside: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Join each free pixel to the neighbouring part whose depth is nearest to its own."""
    grown, best = owner.copy(), np.full(owner.shape, np.inf)
    for side in _SIDES:
        part, other = np.roll(owner, side, (0, 1)), np.roll(depth, side, (0, 1))
        off = np.where((depth > 0) & (other > 0), np.abs(depth - other), DEPTH_STEP)
        joins = inside & (owner == 0) & (part > 0) & (off < best)
        grown[joins], best[joins] = part[joins], off[joins]
    return grown


TRACKING_REACH = 0.045
"""Greatest distance from its believed place at which an object is located, m."""
NEAR_DEPTH_SIGMA = 0.0012
"""Part of the depth's standard deviation in pictures from near, m: round items are not quite round there."""
MAX_FIT_ROUNDS = 8
"""Greatest number of steps of a fit."""
MAX_HEADING_CHANGE = math.radians(20)
"""Greatest difference from the believed heading, rad. Beyond it the patch is another object."""
MAX_TRACKING_MISFIT = 3.0
"""Greatest misfit; a worse fit shows something else."""
MIN_TRACKING_SHOWN = 0.55
"""Least share of its silhouette in sight at which an object is located."""
MAX_EXCESS_AREA = 0.3
"""Greatest area of a patch beyond the silhouette, as a share of it. A larger patch is two touching
objects."""
PIXEL_GRID_ERROR = 2.5e-4
"""Error of a position from the pixel grid, m. More outline points do not reduce it."""
MAX_LEAN = math.radians(12)
"""Greatest lean from every stable pose of its kind at which an object is located, rad."""


@dataclass(frozen=True, slots=True)
class TrackedSighting:
    """One patch that may be one object, with the pose that the object then has."""

    object: ObjectId
    patch: int
    """Number of the patch; the same for all objects that it may be."""
    pose: Pose
    """Pose in the world."""
    sigma_position: float
    """Standard deviation of the position along each axis, m."""
    sigma_angle: float
    """Standard deviation of the angle about the vertical, rad."""
    misfit: float
    """Misfit as in `Hypothesis`; inf for a patch of matching colour and place that the object does not
    fit."""
    shown: float
    """Share of the silhouette in sight."""


def track_objects(
    picture: SegmentationInput, fitter: ItemFitter, objects: Sequence[BeliefObject]
) -> tuple[TrackedSighting, ...]:
    """Return for each object all patches that it may be.

    Patches of its colour within reach that it does not fit are included, with a misfit of inf.
    """
    labels = {label_of(o.colour) for o in objects} - {0}
    usable = ~picture.blocked
    patches = [
        picture.claim(*part, label)
        for label in sorted(labels)
        for rows, columns in connected_patches(usable & (picture.label == label), MIN_BODY_PIXELS)
        for part in split_at_depth_steps(picture.depth, rows, columns)
    ]
    blobs = {p.number: outline_patch(picture, p) for p in patches if p.measured >= 4}
    found: list[TrackedSighting] = []
    for one in objects:
        believed = standing_pose(fitter.rests, one.kind, one.pose)
        if believed is None:
            continue
        for number, blob in blobs.items():
            if blob.patch.label == label_of(one.colour) and _is_within_reach(picture, blob, one):
                found.append(_sighting(picture, fitter, blob, one, believed, number))
    return tuple(found)


MAX_KNOWN_DISTANCE = 0.01
"""Greatest distance from its believed pose at which a known object is confirmed, m. A fit that starts so near
converges."""
SUPPORTED_TOLERANCE = 5e-4
"""Distance from its support below which an object is believed to rest on it, m."""
MIN_KNOWN_CONFIDENCE = 0.6
"""Least believed confidence of a known object that needs a good fit."""
UNEXPLAINED_DISTANCE = 0.5
"""Distance from all silhouettes beyond which the middle of a pixel belongs to none of them, pixels."""
MIN_REAL_OUTLINE = 0.5
"""Least share of real outline of an object whose piece was cut out of a blob: the cut itself shows
nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class KnownSighting:
    """Known object that was confirmed, with the blob or the piece of one that shows it."""

    object: BeliefObject
    blob: Blob
    fit: Hypothesis


@dataclass(frozen=True, slots=True, eq=False)
class KnownContents:
    """Known objects in a blob, and its other contents."""

    found: Sequence[KnownSighting] = ()
    left: Sequence[PixelPatch] = ()
    """Patches of something that touches them."""
    most: int = MAX_PARTS
    """Greatest number of items that the blob may be split into when none was found.

    A split is the most expensive search of a picture, and would be tried in each picture of the blob. It is 1
    for a blob of only set-aside items, whose exact poses are not needed. With other pixels beside them, it
    may be one more than these."""


def known_objects(
    picture: SegmentationInput,
    fitter: ItemFitter,
    blob: Blob,
    floor: SupportSurface,
    known: Sequence[BeliefObject],
) -> KnownContents:
    """Return the `known` objects that the blob shows near their believed poses, and the rest of the blob.

    An object is left out where no other explanation could be excluded: most of it is hidden, the fit is not
    good, it moved or turned. An uncertain object stays uncertain, and the identity of a set-aside object is
    not needed: for these, any fit that explains the blob is enough. `floor` is the support under the blob.
    """
    touching: list[tuple[BeliefObject, StandingPose]] = []
    rests = (*fitter.rests, *fitter.leaning)
    for one in known:
        if label_of(one.colour) != blob.patch.label or one.attached or not _is_believed_on(floor, one):
            continue
        stand = standing_pose(rests, one.kind, one.pose)
        if stand is None:
            continue
        x, y = picture.sight.at_height(blob.middle, one.pose.position[2])
        if (
            math.hypot(float(x) - one.pose.position[0], float(y) - one.pose.position[1])
            < 2 * MAX_KNOWN_DISTANCE
        ):
            found = _confirmed(picture, fitter, blob, floor, one, stand)
            if found is not None:
                return KnownContents([found])
        if _is_visible_in(picture, blob, stand):
            touching.append((one, stand))
    most = MAX_PARTS
    while touching:
        cut = _taken_apart(picture, blob, [stand for _, stand in touching])
        tried = [
            None if piece is None else _confirmed(picture, fitter, piece, floor, one, stand)
            for piece, (one, stand) in zip(cut.pieces, touching, strict=True)
        ]
        found = [each for each in tried if each is not None]
        left = cut.unclaimed_patches([each is None for each in tried])
        outlines = (outline_patch(picture, patch).outline for patch in left)
        # Each of those left shows enough of its own outline, beside that of the cut, to be recognised.
        if len(found) == len(tried) or (found and all(o.real.mean() > MIN_REAL_OUTLINE for o in outlines)):
            return KnownContents(found, left)
        if most == MAX_PARTS:
            most = cut.most([one.place == world_facts.ASIDE for one, _ in touching])
        touching = [each for each, one in zip(touching, tried, strict=True) if one is not None]
    picture.give_back(blob.patch)
    return KnownContents(most=most)


@dataclass(frozen=True, eq=False)
class _Cut:
    """Blob that was cut by the poses of k items in it."""

    picture: SegmentationInput
    blob: Blob
    costs: Array
    """Misfit of each item in each pixel (k, n)."""
    owners: NDArray[np.intp]
    """Number of the item (n,) that each pixel belongs to; k for a pixel of none."""
    pieces: list[Blob | None]
    """Piece of each item; None for one that shows too little of its outline."""

    def unclaimed_patches(self, missing: Sequence[bool]) -> list[PixelPatch]:
        """Claim the patches that belong to no item, or to one that is `missing` (k,)."""
        rows, columns = self.blob.patch.rows, self.blob.patch.columns
        free = np.zeros(self.picture.owner.shape, dtype=np.bool_)
        free[rows, columns] = np.array([*missing, True])[self.owners]
        label = self.blob.patch.label
        return [self.picture.claim(*part, label) for part in connected_patches(free, MIN_BODY_PIXELS)]

    def most(self, aside: Sequence[bool]) -> int:
        """Return `KnownContents.most`, by the items (k,) that were set `aside`."""
        if not any(aside):
            return MAX_PARTS
        more = _patches_beyond(self.picture, self.blob, self.costs[np.array(aside)])
        return min(MAX_PARTS, sum(aside) + 1) if more else 1


def _taken_apart(picture: SegmentationInput, blob: Blob, stands: Sequence[StandingPose]) -> _Cut:
    """Cut the blob by the poses of items in it."""
    rows, columns = blob.patch.rows, blob.patch.columns
    picture.give_back(blob.patch)
    costs = item_costs(picture, blob, stands)
    for part in _patches_beyond(picture, blob, costs):
        picture.claim(*part, blob.patch.label)
    owned = picture.owner[rows, columns] != blob.patch.number
    owners = np.where(owned, len(stands), costs.argmin(axis=0))
    patches = [
        picture.claim(rows[owners == k], columns[owners == k], blob.patch.label)
        if (owners == k).any()
        else None
        for k in range(len(stands))
    ]
    pieces = [outline_patch(picture, p) if p is not None and p.measured >= 4 else None for p in patches]
    shown = [p if p is None or p.outline.real.mean() > MIN_REAL_OUTLINE else None for p in pieces]
    return _Cut(picture, blob, costs, owners, shown)


def _patches_beyond(picture: SegmentationInput, blob: Blob, costs: Array) -> list[tuple[Pixels, Pixels]]:
    """Return rows and columns of the patches of the blob beside all items, by the items' `costs` (k, n)."""
    beyond = np.zeros(picture.owner.shape, dtype=np.uint8)
    beyond[blob.patch.rows, blob.patch.columns] = costs.min(axis=0) > OUTSIDE_COST + UNEXPLAINED_DISTANCE
    beyond = cv2.morphologyEx(beyond, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return connected_patches(beyond.astype(np.bool_), MIN_BODY_PIXELS)


def _confirmed(
    picture: SegmentationInput,
    fitter: ItemFitter,
    blob: Blob,
    floor: SupportSurface,
    one: BeliefObject,
    stand: StandingPose,
) -> KnownSighting | None:
    """Fit the object to the blob, starting from its believed pose; None unless it is clearly there."""
    supported = abs(float(stand.centre[2]) - stand.rest.below - floor.height) < SUPPORTED_TOLERANCE
    found = fitter.refined(blob, stand, supported)
    moved = math.dist(found.stand.centre, one.pose.position)
    turned = abs(found.stand.yaw - stand.yaw) if stand.rest.turn else 0.0
    clear = found.misfit < GOOD_MISFIT and found.shown > MIN_TRACKING_SHOWN
    if not clear and (one.place == world_facts.ASIDE or one.confidence < MIN_KNOWN_CONFIDENCE):
        poor = POOR_MISFIT_IN_BIN if floor.in_bin else POOR_MISFIT
        clear = is_clear(found, poor) and not _shows_two_objects(picture, blob, found)
    if clear and moved < MAX_KNOWN_DISTANCE and turned < MAX_HEADING_CHANGE:
        return KnownSighting(one, blob, found)
    return None


def _is_believed_on(floor: SupportSurface, one: BeliefObject) -> bool:
    return one.place == floor.place or (one.place == world_facts.ASIDE and not floor.in_bin)


def _is_visible_in(picture: SegmentationInput, blob: Blob, stand: StandingPose) -> bool:
    """Whether the middle of an object at that pose appears in the blob."""
    column, row = (round(float(c)) for c in picture.sight.pixels(stand.centre[None])[0])
    rows, columns = picture.owner.shape
    return 0 <= row < rows and 0 <= column < columns and picture.owner[row, column] == blob.patch.number


def standing_pose(rests: Sequence[StablePose], kind: str, pose: Pose) -> StandingPose | None:
    """Return the stable pose in which an item of that kind lies at its pose in the world; None when it leans
    too much."""
    rotation = pose.rotation()
    leaning = [
        (float((rotation @ rest.rotation.T)[2, 2]), -n)
        for n, rest in enumerate(rests)
        if rest.entry.kind == kind
    ]
    if not leaning:
        return None
    upright, n = max(leaning)
    if upright <= math.cos(MAX_LEAN):
        return None
    heading = rotation @ rests[-n].rotation.T
    yaw = math.atan2(float(heading[1, 0]), float(heading[0, 0]))
    return StandingPose(rests[-n], np.array(pose.position), yaw)


def _is_within_reach(picture: SegmentationInput, blob: Blob, one: BeliefObject) -> bool:
    x, y = picture.sight.at_height(blob.middle, one.pose.position[2])
    return math.hypot(float(x) - one.pose.position[0], float(y) - one.pose.position[1]) < 2 * TRACKING_REACH


def _sighting(
    picture: SegmentationInput,
    fitter: ItemFitter,
    blob: Blob,
    one: BeliefObject,
    believed: StandingPose,
    number: int,
) -> TrackedSighting:
    rest, yaw, z = believed.rest, believed.yaw, one.pose.position[2]
    at = picture.sight.at_height(blob.middle, z)
    stand = StandingPose(rest, np.array([at[0], at[1], z]), yaw)
    best = fitter.judged(blob, stand, MAX_FIT_ROUNDS)
    turned = abs(math.remainder(best.stand.yaw - yaw, 2 * math.pi)) if rest.turn else 0.0
    moved = math.dist(best.stand.centre[:2], one.pose.position[:2])
    fits = (
        best.misfit < MAX_TRACKING_MISFIT
        and best.shown > MIN_TRACKING_SHOWN
        and turned < MAX_HEADING_CHANGE
        and moved < TRACKING_REACH
        and not _shows_two_objects(picture, blob, best)
    )
    variance = best.covariance
    loose = math.sqrt(max(1.0, best.misfit)) / max(0.3, best.shown)
    pose = Pose.from_rotation(best.stand.centre, _tracked_orientation(best.stand, one, yaw))
    return TrackedSighting(
        one.id,
        number,
        pose,
        math.sqrt(max(float(variance[0, 0]), float(variance[1, 1]))) * loose + PIXEL_GRID_ERROR,
        math.pi if not rest.turn else min(math.pi, math.sqrt(float(variance[2, 2])) * loose + 2e-3),
        best.misfit if fits else math.inf,
        best.shown,
    )


def _shows_two_objects(picture: SegmentationInput, blob: Blob, best: Hypothesis) -> bool:
    """Whether the patch is too large for the object: another of its colour touches it."""
    whole = covered_area(silhouette(picture.sight, best.stand))
    return blob.area > (1.0 + MAX_EXCESS_AREA) * whole


def _tracked_orientation(stand: StandingPose, one: BeliefObject, yaw: float) -> Array:
    """Return its orientation: the believed one, turned about the vertical by the seen difference. A body
    without heading keeps its own."""
    rotation = one.pose.rotation()
    if not stand.rest.turn:
        return rotation
    c, s = math.cos(stand.yaw - yaw), math.sin(stand.yaw - yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ rotation, dtype=np.float64)
