"""Robot mask: pixels of the robot in a picture, from the hull of each link at the measured joints."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.files import disk_cache
from picktree.world import (
    Array,
    BeliefObject,
    ConvexMesh,
    Pose,
    Shape,
    convex_hull,
    corners,
    inside,
    shapes,
    values,
)
from picktree.world.robot_model import LinkShape, fingerprint
from picktree.world.scene import SceneDescription

from .camera_geometry import PosedCamera
from .camera_registration import ConvexFacets

if TYPE_CHECKING:
    from picktree.world.robot_model import RobotModel

MASK_GROWTH_PIXELS = 3
"""Pixels by which the mask is larger than the model."""
HULL_DIRECTIONS = 96
"""Number of directions; the furthest point in each represents a link's hull."""
ATTACHED_PIXELS = 16
"""Distance from the model within which connected pixels belong to the robot, pixels."""
MAX_STEP_OF_BODY, MIN_BODY_PIXELS = 0.02, 20
"""Greatest step in height between neighbouring pixels of one surface, m, and least number of its pixels
beyond that distance. With as many it is another body."""
_FAR = 1e6
MOUNTING_ERROR = 0.015
"""Greatest apparent displacement of the hand by an error of a camera's mounting, m."""
HAND_REACH = 0.4
"""Distance from the TCP beyond which nothing belongs to the hand, m."""
MIN_CONVEX_SHARE = 0.98
"""Least share of its hull that a convex link fills."""
ATTACHED_HEIGHT = 0.15
"""Height over the table above which connected pixels belong to the robot, m."""
AREA_POINTS = 15
"""Number of points along each side of an area of items."""


class RobotShape(Protocol):
    """Robot model as perception uses it."""

    @property
    def finger_links(self) -> tuple[str, ...]: ...
    def tcp(self, q: Array) -> Pose: ...
    def link_poses(self, q: Array, width: float) -> dict[str, Pose]: ...
    def collision_shapes(self) -> tuple[LinkShape, ...]: ...


class _Hull:
    """Hull of a link in the link's frame: points (n, 3), and inside is `normals @ x <= offsets`."""

    def __init__(self, points: Array, equations: Array) -> None:
        self.points = points
        self.normals: Array = equations[:, :3].copy()
        self.offsets: Array = -equations[:, 3]
        self.middle: Array = points.mean(axis=0)
        self.radius = float(np.linalg.norm(points - self.middle, axis=1).max())

    def facets(self, pose: Pose) -> ConvexFacets:
        """Return the hull in the world, for a link at this pose."""
        normals = self.normals @ pose.rotation().T
        offsets = self.offsets + normals @ np.array(pose.position)
        return ConvexFacets(normals, offsets, pose.apply(self.middle), self.radius)


class RobotMask:
    """Masks of the robot in pictures. The links are loaded once; `paint` costs one projection and one filled
    polygon a link."""

    def __init__(self, robot: RobotShape) -> None:
        self._robot = robot
        parts = robot.collision_shapes()
        kept = disk_cache.cached_arrays(
            "link-hulls", (fingerprint(parts),), _MAKERS, lambda: _link_hulls(parts)
        )
        self._hulls: list[tuple[str, _Hull]] = [
            (part.link, _Hull(kept[f"{n} points"], kept[f"{n} equations"])) for n, part in enumerate(parts)
        ]
        names = robot.finger_links
        convex = all(part.filling > MIN_CONVEX_SHARE for part in parts if part.link in names)
        self._fingers = [(link, hull) for link, hull in self._hulls if link in names and convex]

    def tcp(self, joints: Array) -> Pose:
        """Return the TCP in the world at `joints` (n,) rad."""
        return self._robot.tcp(joints)

    def paint(
        self, sight: PosedCamera, joints: Array, width: float, held: tuple[Shape, Pose] | None
    ) -> NDArray[np.bool_]:
        """Return the pixels (h, w) of the robot at `joints` (n,) and opening `width`, and of the held object.

        `held` is a shape with its pose in the TCP frame.
        """
        mask = np.zeros((sight.intrinsics.height, sight.intrinsics.width), dtype=np.uint8)
        for points in self._placed(sight, joints, width, held):
            fill(mask, sight.pixels(points))
        return _grown(mask, MASK_GROWTH_PIXELS)

    def hidden_share(self, sight: PosedCamera, points: Array, joints: Array, width: float) -> float:
        """Return the share of the points (n, 3) in a camera's picture that the robot hides, 0 … 1.

        1 where the picture shows none of them.
        """
        i = sight.intrinsics
        columns, rows = np.rint(sight.pixels(points)).astype(np.int64).T
        shown = (columns >= 0) & (columns < i.width) & (rows >= 0) & (rows < i.height)
        if not shown.any():
            return 1.0
        return float(self.paint(sight, joints, width, None)[rows[shown], columns[shown]].mean())

    def nearby(
        self,
        sight: PosedCamera,
        depth: Array,
        joints: Array,
        width: float,
        held: tuple[Shape, Pose] | None,
        reach: float = HAND_REACH,
    ) -> NDArray[np.bool_]:
        """Return the pixels (h, w) that show something within MOUNTING_ERROR of the robot or the held object.

        They are at most `reach` m from the TCP.

        A hand camera sees the fingers from so near that an error of its mounting shifts them far beyond
        `paint`. The same happens overhead where the arm is high.
        """
        rows, columns = np.nonzero(depth > 0)
        pixels = np.stack([columns, rows], axis=1).astype(np.float64)
        points = sight.origin + sight.directions(pixels) * depth[rows, columns][:, None]
        of_robot = self.within(points, joints, width, held, MOUNTING_ERROR, reach)
        found = np.zeros(depth.shape, dtype=np.uint8)
        found[rows[of_robot], columns[of_robot]] = 1
        # Depth is often lost at the edges of near bodies.
        return found.astype(np.bool_) | (_grown(found, 2) & (depth <= 0))

    def within(
        self,
        points: Array,
        joints: Array,
        width: float,
        held: tuple[Shape, Pose] | None,
        distance: float,
        reach: float = math.inf,
    ) -> NDArray[np.bool_]:
        """Select the points (n, 3) of the world within `distance` m of the robot or the held object, at most
        `reach` m from the TCP."""
        tcp, poses = self._robot.tcp(joints), self._robot.link_poses(joints, width)
        near = np.flatnonzero(((points - np.array(tcp.position)) ** 2).sum(axis=1) < reach**2)
        found = np.zeros(len(points), dtype=np.bool_)
        for link, hull in self._hulls:
            middle = poses[link].apply(hull.middle)
            away = ((points[near] - middle) ** 2).sum(axis=1)
            about = near[away < (hull.radius + distance) ** 2]
            local = poses[link].inverse().apply(points[about])
            found[about] |= np.all(local @ hull.normals.T <= hull.offsets + distance, axis=1)
        if held is not None:
            shape, in_tcp = held
            found[near] |= inside(shape, tcp @ in_tcp, points[near], distance)
        return found

    def fingers(self, joints: Array, width: float) -> tuple[ConvexFacets, ...]:
        """Return the fingers in the world; none when a finger is not convex."""
        poses = self._robot.link_poses(joints, width)
        return tuple(hull.facets(poses[link]) for link, hull in self._fingers)

    def _placed(
        self, sight: PosedCamera, joints: Array, width: float, held: tuple[Shape, Pose] | None
    ) -> Iterator[Array]:
        """Yield the points (n, 3) in the world of each link and of the held object, without those behind the
        camera."""
        poses = self._robot.link_poses(joints, width)
        bodies = [poses[link].apply(hull.points) for link, hull in self._hulls]
        if held is not None:
            shape, in_tcp = held
            bodies.append((self._robot.tcp(joints) @ in_tcp).apply(corners(shape)))
        for points in bodies:
            before = sight.before(points)
            if len(before):
                yield before


def hidden_shares(robot: RobotModel, scene: SceneDescription, configuration: Array) -> dict[str, float]:
    """Return the share of the items' areas that the arm hides at a configuration (n,), rad, by camera.

    Cameras on the hand are left out: they move with the arm. Empty for a scene without such areas.
    """
    points = [_grid(*load.rectangle) for load in scene.loads]
    if not points:
        return {}
    mask, width = RobotMask(robot), robot.description.gripper.max_width
    return {
        camera.name: mask.hidden_share(
            PosedCamera.at(camera.intrinsics, camera.pose), np.concatenate(points), configuration, width
        )
        for camera in scene.cameras
        if camera.on == "world"
    }


def _grid(low: tuple[float, float], high: tuple[float, float]) -> Array:
    """Return points (n, 3) over a rectangle of the table, m."""
    x, y = (np.linspace(a, b, AREA_POINTS) for a, b in zip(low, high, strict=True))
    return np.column_stack([np.repeat(x, AREA_POINTS), np.tile(y, AREA_POINTS), np.zeros(AREA_POINTS**2)])


def held_part(held: BeliefObject | None) -> tuple[Shape, Pose] | None:
    """Return the shape of the held object with its pose in the TCP frame."""
    return None if held is None or held.object_in_tcp is None else (held.shape, held.object_in_tcp)


def _grown(mask: NDArray[np.uint8], pixels: int) -> NDArray[np.bool_]:
    return cv2.dilate(mask, np.ones((2 * pixels + 1, 2 * pixels + 1), dtype=np.uint8)).astype(np.bool_)


def fill(mask: NDArray[np.uint8], pixels: Array) -> None:
    """Set the hull of `pixels` (n, 2) to 1."""
    rounded = np.clip(np.round(pixels), -8000, 8000).astype(np.int32)
    cv2.fillConvexPoly(mask, cv2.convexHull(rounded), 1)


def add_attached_parts(
    robot: NDArray[np.bool_], height: Array, known: NDArray[np.bool_], above: float
) -> NDArray[np.bool_]:
    """Add to the mask connected pixels that are higher than `above` m and at most ATTACHED_PIXELS away.

    These are cables, and parts that the model lacks. A surface that continues further, at an even height, is
    a body beside or behind the robot, and is left out as a whole.
    """
    high = known & (height > above) & ~robot
    if not robot.any() or int(high.sum()) < 4:
        return robot
    _, found = cv2.connectedComponents((high | robot).astype(np.uint8), connectivity=4)
    marks = np.asarray(found, dtype=np.intp)
    touched = np.zeros(int(marks.max()) + 1, dtype=np.bool_)
    touched[np.unique(marks[robot])] = True
    kernel = np.ones((2 * ATTACHED_PIXELS + 1, 2 * ATTACHED_PIXELS + 1), dtype=np.uint8)
    near = cv2.dilate(robot.astype(np.uint8), kernel).astype(np.bool_)
    return touched[marks] & near & ~_bodies(high, height, near)


def _bodies(high: NDArray[np.bool_], height: Array, near: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Select the pixels (h, w) of surfaces that continue beyond the `near` ones without a step in height."""
    kernel = np.ones((3, 3), dtype=np.uint8)
    highest = cv2.dilate(np.where(high, height, -_FAR), kernel)
    lowest = cv2.erode(np.where(high, height, _FAR), kernel)
    even = high & (highest - lowest <= MAX_STEP_OF_BODY)
    count, found = cv2.connectedComponents(even.astype(np.uint8), connectivity=4)
    marks = np.asarray(found, dtype=np.intp)
    goes_on = np.bincount(marks[even & ~near], minlength=count) >= MIN_BODY_PIXELS
    inner = (goes_on[marks] & even).astype(np.uint8)
    return cv2.dilate(inner, kernel).astype(np.bool_) & high


_MAKERS: Final = (shapes, values, Path(__file__), "numpy", "scipy")
"""Code that the hulls depend on."""


def _link_hulls(parts: Iterable[LinkShape]) -> dict[str, NDArray[Any]]:
    """Return points and equations of each part's hull."""
    arrays: dict[str, NDArray[Any]] = {}
    for n, part in enumerate(parts):
        points = corners(part.shape)
        if isinstance(part.shape, ConvexMesh):
            points = _furthest(points)
        points = part.pose_in_link.apply(points)
        arrays[f"{n} points"] = points
        arrays[f"{n} equations"] = convex_hull(points).equations
    return arrays


def _furthest(points: Array) -> Array:
    """Select a few of these points (n, 3) of a hull whose hull is nearly that of all."""
    k = np.arange(HULL_DIRECTIONS) + 0.5
    polar, turn = np.arccos(1 - 2 * k / HULL_DIRECTIONS), np.pi * (1 + 5**0.5) * k
    sphere = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=1)
    return points[np.unique((points @ sphere.T).argmax(axis=0))]
