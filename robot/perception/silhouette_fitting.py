"""Silhouette fitting: a lying body is fitted to the outline of a blob. It consists of convex parts, whose
pictures are hulls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.world import Array, cross

from .camera_geometry import PosedCamera
from .resting_poses import CIRCLE_CORNERS, StablePose, covered_area, next_corners

PIXEL_SIGMA = 0.33
"""Standard deviation of an outline point from the true edge, pixels: it is half way between two pixels."""
OUTLIER_SIGMAS = 3.0
"""Number of sigmas at which the residual of a point is capped."""
_CIRCLE = np.array([(np.cos(a), np.sin(a)) for a in np.arange(CIRCLE_CORNERS) * (2 * np.pi / CIRCLE_CORNERS)])
_CIRCLE_RADIUS_FACTOR = np.sqrt((2 * np.pi / CIRCLE_CORNERS) / np.sin(2 * np.pi / CIRCLE_CORNERS))
_FAN = np.array([(np.cos(a), np.sin(a)) for a in np.arange(36) * (2 * np.pi / 36)])


@dataclass(frozen=True, eq=False)
class BlobOutline:
    """Points (m, 2) between the pixels of a blob and its surroundings.

    `real` (m,) is False where the blob may extend behind a body that hides it.
    """

    points: Array
    real: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class StandingPose:
    """Pose of an item in a stable pose: centre in the world (3,), m, and turn about the vertical, rad."""

    rest: StablePose
    centre: Array
    yaw: float

    @property
    def turned(self) -> Array:
        """Orientation of the body in the world (3, 3)."""
        c, s = float(np.cos(self.yaw)), float(np.sin(self.yaw))
        return np.array((c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)).reshape(3, 3) @ self.rest.rotation


@dataclass(frozen=True, eq=False)
class SilhouetteFit:
    stand: StandingPose
    misfit: float
    """Mean squared distance of the outline's points from the model's, in sigmas², each capped."""
    covariance: Array
    """Covariance of x, y, yaw (3, 3); m², m·rad, rad²."""
    area: float
    """Area of the silhouette, pixels."""


def silhouette(sight: PosedCamera, stand: StandingPose) -> list[Array]:
    """Return the silhouette as hulls that cover it together: for each convex part its corners (k, 2), pixels.

    The inside of a hull lies to the left of each edge for an eye that sees y point up.
    """
    hulls = (cv2.convexHull(sight.pixels(part).astype(np.float32)) for part in _parts(sight, stand))
    return [hull[:, 0].astype(np.float64) for hull in hulls]


def distances_outside(hulls: Sequence[Array], pixels: Array) -> Array:
    """Return the distance of pixels (n, 2) from a silhouette of hulls, corners (k, 2) each, (n,), pixels; 0
    inside."""
    return np.minimum.reduce([_distances_outside(corners, pixels) for corners in hulls])


def _distances_outside(corners: Array, pixels: Array) -> Array:
    along = np.roll(corners, -1, axis=0) - corners
    squared = np.maximum((along**2).sum(axis=1), 1e-12)
    x, y = (pixels[:, i, None] - corners[:, i] for i in (0, 1))
    sides = along[:, 0] * y - along[:, 1] * x
    found = np.zeros(len(pixels))
    outside = ~((sides >= 0.0).all(axis=1) | (sides <= 0.0).all(axis=1))
    x, y = x[outside], y[outside]
    share = np.clip((x * along[:, 0] + y * along[:, 1]) / squared, 0.0, 1.0)
    found[outside] = np.hypot(x - share * along[:, 0], y - share * along[:, 1]).min(axis=1)
    return found


def _body(sight: PosedCamera, stand: StandingPose) -> Array:
    if not len(stand.rest.outline):
        return _tangent_circle(sight, stand)
    return stand.rest.outline @ _turn(stand.yaw) + stand.centre


def _parts(sight: PosedCamera, stand: StandingPose) -> list[Array]:
    if not stand.rest.parts:
        return [_body(sight, stand)]
    turn = _turn(stand.yaw)
    return [part @ turn + stand.centre for part in stand.rest.parts]


def _turn(yaw: float) -> Array:
    """Return the matrix (3, 3) that turns points, as rows, about the vertical."""
    c, s = float(np.cos(yaw)), float(np.sin(yaw))
    return np.array((c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0)).reshape(3, 3)


def _tangent_circle(sight: PosedCamera, stand: StandingPose) -> Array:
    """Return the polygon (CIRCLE_CORNERS, 3) of the circle's area where the camera's rays graze a sphere."""
    radius = stand.rest.below
    away = stand.centre - sight.origin
    squared = float(away @ away)
    share = radius**2 / squared
    axis = away / np.sqrt(squared)
    side = np.array([1.0, 0.0, 0.0]) - axis * axis[0]
    side /= np.sqrt(side.dot(side))
    across = np.array((side, cross(axis, side)))
    return (
        stand.centre - away * share + _CIRCLE @ across * (radius * np.sqrt(1 - share) * _CIRCLE_RADIUS_FACTOR)
    )


def fit_outline(
    sight: PosedCamera, outline: BlobOutline, start: StandingPose, rounds: int = 5
) -> SilhouetteFit:
    """Fit x, y and yaw by Gauss–Newton on the signed distances between outline and silhouette.

    A point on a hidden border pulls only when it lies outside the model.
    """
    stand = start
    free = 3 if start.rest.turn else 2
    whole, pull = bool(outline.real.all()), np.ones(1)
    while True:
        hulls = silhouette(sight, stand)
        distance, slope = _distances(sight, stand, hulls, outline.points, free)
        rounds -= 1
        if not whole:
            pull = (outline.real | (distance > 0)).astype(np.float64)
        scaled = np.abs(distance) * (pull / PIXEL_SIGMA)
        weighted = slope * (pull / np.maximum(1.0, scaled / 2.0))[:, None]
        inverse = np.linalg.inv(weighted.T @ slope + _DAMPING[:free, :free])
        step = (-inverse @ (weighted.T @ distance)).tolist()
        if rounds < 0:
            break
        x, y = (min(0.02, max(-0.02, c)) for c in step[:2])
        turn = min(0.35, max(-0.35, step[2])) if free == 3 else 0.0
        stand = StandingPose(stand.rest, stand.centre + np.array([x, y, 0.0]), stand.yaw + turn)
        if abs(x) < MIN_FIT_STEP and abs(y) < MIN_FIT_STEP and abs(turn) < MIN_FIT_TURN:
            break
    covariance = np.diag([0.0, 0.0, np.pi**2])
    covariance[:free, :free] = inverse * PIXEL_SIGMA**2
    misfit = float(np.minimum(scaled * scaled, OUTLIER_SIGMAS**2).sum()) / len(distance)
    return SilhouetteFit(stand, misfit, covariance, covered_area(hulls))


MIN_FIT_STEP, MIN_FIT_TURN = 3e-4, 6e-3
"""Step below which the fit ends, m and rad: the rest is of second order."""
_DAMPING = np.diag([0.1, 0.1, 1e-3])
"""Regularisation of the normal equations where the outline determines nothing: pixels²/m², pixels²/rad²."""


def _distances(
    sight: PosedCamera, stand: StandingPose, hulls: Sequence[Array], points: Array, free: int
) -> tuple[Array, Array]:
    """Return the signed distance (m,) of each point from the silhouette, pixels, outside positive, and its
    derivatives.

    The derivatives are by x, y and, if `free` is 3, yaw (m, free). For them only, the image is taken as
    affine about the centre.
    """
    distance, out = _nearest_edges(hulls[0], points)
    for corners in hulls[1:]:
        near, its = _nearest_edges(corners, points)
        nearer = near < distance
        distance, out = np.where(nearer, near, distance), np.where(nearer[:, None], its, out)
    centre = (stand.centre - sight.origin) @ sight.projection.T
    middle = centre[:2] / centre[2]
    by_place = (sight.projection[:2] - middle[:, None] * sight.projection[2])[:, :2] / centre[2]
    slope = np.empty((len(points), free))
    slope[:, :2] = -out @ by_place
    if free == 3:
        turned = (points - middle) @ _turning(by_place)
        slope[:, 2] = -(out[:, 0] * turned[:, 0] + out[:, 1] * turned[:, 1])
    return distance, slope


def _nearest_edges(corners: Array, points: Array) -> tuple[Array, Array]:
    """Return the signed distance (m,) of points (m, 2) from a hull (k, 2), and the normals (m, 2) of the
    edges."""
    along, up = (next_corners(corners) - corners).T
    length = np.sqrt(along * along + up * up) + 1e-9
    out = np.empty_like(corners)
    out[:, 0], out[:, 1] = up / length, -along / length
    away = points @ out.T - (corners[:, 0] * out[:, 0] + corners[:, 1] * out[:, 1])
    nearest = away.argmax(axis=1)
    return away[np.arange(len(points)), nearest], out[nearest]


def _turning(by_place: Array) -> Array:
    """Return the matrix (2, 2) that maps a pixel offset (row) to its change by yaw: M·Q·M⁻¹ transposed, Q a
    quarter turn.

    M is the affine map (2, 2) from the level plane to the image.
    """
    (a, b), (c, d) = by_place.tolist()
    determinant = a * d - b * c
    both = np.array((b * d + a * c, d * d + c * c, -a * a - b * b, -a * c - b * d))
    return both.reshape(2, 2) / determinant


def support(points: Array) -> tuple[Array, Array]:
    """Compute the support function (36,) of the hull of points (n, 2) about its Steiner point, and that point
    (2,).

    The Steiner point turns and moves with the hull, and falls out of the support function's first harmonic
    (Schneider, Convex Bodies, 1.7).
    """
    reach = (points @ _FAN.T).max(axis=0)
    middle = reach @ _FAN / 18.0
    return reach - _FAN @ middle, middle


def likely_turns(
    sight: PosedCamera, stand: StandingPose, seen: tuple[Array, Array], keep: int
) -> list[tuple[float, StandingPose]]:
    """Return starts for the fit, best first, with the mean square that remains, pixels².

    The pose is turned and shifted so that its silhouette's support function fits the one `seen`.
    """
    model, at = support(sight.pixels(_body(sight, stand)))
    count = max(1, round(36 * stand.rest.turn / (2 * np.pi))) if stand.rest.turn else 1
    left = ((model[_SHIFTED[:count]] - seen[0]) ** 2).sum(axis=1) / 36.0
    scale = float((stand.centre - sight.origin) @ sight.rotation[:, 2]) / sight.intrinsics.fx
    x, y = (sight.rotation[:2, :2] @ (seen[1] - at)) * scale
    centre = stand.centre + np.array([x, y, 0.0])
    upwards = -1.0 if sight.rotation[2, 2] < 0 else 1.0
    return [
        (value, StandingPose(stand.rest, centre, stand.yaw + upwards * k * (2 * np.pi / 36)))
        for value, k in _minima(left.tolist())[:keep]
    ]


def seen_turns(
    sight: PosedCamera, stand: StandingPose, seen: tuple[Array, Array], keep: int
) -> list[tuple[float, StandingPose]]:
    """Return starts for the fit as `likely_turns` does, from the silhouette at each turn. It costs more, and
    is exact where a tall body is seen aslant: its sides do not turn with its top."""
    count = max(1, round(36 * stand.rest.turn / (2 * np.pi))) if stand.rest.turn else 1
    scale = float((stand.centre - sight.origin) @ sight.rotation[:, 2]) / sight.intrinsics.fx
    starts: list[tuple[float, StandingPose]] = []
    for k in range(count):
        turned = StandingPose(stand.rest, stand.centre, stand.yaw + k * (2 * np.pi / 36))
        model, at = support(sight.pixels(_body(sight, turned)))
        x, y = (sight.rotation[:2, :2] @ (seen[1] - at)) * scale
        centre = stand.centre + np.array([x, y, 0.0])
        starts.append((float(((model - seen[0]) ** 2).sum()) / 36.0, replace(turned, centre=centre)))
    return [starts[k] for _, k in _minima([left for left, _ in starts])[:keep]]


_SHIFTED = (np.arange(36)[None, :] - np.arange(36)[:, None]) % 36


def _minima(values: list[float]) -> list[tuple[float, int]]:
    """Return the local minima of a periodic row with their indices, lowest first."""
    return sorted(
        (v, k) for k, v in enumerate(values) if v <= values[k - 1] and v <= values[(k + 1) % len(values)]
    )
