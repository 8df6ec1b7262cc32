"""Heaps: items that are poured into a tote or onto the table, and things of an assortment.

Each `o` group of a thing's OBJ file is one convex part.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from picktree.files import PicktreeError, disk_cache
from picktree.world import (
    Array,
    Box,
    ConvexMesh,
    ObjectId,
    Pose,
    Quaternion,
    Shape,
    bottom,
    convex_decomposition,
    convex_hull,
    corners,
    half_spaces,
    heap_geometry,
    mesh_reader,
    top,
)
from picktree.world import convex_parts as convex_parts_of
from picktree.world.scene import (
    ASSORTMENT,
    MESH_SETS,
    Assortment,
    CatalogueEntry,
    Fixture,
    SceneDescription,
    Spawn,
)

from .footprints import support_height

MIN_THICKNESS = 0.002
"""Least thickness of a thing, m: twice the engine's margin of compound shapes."""
POUR_GAP = 0.004
"""Least distance of items that are about to fall, m."""
POUR_HEIGHT = 0.01
"""Height of the lowest layer above its support, m."""
TAG_FACE_SHARE = 0.95
"""Least width of a face that carries a tag, as a share of the tag's side."""
PILE_WALL_HEIGHT = 0.6
"""Height of the walls between which a pile is poured, m."""


@dataclass(frozen=True, slots=True)
class Stickers:
    """Places of one tag on the faces of a thing."""

    poses: tuple[Pose, ...]
    """Poses in the frame of the body: z points outwards."""
    size: float
    """Side of the tag, m."""


@dataclass(frozen=True, slots=True)
class Sticker:
    """ArUco tag on a face of an item."""

    number: int
    size: float
    """Side of the black square, m."""
    pose: Pose
    """Middle of the tag in the world; z points out of the face."""


@dataclass(frozen=True, slots=True)
class Thing:
    """Thing of an assortment, as a kind, with the faces that carry a tag."""

    entry: CatalogueEntry
    stickers: Stickers


@cache
def mesh_files(meshes: str) -> tuple[Path, ...]:
    """Return the OBJ files of a set or folder, sorted by path."""
    if meshes not in MESH_SETS:
        return tuple(sorted(Path(meshes).glob("*.obj")))
    from importlib.util import find_spec

    package = find_spec("pybullet_data")
    assert package is not None and package.origin is not None, "it comes with pybullet"
    folder = Path(package.origin).parent / meshes
    found = sorted(folder.glob("*/*.obj"))
    if not found:
        raise PicktreeError(f"the set {meshes!r} is not installed with pybullet: {folder} is empty")
    return tuple(found)


def draw_things(assortment: Assortment, number: int, rng: np.random.Generator) -> list[Thing]:
    """Draw things of an assortment, each at most once while there are enough.

    Broken meshes of a set are left out: in `random_urdfs` number 168 has no finite vertex, and four others
    are thinner than a millimetre at 9 mm a unit. Raises PicktreeError for a broken mesh of a folder, and when
    all are lighter than the least mass.
    """
    files = mesh_files(assortment.meshes)
    found: list[Thing] = []
    while len(found) < number:
        before = len(found)
        for k in rng.permutation(len(files)):
            try:
                thing = read_thing(files[int(k)], assortment)
            except PicktreeError:
                if assortment.meshes not in MESH_SETS:
                    raise
                continue
            if thing.entry.mass >= assortment.least_mass:
                found.append(thing)
            if len(found) == number:
                break
        if len(found) == before:
            least = f"{assortment.least_mass * 1000:g} g"
            raise PicktreeError(
                f"{assortment.meshes}: all {len(files)} meshes are lighter than {least} at "
                f"{assortment.density:g} kg/m³; give a greater 'density' or 'scale', or another 'least_mass'"
            )
    return found


def read_thing(file: Path, assortment: Assortment) -> Thing:
    """Return the thing of one OBJ file. Raises PicktreeError when its mesh is broken."""
    raw = file.read_bytes()
    side = assortment.tag_size if assortment.tags else 0.0
    key = (raw, repr(assortment.scale), repr(side))
    makers = (Path(__file__), convex_decomposition, mesh_reader, "numpy", "scipy", "trimesh")
    solid = disk_cache.cached_arrays("thing", key, makers, lambda: _solid(file, raw, assortment.scale, side))
    volume, stickers, shape = (
        float(solid["volume"]),
        solid["stickers"],
        convex_decomposition.from_arrays(solid, str(file), assortment.scale),
    )
    entry = CatalogueEntry("unknown", "mesh", shape, volume * assortment.density, assortment.friction)
    poses = tuple(Pose.from_rotation(tuple(m[:3, 3]), m[:3, :3]) for m in stickers)
    return Thing(entry, Stickers(poses, side))


def _solid(file: Path, raw: bytes, scale: float, side: float) -> dict[str, Array]:
    """Return the bodies of a mesh, in SI, with the origin in its centre of mass.

    `volume`; the corners (n, 3) of its hull as `0`, and of its parts from `1` on; the `stickers` (k, 4, 4) of
    tags. `side` is that of a tag; 0: no stickers.
    """
    try:
        parts = [points * scale for points in mesh_reader.parse_groups(raw)]
    except mesh_reader.MeshError as error:
        raise PicktreeError(f"{file}: {error}") from None
    if any(np.linalg.matrix_rank(part - part.mean(axis=0), tol=1e-6) < 3 for part in parts):
        raise PicktreeError(f"{file}: the mesh is broken: a part has no volume")
    volume = sum(convex_decomposition.moments(part)[0] for part in parts)
    body = convex_decomposition.body_of(parts, str(file), scale)
    about = [np.array(part.vertices) for part in convex_parts_of(body)]
    _, spread = convex_decomposition.centre_and_spread(about)
    _, axes = np.linalg.eigh(spread)
    thin = float(np.ptp(np.array(body.vertices) @ axes, axis=0).min())
    if thin < MIN_THICKNESS:
        raise PicktreeError(
            f"{file}: the mesh is {thin * 1000:.1f} mm thick; at least {MIN_THICKNESS * 1000:.0f} mm are "
            "wanted, the engine's margin: give a greater 'scale'"
        )
    return {
        **convex_decomposition.as_arrays(body),
        "volume": np.array(volume),
        "stickers": _stickers(about, side),
    }


MAX_STICKERS = 8
"""Greatest number of tags on a thing."""


def _stickers(parts: Sequence[Array], side: float) -> Array:
    """Return the frames (k, 4, 4) of tags on the greatest flat faces of convex parts (n, 3); z outwards."""
    found: list[tuple[float, Array]] = []
    hulls = [np.unique(np.round(convex_hull(points).equations, 6), axis=0) for points in parts if side > 0.0]
    for points, faces in zip(parts, hulls, strict=False):
        for face in faces:
            frame, size = _face_frame(points, face)
            inside = (h[:, :3] @ frame[:3, 3] + h[:, 3] < 1e-3 for h in hulls)
            hidden = sum(bool(each.all()) for each in inside) > 1
            if min(size) >= TAG_FACE_SHARE * side and not hidden:
                found.append((size[0] * size[1], frame))
    ranked = sorted(found, key=lambda one: -one[0])[:MAX_STICKERS]
    return np.array([frame for _, frame in ranked], dtype=np.float64).reshape(-1, 4, 4)


def _face_frame(points: Array, face: Array) -> tuple[Array, tuple[float, float]]:
    """Return the frame (4, 4) in the middle of a hull's face, and its lengths along x and y, m.

    x is along the longest edge, z outwards. The lengths of an edge or a corner are 0.
    """
    normal, frame = face[:3], np.eye(4)
    touching = points[points @ normal + face[3] > -SUPPORT_TOLERANCE]
    across = np.linalg.svd(normal[None])[2][1:]
    outline = touching @ across.T
    if np.linalg.matrix_rank(outline - outline.mean(axis=0), tol=1e-4) < 2:
        return frame, (0.0, 0.0)
    ends = outline[convex_hull(outline).vertices]
    edges = np.roll(ends, -1, axis=0) - ends
    along = edges[int(np.argmax((edges**2).sum(axis=1)))] @ across
    along /= np.linalg.norm(along)
    frame[:3, :3] = np.column_stack([along, np.cross(normal, along), normal])
    local = touching @ frame[:3, :3]
    low, high = local.min(axis=0), local.max(axis=0)
    frame[:3, 3] = frame[:3, :3] @ np.array([*((low + high) / 2)[:2], high[2]])
    return frame, (float(high[0] - low[0]), float(high[1] - low[1]))


def draw_entries(
    scene: SceneDescription, spawn: Spawn, rng: np.random.Generator
) -> list[tuple[CatalogueEntry, Stickers | None]]:
    """Draw the kinds of a heap's items, in the order of the entry."""
    found: list[tuple[CatalogueEntry, Stickers | None]] = []
    for kind, number in spawn.counts.items():
        if kind == ASSORTMENT:
            assert scene.assortment is not None
            things = draw_things(scene.assortment, number, rng)
            found += [(thing.entry, thing.stickers) for thing in things]
        else:
            found += [(scene.entry(kind), None)] * number
    return found


def pour_poses(
    scene: SceneDescription,
    spawn: Spawn,
    shapes: Sequence[CatalogueEntry],
    turns: Sequence[Quaternion],
    rng: np.random.Generator,
    where: str,
) -> list[Pose]:
    """Return poses from which items fall into a heap: layers of cells as wide as the greatest item.

    Raises PicktreeError when an item is wider than the place, or nothing is below it.
    """
    frame, size = _place(scene, spawn, where)
    reach = max(float(np.linalg.norm(corners(e.shape), axis=1).max()) for e in shapes)
    cell = 2 * reach + POUR_GAP
    columns = [max(1, int(length / cell)) for length in size]
    if min(size) < reach:
        raise PicktreeError(
            f"{where}: an item of {2000 * reach:.0f} mm does not fit into {size[0] * 1000:.0f} × "
            f"{size[1] * 1000:.0f} mm; make the place larger, or the items smaller"
        )
    layer = columns[0] * columns[1]
    poses: list[Pose] = []
    order = [int(k) for _ in range(0, len(shapes), layer) for k in rng.permutation(layer)]
    for n, turn in enumerate(turns):
        i, j = divmod(order[n], columns[1])
        spare = [max(0.0, length / count - cell) for length, count in zip(size, columns, strict=True)]
        x, y = (
            (k + 0.5) * length / count - length / 2 + float(rng.uniform(-0.5, 0.5)) * free
            for k, count, length, free in zip((i, j), columns, size, spare, strict=True)
        )
        z = POUR_HEIGHT + reach + (n // layer) * cell
        at = frame @ Pose((x, y, z))
        poses.append(Pose(at.position, turn))
    return poses


def _place(scene: SceneDescription, spawn: Spawn, where: str) -> tuple[Pose, tuple[float, float]]:
    """Return the middle of a heap's support, and the lengths of the place along its x and y, m."""
    if spawn.into is not None:
        tote = next(each for each in scene.bins if each.id == spawn.into)
        low, high = tote.inside()
        return tote.pose.shifted((0.0, 0.0, tote.wall)), (high[0] - low[0], high[1] - low[1])
    (x0, y0), (x1, y1) = spawn.rectangle
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    z = support_height(scene.fixtures, x, y)
    if z is None:
        raise PicktreeError(f"{where}: no fixture is below ({x:.3f}, {y:.3f}); the heap must lie on a table")
    return Pose((x, y, z)), (x1 - x0, y1 - y0)


def check_contained(
    region: heap_geometry.HeapRegion, lying: Iterable[tuple[ObjectId, CatalogueEntry, Pose]], where: str
) -> None:
    """Raise PicktreeError when items lie outside of their tote or pile, or far above the rim of a tote."""
    x_end, y_end = region.size[0] - region.wall, region.size[1] - region.wall
    count, out = 0, list[str]()
    for name, entry, pose in lying:
        count += 1
        x, y, z = region.frame.inverse().apply(np.array(pose.position))
        inside = region.wall < x < x_end and region.wall < y < y_end and z > 0.0
        height = top(entry.shape, pose) - bottom(entry.shape, pose)
        if not inside or not math.isfinite(z) or (region.wall > 0.0 and z > region.rim + height / 2):
            out.append(str(name))
    if out and region.wall > 0.0:
        raise PicktreeError(
            f"{where}: {region.id} overflows: {len(out)} of {count} items do not stay in it "
            f"({', '.join(out[:4])}); make it larger, or ask for fewer or smaller items"
        )
    if out:
        raise PicktreeError(
            f"{where}: {len(out)} of {count} items roll or slide out of the area with its rim of "
            f"{heap_geometry.PILE_RIM * 1000:.0f} mm ({', '.join(out[:4])}); "
            "ask for fewer or flatter items, another seed, or a larger area"
        )


MIN_UPRIGHT_TILT = math.radians(15.0)
"""Least tilt that an upright thing must survive, rad."""
SUPPORT_TOLERANCE = 2e-4
"""Distance from the plane of a face within which a vertex is in contact with the support, m."""


def upright_turn(shape: Shape) -> Quaternion:
    """Return the upright orientation of a thing, on the face that makes it tallest.

    The face must carry it up to a tilt of `MIN_UPRIGHT_TILT`; without such a face, the most stable one is
    taken. The shape's origin is its centre of mass.
    """
    assert isinstance(shape, ConvexMesh)
    vertices = np.array(shape.vertices)
    best, found = (False, -math.inf), np.array([0.0, 0.0, -1.0])
    for normal, offset in zip(*half_spaces(shape), strict=True):
        touching = vertices[vertices @ normal > offset - SUPPORT_TOLERANCE]
        across = np.linalg.svd(normal[None])[2][1:]
        outline = touching @ across.T
        if np.linalg.matrix_rank(outline - outline.mean(axis=0), tol=1e-4) < 2:
            continue
        tilt = math.atan2(-float(convex_hull(outline).equations[:, 2].max()), offset)
        steady = tilt >= MIN_UPRIGHT_TILT
        rank = (steady, float(np.ptp(vertices @ normal)) if steady else tilt)
        if rank > best:
            best, found = rank, normal
    return _turn_down(found)


def _turn_down(direction: Array) -> Quaternion:
    """Return the smallest rotation that takes a unit vector to -z."""
    x, y, z = (float(c) for c in direction)
    if z > 1.0 - 1e-9:
        return 1.0, 0.0, 0.0, 0.0
    w = math.sqrt((1.0 - z) / 2.0)
    # The axis is direction × (0, 0, -1).
    return -y / (2.0 * w), x / (2.0 * w), 0.0, w


PILE_WALL = 0.01
"""Thickness of the walls between which a pile is poured, m."""


def pile_walls(scene: SceneDescription, spawn: Spawn, where: str) -> tuple[Fixture, ...]:
    """Return the walls between which a pile is poured: as high as the falling items, about the area."""
    frame, (x, y) = _place(scene, spawn, where)
    height = PILE_WALL_HEIGHT
    sides = (
        ((PILE_WALL, y + 2 * PILE_WALL, height), ((x + PILE_WALL) / 2, 0.0)),
        ((PILE_WALL, y + 2 * PILE_WALL, height), (-(x + PILE_WALL) / 2, 0.0)),
        ((x, PILE_WALL, height), (0.0, (y + PILE_WALL) / 2)),
        ((x, PILE_WALL, height), (0.0, -(y + PILE_WALL) / 2)),
    )
    return tuple(
        Fixture(ObjectId(f"wall_{n}"), Box(size), frame.shifted((*at, height / 2)))
        for n, (size, at) in enumerate(sides)
    )
