"""Heaps: items that are poured into a tote or onto the table, and things of an assortment with their meshes.

Each `o` group of an OBJ file is one convex part. The engine reads the parts from the file itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from ...errors import PicktreeError
from ...files.disk_cache import cached_arrays
from ...world.scene.description import ASSORTMENT, Assortment, Bin, CatalogueEntry, SceneDescription, Spawn
from ...world.shapes import ConvexMesh, bottom, convex_hull, corners, top
from ...world.values import Array, ObjectId, Pose, Quaternion, Vector3
from ..footprints import support_height

PACKAGE_SETS = ("random_urdfs",)
"""Sets that come with pybullet. Broken meshes are left out. In `random_urdfs` number 168 has no finite
vertex; four others are thinner than a millimetre at 9 mm a unit."""
MIN_THICKNESS = 0.002
"""Least thickness of a thing, m: twice the engine's margin of compound shapes."""
POUR_GAP = 0.004
"""Least distance of items that are about to fall, m."""
POUR_HEIGHT = 0.01
"""Height of the lowest layer above its support, m."""


@dataclass(frozen=True, slots=True)
class PartsMesh:
    """Mesh of convex parts in its file, for the engine."""

    file: str
    scale: float
    centre: Vector3
    """Centre of mass in the scaled file's frame, m."""
    inertia: Vector3
    """Moments about the centre for 1 kg, m²; products are neglected."""


@dataclass(frozen=True, slots=True)
class Thing:
    """Thing of an assortment: its hull as a kind, and its mesh."""

    entry: CatalogueEntry
    mesh: PartsMesh


@cache
def mesh_files(meshes: str) -> tuple[Path, ...]:
    """Return the OBJ files of a set or folder, sorted by path."""
    if meshes not in PACKAGE_SETS:
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

    Raises PicktreeError for a broken mesh of a folder, and when all are lighter than the least mass.
    """
    files = mesh_files(assortment.meshes)
    found: list[Thing] = []
    while len(found) < number:
        before = len(found)
        for k in rng.permutation(len(files)):
            try:
                thing = read_thing(files[int(k)], assortment)
            except PicktreeError:
                if assortment.meshes not in PACKAGE_SETS:
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
    key = (raw, repr(assortment.scale))
    makers = (Path(__file__), "numpy", "scipy")
    solid = cached_arrays("parts-mesh", key, makers, lambda: _solid(file, raw.decode(), assortment.scale))
    hull, volume = solid["hull"], float(solid["volume"])
    centre, inertia = (tuple(map(float, solid[name])) for name in ("centre", "inertia"))
    shape = ConvexMesh(tuple((float(x), float(y), float(z)) for x, y, z in hull), str(file))
    entry = CatalogueEntry("unknown", "mesh", shape, volume * assortment.density, assortment.friction)
    assert len(centre) == 3 and len(inertia) == 3
    return Thing(entry, PartsMesh(str(file), assortment.scale, centre, inertia))


def _solid(file: Path, text: str, scale: float) -> dict[str, Array]:
    """Return hull (n, 3) about the centre of mass, volume, centre (3,) and inertia (3,) for 1 kg, in SI."""
    parts = [points * scale for points in _parts(file, text)]
    volume, moment, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for points in parts:
        if not np.isfinite(points).all():
            raise PicktreeError(f"{file}: the mesh is broken: a vertex is not a finite number")
        if len(points) < 4 or np.linalg.matrix_rank(points - points.mean(axis=0), tol=1e-6) < 3:
            raise PicktreeError(f"{file}: the mesh is broken: a part has no volume")
        own, first, squares = _moments(points)
        volume, moment, second = volume + own, moment + first, second + squares
    centre = moment / volume
    covariance = second / volume - np.outer(centre, centre)
    spread = np.diag(covariance)
    together = np.concatenate(parts) - centre
    hull = together[np.sort(convex_hull(together).vertices)]
    _, axes = np.linalg.eigh(covariance)
    thin = float(np.ptp(hull @ axes, axis=0).min())
    if thin < MIN_THICKNESS:
        raise PicktreeError(
            f"{file}: the mesh is {thin * 1000:.1f} mm thick; at least {MIN_THICKNESS * 1000:.0f} mm are "
            "wanted, the engine's margin: give a greater 'scale'"
        )
    return {
        "hull": hull,
        "volume": np.array(volume),
        "centre": centre,
        "inertia": spread.sum() - spread,
    }


def _moments(points: Array) -> tuple[float, Array, Array]:
    """Return volume, first (3,) and second (3, 3) moments of the hull of points (n, 3), by tetrahedra."""
    inner = points.mean(axis=0)
    hull = convex_hull(points - inner)
    corners = (points - inner)[hull.simplices]
    volumes = np.abs(np.linalg.det(corners)) / 6.0
    volume = float(volumes.sum())
    sums = corners.sum(axis=1)
    first = (volumes[:, None] * sums).sum(axis=0) / 4.0
    second = np.einsum("k,kai,kaj->ij", volumes, corners, corners)
    second = (second + np.einsum("k,ki,kj->ij", volumes, sums, sums)) / 20.0
    about = np.outer(inner, first)
    return volume, first + volume * inner, second + about + about.T + volume * np.outer(inner, inner)


def _parts(file: Path, text: str) -> list[Array]:
    """Return the vertices (n, 3) of each `o` group of an OBJ text. Raises PicktreeError when it has none."""
    vertices: list[list[float]] = []
    groups: list[set[int]] = [set()]
    try:
        for line in text.splitlines():
            words = line.split()
            if not words:
                continue
            if words[0] == "v":
                vertices.append([float(word) for word in words[1:4]])
            elif words[0] == "o":
                groups.append(set())
            elif words[0] == "f":
                numbers = (int(word.partition("/")[0]) for word in words[1:])
                groups[-1].update(n - 1 if n > 0 else len(vertices) + n for n in numbers)
        points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
        found = [points[sorted(group)] for group in groups if group]
    except (ValueError, IndexError):
        raise PicktreeError(f"{file}: the mesh is broken: it is no OBJ file") from None
    if not found:
        raise PicktreeError(f"{file}: the mesh is broken: it has no faces")
    return found


def draw_entries(
    scene: SceneDescription, spawn: Spawn, rng: np.random.Generator
) -> list[tuple[CatalogueEntry, PartsMesh | None]]:
    """Draw the kinds of a heap's items, in the order of the entry."""
    found: list[tuple[CatalogueEntry, PartsMesh | None]] = []
    for kind, number in spawn.counts:
        if kind == ASSORTMENT:
            assert scene.assortment is not None
            things = draw_things(scene.assortment, number, rng)
            found += [(thing.entry, thing.mesh) for thing in things]
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
    (x0, y0), (x1, y1) = spawn.area
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    z = support_height(scene.fixtures, x, y)
    if z is None:
        raise PicktreeError(f"{where}: no fixture is below ({x:.3f}, {y:.3f}); the heap must lie on a table")
    return Pose((x, y, z)), (x1 - x0, y1 - y0)


def check_contained(tote: Bin, lying: Iterable[tuple[ObjectId, CatalogueEntry, Pose]], where: str) -> None:
    """Raise PicktreeError when items that were poured lie outside of their tote, or far above its rim."""
    low, high = tote.inside()
    count, out = 0, list[str]()
    for name, entry, pose in lying:
        count += 1
        x, y, z = tote.pose.inverse().apply(np.array(pose.position))
        inside = low[0] < x < high[0] and low[1] < y < high[1]
        height = top(entry.shape, pose) - bottom(entry.shape, pose)
        if not inside or not math.isfinite(z) or z > high[2] + height / 2:
            out.append(str(name))
    if out:
        raise PicktreeError(
            f"{where}: {tote.id} overflows: {len(out)} of {count} items do not stay in it "
            f"({', '.join(out[:4])}); make it larger, or ask for fewer or smaller items"
        )
