"""Mesh decimation: edges collapse where that changes the surface least.

Quadric error metrics (Garland & Heckbert 1997, "Surface simplification using quadric error metrics"). Many
independent edges collapse at a time, so that numpy does the work.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...world.values import Array

Indices = NDArray[np.int64]

_WELD_DISTANCE = 1e-6
"""Distance below which two vertices are merged, m."""
_BORDER_WEIGHT = 4.0
"""Weight of a border, or of an edge between two colours, relative to a surface."""
_MIDPOINT_WEIGHT = 1e-4
"""Weight of an edge's middle in the position of the new vertex, relative to the planes around it."""
_PASS_SHARE = 0.5
"""Share of the edges in one pass, those with the lowest cost. All, when none of them may collapse."""
_MIN_TURN_COSINE = 0.3
"""Least cosine of the angle by which a face may turn in one pass."""


@dataclass(slots=True)
class _Surface:
    vertices: Array
    faces: Indices
    colour: Indices
    """Colour number of each face."""
    quadrics: Array
    """Quadric of each vertex, (10, n): the upper triangle of a symmetric 4 × 4 matrix by rows."""


def decimate(vertices: Array, faces: Indices, colours: Array, most: int) -> tuple[Array, Indices, Array]:
    """Reduce a mesh to about `most` faces: vertices (n, 3), faces (m, 3) and the faces' colours (m, 3)."""
    if len(faces) <= most:
        return vertices, faces, colours
    shades = np.round(colours * 255).astype(np.int64)
    example, colour = _distinct(shades)
    first, welded = _distinct(np.round(vertices / _WELD_DISTANCE).astype(np.int64))
    surface = _without_slivers(_Surface(vertices[first], welded[faces], colour, np.zeros((10, len(first)))))
    surface.quadrics = _quadrics(surface)
    share = _PASS_SHARE
    while len(surface.faces) > most:
        if not _collapse(surface, len(surface.faces) - most, share):
            if share == 1.0:
                break
            share = 1.0
    used, index = np.unique(surface.faces, return_inverse=True)
    return surface.vertices[used], index.reshape(-1, 3), (shades[example] / 255)[surface.colour]


def _collapse(surface: _Surface, spare: int, share: float) -> bool:
    """Collapse edges in one pass over that share of them. Return whether any edge was collapsed.

    An edge takes two faces with it, at a border one; `spare` is the number of faces that may go.
    """
    edges = _edges(surface.faces)
    places, costs = _best_places(surface, edges)
    most = max(1, int(share * len(edges)))
    cheap = np.argpartition(costs, most - 1)[:most] if most < len(edges) else np.arange(most)
    order = cheap[np.argsort(costs[cheap])]
    rank = np.arange(len(order))
    best = np.full(len(surface.vertices), len(order))
    for side in (0, 1):
        np.minimum.at(best, edges[order, side], rank)
    lone = (best[edges[order, 0]] == rank) & (best[edges[order, 1]] == rank)
    chosen = order[lone][: (spare + 1) // 2]
    kept, gone, place = edges[chosen, 0], edges[chosen, 1], places[chosen]
    while len(kept):
        moved = surface.vertices.copy()
        moved[kept] = place
        target = np.arange(len(moved))
        target[gone] = kept
        faces = target[surface.faces]
        stays = _proper(faces)
        bad = np.zeros(len(moved), np.bool_)
        bad[faces[stays][_turned_faces(surface, moved, faces, stays)]] = True
        wrong = bad[kept]
        if not wrong.any():
            surface.vertices, surface.faces, surface.colour = moved, faces[stays], surface.colour[stays]
            surface.quadrics[:, kept] += surface.quadrics[:, gone]
            return True
        kept, gone, place = kept[~wrong], gone[~wrong], place[~wrong]
    return False


def _best_places(surface: _Surface, edges: Indices) -> tuple[Array, Array]:
    """Return the best position for the collapse of each edge (n, 2), as (n, 3), and its cost, (n,)."""
    a, b = edges.T
    start, stop = surface.vertices[a].T, surface.vertices[b].T
    xx, xy, xz, x1, yy, yz, y1, zz, z1, one = surface.quadrics[:, a] + surface.quadrics[:, b]
    # The minimum of the quadric, drawn a little towards the edge's middle, by Cramer's rule.
    pull = _MIDPOINT_WEIGHT * (xx + yy + zz) + 1e-15
    u, v, w = pull * (start + stop) / 2 - np.stack([x1, y1, z1])
    p, q, r = xx + pull, yy + pull, zz + pull
    c0, c1, c2 = q * r - yz * yz, xz * yz - xy * r, xy * yz - xz * q
    d1, d2, e2 = p * r - xz * xz, xy * xz - p * yz, p * q - xy * xy
    scale = 1 / (p * c0 + xy * c1 + xz * c2)
    x = (c0 * u + c1 * v + c2 * w) * scale
    y = (c1 * u + d1 * v + d2 * w) * scale
    z = (c2 * u + d2 * v + e2 * w) * scale
    cost = (
        x * (xx * x + 2 * (xy * y + xz * z + x1)) + y * (yy * y + 2 * (yz * z + y1)) + z * (zz * z + 2 * z1)
    ) + one
    # On a plane every edge costs nothing. Short ones come first, so that faces keep their shape.
    return np.column_stack([x, y, z]), np.maximum(cost, 0.0) + 1e-9 * ((start - stop) ** 2).sum(axis=0)


def _quadrics(surface: _Surface) -> Array:
    """Return the squared distances to the planes of the faces around each vertex, weighted by area."""
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    normals /= area[:, None]
    found = np.zeros((10, len(surface.vertices)))
    _add(found, surface.faces.ravel(), (_plane(normals, corners[:, 0]) * area[:, None]).repeat(3, axis=0))
    # Each border has a plane perpendicular to its face.
    edges, which = _edges_of_sides(surface.faces)
    owner = np.arange(len(surface.faces)).repeat(3)
    count = np.bincount(which, minlength=len(edges))
    low, high = np.full(len(edges), np.iinfo(np.int64).max), np.zeros(len(edges), np.int64)
    np.minimum.at(low, which, surface.colour[owner])
    np.maximum.at(high, which, surface.colour[owner])
    face = np.zeros(len(edges), np.int64)
    face[which] = owner
    border = np.flatnonzero((count == 1) | (low != high))
    start, stop = surface.vertices[edges[border, 0]], surface.vertices[edges[border, 1]]
    upright = np.cross(stop - start, normals[face[border]])
    length = np.linalg.norm(upright, axis=1)
    planes = _plane(upright / length[:, None], start) * (_BORDER_WEIGHT * length**2)[:, None]
    for side in (0, 1):
        _add(found, edges[border, side], planes)
    return found


def _plane(normals: Array, points: Array) -> Array:
    """Return quadrics (n, 10) of the squared distance to planes."""
    n = np.column_stack([normals, -np.einsum("ni,ni->n", normals, points)])
    rows, columns = np.triu_indices(4)
    return n[:, rows] * n[:, columns]


def _add(sums: Array, where: Indices, values: Array) -> None:
    for row, column in zip(sums, values.T, strict=True):
        row += np.bincount(where, weights=column, minlength=len(row))


def _edges(faces: Indices) -> Indices:
    """Return all edges (n, 2), each once."""
    keys, most = _keys(faces)
    keys.sort()
    # np.unique of numpy 2.4 takes four times as long.
    keys = keys[np.concatenate([[True], keys[1:] != keys[:-1]])]
    low = keys // most
    return np.column_stack([low, keys - low * most])


def _edges_of_sides(faces: Indices) -> tuple[Indices, Indices]:
    """Return all edges (n, 2), each once, and the edge of each side of each face, (3m,)."""
    keys, most = _keys(faces)
    keys, which = np.unique(keys, return_inverse=True)
    return np.column_stack(np.divmod(keys, most)), which


def _keys(faces: Indices) -> tuple[Indices, int]:
    """Return lower vertex · factor + higher vertex for each side of each face, (3m,), and the factor."""
    most = int(faces.max()) + 1
    keys = np.empty(faces.shape, np.int64)
    for side, (start, stop) in enumerate(((0, 1), (1, 2), (2, 0))):
        a, b = faces[:, start], faces[:, stop]
        keys[:, side] = np.minimum(a, b) * most + np.maximum(a, b)
    return keys.ravel(), most


def _turned_faces(
    surface: _Surface, moved: Array, faces: Indices, stays: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which of the remaining faces turn by too much, or lose all area."""
    a, b, c = _areas(surface.vertices, surface.faces[stays])
    u, v, w = _areas(moved, faces[stays])
    size = np.sqrt(a * a + b * b + c * c) * np.sqrt(u * u + v * v + w * w)
    return a * u + b * v + c * w <= _MIN_TURN_COSINE * size


def _areas(vertices: Array, faces: Indices) -> tuple[Array, Array, Array]:
    """Return the coordinates (m,) of each face's normal with twice its area as length."""
    (x, y, z), (a, b, c) = vertices.T.copy(), faces.T
    first_x, first_y, first_z = x[a], y[a], z[a]
    ux, uy, uz = x[b] - first_x, y[b] - first_y, z[b] - first_z
    vx, vy, vz = x[c] - first_x, y[c] - first_y, z[c] - first_z
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


def _distinct(rows: Indices) -> tuple[Indices, Indices]:
    """Return the distinct rows of (n, 3) as the index of the first of each, sorted by row, (k,).

    Second result: the place of each row among them, (n,).
    """
    low = rows.min(axis=0)
    across, deep, high = (int(n) for n in rows.max(axis=0) - low + 1)
    if across * deep * high < 2**62:  # one number for a row: sorting rows takes seven times as long
        x, y, z = (rows - low).T
        _, first, which = np.unique((x * deep + y) * high + z, return_index=True, return_inverse=True)
    else:
        _, first, which = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return first, which.ravel()


def _proper(faces: Indices) -> NDArray[np.bool_]:
    a, b, c = faces.T
    return (a != b) & (b != c) & (c != a)


def _without_slivers(surface: _Surface) -> _Surface:
    """Remove the faces that have no area."""
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    stays = _proper(surface.faces) & (np.linalg.norm(normals, axis=1) > 1e-14)
    return _Surface(surface.vertices, surface.faces[stays], surface.colour[stays], surface.quadrics)
