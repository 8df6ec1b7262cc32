"""Scene images: the robot, its belief, the ground truth and the planned path at a moment of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from ...logs.meshes.binary_gltf import parts_of, read_glb
from ...logs.meshes.triangle_meshes import Mesh, join_meshes, part_mesh, shape_mesh
from ...logs.recording.foxglove_messages import UNKNOWN_COLOUR
from ...logs.run_log import RunLog
from ...logs.schema.records import BlockRecord, BodyRecord, LinkMesh, PartRecord, Scene
from ...world.colours import COLOURS, TRUTH_COLOUR
from ...world.scene.destinations import colours_of_destinations
from ...world.shapes import Shape
from ...world.values import Array, Pose
from .rasterizer import Picture, RasterModel
from .renderer import MeshRenderer
from .viewpoint import PictureView

Show: TypeAlias = Literal["belief", "truth", "both"]

TRUTH_LINE = tuple(round(255 * share) for share in TRUTH_COLOUR)
PATH_LINE = (0, 140, 160)


@dataclass(frozen=True, slots=True)
class SceneContent:
    """Content of an image. Poses are in the world."""

    links: Mapping[str, Pose]
    """Poses of the robot's links and of bodies that move with them, by name."""
    solid: Scene
    """Bodies that are drawn solid."""
    outlined: Scene | None = None
    """Bodies whose outline is drawn, also where they are hidden."""
    path: tuple[tuple[float, float, float], ...] = ()
    """Planned TCP path, m."""


class SceneRenderer:
    """Renderer of moments of one run, in one size and from one view."""

    def __init__(
        self,
        robot: tuple[LinkMesh, ...],
        view: PictureView,
        size: tuple[int, int],
        tints: Mapping[str, str],
        *,
        fine: int = 2,
    ) -> None:
        """`tints`: colour of a bin's items, by bin; see `bin_tints`."""
        self._robot_meshes = {mesh.link: read_glb(mesh.glb) for mesh in robot}
        self._view, self._size, self._tints, self._fine = view, size, tints, fine
        self._fixed: tuple[PartRecord, ...] | None = None
        self._studio = MeshRenderer(join_meshes([]), view, size)
        self._robot: dict[str, RasterModel] = {}
        self._bodies: dict[tuple[Shape, str, tuple[BlockRecord, ...]], RasterModel] = {}

    def picture(self, shown: SceneContent) -> Picture:
        """Return the image as RGB (h, w, 3)."""
        if self._fixed is None or shown.solid.fixed != self._fixed:
            self._build(shown.solid.fixed)
        links = shown.links
        moving = [(model, links[link]) for link, model in self._robot.items() if link in links]
        moving += [(self._body(body), _pose(body, links)) for body in shown.solid.bodies]
        return self._drawn_over(self._studio.picture(moving), shown)

    def single(self, shown: SceneContent) -> Picture:
        """Return the same as `picture`, in less time for a single image."""
        links = shown.links
        parts = [mesh.placed(links[link]) for link, mesh in self._robot_meshes.items() if link in links]
        parts += [self._part(part) for part in shown.solid.fixed]
        parts += [_body_mesh(b).placed(_pose(b, links)) for b in shown.solid.bodies]
        studio = MeshRenderer(join_meshes(parts), self._view, self._size, fine=self._fine)
        return self._drawn_over(studio.picture([]), shown)

    def _drawn_over(self, picture: Picture, shown: SceneContent) -> Picture:
        """Return the image with the lines that nothing hides."""
        if len(shown.path) > 1:
            self._line(picture, np.array(shown.path))
        for body in shown.outlined.bodies if shown.outlined else ():
            for shape, pose in parts_of(body):
                self._outline(picture, _mesh(shape, body.colour).placed(body.pose @ pose).vertices)
        return picture

    def _build(self, fixed: tuple[PartRecord, ...]) -> None:
        self._fixed = fixed
        parts = [self._part(part) for part in fixed]
        self._studio = MeshRenderer(join_meshes(parts), self._view, self._size, fine=self._fine)
        self._robot = {link: self._studio.model(mesh) for link, mesh in self._robot_meshes.items()}
        self._bodies = {}

    def _part(self, part: PartRecord) -> Mesh:
        return part_mesh(part.shape, part.holes, part_colour(part, self._tints)).placed(part.pose)

    def _body(self, body: BodyRecord) -> RasterModel:
        key = (body.shape, body.colour, body.blocks)
        if key not in self._bodies:
            self._bodies[key] = self._studio.model(_body_mesh(body))
        return self._bodies[key]

    def _pixels(self, points: Array) -> NDArray[np.int32] | None:
        """Return sixteenths of a pixel, (n, 2); None when a point is behind the camera."""
        seen = self._view.project(points, self._size)
        if (seen[:, 2] <= 0.05).any():
            return None
        return np.round((seen[:, :2] - 0.5) * 16).astype(np.int32)

    def _outline(self, picture: Picture, points: Array) -> None:
        """Draw the outline of a convex body."""
        pixels = self._pixels(points)
        if pixels is not None:
            border = cv2.convexHull(pixels)
            cv2.polylines(picture, [border], True, TRUTH_LINE, self._wide(1), cv2.LINE_AA, 4)

    def _line(self, picture: Picture, points: Array) -> None:
        pixels = self._pixels(points)
        if pixels is not None:
            wide = self._wide(1.5)
            cv2.polylines(picture, [pixels], False, (255, 255, 255), wide + 2, cv2.LINE_AA, 4)
            cv2.polylines(picture, [pixels], False, PATH_LINE, wide, cv2.LINE_AA, 4)
            end = (int(pixels[-1, 0]), int(pixels[-1, 1]))
            cv2.circle(picture, end, 16 * (wide + 2), PATH_LINE, cv2.FILLED, cv2.LINE_AA, 4)

    def _wide(self, pixels: float) -> int:
        """Return the width of a line that is `pixels` wide in an image 600 pixels high."""
        return max(1, round(pixels * self._size[1] / 600))


def bin_tints(log: RunLog) -> dict[str, str]:
    """Return the colour of the items that belong into a bin, by bin, where all its items have the same one.

    Empty when the log holds no scene that can be read."""
    from ..explain.investigation.case import scene_of  # slow to import

    scene = scene_of(log)
    if scene is None:
        return {}
    return colours_of_destinations(scene.destinations, [(each.kind, each.form) for each in scene.catalogue])


def part_colour(part: PartRecord, tints: Mapping[str, str]) -> tuple[float, float, float]:
    """Return a fixture's colour as RGB, 0 … 1; that of a bin is half the colour of its items."""
    own = COLOURS.get(part.colour, UNKNOWN_COLOUR)
    tint = COLOURS.get(tints.get(part.id.split("/")[0], ""), own)
    return (0.5 * (own[0] + tint[0]), 0.5 * (own[1] + tint[1]), 0.5 * (own[2] + tint[2]))


def _mesh(shape: Shape, colour: str) -> Mesh:
    return shape_mesh(shape, COLOURS.get(colour, UNKNOWN_COLOUR))


def _body_mesh(body: BodyRecord) -> Mesh:
    return join_meshes(_mesh(shape, body.colour).placed(pose) for shape, pose in parts_of(body))


def _pose(body: BodyRecord, links: Mapping[str, Pose]) -> Pose:
    """Return the pose. A held body moves with the hand between two messages of the belief."""
    return links.get(body.id, body.pose)
