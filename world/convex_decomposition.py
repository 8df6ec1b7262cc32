"""Convex decomposition: a mesh, or the blocks of an obstacle, as few convex bodies; masses, and the file
of the parts.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from .mesh_reader import FlatMesh, MeshError, TriangleMesh, hull_corners, hulls_text, parse_groups
from .planning_scene import ObstacleBlock
from .shapes import OBSTACLE_VOLUME, Box, CompoundMesh, ConvexMesh, convex_hull
from .values import Array, Vector3

MAX_PARTS = 16
"""Greatest number of parts: contacts cost more with each."""
CONCAVITIES = (0.2, 0.1, 0.06, 0.03)
"""Concavities at which a part counts as convex, coarse ones first, as shares of its size: coacd's
`threshold`."""
SMALL_EXCESS = 0.03
"""Volume of the parts beyond that of the mesh at which no finer parts are looked for, as a share of it."""
SEARCH = {"mcts_iterations": 30, "mcts_nodes": 10, "resolution": 1000}
"""Effort of the search for cuts: a quarter of the library's own, with parts of the same volume."""
RESOLUTION_DIGITS = 5
"""Decimals to which coordinates of parts are rounded, m: 10 µm."""
MAX_EXCESS = 0.25
"""Greatest volume of the parts beyond that of the mesh, as a share of it."""
MAX_CORNERS = 256
"""Greatest number of corners of a hull: contact costs grow with it."""


def decomposed(mesh: TriangleMesh) -> list[Array]:
    """Return the corners (k, 3) of at most `MAX_PARTS` convex parts that together are about the mesh, in its
    frame.

    The decomposition is that of Wei et al., Approximate Convex Decomposition for 3D Meshes with
    Collision-Aware Concavity and Tree Search (SIGGRAPH 2022), by their library.
    Raises MeshError when so few parts do not come near to it.
    """
    import coacd as library  # pyright: ignore[reportMissingTypeStubs] # slow to load

    coacd = cast("Any", library)
    coacd.set_log_level("error")
    best, excess = list[Array](), math.inf
    for concavity in CONCAVITIES:
        found = coacd.run_coacd(
            coacd.Mesh(mesh.vertices, mesh.faces),
            threshold=concavity,
            max_convex_hull=MAX_PARTS,
            preprocess_mode="off",
            **SEARCH,
            seed=0,
        )
        parts = [np.asarray(vertices, dtype=np.float64) for vertices, _ in found]
        more = sum(moments(part)[0] for part in parts) / mesh.volume() - 1.0
        if more < excess:
            best, excess = parts, more
        # The library merges parts again where there are more than it may return, which makes them larger.
        if excess <= (MAX_EXCESS if len(parts) >= MAX_PARTS else SMALL_EXCESS):
            break
    if excess > MAX_EXCESS:
        raise MeshError(
            f"the mesh is too intricate: {MAX_PARTS} convex parts are {100 * excess:.0f} % larger "
            "than the mesh",
            "leave out threads, ribs and engravings",
        )
    return best


def body_of(
    parts: Sequence[Array],
    source: str,
    scale: float,
    hull: Array | None = None,
    centre: Array | None = None,
) -> ConvexMesh:
    """Return the body of convex parts, corners (k, 3) each, about its centre of mass.

    `source` and `scale`: its file, and the factor from the file's coordinates to m.
    `hull` (n, 3) and `centre` (3,) are those of the mesh that was decomposed, if it was one. Parts are only
    about as symmetric as that. Coordinates of parts are rounded to `RESOLUTION_DIGITS`, and slivers that have
    no volume then are left out. Raises FlatMesh when none is left.
    """
    if centre is None:
        centre, _ = centre_and_spread(parts)
    rounded = (np.unique(np.round(part - centre, RESOLUTION_DIGITS) + 0.0, axis=0) for part in parts)
    solid = [_hull_alone(simplified(part)) for part in rounded if _has_volume(part)]
    if not solid:
        raise FlatMesh
    alone = sorted(solid, key=lambda corners: corners.tolist())
    whole = simplified(np.concatenate(alone) if hull is None else hull - centre)
    return _mesh(whole, source, scale, alone if len(alone) > 1 else [])


def _mesh(vertices: Array, source: str, scale: float, parts: Sequence[Array]) -> ConvexMesh:
    if not parts:
        return ConvexMesh(_vectors(vertices), source)
    return CompoundMesh(_vectors(vertices), source, tuple(map(_vectors, parts)), scale)


def as_arrays(mesh: ConvexMesh) -> dict[str, Array]:
    """Return a body as arrays (k, 3) for the disk cache: its hull as `0`, its parts from `1` on."""
    parts = mesh.parts if isinstance(mesh, CompoundMesh) else ()
    return {str(n): np.array(corners) for n, corners in enumerate((mesh.vertices, *parts))}


def from_arrays(arrays: Mapping[str, Array], source: str, scale: float) -> ConvexMesh:
    """Return the body from the arrays of `as_arrays`; other names are ignored."""
    numbers = range(sum(name.isdecimal() for name in arrays))
    vertices, *parts = (arrays[str(n)] for n in numbers)
    return _mesh(vertices, source, scale, parts)


def _has_volume(points: Array) -> bool:
    try:
        hull_corners(points)
    except FlatMesh:
        return False
    return True


def _hull_alone(points: Array) -> Array:
    """Return the points (n, 3) without those that are no corners, also not of the hull that is left."""
    while len(points) > len(corners := points[np.sort(convex_hull(points).vertices)]):
        points = corners
    return points


def _vectors(points: Array) -> tuple[tuple[float, float, float], ...]:
    return tuple((x, y, z) for x, y, z in points.tolist())


def simplified(corners: Array) -> Array:
    """Return at most `MAX_CORNERS` of the corners (k, 3) of a hull: each next one lies farthest outside.

    The surface of a ball, which is the worst case, moves by 0.8 % of its diameter.
    """
    corners = corners[np.sort(convex_hull(corners).vertices)]
    if len(corners) <= MAX_CORNERS:
        return corners
    kept = {int(k) for axis in range(3) for k in (corners[:, axis].argmin(), corners[:, axis].argmax())}
    while len(kept) < 4 or np.linalg.matrix_rank(corners[list(kept)] - corners[min(kept)], tol=1e-7) < 3:
        away = np.linalg.norm(corners[:, None] - corners[sorted(kept)], axis=2).min(axis=1)
        kept.add(int(away.argmax()))
    while True:
        chosen = np.array(sorted(kept))
        faces = np.unique(np.round(convex_hull(corners[chosen]).equations, 12), axis=0)
        outside = (corners @ faces[:, :3].T + faces[:, 3]).max(axis=1)
        outside[chosen] = -1.0
        if len(kept) == MAX_CORNERS or outside.max() <= 0.0:
            break
        kept.add(int(outside.argmax()))
    return corners[chosen]


def centre_and_spread(parts: Sequence[Array]) -> tuple[Array, Array]:
    """Return centre of mass (3,), m, and covariance (3, 3), m², of the mass of parts of one density."""
    volume, moment, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for points in parts:
        own, first, squares = moments(points)
        volume, moment, second = volume + own, moment + first, second + squares
    centre = moment / volume
    return centre, second / volume - np.outer(centre, centre)


def moments(points: Array) -> tuple[float, Array, Array]:
    """Return volume, m³, first (3,) and second (3, 3) moments of the hull of points (n, 3), by tetrahedra."""
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


def parts_name(mesh: str, scale: float) -> str:
    """Return the name of the file of the parts of a mesh with that name at a scale."""
    return f"{mesh}@{scale:g}.parts.obj"


def parts_text(shape: CompoundMesh, raw: bytes) -> str:
    """Return the content of the file of a body's parts, for a mesh with that content."""
    return f"{_heading(raw, shape.scale)}\n{hulls_text([np.array(part) for part in shape.parts])}"


def read_parts(mesh: Path, raw: bytes, scale: float) -> list[Array] | None:
    """Return the corners (k, 3) of the parts in the file beside a mesh, about its centre of mass, m.

    None: there is no such file for this content and scale.
    """
    file = mesh.with_name(parts_name(mesh.name, scale))
    try:
        text = file.read_bytes()
    except OSError:
        return None
    if text.partition(b"\n")[0].decode(errors="replace").strip() != _heading(raw, scale):
        return None
    return parse_groups(text)


def _heading(raw: bytes, scale: float) -> str:
    return f"# convex parts of the mesh {hashlib.sha256(raw).hexdigest()} at scale {scale!r}"


MAX_HULL_VOLUME_RATIO = 1.25
"""Greatest volume of a hull that replaces blocks, as a multiple of their volume."""
ROUNDING_SHARE = 0.01
"""Share by which rounded edges may enlarge the volume of blocks."""
EDGE_DECIMALS = 5
"""Digits to which edges of blocks are compared, m: the belief rounds their places to a thousandth of a mm."""
_SIGNS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


@lru_cache(maxsize=64)
def hulls_of(blocks: tuple[ObstacleBlock, ...]) -> tuple[tuple[Box | ConvexMesh, Vector3], ...]:
    """Return convex bodies that contain all blocks, each with the place of its frame in theirs, m.

    A group of them whose convex hull wastes little becomes that hull; any other is divided where the bounding
    boxes of its two halves waste least.
    """
    sizes = np.array([block.size for block in blocks])
    middles = np.array([block.at for block in blocks])
    found: list[tuple[Box | ConvexMesh, Vector3]] = []
    waiting: list[NDArray[np.intp]] = [np.arange(len(blocks), dtype=np.intp)]
    while waiting:
        group = waiting.pop()
        body = _one_body(sizes[group], middles[group])
        if body is not None:
            found.append(body)
        else:
            first, second = _halves(sizes[group], middles[group])
            waiting += [group[second], group[first]]
    return tuple(found)


def hull_of(blocks: Sequence[ObstacleBlock]) -> Box | ConvexMesh | None:
    """Return the convex body of all blocks, a box where it is one; None when it wastes too much."""
    found = _one_body(np.array([block.size for block in blocks]), np.array([block.at for block in blocks]))
    return None if found is None else found[0]


def _one_body(sizes: Array, middles: Array) -> tuple[Box | ConvexMesh, Vector3] | None:
    """Return the hull of blocks (n, 3), a box where it is one; None when it wastes too much."""
    corners = (middles[:, None] + _SIGNS * sizes[:, None]).reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    # Blocks overlap, and their union takes longer than all else: mostly their sum decides.
    most = (1.0 + ROUNDING_SHARE) * float(sizes.prod(axis=1).sum()) + 1e-8
    if float((high - low).prod()) < most:
        volume = _union(middles - sizes / 2, middles + sizes / 2)
        if float((high - low).prod()) < volume + 1e-9:
            return Box(_vector(high - low)), _vector((low + high) / 2)
    hull = convex_hull(corners)
    if float(hull.volume) > MAX_HULL_VOLUME_RATIO * most:
        return None
    if float(hull.volume) > MAX_HULL_VOLUME_RATIO * _union(middles - sizes / 2, middles + sizes / 2):
        return None
    vertices = np.unique(corners[hull.vertices], axis=0)
    return ConvexMesh(tuple(_vector(vertex) for vertex in vertices), OBSTACLE_VOLUME), (0.0, 0.0, 0.0)


def _halves(sizes: Array, middles: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the numbers of the blocks (n, 3) on either side of the best cut between them."""
    low, high = middles - sizes / 2, middles + sizes / 2
    found: list[tuple[float, NDArray[np.intp], NDArray[np.intp]]] = []
    for axis in range(3):
        order = np.argsort(middles[:, axis], kind="stable")
        waste = _volumes(low[order], high[order])[:-1] + _volumes(low[order[::-1]], high[order[::-1]])[-2::-1]
        cut = int(waste.argmin())
        found.append((round(float(waste[cut]), 12), order[: cut + 1], order[cut + 1 :]))
    _, first, second = min(found, key=lambda each: each[0])
    return first, second


def _volumes(low: Array, high: Array) -> Array:
    """Return the volumes of the bounding boxes of the first, the first two, … of boxes (n, 3), (n,) m³."""
    return (np.maximum.accumulate(high) - np.minimum.accumulate(low)).prod(axis=1)


def _union(low: Array, high: Array) -> float:
    """Return the volume of boxes (n, 3) together, m³; they may overlap."""
    low, high = np.round(low, EDGE_DECIMALS), np.round(high, EDGE_DECIMALS)
    edges = [np.unique(np.concatenate([low[:, k], high[:, k]])) for k in range(3)]
    filled = np.zeros([len(each) - 1 for each in edges])
    first, last = (
        [np.searchsorted(each, side[:, k]) for k, each in enumerate(edges)] for side in (low, high)
    )
    for x, y, z, u, v, w in zip(*first, *last, strict=True):
        filled[x:u, y:v, z:w] = 1.0
    lengths = [np.diff(each) for each in edges]
    return float(np.einsum("xyz,x,y,z->", filled, *lengths))


def _vector(numbers: Array) -> Vector3:
    x, y, z = (round(float(n), 6) for n in numbers)
    return x, y, z
