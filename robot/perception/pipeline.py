"""Perception pipeline: one RGB-D image is masked, segmented and fitted to the catalogue. Blobs without a fit
are reported as unexplained.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.world import (
    Array,
    BeliefObject,
    Pose,
    RecognisedItem,
    RgbdImage,
    heap_geometry,
    ray_hits,
    top,
)
from picktree.world.scene import SceneDescription, destinations

from . import segmentation
from .backdrop import MIN_FRONT_DEPTH, BackgroundModel, SupportSurface, SupportSurfaces, table_of
from .camera_geometry import PosedCamera
from .camera_registration import level_camera, register_hand_camera
from .heap_mapping import bin_height_map, map_heaps
from .held_thing import HeldView, view_held_thing
from .hole_mouths import HoleMouths
from .item_fitting import (
    GOOD_MISFIT,
    HEIGHT_GATE,
    MAX_HOVER_HEIGHT,
    MODEL_DEPTH_SIGMA,
    POOR_MISFIT,
    POOR_MISFIT_IN_BIN,
    Fitting,
    Hypothesis,
    ItemFitter,
    detection_from,
    is_clear,
    split_blob,
)
from .known_object_fitting import (
    NEAR_DEPTH_SIGMA,
    KnownSighting,
    TrackedSighting,
    known_objects,
    standing_pose,
    track_objects,
)
from .obstacle_volumes import MIN_RAISED_DEPTH, bounding_box_of, points_of, unexplained_patches
from .picture_memory import PictureMemory, UnchangedContents
from .resting_poses import StablePose, catalogue_poses
from .robot_mask import ATTACHED_HEIGHT, RobotMask, RobotShape, add_attached_parts, held_part
from .segmentation import (
    Blob,
    PixelPatch,
    SegmentationInput,
    connected_patches,
    cut_off,
    downsample,
    outline_patch,
)
from .silhouette_fitting import StandingPose
from .view import CERTAIN_CONFIDENCE, BinView, Detection, PerceivedView, RecognisedPatch, UnexplainedPatch


@dataclass(frozen=True, eq=False)
class MaskedPicture:
    """Picture with the robot and the walls masked, and the scene that is expected without items."""

    picture: SegmentationInput
    backdrop: BackgroundModel
    robot: NDArray[np.bool_]
    noise: float
    """Standard deviation of the depth at 0.7 m, m."""
    moving: bool
    """Whether the camera is on the hand. Then hand and border may cut through items in the picture."""
    stride: int
    """Step between the pixels of the whole picture that were kept."""

    @property
    def rough(self) -> float:
        """Part of the depth's standard deviation that does not depend on the distance, m."""
        return NEAR_DEPTH_SIGMA if self.moving else MODEL_DEPTH_SIGMA


WORK_PER_TICK = 3
"""Work after which the evaluation of an image is continued in the next tick while the arm moves, in fits.
Masking the robot takes as long, and so do height maps and free rays together."""
MIN_PATCH_PIXELS = 10
"""Least number of pixels of a patch of colour."""
MIN_ITEM_HEIGHT = 0.002
"""Height of a patch's top over its support below which the patch is paint, m."""
MIN_HEIGHT_OVER_PAINT = 0.0035
"""Height over a painted surface above which its colour belongs to something else, m."""
HEAP_ABOVE_RIM, BLOB_ABOVE_RIM = 0.03, 0.10
"""Heights over a bin's rim up to which depth belongs to the heap in the bin, m: grey, and of an item's
colour. Items may lean over the rim."""
HEIGHT_ABOVE_TALLEST = 0.015
"""Height above the tallest item from which a blob cannot be an item, m."""
RAY_EXTENSION = 0.02
"""Length by which a ray is extended into a fixture or bin, m. It thereby clears volumes that touch such a
surface."""
MAX_CAMERA_DISPLACEMENT, DISPLACEMENT_DISTANCE = 0.006, 0.8
"""Displacement at the distance of the second value above which a corrected camera counts as misplaced, m. Its
background is then computed again."""
MIN_RAY_DESCENT = 0.1
"""Least descent of a ray of a moving camera for each m of depth. Flatter rays go to the horizon, where no
item lies."""
MAX_CUT_MISFIT, MIN_CUT_SHOWN = 2.5, 0.75
"""Greatest misfit and least visible share of a blob that the hand or the picture's border cuts through. Other
cut blobs are ignored: another picture shows them better."""
SUPPORT_ABOVE = 0.005
"""Height above a patch's top up to which a surface may be its support, m: depth has noise."""
SURFACE_TOLERANCE = 0.015
"""Distance of a pixel's depth from the surface at a reported pose up to which the pixel shows the item, m."""
MAX_REST_SIGMAS = 3.0
"""Standard deviations of a reported pose within which it rests on its support."""
DEFAULT_POSITION_SIGMA, DEFAULT_ANGLE_SIGMA = 0.003, 0.05
"""Standard deviations of a reported pose without its own, m and rad."""
MIN_SUNK_DEPTH = 0.005
"""Depth of an item's lowest point below the face around a hole from which the item is in the hole, m."""
MIN_ITEM_DISTANCE = 0.01
"""Distance of two reported items' centres below which they are one, m."""
MAX_POSITION_SIGMA = 0.012
"""Standard deviation of a position from which on a fit is no detection, m."""


class Perception:
    """Perception of one scene: its fixtures, bins, cameras and catalogue, and the robot's shape. Between
    pictures it keeps nothing but the cameras' views of the empty scene; see `PictureMemory`."""

    def __init__(
        self, description: SceneDescription, robot: RobotShape, table_z: float | None = None
    ) -> None:
        table = table_of(description)
        self._description = description
        self._robot = RobotMask(robot)
        self._table = table
        if table_z is None:
            table_z = 0.0 if table is None else top(table.shape, table.pose)
        self._table_z = table_z
        self.rests = catalogue_poses(description.catalogue)
        self.tallest = max((rest.height for rest in self.rests), default=0.0)
        """Height of the tallest item in its tallest stable pose, m."""
        self.regions = heap_geometry.heap_regions(description)
        self._floors = SupportSurfaces(description.fixtures, description.bins, self.regions)
        self.mouths = HoleMouths(description.fixtures, description.catalogue)
        self.noise = {c.name: max(c.depth_noise, 2e-4) for c in description.cameras}
        """Standard deviation of the depth of each camera at 0.7 m, m."""
        self.moving = frozenset(c.name for c in description.cameras if c.on == "hand")
        """Names of the cameras on the hand."""
        self._backdrops: dict[tuple[object, Pose], BackgroundModel] = {}

    def detect(
        self,
        image: RgbdImage,
        joints: Array,
        width: float,
        held: BeliefObject | None,
        known: Sequence[BeliefObject] = (),
    ) -> PerceivedView:
        """Return the view in a picture, see `understand`."""
        work = self.understand(image, joints, width, held, known)
        while True:
            try:
                next(work)
            except StopIteration as done:
                return done.value

    def understand(
        self,
        image: RgbdImage,
        joints: Array,
        width: float,
        held: BeliefObject | None,
        known: Sequence[BeliefObject] = (),
        memory: PictureMemory | None = None,
        believed: Sequence[BeliefObject] = (),
        reported: Sequence[RecognisedItem] | None = None,
    ) -> Generator[int, None, PerceivedView]:
        """Compute the view in a picture, taken with the arm at `joints` (n,) rad and the fingers `width` m
        open. Yields the work so far after each part of it, in `WORK_PER_TICK`: a fit counts as 1.

        A patch that one of the `known` objects fits near its believed pose is that object. All others are
        recognised, except those that have not changed since the `memory` of this camera understood them, and
        whose objects are `believed`.

        `reported`: items that another process has recognised in the picture. With them nothing is recognised
        by colour, and neither `known` objects nor the `memory` count.
        """
        shot = self._shot(image, joints, width, held, reported)
        picture, finding = shot.picture, _Finding(self, shot, known)
        yield WORK_PER_TICK
        unchanged = UnchangedContents()
        if memory is not None and not shot.moving and reported is None:
            unchanged = memory.compare(picture, shot.noise, believed, image.stamp)
            finding.unexplained += unchanged.unexplained
        for _ in finding.items(unchanged) if reported is None else finding.reported_items(reported):
            yield WORK_PER_TICK + finding.fitter.count.fits
        yield 2 * WORK_PER_TICK + finding.fitter.count.fits
        finding.things()
        bins = {
            b.id: BinView(partial(bin_height_map, picture, shot.robot, b, shot.noise))
            for b in self._description.bins
        }
        return PerceivedView(
            image.camera,
            image.stamp,
            tuple(finding.detections),
            tuple(finding.unexplained),
            bins,
            picture.sight,
            picture.depth,
            picture.label,
            picture.blocked,
            finding.reach(),
            self._floors.supports,
            lambda points, distance: self._robot.within(points, joints, width, held_part(held), distance),
            {} if shot.moving else map_heaps(picture, shot.robot, self._description, image.colour),
            unchanged.seen,
            tuple(finding.recognised),
        )

    def track(
        self,
        image: RgbdImage,
        joints: Array,
        width: float,
        held: BeliefObject | None,
        objects: Sequence[BeliefObject],
        reported: Sequence[RecognisedItem] | None = None,
    ) -> tuple[TrackedSighting, ...]:
        """Locate objects that are believed to be in the picture; see `known_object_fitting`. It is cheaper
        and surer than `detect`, because nothing has to be recognised. `reported` as in `understand`."""
        shot = self._shot(image, joints, width, held, reported)
        fitter = ItemFitter(self.rests, shot.picture.sight, shot.noise, shot.rough)
        return track_objects(shot.picture, fitter, objects)

    def held(self, image: RgbdImage, joints: Array, width: float) -> HeldView:
        """Return the view of the hand in the picture of a fixed camera, with the arm at `joints` (n,) rad."""
        believed = PosedCamera.at(image.intrinsics, image.camera_in_world)
        backdrop = self._backdrop(believed, image)
        depth = np.where(np.isfinite(image.depth), image.depth, 0.0).astype(np.float64)
        sight = level_camera(believed, depth, backdrop, self._table_z)
        depth[backdrop.depth - depth <= MIN_RAISED_DEPTH] = 0.0
        tagged = destinations.asks_for(self._description.destinations, "tag")
        return view_held_thing(sight, depth, image.colour, self._robot, (joints, width), tagged=tagged)

    def _shot(
        self,
        image: RgbdImage,
        joints: Array,
        width: float,
        held: BeliefObject | None,
        reported: Sequence[RecognisedItem] | None = None,
    ) -> MaskedPicture:
        moving = image.camera in self.moving
        whole = image
        if moving:
            image = downsample(image)
        depth = np.where(np.isfinite(image.depth), image.depth, 0.0).astype(np.float64)
        believed = PosedCamera.at(image.intrinsics, image.camera_in_world)
        backdrop = self._backdrop(believed, image)
        stride = max(1, round(whole.intrinsics.fx / image.intrinsics.fx))
        own = reported is None
        label = segmentation.labels(image.colour) if own else _reported_labels(reported, depth.shape, stride)
        in_hand = held_part(held)
        if moving:
            # From near, items and fingers may fill more of the picture than the table does.
            clutter = (label > 0) | self._robot.nearby(believed, depth, joints, width, in_hand)
            sight = level_camera(believed, depth, backdrop, self._table_z, clutter)
            sight = self._beside_hand(sight, whole, joints, width)
        else:
            sight = level_camera(believed, depth, backdrop, self._table_z)
        if believed.apart(sight, DISPLACEMENT_DISTANCE) > MAX_CAMERA_DISPLACEMENT:
            # Seen walls and table are compared with their known places, from the corrected camera.
            believed = sight
            backdrop = BackgroundModel.of(self._description, sight, self._table, self._table_z)
        height = sight.heights(depth)
        robot = self._robot.paint(believed, joints, width, in_hand)
        if moving:
            robot |= self._robot.nearby(believed, depth, joints, width, in_hand)
        else:
            # A camera that is mounted elsewhere than believed sees a rim of the robot next to the model.
            high = np.where(~robot & (height > self._table_z + ATTACHED_HEIGHT), depth, 0.0)
            if high.any():
                robot |= self._robot.nearby(believed, high, joints, width, in_hand, math.inf) & (high > 0)
        robot = add_attached_parts(robot, height, depth > 0, self._table_z + ATTACHED_HEIGHT)
        walls = np.isfinite(backdrop.guard) & ((depth == 0) | (depth > backdrop.guard - MIN_FRONT_DEPTH))
        if moving:
            walls |= sight.all_directions()[:, :, 2] > -MIN_RAY_DESCENT
        picture = SegmentationInput(
            sight, depth, height, label, robot | walls, np.zeros(depth.shape, dtype=np.int32), []
        )
        return MaskedPicture(picture, backdrop, robot, self.noise.get(image.camera, 0.002), moving, stride)

    def _beside_hand(self, sight: PosedCamera, image: RgbdImage, joints: Array, width: float) -> PosedCamera:
        """Correct the levelled pose of a hand camera by the fingers that the whole picture shows."""
        fine = PosedCamera.along(image.intrinsics, sight.origin, sight.rotation)
        found = register_hand_camera(fine, image.depth.astype(np.float64), self._robot.fingers(joints, width))
        return PosedCamera.along(sight.intrinsics, found.origin, found.rotation)

    def _backdrop(self, sight: PosedCamera, image: RgbdImage) -> BackgroundModel:
        if image.camera in self.moving:
            return BackgroundModel.of(self._description, sight, self._table, self._table_z)
        key = (image.intrinsics, image.camera_in_world)
        if key not in self._backdrops:
            self._backdrops[key] = BackgroundModel.of(self._description, sight, self._table, self._table_z)
        return self._backdrops[key]

    def in_heap(self, points: Array, over: float = HEAP_ABOVE_RIM) -> NDArray[np.bool_]:
        """Select the points (n, 3) of a pile, or of a bin up to `over` m above its rim."""
        return self._floors.in_heap(points, over)

    def floor(self, x: float, y: float, below: float) -> SupportSurface:
        return self._floors.under(x, y, below)


def _reported_labels(
    reported: Sequence[RecognisedItem], shape: tuple[int, ...], stride: int
) -> NDArray[np.uint8]:
    """Return the labels (h, w) of the pixels in the masks of reported items."""
    label = np.zeros(shape, np.uint8)
    for each in reported:
        if each.masked:
            label[_kept_pixels(each, stride)] = segmentation.label_of(each.colour)
    return label


def _kept_pixels(each: RecognisedItem, stride: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns of an item's pixels in a picture of which each `stride`-th pixel was kept."""
    kept = (each.rows % stride == 0) & (each.columns % stride == 0)
    return each.rows[kept] // stride, each.columns[kept] // stride


class _Finding:
    """Recognition of items and unexplained patches in one picture."""

    def __init__(self, perception: Perception, shot: MaskedPicture, known: Sequence[BeliefObject]) -> None:
        self.perception = perception
        self.known = known
        self.picture = shot.picture
        self.fitter = ItemFitter(perception.rests, shot.picture.sight, shot.noise, shot.rough)
        self.backdrop = shot.backdrop
        self.robot = shot.robot
        self.moving = shot.moving
        self.stride = shot.stride
        self.detections: list[Detection] = []
        self.unexplained: list[UnexplainedPatch] = []
        self.recognised: list[RecognisedPatch] = []

    def items(self, unchanged: UnchangedContents) -> Iterator[None]:
        """Fit the coloured patches beside the `unchanged` ones; yield after each part of the work. Patches
        that fit nothing become boxes."""
        picture = self.picture
        usable = (picture.label > 0) & ~picture.blocked
        for patch in unchanged.patches:
            usable[patch.rows, patch.columns] = False
        if self.backdrop.label.any():
            usable &= self._is_more_than_paint()
        present = np.flatnonzero(np.bincount(picture.label[usable], minlength=len(segmentation.LABEL_NAMES)))
        patches = [
            picture.claim(rows, columns, int(label))
            for label in present
            for rows, columns in connected_patches(usable & (picture.label == label), MIN_PATCH_PIXELS)
        ]
        for patch in patches:
            if patch.measured >= 4:
                found, boxed = len(self.detections), len(self.unexplained)
                yield from self._item(patch)
                self._note(patch, found, boxed)
                yield

    def _note(self, patch: PixelPatch, found: int, boxed: int) -> None:
        """Record that the patch was recognised; its contents are those after the first `found` detections and
        `boxed` boxes."""
        detections = range(found, len(self.detections))
        self.recognised.append(
            RecognisedPatch(
                patch.rows,
                patch.columns,
                patch.label,
                patch.top,
                tuple(detections),
                tuple(self.unexplained[boxed:]),
                all(self.detections[n].confidence >= CERTAIN_CONFIDENCE for n in detections),
            )
        )

    def _is_more_than_paint(self) -> NDArray[np.bool_]:
        """Select pixels that are more than paint: of another colour than the background, or raised from it.

        Pixels count as raised with their neighbours only, because depth noise is as large as a plate is
        thick.
        """
        return self._is_raised() | (self.picture.label != self.backdrop.label)

    def _is_raised(self) -> NDArray[np.bool_]:
        """Select pixels whose surface is clearly in front of the background."""
        picture, behind = self.picture, self.backdrop
        known = picture.depth > 0
        out = np.where(known, behind.depth - picture.depth, 0.0)
        around = cv2.blur(out, (3, 3)) / np.maximum(cv2.blur(known.astype(np.float64), (3, 3)), 0.1)
        raised = (around > MIN_HEIGHT_OVER_PAINT) & (~known | (out > 0.5 * around))
        clean = cv2.medianBlur(raised.astype(np.uint8), 3)
        return clean.astype(np.bool_)

    def reported_items(self, reported: Sequence[RecognisedItem]) -> Iterator[None]:
        """Detect the items that another process has recognised; yield after each part of the work. An item
        without a pose is fitted to its pixels. The more confident of two items at one place is taken."""
        ordered = sorted(reported, key=lambda each: -each.confidence)
        patches = [self._reported_patch(each) for each in ordered]
        for each, patch in zip(ordered, patches, strict=True):
            if patch is None or patch.measured < 4:
                continue
            before = len(self.detections)
            if each.pose is None:
                yield from self._fit_reported(each, patch)
            else:
                self._place_reported(each, each.pose, patch)
            fresh, self.detections[before:] = self.detections[before:], []
            for seen in fresh:
                if all(seen.pose.distance(d.pose) > MIN_ITEM_DISTANCE for d in self.detections):
                    self.detections.append(seen)
            yield

    def _reported_patch(self, each: RecognisedItem) -> PixelPatch | None:
        """Claim the visible pixels of a reported item; None without enough of them.

        In a box they are those at its pose, or without a pose the largest raised patch.
        """
        picture = self.picture
        rows, columns = _kept_pixels(each, self.stride)
        shown = ~picture.blocked[rows, columns]
        if not each.masked and each.pose is not None:
            pose = self._in_world(each.pose)
            rays = picture.sight.directions(np.stack([columns, rows], axis=1).astype(np.float64))
            shape = self._rests_of(each.kind)[0].entry.shape
            surface = ray_hits(shape, pose.rotation(), np.array(pose.position), picture.sight.origin, rays)
            depth = picture.depth[rows, columns]
            shown &= np.isfinite(surface) & (depth > 0) & (np.abs(depth - surface) < SURFACE_TOLERANCE)
        rows, columns = rows[shown], columns[shown]
        if not each.masked and each.pose is None:
            within = np.zeros(picture.depth.shape, dtype=np.bool_)
            within[rows, columns] = True
            parts = connected_patches(within & self._is_raised(), MIN_PATCH_PIXELS)
            rows, columns = max(parts, key=lambda part: len(part[0]), default=(rows[:0], columns[:0]))
        if len(rows) < MIN_PATCH_PIXELS:
            return None
        label = segmentation.label_of(each.colour)
        picture.label[rows, columns] = label
        return picture.claim(rows, columns, label)

    def _fit_reported(self, each: RecognisedItem, patch: PixelPatch) -> Iterator[None]:
        """Fit a reported kind to its pixels, and accept the best fit."""
        floor = self._floor(patch.rows, patch.columns, patch.top)
        if floor.heaped:
            return
        blob = outline_patch(self.picture, patch)
        before = len(self.detections)
        fitter = replace(self.fitter, rests=self._rests_of(each.kind))
        heaped = (0.0, math.inf) if floor.in_bin else (GOOD_MISFIT, MAX_HOVER_HEIGHT)
        hypotheses = yield from fitter.explain(blob, floor.height, *heaped)
        seated = yield from self._seated(blob)
        misfit = hypotheses[0].misfit if hypotheses else math.inf
        if (
            seated is not None
            and seated.detection.kind == each.kind
            and seated.best.misfit < max(GOOD_MISFIT, misfit)
        ):
            self.detections.append(seated.detection)
        else:
            self._settle(blob, hypotheses, floor)
        self.detections[before:] = [
            replace(
                d, colour=each.colour or "grey", confidence=min(d.confidence, each.confidence), reported=True
            )
            for d in self.detections[before:]
        ]

    def _place_reported(self, each: RecognisedItem, reported: Pose, patch: PixelPatch) -> None:
        """Accept an item at its reported pose. One that rests on its support within the pose's deviation is
        placed exactly on it."""
        perception = self.perception
        sigma = each.sigma_position or DEFAULT_POSITION_SIGMA
        pose = self._in_world(reported)
        x, y, z = pose.position
        floor = perception.floor(x, y, z + SUPPORT_ABOVE)
        if floor.heaped:
            return
        if sigma > MAX_POSITION_SIGMA:
            self._box(patch.rows, patch.columns, floor if floor.in_bin else None)
            return
        rests = self._rests_of(each.kind)
        stand, entry, place = standing_pose(rests, each.kind, pose), rests[0].entry, floor.place
        turn = 2 * math.pi if stand is None else stand.rest.turn
        if stand is not None:
            lowest = float(stand.centre[2]) - stand.rest.below
            mouth = perception.mouths.near(x, y)
            if mouth is not None and lowest < mouth.height - MIN_SUNK_DEPTH:
                place = mouth.id
            elif abs(lowest - floor.height) < max(HEIGHT_GATE, MAX_REST_SIGMAS * sigma):
                centre = np.array([x, y, floor.height + stand.rest.below])
                pose = Pose.from_rotation(centre, StandingPose(stand.rest, centre, stand.yaw).turned)
        self.detections.append(
            Detection(
                entry.kind,
                entry.form,
                entry.shape,
                each.colour or "grey",
                pose,
                sigma,
                math.pi if not turn else max(each.sigma_angle or DEFAULT_ANGLE_SIGMA, 2e-3),
                each.confidence,
                turn,
                place,
                reported=True,
            )
        )

    def _in_world(self, pose: Pose) -> Pose:
        """Return the pose in the world of an item whose pose in the camera's optical frame is given."""
        sight = self.picture.sight
        return Pose.from_rotation(sight.origin, sight.rotation) @ pose

    def _rests_of(self, kind: str) -> tuple[StablePose, ...]:
        return tuple(rest for rest in self.perception.rests if rest.entry.kind == kind)

    def things(self) -> None:
        """Collect the grey depth that nothing known explains. In bins it belongs to the heap."""
        picture = self.picture
        for rows, columns in unexplained_patches(
            picture, self.backdrop.depth, self.robot, self.perception.in_heap
        ):
            self._box(rows, columns)

    def reach(self) -> NDArray[np.float32]:
        """Compute how far each ray passes through free space, see `PerceivedView.reach`."""
        picture, behind = self.picture, self.backdrop
        explained = behind.depth - picture.depth <= MIN_RAISED_DEPTH
        explained |= np.isfinite(behind.guard) & (picture.depth > behind.guard - MIN_FRONT_DEPTH)
        explained &= picture.owner == 0
        known = np.where(explained, np.maximum(picture.depth, behind.depth) + RAY_EXTENSION, picture.depth)
        known[picture.depth <= 0] = np.inf
        known[self.robot] = 0.0
        return known.astype(np.float32)

    def _floor(self, rows: NDArray[np.intp], columns: NDArray[np.intp], height: float) -> SupportSurface:
        middle = np.array([columns.mean(), rows.mean()])
        x, y = self.picture.sight.at_height(middle, height)
        return self.perception.floor(float(x), float(y), height + SUPPORT_ABOVE)

    def _item(self, patch: PixelPatch) -> Iterator[None]:
        floor = self._floor(patch.rows, patch.columns, patch.top)
        if patch.top - floor.height < MIN_ITEM_HEIGHT or floor.heaped:
            return
        blob = outline_patch(self.picture, patch)
        heaped = (0.0, math.inf) if floor.in_bin else (GOOD_MISFIT, MAX_HOVER_HEIGHT)
        known = known_objects(self.picture, self.fitter, blob, floor, self.known)
        for one in known.found:
            self._confirm(one, floor)
        for left in known.left:
            if left.measured >= 4:
                yield from self._item(left)
        if known.found:
            return
        hypotheses = yield from self.fitter.explain(blob, floor.height, *heaped)
        seated = yield from self._seated(blob)
        if seated is not None and (
            not hypotheses or seated.best.misfit < max(GOOD_MISFIT, hypotheses[0].misfit)
        ):
            self.detections.append(seated.detection)
            return
        misfit = hypotheses[0].misfit if hypotheses else 9.0
        hidden = cut_off(patch.rows, patch.columns, *self.picture.depth.shape) or self._beside_robot(blob)
        if self.moving and hidden:
            if hypotheses and is_clear(hypotheses[0], MAX_CUT_MISFIT) and hypotheses[0].shown > MIN_CUT_SHOWN:
                self._settle(blob, hypotheses, floor)
            return
        # Items that the border or the robot hides in part do not fit, and would be searched in each picture.
        if misfit > GOOD_MISFIT and not floor.in_bin and not hidden:
            parts = yield from split_blob(self.picture, self.fitter, blob, floor.height, misfit, known.most)
            if parts is not None and (
                misfit >= POOR_MISFIT or all(is_clear(part.hypotheses[0]) for part in parts)
            ):
                for part in parts:
                    self._settle(part.blob, part.hypotheses, floor)
                return
        self._settle(blob, hypotheses, floor)

    def _confirm(self, one: KnownSighting, floor: SupportSurface) -> None:
        """Add a known object with at most its believed confidence: other kinds were not compared."""
        detection = detection_from(self.picture.sight, one.blob, [one.fit], floor)
        confidence = min(detection.confidence, one.object.confidence)
        self.detections.append(replace(detection, confidence=confidence))

    def _seated(self, blob: Blob) -> Fitting[_Seated | None]:
        """Return the item whose protruding part the blob is. None when no hole is near, or no item fits
        clearly."""
        x, y = self.picture.sight.at_height(blob.middle, blob.top)
        mouth = self.perception.mouths.near(float(x), float(y))
        if mouth is None or not mouth.stubs:
            return None
        found = yield from replace(self.fitter, rests=mouth.rests).explain(blob, mouth.height)
        stub = mouth.stub(found[0].stand.rest) if found else None
        if stub is None or not is_clear(found[0]):
            return None
        seen = detection_from(self.picture.sight, blob, found, SupportSurface(mouth.id, mouth.height, False))
        # The board hides a part of the outline. Where that leaves the place uncertain, the hole gives it.
        at = seen.pose.position if seen.sigma_position < mouth.sigma else (*mouth.at, seen.pose.position[2])
        pose = Pose(at, seen.pose.orientation).shifted((0.0, 0.0, -stub.sunk))
        sigma = min(seen.sigma_position, mouth.sigma)
        return _Seated(found[0], replace(seen, shape=stub.entry.shape, pose=pose, sigma_position=sigma))

    def _settle(self, blob: Blob, hypotheses: list[Hypothesis], floor: SupportSurface) -> None:
        """Accept the best hypothesis as a detection, or box the blob."""
        if hypotheses and is_clear(hypotheses[0], POOR_MISFIT_IN_BIN if floor.in_bin else POOR_MISFIT):
            detection = detection_from(self.picture.sight, blob, hypotheses, floor)
            if detection.sigma_position < MAX_POSITION_SIGMA:
                self.detections.append(detection)
                return
        if not self._beside_robot(blob) or self._too_large(blob, floor):
            self._box(blob.patch.rows, blob.patch.columns, floor if floor.in_bin else None)

    def _beside_robot(self, blob: Blob) -> bool:
        """Whether the robot may hide a part of the blob, which then cannot be expected to fit."""
        rows, columns = blob.patch.rows, blob.patch.columns
        y0, y1 = max(int(rows.min()) - 2, 0), int(rows.max()) + 3
        x0, x1 = max(int(columns.min()) - 2, 0), int(columns.max()) + 3
        return bool(self.robot[y0:y1, x0:x1].any()) and not blob.whole

    def _too_large(self, blob: Blob, floor: SupportSurface) -> bool:
        """Whether the blob is too high to be a part of any item, even of one that the robot hides in part."""
        return blob.top - floor.height > self.perception.tallest + HEIGHT_ABOVE_TALLEST

    def _box(
        self, rows: NDArray[np.intp], columns: NDArray[np.intp], heap: SupportSurface | None = None
    ) -> None:
        """Add the box of a patch to the unexplained. Pixels that belong to a heap are left out; with a `heap`
        only those far above its rim stay."""
        known = self.picture.depth[rows, columns] > 0
        points = points_of(self.picture, rows, columns)
        known &= ~self.perception.in_heap(points, HEAP_ABOVE_RIM if heap is None else BLOB_ABOVE_RIM)
        if int(known.sum()) < MIN_PATCH_PIXELS:
            return
        x, y, z = (float(c) for c in np.median(points[known], axis=0))
        below = self.perception.floor(x, y, z + 0.005)
        box = bounding_box_of(self.picture, rows[known], columns[known], below.height)
        if box is not None:
            self.unexplained.append(box)


@dataclass(frozen=True, eq=False)
class _Seated:
    """Item that is seated in a hole."""

    best: Hypothesis
    detection: Detection
