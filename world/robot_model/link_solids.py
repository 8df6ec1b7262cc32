"""Shapes of links: the convex bodies that planner, physics, masks and pictures take, from one reading."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final, NoReturn, TypeAlias

import numpy as np

from picktree.files import PicktreeError, disk_cache
from picktree.world import Array, ConvexMesh, Pose, Shape, convex_hull, extents, mesh_reader, shapes

from .urdf_parser import (
    Geometry,
    UrdfMesh,
    UrdfPrimitive,
    UrdfTree,
    element_faults,
    link_geometry,
    links_seen_only,
    parsed_urdf,
    skeleton_of,
)


@dataclass(frozen=True, slots=True)
class LinkShape:
    """Convex body of a link: planner, physics, masks and pictures take the same one."""

    link: str
    shape: Shape
    """A primitive, or the convex hull of a mesh in the mesh's frame."""
    pose_in_link: Pose
    filling: float = 1.0
    """Share of its hull that a mesh fills, 0 … 1; 1 for a primitive."""


Stamp: TypeAlias = tuple[int, int, int]

MAX_SIZE_RATIO = 4.0
"""Size of a moving link's mesh, as a multiple of the robot's length, above which its unit is doubted."""
MAX_FOOT_RATIO = 20.0
"""The same for a link that does not move: a robot may be mounted on a table or in a hall."""
MIN_ROBOT_LENGTH = 0.02
"""Length of a robot below which its joints give no measure for the size of its links, m."""
MIN_SCALED_SIZE = 0.002
"""Size of a scaled mesh below which its scale is doubted, m."""
UNITS: Final = ((1000.0, "millimetres"), (100.0, "centimetres"), (39.37, "inches"))


def link_shapes(urdf: str) -> tuple[LinkShape, ...]:
    """Return the bodies with which the links of a URDF collide, in the order of the file.

    Raises PicktreeError for unusable geometry: file, link, problem, and remedy. Hulls from earlier calls come
    from the disk cache.
    """
    elements = _collisions(urdf, _stamp(urdf))
    stamps = tuple(_stamp(element.path) for element in elements if isinstance(element, UrdfMesh))
    return _known_shapes(urdf, elements, stamps)


def geometry_faults(urdf: str) -> tuple[str, ...]:
    """Return a sentence for each shape of a URDF that cannot be used, with its link."""
    if faults := element_faults(urdf):
        return faults
    try:
        link_shapes(urdf)
    except PicktreeError:
        found: dict[str, None] = {}
        seen_only, tree = links_seen_only(urdf), _tree(urdf)
        for part in link_geometry(urdf, "collision"):  # one by one, since all that is wrong is wanted
            try:
                _shaped(urdf, tree, part, may_be_flat=part.link in seen_only)
            except PicktreeError as error:
                found[str(error).removeprefix(f"{urdf}: ")] = None
        return tuple(found)
    return ()


def fingerprint(parts: tuple[LinkShape, ...]) -> bytes:
    """Return all that the parts consist of, for the key of a cache."""
    import orjson  # not needed by commands that only check

    return orjson.dumps(parts)


def _stamp(file: str) -> Stamp:
    """Return inode, time of change and size; together they identify a version of the file within one
    process."""
    try:
        stat = Path(file).stat()
    except OSError as error:
        raise PicktreeError(f"{file}: {error.strerror}") from None
    return stat.st_ino, stat.st_ctime_ns, stat.st_size


@lru_cache(maxsize=8)
def _collisions(urdf: str, stamp: Stamp) -> tuple[Geometry, ...]:
    return link_geometry(urdf, "collision")


@lru_cache(maxsize=8)
def _known_shapes(
    urdf: str, elements: tuple[Geometry, ...], stamps: tuple[Stamp, ...]
) -> tuple[LinkShape, ...]:
    inputs = (
        Path(urdf),
        repr(elements),
        *(Path(e.path) for e in elements if isinstance(e, UrdfMesh)),
    )
    kept = disk_cache.cached_arrays("link-shapes", inputs, _MAKERS, lambda: _shapes(urdf, elements))
    return tuple(
        LinkShape(
            element.link,
            _convex(kept[f"{n} corners"], element.path) if isinstance(element, UrdfMesh) else element.shape,
            element.pose_in_link,
            float(kept["filling"][n]),
        )
        for n, element in enumerate(elements)
        if kept["filling"][n] > 0.0
    )


_MAKERS: Final = (mesh_reader, shapes, Path(__file__), "numpy", "scipy", "trimesh", "pycollada")
"""Code that the shapes depend on."""


def _shapes(urdf: str, elements: Sequence[Geometry]) -> dict[str, Array]:
    """Return the corners of each mesh's hull, and the share of it that is filled; 0: it has none."""
    seen_only, tree = links_seen_only(urdf), _tree(urdf)
    arrays: dict[str, Array] = {}
    filling: list[float] = []
    for n, element in enumerate(elements):
        shaped = _shaped(urdf, tree, element, may_be_flat=element.link in seen_only)
        filling.append(0.0 if shaped is None else max(shaped.filling, 1e-6))
        if shaped is not None and isinstance(shaped.shape, ConvexMesh):
            arrays[f"{n} corners"] = np.array(shaped.shape.vertices)
    return {**arrays, "filling": np.array(filling)}


def _convex(points: Array, source: str) -> ConvexMesh:
    return ConvexMesh(tuple((x, y, z) for x, y, z in points.tolist()), source)


def _shaped(urdf: str, tree: UrdfTree, element: Geometry, *, may_be_flat: bool) -> LinkShape | None:
    """Return the convex body of one element; None for a flat mesh that may be flat. Raises PicktreeError."""
    link = element.link
    if isinstance(element, UrdfPrimitive):
        _doubt_size(urdf, tree, element, element.shape)
        return LinkShape(link, element.shape, element.pose_in_link)
    try:
        mesh = mesh_reader.read_mesh(Path(element.path))
        # Rounded to what the engine keeps of a mesh file, so that all have the same hull.
        scaled = (mesh.vertices * np.array(element.scale)).astype(np.float32).astype(np.float64)
        points = mesh_reader.hull_corners(scaled)
    except mesh_reader.FlatMesh as error:
        if may_be_flat:
            return None
        _refuse(urdf, link, f"{element.path}: {error.message}", "give it a thickness, or take a <box>")
    except mesh_reader.MeshError as error:
        refuse_mesh(urdf, element, error)
    shape = _convex(points, element.path)
    _doubt_size(urdf, tree, element, shape)
    volume = float(convex_hull(points).volume)
    filled = mesh.volume() * abs(float(np.prod(element.scale)))
    return LinkShape(link, shape, element.pose_in_link, min(1.0, filled / volume))


def refuse_mesh(urdf: str, element: UrdfMesh, error: mesh_reader.MeshError) -> NoReturn:
    """Raise PicktreeError for a mesh file that cannot be used: URDF, link, file, and a remedy."""
    message = error.message if element.path in error.message else f"{element.path}: {error.message}"
    _refuse(urdf, element.link, message, error.hint)


def refuse_size(urdf: str, element: UrdfMesh, points: Array) -> None:
    """Raise PicktreeError when points (n, 3) of a mesh, m, imply another unit than metres."""
    _doubt_size(urdf, _tree(urdf), element, _convex(points, element.path))


def _doubt_size(urdf: str, tree: UrdfTree, element: Geometry, shape: Shape) -> None:
    """Raise PicktreeError when the size of a shape implies another unit than metres."""
    low, high = extents(shape, np.eye(3))
    size = high - low
    longest, reach = float(size.max()), _length(tree)
    if isinstance(element, UrdfMesh):
        file = Path(element.path).name
        unscaled = float((size / np.abs(np.array(element.scale))).max())
        if (
            longest < MIN_SCALED_SIZE
            and max(map(abs, element.scale)) < 0.1
            and unscaled > 5 * MIN_SCALED_SIZE
        ):
            scale = " ".join(f"{s:g}" for s in element.scale)
            _refuse(urdf, element.link, f"{file} is {1000 * longest:.2g} mm large with its scale {scale}",
                    "is it in metres? then it has no scale")  # fmt: skip
    if reach < MIN_ROBOT_LENGTH:
        return
    stands = all(tree.joints[name].type == "fixed" for name in tree.joints_to(element.link))
    if longest <= (MAX_FOOT_RATIO if stands else MAX_SIZE_RATIO) * reach:
        return
    factor, unit = min(UNITS, key=lambda one: abs(math.log(longest / one[0] / (reach / 4))))
    what = Path(element.path).name if isinstance(element, UrdfMesh) else "a shape of it"
    sizes = " × ".join(f"{s:.3g}" for s in size.tolist())
    remedy = f"is it in {unit}?"
    if isinstance(element, UrdfMesh):
        scale = f"{float(f'{1 / factor:.4g}'):g}"
        remedy += f' then scale="{scale} {scale} {scale}" in its <mesh>'
    _refuse(urdf, element.link, f"{what} is {sizes} m large, and the whole robot {reach:.2g} m long", remedy)


def _length(tree: UrdfTree) -> float:
    """Return the length of the longest chain of joints, m."""
    lengths = [0.0]
    for link in tree.links:
        chain = (tree.joints[name].child_in_parent.position for name in tree.joints_to(link))
        lengths.append(sum(math.hypot(*position) for position in chain))
    return max(lengths)


def _tree(urdf: str) -> UrdfTree:
    return skeleton_of(parsed_urdf(Path(urdf)))


def _refuse(urdf: str, link: str, message: str, hint: str = "") -> NoReturn:
    raise PicktreeError(f"{urdf}: link {link!r}: {message}" + (f" ({hint})" if hint else ""))
