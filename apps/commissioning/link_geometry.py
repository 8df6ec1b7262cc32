"""Link geometry: points and triangles in the frame of each link, and boxes around the parts of a gripper."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from picktree.files import PicktreeError, XmlError, file_system, parse_xml
from picktree.files.yaml import file_text
from picktree.world import Array, Box, Pose, corners, mesh_reader
from picktree.world.robot_model import UrdfError, gripper_mounting, link_shapes, urdf_parser


class UnsuitableUrdf(PicktreeError):
    """Error for a URDF without a robot file: the findings, the missing parts, and a remedy."""

    def __init__(self, urdf: str, found: str, missing: str, helps: str) -> None:
        self.found, self.missing, self.helps = found, missing, helps
        super().__init__(
            f"{urdf}: no robot file can be made of it\n  found    {found}\n"
            f"  missing  {missing}\n  helps    {helps}"
        )


_MACRO = re.compile(r"\$\{|\$\((?:arg|find|optenv|env|eval|dirname)\b")


@dataclass(frozen=True, slots=True)
class UrdfSource:
    """URDF as named on the command line, found and read."""

    text: str
    """Name on the command line: a path, or `package:path`."""
    urdf: gripper_mounting.NamedUrdf
    skeleton: urdf_parser.UrdfTree


def find_source(text: str) -> UrdfSource:
    """Find and read a URDF. Raises PicktreeError for a missing file, UnsuitableUrdf when it is no URDF."""
    named = _named(text)
    refuse_template(text, named.path)
    try:
        return UrdfSource(text, named, urdf_parser.read_skeleton(named.path))
    except UrdfError as error:
        raise UnsuitableUrdf(
            text,
            "a file that cannot be used as a URDF: " + f"\n{' ' * 11}".join(error.faults),
            "an XML file <robot> with <link> and <joint> elements that form one tree",
            "mend a copy of the file; `check_urdf FILE` of liburdfdom-tools describes the faults of a URDF",
        ) from None


def refuse_template(text: str, path: Path) -> None:
    """Raise UnsuitableUrdf when the file is a xacro template, with the command that expands it."""
    try:
        raw = file_text.read_bytes(path, urdf_parser.MAX_BYTES)
    except file_text.Unreadable as error:
        raise PicktreeError(f"{text}: {error}") from None
    if path.suffix == ".xacro" or _is_template(raw):
        target = f"{path.name.removesuffix('.xacro').removesuffix('.urdf')}.urdf"
        raise UnsuitableUrdf(
            text,
            "a xacro template, from which a URDF is made",
            "the URDF itself",
            f"`pip install xacro`, then `xacro {path} > {target}`, and take {target}",
        )


def _is_template(raw: bytes) -> bool:
    """Whether links or joints need an expansion by xacro. Values that nothing takes, and what is for other
    programs, as <gazebo>, do not count."""
    try:
        root = parse_xml(raw)
    except XmlError:
        return False
    calls = (element.tag for element in root.iter() if element.tag.startswith("xacro:"))
    if any(tag not in ("xacro:property", "xacro:arg") for tag in calls):
        return True
    parts = (part for tag in ("link", "joint") for element in root.findall(tag) for part in element.iter())
    return any(_MACRO.search(value) for part in parts for value in part.attrib.values())


def _named(text: str) -> gripper_mounting.NamedUrdf:
    package, colon, inside = text.partition(":")
    if colon and not file_system.is_file(Path(text)):
        folder = urdf_parser.package_folder(package)
        if folder is None:
            raise PicktreeError(
                f"{text}: there is no installed package {package!r}; write a path, or package:path inside an "
                "installed Python package"
            )
        path = folder / inside
        if not path.resolve().is_relative_to(folder.resolve()):
            raise PicktreeError(f"{text}: that is outside of the package {package!r}")
        if not file_system.is_file(path):
            raise PicktreeError(f"{text}: there is no file {path}")
        return gripper_mounting.NamedUrdf(path, package, folder)
    path = Path(text)
    if not file_system.is_file(path):
        raise PicktreeError(f"there is no file {text}")
    return gripper_mounting.NamedUrdf(path)


EDGE_SAMPLES = 30
"""Number of points on each edge of a mesh when the rest of a finger is measured."""


@dataclass(frozen=True, slots=True, eq=False)
class LinkGeometry:
    """Collision geometry of a link: vertices (n, 3) and triangles (k, 3) in its frame."""

    points: Array
    triangles: NDArray[np.int64]

    def hull(self) -> Array:
        """Return the corners (m, 3) of the convex hull; all points when the geometry is flat."""
        try:
            return self.points[ConvexHull(self.points).vertices]
        except (RuntimeError, ValueError):
            return self.points

    def volume(self) -> float:
        """Return the volume of the convex hull, m³; 0 when the geometry is flat."""
        try:
            return float(ConvexHull(self.points).volume)
        except (RuntimeError, ValueError):
            return 0.0

    def along_edges(self, points: Array) -> Array:
        """Return points (m, 3) along the edges of the triangles, for their vertices `points` (n, 3)."""
        triangles = points[self.triangles]
        along = np.linspace(0.0, 1.0, EDGE_SAMPLES)[:, None, None]
        edges = [triangles[:, k] * (1 - along) + triangles[:, k - 1] * along for k in range(3)]
        return np.concatenate([edge.reshape(-1, 3) for edge in edges])


def missing_meshes(urdf: Path) -> tuple[str, ...]:
    """Return the meshes that the URDF names and that do not exist, as it names them, each once."""
    root = urdf_parser.parsed_urdf(urdf)
    named = dict.fromkeys(mesh.get("filename", "") for mesh in root.iter("mesh"))
    return tuple(name for name in named if urdf_parser.mesh_file(urdf, name) is None)


def refuse_missing_meshes(source: str, urdf: Path) -> None:
    """Raise UnsuitableUrdf with all missing meshes, if there are any."""
    missing = missing_meshes(urdf)
    if not missing:
        return
    shown = ", ".join(missing[:6]) + (f" and {len(missing) - 6} more" if len(missing) > 6 else "")
    packages = sorted(
        {m.removeprefix("package://").split("/")[0] for m in missing if m.startswith("package://")}
    )
    helps = f"put the meshes where the URDF names them; plain paths are relative to {urdf.parent}"
    if packages:
        listed = " and ".join(packages)
        helps = (
            f"put the ROS package {listed} beside {urdf.parent} or into one of the folders above it, or name "
            f"its folder in {urdf_parser.ROS_PATH} or {urdf_parser.AMENT_PATH}"
        )
    raise UnsuitableUrdf(source, f"{len(missing)} meshes that are not there: {shown}", "their files", helps)


def read_solids(urdf: Path) -> Mapping[str, LinkGeometry]:
    """Read the collision geometry by link, where there is any. Raises PicktreeError for unusable geometry."""
    link_shapes(str(urdf))  # what cannot be used has its sentence there
    parts: dict[str, list[LinkGeometry]] = {}
    for element in urdf_parser.link_geometry(str(urdf), "collision"):
        parts.setdefault(element.link, []).append(_solid(element))
    return {link: _joined(solids) for link, solids in parts.items()}


def _solid(element: urdf_parser.UrdfMesh | urdf_parser.UrdfPrimitive) -> LinkGeometry:
    if isinstance(element, urdf_parser.UrdfMesh):
        mesh = mesh_reader.read_mesh(Path(element.path))
        points, triangles = mesh.vertices * np.array(element.scale), mesh.faces
    else:
        points = corners(element.shape)
        triangles = ConvexHull(points).simplices.astype(np.int64)
        faces = points[triangles]
        outward = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        turned = np.einsum("ij,ij->i", outward, faces.mean(axis=1) - points.mean(axis=0)) < 0
        triangles = np.where(turned[:, None], triangles[:, ::-1], triangles)
    return LinkGeometry(element.pose_in_link.apply(points), triangles)


def _joined(solids: list[LinkGeometry]) -> LinkGeometry:
    starts = np.cumsum([0, *(len(solid.points) for solid in solids[:-1])]).tolist()
    return LinkGeometry(
        np.concatenate([solid.points for solid in solids]),
        np.concatenate([solid.triangles + start for solid, start in zip(solids, starts, strict=True)]),
    )


MAX_STICK_OUT = 0.0025
"""Greatest distance of a box's corner from the hull of its finger, m. The simulation takes the box, and the
planner the hull, which it keeps 3 mm away from other bodies."""
INNER_STEPS = 17
"""Number of depths and of lengths of a box that are tried."""
HAND_BOX_COUNT = 3
"""Number of boxes along the hand, which mostly tapers."""


def hand_boxes(
    static: list[Array], swept: list[Array], top: float, widest: float
) -> tuple[tuple[Box, Pose], ...]:
    """Return boxes around the hand behind its palm, and around parts that protrude beside open fingers."""
    boxes: list[tuple[Box, Pose]] = []
    below = [points[points[:, 2] <= top] for points in swept]
    points = (
        np.concatenate([*static, *(b for b in below if len(b))]) if static or any(map(len, below)) else None
    )
    if points is not None and len(points) >= 4:
        bottom = float(points[:, 2].min())
        edges = _hull_edges(points)
        count = HAND_BOX_COUNT if top - bottom > 0.03 else 1
        bounds = np.linspace(top, bottom, count + 1)
        for high, low in pairwise(bounds.tolist()):
            inside = _between(edges, low, high)
            if len(inside):
                boxes.append(_box(inside.min(axis=0), inside.max(axis=0), low, high))
    for side in (1.0, -1.0):
        beside = [p[(p[:, 2] > top) & (side * p[:, 1] >= widest / 2)] for p in swept]
        beside = [p for p in beside if len(p)]
        if beside:
            whole = np.concatenate(beside)
            low, high = whole.min(axis=0), whole.max(axis=0)
            boxes.append(_box(low, high, float(low[2]), float(high[2])))
    if not boxes:
        boxes.append((Box((0.04, 0.04, 0.02)), Pose((0.0, 0.0, top - 0.01))))
    return tuple(boxes)


def finger_box(fingers: list[Array], widths: list[float]) -> tuple[Box, Pose]:
    """Return a box around the +y finger at all openings, each moved back by half of the opening."""
    moved = np.concatenate(
        [points - [0.0, width / 2, 0.0] for points, width in zip(fingers, widths, strict=True)]
    )
    low, high = moved.min(axis=0), moved.max(axis=0)
    low[1] = max(low[1], 0.0)
    return _box(low, high, float(low[2]), float(high[2]))


def inner_box(points: Array, low: Array, high: Array, side: float, least: float) -> tuple[Array, Array]:
    """Return the corners of the largest box within a finger that has the face and the tip of a given one.

    `points` (n, 3) are those of the finger, `low` and `high` (3,) the corners of the given box, m. Its face
    is where y is least for a `side` of 1, greatest for -1; its tip is where z is greatest. The result is at
    least half as long and at least `least` m deep. Its corners are at most MAX_STICK_OUT outside of the hull
    of the points. Without such a box the given one is returned.
    """
    try:
        planes = ConvexHull(points).equations
    except (RuntimeError, ValueError):
        return low, high
    nx, ny, nz, offset = planes.T
    to_right, to_left = nx > 1e-9, nx < -1e-9
    face = float(low[1] if side > 0 else high[1])
    deep, long = float(high[1] - low[1]), float(high[2] - low[2])
    best, volume = (low, high), 0.0
    for depth, length in product(
        np.linspace(deep, least, INNER_STEPS).tolist(), np.linspace(long, long / 2, INNER_STEPS).tolist()
    ):
        near, far = sorted((face, face + side * depth))
        bottom = float(high[2]) - length
        room = MAX_STICK_OUT - offset
        room -= np.maximum(ny * near, ny * far) + np.maximum(nz * bottom, nz * high[2])
        if (room[~to_right & ~to_left] < 0.0).any():
            continue
        left = (room[to_left] / nx[to_left]).max(initial=float(low[0]))
        right = (room[to_right] / nx[to_right]).min(initial=float(high[0]))
        if (right - left) * depth * length > volume * (1 + 1e-9):
            volume = (right - left) * depth * length
            best = (np.array([left, near, bottom]), np.array([right, far, high[2]]))
    return best


def _box(low: Array, high: Array, bottom: float, top: float) -> tuple[Box, Pose]:
    size = (float(high[0] - low[0]), float(high[1] - low[1]), top - bottom)
    centre = (float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2, (bottom + top) / 2)
    return Box((max(size[0], 1e-3), max(size[1], 1e-3), max(size[2], 1e-3))), Pose(centre)


def _hull_edges(points: Array) -> Array:
    """Return the edges (m, 2, 3) of the convex hull."""
    try:
        hull = ConvexHull(points)
    except (RuntimeError, ValueError):
        return np.stack([points, points], axis=1)
    pairs = np.concatenate([hull.simplices[:, [0, 1]], hull.simplices[:, [1, 2]], hull.simplices[:, [2, 0]]])
    return points[pairs]


def _between(edges: Array, low: float, high: float) -> Array:
    """Return points (k, 3) of the edges' parts between two heights."""
    found: list[Array] = []
    for z in (low, high):
        a, b = edges[:, 0], edges[:, 1]
        across = (a[:, 2] - z) * (b[:, 2] - z) < 0
        share = (z - a[across, 2]) / (b[across, 2] - a[across, 2])
        found.append(a[across] + share[:, None] * (b[across] - a[across]))
    ends = edges.reshape(-1, 3)
    found.append(ends[(ends[:, 2] >= low - 1e-9) & (ends[:, 2] <= high + 1e-9)])
    return np.concatenate(found)
