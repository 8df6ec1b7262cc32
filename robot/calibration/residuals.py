"""Residuals of calibration parameters against images and touches, in standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...world.scene.calibration_results import TargetTile
from ...world.values import Array, Pose
from .observations import CalibrationData, TargetImage
from .target_detection import area_and_centroid, pixels_of

PIXEL_SIGMA, EDGE_SIGMA = 0.05, 0.3
"""Standard deviation of a square's centroid, pixels, measured on images: `PIXEL_SIGMA` plus `EDGE_SIGMA` over
the length of its edge."""
DEPTH_SIGMA = 3e-5
"""Standard deviation of a square's mean depth beyond that from its scatter, m."""
TOUCH_SIGMA = 1e-4
"""Standard deviation of the fingers' position at a touch, m."""
COMPLIANCE_SIGMA = 1e-4
"""Standard deviation of the compliance of fingers and target, m/N, around 0. Touches of different force
determine the compliance."""
FOCAL_LENGTH_SIGMA = 1e-3
"""Standard deviation of a camera's focal length, as a share of the stated one."""
PRIOR_POSITION_SIGMA, PRIOR_ANGLE_SIGMA = 0.03, 0.2
"""Prior standard deviations of the poses of target and tool, m and rad; wide enough that measurements
dominate."""


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationParameters:
    """Parameters of a calibration. A pose changes by a shift of its origin and a rotation about it, in the
    parent's axes."""

    target: Pose
    """Pose of the target in the world."""
    cameras: tuple[Pose, ...]
    """Optical frame of each camera in the believed TCP, or in the world for a fixed camera."""
    zooms: tuple[float, ...]
    """Relative error of each camera's focal length; positive: longer than stated."""
    tool: Array
    """Position (3,) of the true TCP in the frame of the believed one, m."""
    yields: float
    """Compliance of fingers and target, m/N."""

    @property
    def size(self) -> int:
        return 6 + 7 * len(self.cameras) + 4

    def moved(self, step: Array) -> CalibrationParameters:
        """Return the parameters changed by `step` (size,): target and cameras (m, rad), focal lengths
        (shares), tool (m), compliance (m/N)."""
        poses = [_moved(pose, step[6 * n : 6 * n + 6]) for n, pose in enumerate((self.target, *self.cameras))]
        longer = step[6 * len(poses) : -4].tolist()
        return replace(
            self,
            target=poses[0],
            cameras=tuple(poses[1:]),
            zooms=tuple(zoom + more for zoom, more in zip(self.zooms, longer, strict=True)),
            tool=self.tool + step[-4:-1],
            yields=self.yields + float(step[-1]),
        )


def _moved(pose: Pose, step: Array) -> Pose:
    angle = float(np.linalg.norm(step[3:]))
    axis = step[3:] / angle if angle > 1e-12 else np.zeros(3)
    x, y, z = np.sin(angle / 2) * axis
    turn = Pose(orientation=(float(x), float(y), float(z), float(np.cos(angle / 2))))
    return Pose(pose.position, (turn @ Pose(orientation=pose.orientation)).orientation).shifted(step[:3])


class CalibrationResiduals:
    """Residuals of one set of calibration data. `names` are the cameras, in the order of
    `CalibrationParameters.cameras`."""

    def __init__(
        self,
        evidence: CalibrationData,
        tiles: Sequence[TargetTile],
        size: Array,
        names: Sequence[str],
        first: CalibrationParameters,
    ) -> None:
        """`size` (3,): edges of the target's box, m; `first`: what was believed before."""
        self._shots = evidence.shots
        self._touches = evidence.touches
        self._tips = evidence.tips
        self._half = size / 2
        self._first = first
        self._corners = np.array([tile.corners() for tile in tiles])
        self._centres = np.array([tile.centre for tile in tiles])
        self._camera_of = [names.index(shot.camera) for shot in self._shots]

    def of(self, guess: CalibrationParameters) -> Array:
        """Return all residuals (n,): pixels and depths of all images, then touches, then the prior."""
        parts = [
            np.concatenate([p.ravel(), d])
            for shot, n in zip(self._shots, self._camera_of, strict=True)
            for p, d in [self._seen(shot, guess, n)]
        ]
        return np.concatenate([*parts, self._felt(guess), self._known(guess)])

    def seen(self, guess: CalibrationParameters, camera: int) -> tuple[Array, Array]:
        """Return the residuals of one camera: pixels (n, 2) and depths (n,) m, not normalised."""
        pixels, depths = zip(
            *(
                self._misses(shot, guess, camera)
                for shot, n in zip(self._shots, self._camera_of, strict=True)
                if n == camera
            ),
            strict=True,
        )
        return np.concatenate(pixels), np.concatenate(depths)

    def felt(self, guess: CalibrationParameters) -> Array:
        """Return the distances (n,) between the fingers and the faces that they touch, m, not normalised."""
        turn, place = guess.target.rotation(), np.array(guess.target.position)
        found: list[float] = []
        for touch in self._touches:
            normal = turn @ np.array(touch.face)
            tips = touch.tcp.apply(self._tips + guess.tool)
            reach = float(np.abs(np.array(touch.face)) @ self._half)
            gap = float(((tips - place) @ normal).min()) - reach
            found.append(gap + guess.yields * touch.force)
        return np.array(found)

    def _felt(self, guess: CalibrationParameters) -> Array:
        return self.felt(guess) / TOUCH_SIGMA

    def _seen(self, shot: TargetImage, guess: CalibrationParameters, camera: int) -> tuple[Array, Array]:
        pixels, depths = self._misses(shot, guess, camera)
        edges = np.sqrt(np.array([tile.area for tile in shot.tiles]))
        sigma = np.hypot(DEPTH_SIGMA, np.array([tile.depth_sigma for tile in shot.tiles]))
        return pixels / (PIXEL_SIGMA + EDGE_SIGMA / edges)[:, None], depths / sigma

    def _misses(self, shot: TargetImage, guess: CalibrationParameters, camera: int) -> tuple[Array, Array]:
        if not shot.tiles:
            return np.empty((0, 2)), np.empty(0)
        pose = guess.cameras[camera]
        optical = shot.tcp @ pose if shot.on_hand else pose
        target = optical.inverse() @ guess.target
        turn, place = target.rotation(), np.array(target.position)
        which = [tile.index for tile in shot.tiles]
        zoom = 1.0 + guess.zooms[camera]
        i = replace(shot.intrinsics, fx=shot.intrinsics.fx * zoom, fy=shot.intrinsics.fy * zoom)
        outlines = pixels_of(self._corners[which] @ turn.T + place, i)
        pixels = area_and_centroid(outlines)[1] - np.array([tile.pixel for tile in shot.tiles])
        at = np.array([tile.depth_pixel for tile in shot.tiles])
        rays = np.column_stack([(at[:, 0] - i.cx) / i.fx, (at[:, 1] - i.cy) / i.fy, np.ones(len(at))])
        normal = turn[:, 2]
        on_top = float(normal @ (turn @ self._centres[0] + place))
        return pixels, on_top / (rays @ normal) - np.array([tile.depth for tile in shot.tiles])

    def _known(self, guess: CalibrationParameters) -> Array:
        first = self._first
        off = guess.target @ first.target.inverse()
        x, y, z, w = off.orientation
        shift = np.subtract(guess.target.position, first.target.position) / PRIOR_POSITION_SIGMA
        turn = 2.0 * np.sign(w or 1.0) * np.array([x, y, z]) / PRIOR_ANGLE_SIGMA
        tool = (guess.tool - first.tool) / PRIOR_POSITION_SIGMA
        zooms = np.array(guess.zooms) / FOCAL_LENGTH_SIGMA
        return np.concatenate([shift, turn, tool, zooms, [guess.yields / COMPLIANCE_SIGMA]])
