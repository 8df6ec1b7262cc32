"""Joint estimate of target, cameras and tool from all images and touches, by robust non-linear least squares.

Hand-eye calibration in closed form gives the first guess.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares

from picktree.files import PicktreeError
from picktree.world import Array, Pose, Vector3, vector3
from picktree.world.scene import TargetTile

from .observations import CalibrationData, TargetImage
from .target_detection import align_points, area_and_centroid, pixels_of

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
            for p, d in [self._weighted_tiles(shot, guess, n)]
        ]
        return np.concatenate([*parts, self._weighted_touches(guess), self._prior_residuals(guess)])

    def camera_residuals(self, guess: CalibrationParameters, camera: int) -> tuple[Array, Array]:
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

    def touch_residuals(self, guess: CalibrationParameters) -> Array:
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

    def _weighted_touches(self, guess: CalibrationParameters) -> Array:
        return self.touch_residuals(guess) / TOUCH_SIGMA

    def _weighted_tiles(
        self, shot: TargetImage, guess: CalibrationParameters, camera: int
    ) -> tuple[Array, Array]:
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

    def _prior_residuals(self, guess: CalibrationParameters) -> Array:
        first = self._first
        off = guess.target @ first.target.inverse()
        x, y, z, w = off.orientation
        shift = np.subtract(guess.target.position, first.target.position) / PRIOR_POSITION_SIGMA
        turn = 2.0 * np.sign(w or 1.0) * np.array([x, y, z]) / PRIOR_ANGLE_SIGMA
        tool = (guess.tool - first.tool) / PRIOR_POSITION_SIGMA
        zooms = np.array(guess.zooms) / FOCAL_LENGTH_SIGMA
        return np.concatenate([shift, turn, tool, zooms, [guess.yields / COMPLIANCE_SIGMA]])


MIN_HAND_VIEWS = 4
"""Minimum number of views by a camera on the hand."""
MIN_AXIS_SPREAD = math.radians(30.0)
"""Minimum angle between the hand's rotation axes, rad."""
MAX_TOOL_DEVIATION = 5e-4
"""Maximum standard deviation of the tool's position in any direction, m. Above it the tool is not
corrected."""
DIFFERENCE_STEP = 1e-6
"""Step of the central differences that approximate derivatives, m and rad."""


@dataclass(frozen=True, slots=True)
class PoseDeviation:
    """Standard deviations of a pose: m along each axis of its parent, rad about each."""

    position: Vector3
    angle: Vector3


@dataclass(frozen=True, slots=True)
class CameraEstimate:
    """Estimated pose of a camera."""

    name: str
    on_hand: bool
    pose: Pose
    """Optical frame in the world, or in the TCP for a camera on the hand. The TCP is the corrected one
    when the tool is `sure`."""
    before: Pose
    """Believed pose before the calibration: the same frame in the world, or in the believed TCP."""
    deviation: PoseDeviation
    shots: int
    pixels: float
    """Root mean square of the residuals, pixels."""
    depth: float
    """Root mean square of the depth residuals, m."""

    @property
    def moved(self) -> float:
        """Distance between estimated and believed position, m."""
        return self.pose.distance(self.before)

    @property
    def turned(self) -> float:
        """Angle between estimated and believed orientation, rad."""
        return self.pose.angle(self.before)


@dataclass(frozen=True, slots=True)
class ToolEstimate:
    """Estimated TCP. Touches with the finger tips determine its position, not the orientation of the hand."""

    offset: Vector3
    """Estimated TCP in the frame of the believed TCP, m."""
    deviation: Vector3
    touches: int
    left: float
    """Root mean square of the residuals at the faces, m."""

    @property
    def sure(self) -> bool:
        """Whether the touches determine the tool's position in all three directions."""
        return max(self.deviation) < MAX_TOOL_DEVIATION


@dataclass(frozen=True, slots=True)
class CalibrationEstimate:
    """Result of a calibration."""

    cameras: tuple[CameraEstimate, ...]
    tool: ToolEstimate | None
    """Estimated tool; None: the data contain no touches."""
    target: Pose
    """Estimated pose of the target in the world."""


def estimate(
    evidence: CalibrationData, tiles: Sequence[TargetTile], size: Vector3, believed: Pose
) -> CalibrationEstimate:
    """Estimate cameras, tool and target from the data. `tiles` and `size` (m) are those of the target;
    `believed` is its pose in the world to within centimetres.

    Starts from the closed form of each camera on the hand, then minimises all residuals at once; outliers
    lose weight (Huber). Standard deviations follow from the normal equations; residuals above the expected
    ones scale them. Raises PicktreeError when the data do not determine cameras or target.
    """
    names = list(dict.fromkeys(shot.camera for shot in evidence.shots))
    by_camera = {name: [shot for shot in evidence.shots if shot.camera == name] for name in names}
    target = _first_target(by_camera, tiles, believed, touched=bool(evidence.touches))
    cameras = tuple(_first_camera(shots, tiles, target) for shots in by_camera.values())
    first = CalibrationParameters(target, cameras, (0.0,) * len(cameras), np.zeros(3), 0.0)
    residuals = CalibrationResiduals(evidence, tiles, np.array(size), names, replace(first, target=believed))
    best, sigma = _solved(residuals, first)
    tool = None
    if evidence.touches:
        left = float(np.sqrt((residuals.touch_residuals(best) ** 2).mean()))
        tool = ToolEstimate(vector3(best.tool), vector3(sigma[-4:-1]), len(evidence.touches), left)
    corrected = Pose(tool.offset) if tool is not None and tool.sure else Pose()
    found: list[CameraEstimate] = []
    for n, (name, shots) in enumerate(by_camera.items()):
        pixels, depths = residuals.camera_residuals(best, n)
        pose = best.cameras[n]
        if shots[0].on_hand:
            pose = corrected.inverse() @ pose
        found.append(
            CameraEstimate(
                name,
                shots[0].on_hand,
                pose,
                shots[0].believed,
                _deviation(sigma[6 * n + 6 : 6 * n + 12]),
                len(shots),
                float(np.sqrt((pixels**2).sum(axis=1).mean())),
                float(np.sqrt((depths**2).mean())),
            )
        )
    return CalibrationEstimate(tuple(found), tool, best.target)


def _first_target(
    by_camera: dict[str, list[TargetImage]], tiles: Sequence[TargetTile], believed: Pose, *, touched: bool
) -> Pose:
    """Return the first guess of the target's pose in the world: from the first camera on the hand, else
    the believed pose, which touches correct. Raises PicktreeError when there are neither."""
    on_hand = [shots for shots in by_camera.values() if shots[0].on_hand]
    for shots in on_hand:
        _suffices(shots)
        shot = shots[0]
        return shot.tcp @ camera_in_tcp(shots, tiles) @ target_in_camera(shot, tiles)
    if not touched:
        names = ", ".join(by_camera)
        raise PicktreeError(
            f"the pose of the target is unknown: nothing touched it, and {names} is fixed; "
            "calibrate a camera on the hand or the tool with it"
        )
    return believed


def _first_camera(shots: Sequence[TargetImage], tiles: Sequence[TargetTile], target: Pose) -> Pose:
    if shots[0].on_hand:
        _suffices(shots)
        return camera_in_tcp(shots, tiles)
    return target @ target_in_camera(shots[0], tiles).inverse()


def _suffices(shots: Sequence[TargetImage]) -> None:
    name = shots[0].camera
    if len(shots) < MIN_HAND_VIEWS:
        raise PicktreeError(
            f"{name}: the target was seen from {len(shots)} places; {MIN_HAND_VIEWS} are needed"
        )
    if (angle := spread(shots)) < MIN_AXIS_SPREAD:
        raise PicktreeError(
            f"{name}: the hand was turned about axes that are {math.degrees(angle):.0f}° apart at most; "
            f"{math.degrees(MIN_AXIS_SPREAD):.0f}° are needed to tell where the camera is"
        )


def _solved(
    residuals: CalibrationResiduals, first: CalibrationParameters
) -> tuple[CalibrationParameters, Array]:
    """Return the best parameters, and the standard deviations (size,) of their numbers."""
    best, left = first, np.empty(0)
    jacobian = np.empty((0, 0))
    # Turns are about where a pose was last, so that they stay small: twice is enough.
    for _ in range(2):
        at = best
        found = least_squares(
            lambda step: residuals.of(at.moved(step)),  # noqa: B023 - used up before `at` changes
            np.zeros(first.size),
            loss="huber",
            f_scale=2.0,
            x_scale=_scale(first.size),
            diff_step=None,
            xtol=1e-10,
            ftol=1e-10,
        )
        best = at.moved(found.x)
        left = residuals.of(best)
        jacobian = _differences(residuals, best)
    weights = np.minimum(1.0, 2.0 / np.maximum(np.abs(left), 1e-12))
    normal = jacobian.T @ (jacobian * weights[:, None])
    spare = max(1.0, float(weights.sum()) - first.size)
    excess = max(1.0, float((weights * left**2).sum()) / spare)
    return best, np.sqrt(np.diag(np.linalg.inv(normal)) * excess)


def _scale(size: int) -> Array:
    scale = np.full(size, 1e-3)
    scale[-1] = 1e-5
    return scale


def _differences(residuals: CalibrationResiduals, at: CalibrationParameters) -> Array:
    """Return the Jacobian (n, size) of the residuals, by central differences."""
    steps = np.full(at.size, DIFFERENCE_STEP)
    steps[-1] = DIFFERENCE_STEP / 100
    columns = [
        (residuals.of(at.moved(unit * step)) - residuals.of(at.moved(-unit * step))) / (2 * step)
        for unit, step in zip(np.eye(at.size), steps, strict=True)
    ]
    return np.column_stack(columns)


def _deviation(sigma: Array) -> PoseDeviation:
    return PoseDeviation(vector3(sigma[:3]), vector3(sigma[3:]))


MIN_VIEW_ROTATION = math.radians(10.0)
"""Minimum rotation between two views, rad; smaller ones determine the rotation axis poorly."""


def target_in_camera(shot: TargetImage, tiles: Sequence[TargetTile]) -> Pose:
    """Return the target's pose in the camera's optical frame, from the squares' depths alone, unweighted."""
    i = shot.intrinsics
    rays = np.array([((t.pixel[0] - i.cx) / i.fx, (t.pixel[1] - i.cy) / i.fy, 1.0) for t in shot.tiles])
    depths = np.array([t.depth for t in shot.tiles])
    return align_points(np.array([tiles[t.index].centre for t in shot.tiles]), rays * depths[:, None])


def camera_in_tcp(shots: Sequence[TargetImage], tiles: Sequence[TargetTile]) -> Pose:
    """Solve AX = XB for X, the camera in the TCP, with views that `spread` accepts. A is the hand's motion
    between two views, B the camera's motion relative to the target. The rotation is solved first, then the
    translation. Park & Martin (1994)."""
    views = [(shot.tcp, target_in_camera(shot, tiles)) for shot in shots]
    motions = [
        (hand.inverse() @ first, seen @ there.inverse())
        for (first, there), (hand, seen) in combinations(views, 2)
    ]
    alphas = np.array([_turn(a) for a, _ in motions])
    betas = np.array([_turn(b) for _, b in motions])
    u, _, vt = np.linalg.svd(alphas.T @ betas)
    rotation: Array = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    left = np.concatenate([a.rotation() - np.eye(3) for a, _ in motions])
    right = np.concatenate([rotation @ np.array(b.position) - np.array(a.position) for a, b in motions])
    translation: Array = np.asarray(np.linalg.lstsq(left, right, rcond=None)[0], np.float64)
    return Pose.from_rotation(translation, rotation)


def spread(shots: Sequence[TargetImage]) -> float:
    """Return the greatest angle between two rotation axes of the hand over all pairs of views, rad.
    Rotations about one axis alone leave the camera's position along it undetermined (Tsai & Lenz 1989)."""
    axes = [axis for one, other in combinations(shots, 2) if (axis := _axis(one.tcp, other.tcp)) is not None]
    if len(axes) < 2:
        return 0.0
    between = np.abs(np.array(axes) @ np.array(axes).T)
    return float(np.arccos(np.clip(between.min(), 0.0, 1.0)))


def _axis(one: Pose, other: Pose) -> Array | None:
    turn = _turn(one.inverse() @ other)
    angle = float(np.linalg.norm(turn))
    return None if angle < MIN_VIEW_ROTATION else turn / angle


def _turn(pose: Pose) -> Array:
    """Return the rotation vector (3,), rad."""
    x, y, z, w = pose.orientation
    size = math.sqrt(x * x + y * y + z * z)
    angle = 2.0 * math.atan2(size, abs(w))
    return np.array([x, y, z]) * (math.copysign(angle, w) / max(size, 1e-12))
