"""Shapes of a robot's links: one reading of a URDF's geometry for planner, physics, masks and pictures."""

from __future__ import annotations

import copy
import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final, Literal, NoReturn, TypeAlias

import numpy as np

from ..errors import PicktreeError
from ..files.disk_cache import cached_arrays
from ..world import mesh_reader, shapes
from ..world.mesh_reader import FlatMesh, MeshError, hull_corners, read_mesh
from ..world.shapes import Box, ConvexMesh, Cylinder, Shape, Sphere, convex_hull, extents
from ..world.values import Array, Pose, Vector3
from .mesh_files import mesh_file
from .urdf_faults import UrdfError
from .urdf_text import parsed_urdf
from .urdf_tree import numbers_text, origin_pose, skeleton_of


@dataclass(frozen=True, slots=True)
class UrdfMesh:
    """A mesh file that belongs to a link: scale its vertices, then place it by `pose_in_link`."""

    link: str
    path: str
    pose_in_link: Pose
    scale: Vector3 = (1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True)
class UrdfPrimitive:
    """A primitive that belongs to a link."""

    link: str
    shape: Box | Cylinder | Sphere
    pose_in_link: Pose


@dataclass(frozen=True, slots=True)
class LinkShape:
    """Convex body of a link: planner, physics, masks and pictures take the same one."""

    link: str
    shape: Shape
    """A primitive, or the convex hull of a mesh in the mesh's frame."""
    pose_in_link: Pose
    filling: float = 1.0
    """Share of its hull that a mesh fills, 0 … 1; 1 for a primitive."""


Which = Literal["visual", "collision"]
Stamp: TypeAlias = tuple[int, int, int]

MAX_SIZE_RATIO = 4.0
"""Size of a moving link's mesh, as a multiple of the robot's length, above which its unit is doubted."""
MAX_FOOT_RATIO = 20.0
"""The same for a link that does not move: a robot may stand on a table or in a hall."""
MIN_ROBOT_LENGTH = 0.02
"""Length of a robot below which its joints tell nothing of the size of its links, m."""
MIN_SCALED_SIZE = 0.002
"""Size of a scaled mesh below which its scale is doubted, m."""
UNITS: Final = ((1000.0, "millimetres"), (100.0, "centimetres"), (39.37, "inches"))


def read_geometry(urdf: str) -> ElementTree.Element:
    """Read a URDF with its geometry in the form that all parts of picktree take.

    Mesh files have full paths. A capsule is a cylinder with a sphere at either end. A link that is seen and
    has no collision geometry collides as it is seen. Raises PicktreeError when the file is no URDF.
    """
    try:
        root = parsed_urdf(Path(urdf))
    except UrdfError as error:
        raise PicktreeError(f"{urdf}: {error}") from None
    for link in root.findall("link"):
        for which in ("visual", "collision"):
            for element in link.findall(which):
                _split_capsule(urdf, link, element)
        if link.find("collision") is None:
            for element in link.findall("visual"):
                stand_in = copy.deepcopy(element)
                stand_in.tag = "collision"
                link.append(stand_in)
    for mesh in root.iter("mesh"):
        file = mesh_file(Path(urdf), mesh.get("filename", ""))
        if file is not None:
            mesh.set("filename", str(file.absolute()))
    return root


def _split_capsule(urdf: str, link: ElementTree.Element, element: ElementTree.Element) -> None:
    """Replace a visual or collision element with a capsule by three: its length counts between the spheres'
    centres."""
    geometry = element.find("geometry")
    capsule = None if geometry is None else geometry.find("capsule")
    if geometry is None or capsule is None:
        return
    name = link.get("name", "")
    radius, length = (_size(urdf, name, capsule, key) for key in ("radius", "length"))
    pose = _origin(urdf, name, element)
    place = list(link).index(element) + 1
    for n, z in enumerate((0.0, length / 2, -length / 2)):
        part = element if n == 0 else copy.deepcopy(element)
        inside = part.find("geometry")
        assert inside is not None
        for old in (*inside, *part.findall("origin")):
            (inside if old in list(inside) else part).remove(old)
        at = pose @ Pose((0.0, 0.0, z))
        ElementTree.SubElement(part, "origin", xyz=numbers_text(at.position), rpy=numbers_text(at.rpy()))
        if n == 0:
            ElementTree.SubElement(inside, "cylinder", radius=repr(radius), length=repr(length))
        else:
            ElementTree.SubElement(inside, "sphere", radius=repr(radius))
            link.insert(place, part)


def link_geometry(urdf: str, which: Which) -> tuple[UrdfMesh | UrdfPrimitive, ...]:
    """Return all visual or collision elements of a URDF file, in the order of the file.

    Raises PicktreeError at the first that cannot be used.
    """
    return tuple(_elements(urdf, read_geometry(urdf), which))


def _elements(urdf: str, root: ElementTree.Element, which: Which) -> Iterator[UrdfMesh | UrdfPrimitive]:
    for link in root.findall("link"):
        for element in link.findall(which):
            yield _element(urdf, link.get("name", ""), element)


def _element(urdf: str, link: str, element: ElementTree.Element) -> UrdfMesh | UrdfPrimitive:
    geometry = element.find("geometry")
    if geometry is None or len(geometry) != 1:
        _refuse(urdf, link, f"the <geometry> of its <{element.tag}> must be one shape", _SHAPES)
    pose, kind = _origin(urdf, link, element), geometry[0]
    if kind.tag == "mesh":
        filename = kind.get("filename", "")
        path = mesh_file(Path(urdf), filename)
        if path is None:
            plain = filename.removeprefix("package://").removeprefix("file://")
            raise PicktreeError(f"{urdf}: mesh {plain!r} not found: {Path(urdf).parent / plain}")
        return UrdfMesh(link, str(path), pose, _vector(urdf, link, kind, "scale", "1 1 1"))
    if kind.tag == "box":
        shape: Box | Cylinder | Sphere = Box(_vector(urdf, link, kind, "size"))
    elif kind.tag == "cylinder":
        shape = Cylinder(_size(urdf, link, kind, "radius"), _size(urdf, link, kind, "length"))
    elif kind.tag == "sphere":
        shape = Sphere(_size(urdf, link, kind, "radius"))
    else:
        _refuse(urdf, link, f"<{kind.tag}> is no shape that is read here", _SHAPES)
    return UrdfPrimitive(link, shape, pose)


_SHAPES = "one of <mesh>, <box>, <cylinder>, <sphere>, <capsule>"


def _refuse(urdf: str, link: str, message: str, hint: str = "") -> NoReturn:
    raise PicktreeError(f"{urdf}: link {link!r}: {message}" + (f" ({hint})" if hint else ""))


def _origin(urdf: str, link: str, element: ElementTree.Element) -> Pose:
    origin = element.find("origin")
    try:
        pose = origin_pose(origin)
        if all(map(math.isfinite, pose.position)):
            return pose
    except ValueError:
        pass
    written = "" if origin is None else " ".join(f'{key}="{value}"' for key, value in origin.items())
    _refuse(urdf, link, f"<origin {written}> of its <{element.tag}> must be three numbers each")


def _numbers(urdf: str, link: str, shape: ElementTree.Element, key: str, count: int, default: str) -> Array:
    text = shape.get(key, default)
    written = f'<{shape.tag} {key}="{text}">' if key in shape.attrib else f"<{shape.tag}> without {key!r}"
    wanted = "one number" if count == 1 else f"{count} numbers"
    try:
        numbers = np.array([float(word) for word in text.split()], dtype=np.float64)
    except ValueError:
        point = text.replace(", ", " ").replace(",", ".")
        hint = f'as {key}="{point}"' if "," in text else ""
        _refuse(urdf, link, f"{written} must be {wanted}", hint)
    if len(numbers) != count:
        hint = f'as {key}="{" ".join([text.strip()] * count)}"' if len(numbers) == 1 else ""
        _refuse(urdf, link, f"{written} must be {wanted}, not {len(numbers)}", hint)
    if not np.isfinite(numbers).all():
        _refuse(urdf, link, f"{written} must be finite")
    return numbers


def _vector(
    urdf: str, link: str, shape: ElementTree.Element, key: Literal["size", "scale"], default: str = ""
) -> Vector3:
    numbers = _numbers(urdf, link, shape, key, 3, default)
    x, y, z = numbers.tolist()
    if key == "size" and numbers.min() <= 0.0:
        _refuse(urdf, link, f'<{shape.tag} size="{shape.get(key)}"> must be greater than 0 in each direction')
    if not numbers.all():
        _refuse(urdf, link, f'<{shape.tag} {key}="{shape.get(key)}"> must not be 0')
    return (x, y, z)


def _size(urdf: str, link: str, shape: ElementTree.Element, key: str) -> float:
    (number,) = _numbers(urdf, link, shape, key, 1, "").tolist()
    if number <= 0.0:
        _refuse(urdf, link, f'<{shape.tag} {key}="{shape.get(key)}"> must be greater than 0')
    return number


def geometry_faults(urdf: str) -> tuple[str, ...]:
    """Return a sentence for each element of a URDF whose geometry cannot be used, with its link."""
    try:
        root = read_geometry(urdf)
    except PicktreeError as error:
        return (str(error).removeprefix(f"{urdf}: "),)
    found: dict[str, None] = {}
    collisions: list[UrdfMesh | UrdfPrimitive] = []
    for which in ("visual", "collision"):
        for link in root.findall("link"):
            for element in link.findall(which):
                try:
                    part = _element(urdf, link.get("name", ""), element)
                except PicktreeError as error:
                    found[str(error).removeprefix(f"{urdf}: ")] = None
                else:
                    collisions += [part] if which == "collision" else []
    if not found:
        try:
            link_shapes(urdf)
        except PicktreeError:
            seen_only = links_seen_only(urdf)
            for part in collisions:  # one by one, since all that is wrong is wanted
                try:
                    _shaped(urdf, root, part, may_be_flat=part.link in seen_only)
                except PicktreeError as error:
                    found[str(error).removeprefix(f"{urdf}: ")] = None
    return tuple(found)


def mesh_paths(urdf: str, *which: Which) -> tuple[str, ...]:
    """Return the mesh files of a URDF's elements, each once: of both kinds unless `which` names one."""
    parts = [part for one in which or ("visual", "collision") for part in link_geometry(urdf, one)]
    return tuple(dict.fromkeys(part.path for part in parts if isinstance(part, UrdfMesh)))


def links_seen_only(urdf: str) -> tuple[str, ...]:
    """Return the links that have visual and no collision geometry, in the order of the file."""
    root = parsed_urdf(Path(urdf))
    links = [link for link in root.findall("link") if link.find("collision") is None]
    return tuple(link.get("name", "") for link in links if link.find("visual") is not None)


def link_shapes(urdf: str) -> tuple[LinkShape, ...]:
    """Return the bodies with which the links of a URDF collide, in the order of the file.

    Raises PicktreeError for geometry that cannot be used: file, link, what is wrong, and a remedy. Hulls that
    were made before come from the disk cache.
    """
    elements = _collisions(urdf, _stamp(urdf))
    stamps = tuple(_stamp(element.path) for element in elements if isinstance(element, UrdfMesh))
    return _known_shapes(urdf, elements, stamps)


def fingerprint(parts: tuple[LinkShape, ...]) -> bytes:
    """Return all that the parts consist of, for the key of a cache."""
    import orjson  # not needed by commands that only check

    return orjson.dumps(parts)


def _stamp(file: str) -> Stamp:
    """Return the inode, its last change and the size by which a changed file is told, within one process."""
    stat = Path(file).stat()
    return stat.st_ino, stat.st_ctime_ns, stat.st_size


@lru_cache(maxsize=8)
def _collisions(urdf: str, stamp: Stamp) -> tuple[UrdfMesh | UrdfPrimitive, ...]:
    return link_geometry(urdf, "collision")


@lru_cache(maxsize=8)
def _known_shapes(
    urdf: str, elements: tuple[UrdfMesh | UrdfPrimitive, ...], stamps: tuple[Stamp, ...]
) -> tuple[LinkShape, ...]:
    inputs = (
        Path(urdf),
        repr(elements),
        *(Path(e.path) for e in elements if isinstance(e, UrdfMesh)),
    )
    kept = cached_arrays("link-shapes", inputs, _MAKERS, lambda: _shapes(urdf, elements))
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


def _shapes(urdf: str, elements: Sequence[UrdfMesh | UrdfPrimitive]) -> dict[str, Array]:
    """Return the corners of each mesh's hull, and the share of it that is filled; 0: it has none."""
    root = read_geometry(urdf)
    seen_only = links_seen_only(urdf)
    arrays: dict[str, Array] = {}
    filling: list[float] = []
    for n, element in enumerate(elements):
        shaped = _shaped(urdf, root, element, may_be_flat=element.link in seen_only)
        filling.append(0.0 if shaped is None else max(shaped.filling, 1e-6))
        if shaped is not None and isinstance(shaped.shape, ConvexMesh):
            arrays[f"{n} corners"] = np.array(shaped.shape.vertices)
    return {**arrays, "filling": np.array(filling)}


def _convex(points: Array, source: str) -> ConvexMesh:
    return ConvexMesh(tuple((x, y, z) for x, y, z in points.tolist()), source)


def _shaped(
    urdf: str, root: ElementTree.Element, element: UrdfMesh | UrdfPrimitive, *, may_be_flat: bool
) -> LinkShape | None:
    """Return the convex body of one element; None for a flat mesh that may be flat. Raises PicktreeError."""
    link = element.link
    if isinstance(element, UrdfPrimitive):
        _doubt_size(urdf, root, element, element.shape)
        return LinkShape(link, element.shape, element.pose_in_link)
    try:
        mesh = read_mesh(Path(element.path))
        # Rounded to what the engine keeps of a mesh file, so that all have the same hull.
        scaled = (mesh.vertices * np.array(element.scale)).astype(np.float32).astype(np.float64)
        points = hull_corners(scaled)
    except FlatMesh as error:
        if may_be_flat:
            return None
        _refuse(urdf, link, f"{element.path}: {error.message}", "give it a thickness, or take a <box>")
    except MeshError as error:
        refuse_mesh(urdf, element, error)
    shape = _convex(points, element.path)
    _doubt_size(urdf, root, element, shape)
    volume = float(convex_hull(points).volume)
    filled = mesh.volume() * abs(float(np.prod(element.scale)))
    return LinkShape(link, shape, element.pose_in_link, min(1.0, filled / volume))


def refuse_mesh(urdf: str, element: UrdfMesh, error: MeshError) -> NoReturn:
    """Raise PicktreeError for a mesh file that cannot be used: URDF, link, file, and a remedy."""
    message = error.message if element.path in error.message else f"{element.path}: {error.message}"
    _refuse(urdf, element.link, message, error.hint)


def refuse_size(urdf: str, element: UrdfMesh, points: Array) -> None:
    """Raise PicktreeError when points (n, 3) of a mesh, m, ask for another unit than metres."""
    _doubt_size(urdf, read_geometry(urdf), element, _convex(points, element.path))


def _doubt_size(
    urdf: str, root: ElementTree.Element, element: UrdfMesh | UrdfPrimitive, shape: Shape
) -> None:
    """Raise PicktreeError when the size of a shape asks for another unit than metres."""
    low, high = extents(shape, np.eye(3))
    size = high - low
    longest, reach = float(size.max()), _length(root)
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
    tree = skeleton_of(root)
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


def _length(root: ElementTree.Element) -> float:
    """Return the length of the longest chain of joints, m; 0 when the links are no tree."""
    try:
        tree = skeleton_of(root)
    except UrdfError:
        return 0.0
    lengths = [0.0]
    for link in tree.links:
        chain = (tree.joints[name].child_in_parent.position for name in tree.joints_to(link))
        lengths.append(sum(math.hypot(*position) for position in chain))
    return max(lengths)
