"""Hole mouths: those of a scene with the objects that protrude from them, and their detection in a depth
picture.

In a hole, rays pass below the face around it. The face is a plane through the depth around the hole. A ray
whose depth goes beyond that plane passed through the mouth, and was still between the walls a little below
it. These rays have an outline of known form and size. Its place and turn on the face are fitted to all pixels
at once, those beyond the outline and those within it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from picktree.world import Array, Box, Cylinder, ObjectId, Pose, RgbdImage, Shape, hole_geometry, top
from picktree.world.scene import CatalogueEntry, Fixture, Hole

from .camera_geometry import PosedCamera
from .resting_poses import StablePose, stable_poses

MAX_HOLE_OFFSET = 0.012
"""Greatest distance between the middle of an item's visible part, sides included, and its hole, m. The
uncertainty of the hole's place is added."""
MIN_PROTRUSION = 0.004
"""Least protruding height that is recognised, m."""


@dataclass(frozen=True, slots=True)
class ProtrudingPart:
    """Part of an item in a hole that protrudes from it."""

    entry: CatalogueEntry
    """Catalogue entry of the whole item."""
    rest: StablePose
    sunk: float
    """Depth of the item's centre below that of the protruding part, m."""


@dataclass(frozen=True, eq=False)
class HoleMouth:
    """Hole of the believed scene, with the items that fit."""

    id: ObjectId
    at: tuple[float, float]
    """Position x, y in the world, m."""
    height: float
    """Height of the surrounding face in the world, m."""
    reach: float
    """Distance from the mouth within which an item's visible middle may belong to an item in the hole, m."""
    sigma: float
    """Standard deviation of the position along each axis, m."""
    stubs: tuple[ProtrudingPart, ...]
    """Protruding parts of all kinds that fit."""

    @property
    def rests(self) -> tuple[StablePose, ...]:
        return tuple(stub.rest for stub in self.stubs)

    def stub(self, rest: StablePose) -> ProtrudingPart | None:
        return next((stub for stub in self.stubs if stub.rest is rest), None)


class HoleMouths:
    """Holes of a believed scene."""

    def __init__(self, fixtures: Iterable[Fixture], catalogue: Iterable[CatalogueEntry]) -> None:
        entries = tuple(catalogue)
        self._mouths = [_mouth(fixture, hole, entries) for fixture in fixtures for hole in fixture.holes]

    def near(self, x: float, y: float) -> HoleMouth | None:
        """Return the nearest hole within whose reach (x, y) is; None without one."""
        away = [(math.dist((x, y), mouth.at), n) for n, mouth in enumerate(self._mouths)]
        if not away:
            return None
        distance, n = min(away)
        return self._mouths[n] if distance < self._mouths[n].reach else None


def spread(fixture: Fixture) -> float:
    """Return how far a point of the fixture may be from its believed place, m."""
    most = fixture.uncertainty
    if not isinstance(fixture.shape, Box):
        return most.position
    x, y, _ = fixture.shape.size
    return most.position + most.angle * math.hypot(x, y) / 2


def _mouth(fixture: Fixture, hole: Hole, entries: Iterable[CatalogueEntry]) -> HoleMouth:
    x, y, _ = (fixture.pose @ hole.pose).position
    stubs = tuple(stub for entry in entries if (stub := _protruding_part(entry, hole)) is not None)
    away = spread(fixture)
    # It is anywhere within its bounds with equal probability, and nowhere else.
    sigma = max(1e-3, away / math.sqrt(3.0))
    return HoleMouth(hole.id, (x, y), top(fixture.shape, fixture.pose), MAX_HOLE_OFFSET + away, sigma, stubs)


def _protruding_part(entry: CatalogueEntry, hole: Hole) -> ProtrudingPart | None:
    if not hole_geometry.fits_hole(hole, entry.shape):
        return None
    shape: Shape
    match entry.shape:
        case Cylinder(radius, height):
            left, shape = height - hole.depth, Cylinder(radius, height - hole.depth)
        case Box((x, y, z)):
            left, shape = z - hole.depth, Box((x, y, z - hole.depth))
        case _:
            return None
    if left < MIN_PROTRUSION:
        return None
    # The first stable pose is upright, as in the catalogue.
    rest = stable_poses(replace(entry, shape=shape))[0]
    return ProtrudingPart(entry, rest, hole.depth / 2)


FACE_RING_WIDTH = 0.015
"""Half width of the ring around the mouth whose points give the plane of the face, m."""
FIT_RING_WIDTH = 0.005
"""Width of the ring around the mouth that takes part in the fit, m: further away is another hole."""
MAX_FACE_OFFSET = 0.012
"""Distance from the believed face beyond which points are not taken for it, m."""
MIN_DEPTH_BELOW_FACE = 0.003
"""Depth below the face that is beyond noise, m."""
MAX_HEIGHT_ABOVE_FACE = 0.004
"""Height above the face from which a body hides it, m: fingers, held objects."""
OUTLINE_WIDTHS = (0.002, 0.0006)
"""Widths of the outline in the two fits, m: first wide, to converge from afar, then narrow, to be exact."""
CIRCLE_RADIUS_FACTOR = 1.0016
"""Radius of the circle with the area of a regular polygon of 32 sides around a circle of radius 1."""
MIN_MOUTH_PIXELS = 60
"""Least number of pixels within the mouth."""
MIN_VISIBLE_SHARE = 0.6
"""Least share of the mouth that must be in view."""
MIN_AGREEMENT = 0.95
"""Least share of pixels on the correct side of the outline."""
MAX_MOUTH_TURN = math.radians(10.0)
"""Greatest turn from the believed pose, rad."""


@dataclass(frozen=True, slots=True)
class DetectedHole:
    """Hole as one picture shows it, through the camera pose that the picture states."""

    pose: Pose
    """Pose of the mouth's middle in the world: z out of the hole, x along a slot."""
    agreement: float
    """Share of pixels that are on the correct side of the outline."""
    pixels: int
    """Number of pixels within the mouth."""


def detect_hole(image: RgbdImage, hole: Hole, believed: Pose, off: float) -> DetectedHole | None:
    """Locate the hole whose mouth is `believed` there in the world, to `off` m. None when the picture does
    not show it clearly."""
    sight = PosedCamera.at(image.intrinsics, image.camera_in_world)
    camera = believed.inverse() @ image.camera_in_world
    rows, columns = np.nonzero(image.depth > 0)
    pixels = np.column_stack([columns, rows]).astype(np.float64)
    rays: Array = sight.directions(pixels) @ believed.rotation()
    points: Array = np.array(camera.position) + rays * image.depth[rows, columns].astype(np.float64)[:, None]
    reach = max(hole.size) / 2 * (1.0 if hole.form == "round" else math.sqrt(2.0)) + off
    face = _fit_face(points, reach, off)
    if face is None:
        return None
    # All that follows is in a frame on the measured face, with the believed mouth's directions.
    turn = face.rotation()
    rays, points = rays @ turn, face.inverse().apply(points)
    eye = face.inverse().apply(np.array(camera.position))
    onto = -eye[2] / np.where(np.abs(rays[:, 2]) < 1e-9, -1e-9, rays[:, 2])
    there = eye[:2] + rays[:, :2] * onto[:, None]
    near = (
        (onto > 0)
        & (_depth_inside(hole, there, np.zeros(3)) > -off - FIT_RING_WIDTH)
        & (points[:, 2] < MAX_HEIGHT_ABOVE_FACE)
    )
    if int(near.sum()) < 2 * MIN_MOUTH_PIXELS:
        return None
    below = points[near, 2] < -max(MIN_DEPTH_BELOW_FACE, hole.chamfer + MIN_DEPTH_BELOW_FACE / 2)
    if int(below.sum()) < MIN_MOUTH_PIXELS:
        return None
    slant = rays[near, :2] / -rays[near, 2:]
    fit = _Fit(
        hole, there[near], slant, below, max(MIN_DEPTH_BELOW_FACE, hole.chamfer + MIN_DEPTH_BELOW_FACE / 2)
    )
    place = fit.solved(off)
    if place is None:
        return None
    x, y, yaw = place.tolist()
    agreement = fit.agreement(place)
    inside = int(below.sum())
    if agreement < MIN_AGREEMENT or inside < MIN_VISIBLE_SHARE * _pixels_of(hole, image, eye):
        return None
    if hole.form == "round":
        yaw = 0.0
    on_face = Pose((x, y, 0.0), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))
    return DetectedHole(believed @ face @ on_face, agreement, inside)


def _fit_face(points: Array, reach: float, off: float) -> Pose | None:
    """Fit the plane of the face around the mouth. None when too little of it is seen, or it is too far off.

    The result is a frame on the plane, given in the believed mouth's frame; its origin is straight above or
    below the mouth's.
    """
    aside = np.hypot(points[:, 0], points[:, 1])
    around = (
        (aside > reach) & (aside < reach + 2 * FACE_RING_WIDTH) & (np.abs(points[:, 2]) < MAX_FACE_OFFSET)
    )
    if int(around.sum()) < MIN_MOUTH_PIXELS:
        return None
    chosen = points[around]
    plane = np.zeros(3)
    keep = np.ones(len(chosen), dtype=np.bool_)
    for _ in range(5):
        if int(keep.sum()) < MIN_MOUTH_PIXELS:
            return None
        design = np.column_stack([chosen[:, :2], np.ones(len(chosen))])
        plane = np.asarray(np.linalg.lstsq(design[keep], chosen[keep, 2], rcond=None)[0], np.float64)
        left = np.abs(chosen[:, 2] - design @ plane)
        keep = left < 3.0 * max(2e-4, 1.5 * float(np.median(left[keep])))
    normal = np.array([-plane[0], -plane[1], 1.0])
    normal /= np.linalg.norm(normal)
    if normal[2] < math.cos(MAX_MOUTH_TURN) or abs(float(plane[2])) > MAX_FACE_OFFSET:
        return None
    x = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
    x /= np.linalg.norm(x)
    return Pose.from_rotation((0.0, 0.0, float(plane[2])), np.column_stack([x, np.cross(normal, x), normal]))


class _Fit:
    """Fit of an outline's place (x, y) and turn, so that it separates rays that go below the face from the
    others."""

    def __init__(self, hole: Hole, there: Array, slant: Array, below: NDArray[np.bool_], deep: float) -> None:
        """Precompute the rays' points at the upper and lower end of the walls.

        `there` (n, 2): where rays meet the face. `slant` (n, 2): their sideways travel for each metre below
        it. `below` (n,): which of them go `deep` m below it.
        """
        self._hole = hole
        # The walls begin below the chamfer. A ray counts as below when it is between them from the chamfer
        # on.
        self._upper = there + slant * hole.chamfer
        self._lower = there + slant * deep
        self._below = below.astype(np.float64)

    def solved(self, off: float) -> Array | None:
        """Return (x, y, yaw), or None when that is further from the belief than allowed."""
        from scipy.optimize import least_squares  # slow to import

        inside = self._below > 0.5
        first = np.array([*((self._upper + self._lower) / 2)[inside].mean(axis=0), 0.0])
        place = first
        for soft in OUTLINE_WIDTHS:
            width = soft
            found = least_squares(
                lambda guess: self._misses(guess, width),  # noqa: B023 - used up before it changes
                place,
                x_scale=np.array([1e-3, 1e-3, 2e-2]),
            )
            place = found.x
        far = math.hypot(float(place[0]), float(place[1])) > 1.5 * off + 0.002
        return None if far or abs(float(place[2])) > MAX_MOUTH_TURN else place

    def agreement(self, place: Array) -> float:
        return float(((self._depth(place) > 0) == (self._below > 0.5)).mean())

    def _misses(self, place: Array, soft: float) -> Array:
        expected = 0.5 * (1.0 + np.tanh(self._depth(place) / soft))
        held = place[2] if self._hole.form != "round" else 10.0 * place[2]
        return np.concatenate([expected - self._below, [0.1 * held]])

    def _depth(self, place: Array) -> Array:
        """Return how far within the outline both points of each ray are (n,), m; negative outside."""
        return np.minimum(
            _depth_inside(self._hole, self._upper, place), _depth_inside(self._hole, self._lower, place)
        )


def _depth_inside(hole: Hole, points: Array, place: Array) -> Array:
    """Return how far points (n, 2) of the face are within the walls of a hole at (x, y, yaw), (n,), m;
    negative outside."""
    aside = points - place[:2]
    if hole.form == "round":
        return CIRCLE_RADIUS_FACTOR * hole.size[0] / 2 - np.hypot(aside[:, 0], aside[:, 1])
    c, s = math.cos(float(place[2])), math.sin(float(place[2]))
    along = np.abs(aside @ np.array([c, s])) - hole.size[0] / 2
    across = np.abs(aside @ np.array([-s, c])) - hole.size[1] / 2
    return -np.maximum(along, across)


def _pixels_of(hole: Hole, image: RgbdImage, eye: Array) -> float:
    """Estimate the number of pixels that the mouth fills when it is seen whole."""
    area = math.pi / 4 * hole.size[0] ** 2 if hole.form == "round" else hole.size[0] * hole.size[1]
    distance = float(np.linalg.norm(eye))
    slant = abs(float(eye[2])) / distance
    return area * slant * image.intrinsics.fx * image.intrinsics.fy / distance**2
