"""Picture memory: understood patches of a fixed camera's pictures. The contents of a patch are valid until
its pixels change.

A picture is compared with the memory before anything is recognised in it. Understood patches without a change
confirm their objects. A patch is recognised again when its pixels change, when one of its objects is believed
elsewhere, while its contents are uncertain, and from time to time.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.world import BeliefObject, Box, ObjectId, Pose, world_facts

from .segmentation import PixelPatch, Pixels, SegmentationInput
from .view import PerceivedView, RecognisedPatch, UnexplainedPatch

RING_WIDTH = 2
"""Width of the ring around a patch in which colours are compared, too, pixels. A body that comes to touch the
patch changes them."""
DEPTH_UNIT = 0.0005
"""Step of the remembered depth, m."""
CHANGE_SIGMAS = 6.0
"""Difference in depth from which a pixel has changed, in standard deviations of the difference."""
MIN_SHIFT = 0.001
"""Least mean difference in depth of a whole patch from which it has changed, m."""
MAX_CHANGED_SHARE, MIN_CHANGED_PIXELS, MAX_CHANGED_PIXELS = 0.02, 1, 5
"""Share of changed pixels of a patch up to which it is unchanged, and the bounds of their number: colours
flip at outlines. On a large painted surface more pixels may be a new item."""
MIN_VISIBLE_SHARE = 0.5
"""Least visible share of a patch at which its objects are confirmed. A patch of which less is visible stays
remembered."""
MAX_LOOKS = 3
"""Number of pictures in which uncertain contents are recognised. A further picture has no better chance."""
REVIEW_PERIOD = 1.0
"""Time between two reviews, s. A review recognises the patch again that was recognised longest ago."""
REVIEW_AGE = 10.0
"""Age of a recognition from which it is reviewed, s; an uncertain one is at each occasion."""
_UNKNOWN = 255
"""Label of a pixel of which the picture showed nothing."""
_NO_PIXELS: NDArray[np.int32] = np.zeros(0, dtype=np.int32)


@dataclass(frozen=True, slots=True)
class KnownPlace:
    """Object of the belief with its pose in the world when it was recognised."""

    object: ObjectId
    pose: Pose


@dataclass(frozen=True, slots=True)
class UnexplainedBox:
    """Box of an unexplained patch, without its pixels."""

    shape: Box
    pose: Pose
    colour: str


@dataclass(frozen=True, slots=True)
class PatchContents:
    """Contents of an understood patch."""

    label: int
    """Label of its colour, see `segmentation.LABEL_NAMES`."""
    top: float
    """Height of its upper parts in the world, m."""
    objects: tuple[KnownPlace, ...]
    boxes: tuple[UnexplainedBox, ...]
    certain: bool
    """Whether it has contents, and each detection in it was recognised with confidence and is an object; or
    its objects are set aside."""
    looks: int
    """Number of pictures in a row in which it was recognised without a change."""
    time: float
    """Time of the last of these pictures, s."""


@dataclass(frozen=True, slots=True)
class PatchState:
    """Understood patch in a checkpoint; its pixels are in `PictureState.pixels`."""

    contents: PatchContents
    own: int
    ring: int
    boxes: tuple[int, ...]
    """Number of pixels of each box."""


@dataclass(frozen=True, slots=True)
class PictureState:
    """Memory of one camera's pictures in a checkpoint."""

    shape: tuple[int, int]
    reviewed: float
    patches: tuple[PatchState, ...]
    pixels: str
    """Pixels of all patches: compressed bytes in base64."""


@dataclass(frozen=True, slots=True, eq=False)
class _Patch:
    """Understood patch with its pixels, as indices into the flat picture."""

    contents: PatchContents
    own: NDArray[np.int32]
    """Pixels of the patch (n,)."""
    ring: NDArray[np.int32]
    """Pixels around it (m,)."""
    depth: NDArray[np.uint16]
    """Depths of its own pixels (n,), in `DEPTH_UNIT`; 0 where unknown."""
    labels: NDArray[np.uint8]
    """Labels of the ring (m,)."""
    boxes: tuple[NDArray[np.int32], ...]
    """Pixels of each unexplained box."""


@dataclass(frozen=True, eq=False)
class UnchangedContents:
    """Understood contents of a picture that have not changed."""

    seen: tuple[ObjectId, ...] = ()
    """Objects that are confirmed."""
    patches: tuple[PixelPatch, ...] = ()
    """Visible pixels of the unchanged patches. They are claimed in the picture."""
    unexplained: tuple[UnexplainedPatch, ...] = ()


class PictureMemory:
    """Understood patches of one fixed camera. It is part of the state of a run."""

    def __init__(self) -> None:
        self._shape = (0, 0)
        self._patches: list[_Patch] = []
        self._reviewed = 0.0

    def __len__(self) -> int:
        return len(self._patches)

    def forget(self) -> None:
        """Forget all patches, so that the next picture is recognised as a whole."""
        self._patches = []

    def compare(
        self, picture: SegmentationInput, noise: float, believed: Sequence[BeliefObject], now: float
    ) -> UnchangedContents:
        """Claim the patches of `picture` that have not changed, and return their contents.

        `noise`: standard deviation of the depth at 0.7 m, m. Patches of objects that are not `believed`
        at their remembered pose are recognised again. Changed patches are forgotten.
        """
        if picture.depth.shape != self._shape:
            self._shape, self._patches = picture.depth.shape, []
        if not self._patches:
            return UnchangedContents()
        changed, visible = self._changes(picture, noise)
        self._patches = [each for each, gone in zip(self._patches, changed, strict=True) if not gone]
        shares = [share for share, gone in zip(visible, changed, strict=True) if not gone]
        poses = {o.id: o.pose for o in believed if not o.attached}
        review = self._due(shares, now)
        seen: list[ObjectId] = []
        patches: list[PixelPatch] = []
        unexplained: list[UnexplainedPatch] = []
        for patch, share in zip(self._patches, shares, strict=True):
            contents = patch.contents
            again = not contents.certain and contents.looks < MAX_LOOKS
            elsewhere = any(poses.get(place.object) != place.pose for place in contents.objects)
            if patch is review or (share >= MIN_VISIBLE_SHARE and (again or elsewhere)):
                continue
            patches.append(self._claim(picture, patch))
            if share >= MIN_VISIBLE_SHARE and not elsewhere:
                seen += [place.object for place in contents.objects]
            unexplained += self._boxes(picture, patch)
        return UnchangedContents(tuple(seen), tuple(patches), tuple(unexplained))

    def keep(self, view: PerceivedView, objects: Mapping[int, BeliefObject]) -> None:
        """Remember the recognised patches of a view. `objects`: the belief of each detection that has one,
        by its index in the view. A patch replaces those that it overlaps."""
        fresh = [self._understood(view, patch, objects) for patch in view.recognised]
        if not fresh:
            return
        taken = np.zeros(view.depth.size, dtype=np.bool_)
        for patch in fresh:
            taken[patch.own] = True
        before, self._patches = self._patches, []
        for patch in before:
            if not taken[patch.own].any():
                self._patches.append(patch)
        former = np.zeros(view.depth.size, dtype=np.int32)
        for number, patch in enumerate(before, start=1):
            former[patch.own] = number
        for patch in fresh:
            number = int(np.bincount(former[patch.own]).argmax())
            looks = before[number - 1].contents.looks + 1 if number else 1
            self._patches.append(replace(patch, contents=replace(patch.contents, looks=looks)))
        self._shape = view.depth.shape

    def state(self) -> PictureState:
        """Return the state for a checkpoint."""
        arrays: list[NDArray[np.int32] | NDArray[np.uint16] | NDArray[np.uint8]] = []
        for patch in self._patches:
            arrays += [
                _differences(patch.own),
                _differences(patch.ring),
                patch.depth,
                patch.labels,
                *(_differences(box) for box in patch.boxes),
            ]
        data = zlib.compress(b"".join(each.tobytes() for each in arrays))
        return PictureState(
            self._shape,
            self._reviewed,
            tuple(
                PatchState(p.contents, len(p.own), len(p.ring), tuple(len(box) for box in p.boxes))
                for p in self._patches
            ),
            base64.b64encode(data).decode("ascii"),
        )

    @classmethod
    def from_state(cls, state: PictureState) -> PictureMemory:
        """Return the memory with that state."""
        memory = cls()
        memory._shape, memory._reviewed = state.shape, state.reviewed
        data, at = zlib.decompress(base64.b64decode(state.pixels)), 0

        def pixels(count: int) -> NDArray[np.int32]:
            nonlocal at
            at += 4 * count
            return np.cumsum(np.frombuffer(data, np.int32, count, at - 4 * count), dtype=np.int32)

        for patch in state.patches:
            own, ring = pixels(patch.own), pixels(patch.ring)
            depth = np.frombuffer(data, np.uint16, patch.own, at)
            labels = np.frombuffer(data, np.uint8, patch.ring, at + 2 * patch.own)
            at += 2 * patch.own + patch.ring
            boxes = tuple(pixels(count) for count in patch.boxes)
            memory._patches.append(_Patch(patch.contents, own, ring, depth, labels, boxes))
        return memory

    def _changes(
        self, picture: SegmentationInput, noise: float
    ) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        """Return for each patch whether it has changed, and which share of it is visible."""
        patches = self._patches
        counts = np.array([len(p.own) for p in patches])
        starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
        own = np.concatenate([p.own for p in patches])
        labels = np.repeat(np.array([p.contents.label for p in patches], dtype=np.uint8), counts)
        visible = ~picture.blocked.ravel()[own]
        flipped = visible & (picture.label.ravel()[own] != labels)
        former = np.concatenate([p.depth for p in patches]) * DEPTH_UNIT
        depth = picture.depth.ravel()[own]
        measured = visible & ~flipped & (depth > 0) & (former > 0)
        sigma = np.sqrt(2.0) * noise * (np.maximum(former, 0.1) / 0.7) ** 2 + DEPTH_UNIT
        off = np.where(measured, depth - former, 0.0)
        moved = np.abs(off) > CHANGE_SIGMAS * sigma
        shown = np.add.reduceat(visible.astype(np.float64), starts)
        number = np.maximum(np.add.reduceat(measured.astype(np.float64), starts), 1.0)
        shift = np.abs(np.add.reduceat(off, starts)) / number
        noisy = CHANGE_SIGMAS * np.maximum.reduceat(sigma, starts) / np.sqrt(number)
        wrong = np.add.reduceat((flipped | moved).astype(np.float64), starts) + self._ring_changes(picture)
        allowed = np.clip(MAX_CHANGED_SHARE * counts, MIN_CHANGED_PIXELS, MAX_CHANGED_PIXELS)
        return (wrong > allowed) | (shift > np.maximum(MIN_SHIFT, noisy)), shown / counts

    def _ring_changes(self, picture: SegmentationInput) -> NDArray[np.float64]:
        """Return for each patch the number of pixels in its ring whose colour has changed."""
        lengths = np.array([len(p.ring) for p in self._patches])
        if not lengths.sum():
            return np.zeros(len(lengths))
        ring = np.concatenate([p.ring for p in self._patches])
        former = np.concatenate([p.labels for p in self._patches])
        label = picture.label.ravel()[ring]
        # Behind the robot anything may have been: its colour counts as changed when it shows.
        changed = ~picture.blocked.ravel()[ring] & (label != former) & ((former != _UNKNOWN) | (label > 0))
        of = np.repeat(np.arange(len(lengths)), lengths)
        return np.asarray(np.bincount(of, weights=changed, minlength=len(lengths)), dtype=np.float64)

    def _due(self, shares: Sequence[float], now: float) -> _Patch | None:
        """Return the visible patch that is reviewed now; None without one."""
        if now - self._reviewed < REVIEW_PERIOD:
            return None
        shown = [p for p, share in zip(self._patches, shares, strict=True) if share >= MIN_VISIBLE_SHARE]
        due = [p for p in shown if not p.contents.certain or now - p.contents.time >= REVIEW_AGE]
        oldest = min(due, key=lambda p: p.contents.time, default=None)
        if oldest is None:
            return None
        self._reviewed = now
        return oldest

    def _claim(self, picture: SegmentationInput, patch: _Patch) -> PixelPatch:
        rows, columns = self._visible(picture, patch.own)
        contents = patch.contents
        same = picture.label[rows, columns] == contents.label
        rows, columns = rows[same], columns[same]
        claimed = PixelPatch(len(picture.patches) + 1, contents.label, rows, columns, contents.top, len(rows))
        picture.patches.append(claimed)
        picture.give_back(claimed)
        return claimed

    def _boxes(self, picture: SegmentationInput, patch: _Patch) -> list[UnexplainedPatch]:
        found: list[UnexplainedPatch] = []
        for box, pixels in zip(patch.contents.boxes, patch.boxes, strict=True):
            rows, columns = self._visible(picture, pixels)
            known = picture.depth[rows, columns] > 0
            if known.any():
                rows, columns = rows[known], columns[known]
                found.append(UnexplainedPatch(box.shape, box.pose, box.colour, rows, columns))
        return found

    def _visible(self, picture: SegmentationInput, pixels: NDArray[np.int32]) -> tuple[Pixels, Pixels]:
        shown = pixels[~picture.blocked.ravel()[pixels]].astype(np.intp)
        return shown // self._shape[1], shown % self._shape[1]

    def _understood(
        self, view: PerceivedView, patch: RecognisedPatch, objects: Mapping[int, BeliefObject]
    ) -> _Patch:
        width = view.depth.shape[1]
        own = _flat(patch.rows, patch.columns, width)
        ring = _ring(patch.rows, patch.columns, view.depth.shape)
        labels = np.where(view.blocked.ravel()[ring], _UNKNOWN, view.label.ravel()[ring])
        depth = np.round(view.depth.ravel()[own] / DEPTH_UNIT)
        found = [objects[n] for n in patch.detections if n in objects]
        aside = bool(found) and all(each.place == world_facts.ASIDE for each in found)
        explained = bool(found or patch.unexplained) and len(found) == len(patch.detections)
        return _Patch(
            PatchContents(
                patch.label,
                patch.top,
                tuple(KnownPlace(each.id, each.pose) for each in found),
                tuple(UnexplainedBox(u.shape, u.pose, u.colour) for u in patch.unexplained),
                (patch.certain and explained) or aside,
                1,
                view.stamp,
            ),
            own,
            ring,
            np.minimum(depth, np.iinfo(np.uint16).max).astype(np.uint16),
            labels.astype(np.uint8),
            tuple(_flat(u.rows, u.columns, width) for u in patch.unexplained),
        )


def _flat(rows: Pixels, columns: Pixels, width: int) -> NDArray[np.int32]:
    return np.sort(rows * width + columns).astype(np.int32)


def _ring(rows: Pixels, columns: Pixels, shape: tuple[int, ...]) -> NDArray[np.int32]:
    """Return the pixels around a patch within `RING_WIDTH`, as flat indices."""
    y, x = max(int(rows.min()) - RING_WIDTH, 0), max(int(columns.min()) - RING_WIDTH, 0)
    h = min(int(rows.max()) + RING_WIDTH + 1, shape[0]) - y
    w = min(int(columns.max()) + RING_WIDTH + 1, shape[1]) - x
    own = np.zeros((h, w), dtype=np.uint8)
    own[rows - y, columns - x] = 1
    size = 2 * RING_WIDTH + 1
    ring = cv2.dilate(own, np.ones((size, size), np.uint8)) > own
    ring_rows, ring_columns = np.nonzero(ring)
    return _flat(ring_rows + y, ring_columns + x, shape[1])


def _differences(pixels: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the pixels as differences to the one before, which compress well."""
    return np.diff(pixels, prepend=np.int32(0)).astype(np.int32) if len(pixels) else _NO_PIXELS
