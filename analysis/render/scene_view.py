"""Scene images: the robot, its belief, the ground truth and the planned path at a moment of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.logs import RunLog, binary_gltf, log_records, triangle_meshes
from picktree.logs.recording import UNKNOWN_COLOUR
from picktree.world import COLOURS, TRUTH_COLOUR, Array, Box, Pose, Shape, top
from picktree.world.scene import destinations

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
    solid: log_records.Scene
    """Bodies that are drawn solid."""
    outlined: log_records.Scene | None = None
    """Bodies whose outline is drawn, also where they are hidden."""
    path: tuple[tuple[float, float, float], ...] = ()
    """Planned TCP path, m."""


class SceneRenderer:
    """Renderer of moments of one run, in one size and from one view."""

    def __init__(
        self,
        robot: tuple[log_records.LinkMesh, ...],
        view: PictureView,
        size: tuple[int, int],
        tints: Mapping[str, str],
        *,
        fine: int = 2,
    ) -> None:
        """`tints`: colour of a bin's items, by bin; see `bin_tints`."""
        self._robot_meshes = {mesh.link: binary_gltf.read_glb(mesh.glb) for mesh in robot}
        self._view, self._size, self._tints, self._fine = view, size, tints, fine
        self._fixed: tuple[log_records.PartRecord, ...] | None = None
        self._studio = MeshRenderer(triangle_meshes.join_meshes([]), view, size)
        self._robot: dict[str, RasterModel] = {}
        self._bodies: dict[tuple[Shape, str, tuple[log_records.BlockRecord, ...]], RasterModel] = {}

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
        fixed = shown.solid.fixed
        parts += [body_mesh(b, fixed).placed(_pose(b, links)) for b in shown.solid.bodies]
        studio = MeshRenderer(triangle_meshes.join_meshes(parts), self._view, self._size, fine=self._fine)
        return self._drawn_over(studio.picture([]), shown)

    def _drawn_over(self, picture: Picture, shown: SceneContent) -> Picture:
        """Return the image with the lines that nothing hides."""
        if len(shown.path) > 1:
            self._line(picture, np.array(shown.path))
        for body in shown.outlined.bodies if shown.outlined else ():
            for shape, pose in binary_gltf.parts_of(body):
                self._outline(picture, _mesh(shape, body.colour).placed(body.pose @ pose).vertices)
        return picture

    def _build(self, fixed: tuple[log_records.PartRecord, ...]) -> None:
        self._fixed = fixed
        parts = [self._part(part) for part in fixed]
        self._studio = MeshRenderer(
            triangle_meshes.join_meshes(parts), self._view, self._size, fine=self._fine
        )
        self._robot = {link: self._studio.model(mesh) for link, mesh in self._robot_meshes.items()}
        self._bodies = {}

    def _part(self, part: log_records.PartRecord) -> triangle_meshes.Mesh:
        return triangle_meshes.part_mesh(part.shape, part.holes, part_colour(part, self._tints)).placed(
            part.pose
        )

    def _body(self, body: log_records.BodyRecord) -> RasterModel:
        key = (body.shape, body.colour, body.blocks)
        if key not in self._bodies:
            self._bodies[key] = self._studio.model(body_mesh(body, self._fixed or ()))
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
    from picktree.analysis.explain import scene_of  # slow to import

    scene = scene_of(log)
    if scene is None:
        return {}
    kinds = [(each.kind, each.form) for each in scene.catalogue]
    if scene.assortment is not None:
        kinds.append(("unknown", "mesh"))
    return destinations.colours_of_destinations(scene.destinations, kinds)


def part_colour(part: log_records.PartRecord, tints: Mapping[str, str]) -> tuple[float, float, float]:
    """Return a fixture's colour as RGB, 0 … 1; that of a bin is half the colour of its items."""
    own = COLOURS.get(part.colour, UNKNOWN_COLOUR)
    tint = COLOURS.get(tints.get(part.id.split("/")[0], ""), own)
    return (0.5 * (own[0] + tint[0]), 0.5 * (own[1] + tint[1]), 0.5 * (own[2] + tint[2]))


def _mesh(shape: Shape, colour: str) -> triangle_meshes.Mesh:
    return triangle_meshes.shape_mesh(shape, COLOURS.get(colour, UNKNOWN_COLOUR))


HEAP_SCALE = 0.1
"""Height above the floor of the last colour of a heap's columns, m."""
COLUMN_STEP = 0.006
"""Rounding of the columns' heights, m: upwards."""
UNSEEN_COLOUR = (0.45, 0.45, 0.48)
"""Colour of columns that were never seen."""
_HEIGHT_COLOURS = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_VIRIDIS)[:, 0, ::-1]


def body_mesh(body: log_records.BodyRecord, fixed: Sequence[log_records.PartRecord]) -> triangle_meshes.Mesh:
    """Return the mesh of a body in its frame. The columns of a heap are coloured by their heights."""
    if body.role != "heap":
        return triangle_meshes.join_meshes(
            _mesh(shape, body.colour).placed(pose) for shape, pose in binary_gltf.parts_of(body)
        )
    unseen = unseen_height(body, fixed)
    columns = (_inside(block, body.shape) for block in body.blocks)
    return triangle_meshes.join_meshes(
        triangle_meshes.shape_mesh(Box(one.size), _height_colour(one.size[2], unseen)).placed(Pose(one.at))
        for one in columns
        if min(one.size) > 0.0
    )


def _inside(block: log_records.BlockRecord, shape: Shape) -> log_records.BlockRecord:
    """Return a column cut off at the inner sides of the walls: those beside a wall reach into it."""
    far = np.array(shape.size if isinstance(shape, Box) else (math.inf,) * 3) / 2
    far[2] = math.inf
    at, size = np.array(block.at), np.array(block.size)
    low, high = np.maximum(at - size / 2, -far), np.minimum(at + size / 2, far)
    (x, y, z), (a, b, c) = (low + high) / 2, high - low
    return log_records.BlockRecord((float(a), float(b), float(c)), (float(x), float(y), float(z)))


def unseen_height(heap: log_records.BodyRecord, fixed: Sequence[log_records.PartRecord]) -> float:
    """Return the height of columns that were never seen, m: that of the tote's rim above its floor. inf: the
    heap lies in no tote.

    A seen column that ends less than `COLUMN_STEP` below the rim has the same height.
    """
    floor = heap.pose.position[2] - (heap.shape.size[2] / 2 if isinstance(heap.shape, Box) else 0.0)
    rim = max((top(p.shape, p.pose) for p in fixed if p.id.split("/")[0] == heap.place), default=-math.inf)
    steps = math.ceil((rim - floor) / COLUMN_STEP - 1e-6) if rim - floor > COLUMN_STEP else math.inf
    return steps * COLUMN_STEP


def heap_remark(body: log_records.BodyRecord, fixed: Sequence[log_records.PartRecord]) -> str:
    """Return what the colours of a heap mean, with its greatest height above the floor. Empty: no heap."""
    if body.role != "heap":
        return ""
    unseen = unseen_height(body, fixed)
    heights = [block.size[2] for block in body.blocks]
    seen = [height for height in heights if not _is_same_step(height, unseen)]
    hidden = "; grey: never seen" if len(seen) < len(heights) else ""
    return f"0 … {1000 * HEAP_SCALE:.0f} mm; {body.id}: up to {1000 * max(seen, default=0.0):.0f} mm{hidden}"


def _is_same_step(a: float, b: float) -> bool:
    return abs(a - b) < 0.5 * COLUMN_STEP


def _height_colour(height: float, unseen: float) -> tuple[float, float, float]:
    if _is_same_step(height, unseen):
        return UNSEEN_COLOUR
    red, green, blue = _HEIGHT_COLOURS[round(255 * min(1.0, height / HEAP_SCALE))] / 255
    return (float(red), float(green), float(blue))


def _pose(body: log_records.BodyRecord, links: Mapping[str, Pose]) -> Pose:
    """Return the pose. A held body moves with the hand between two messages of the belief."""
    return links.get(body.id, body.pose)
