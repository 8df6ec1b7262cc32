"""The surface of a fixture with holes, for whatever shows it: cameras, pages, pictures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial import ConvexHull

from ..shapes import Box
from ..values import Array
from .hole_geometry import layered_pieces
from .holes import Hole

ABOVE = 1e-6
"""A face is seen unless this much above its middle is inside another piece, m."""
TOUCHING = 1e-8
"""What is no farther outside a piece than this is inside: faces of pieces meet, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Triangles in the box's frame, counter-clockwise from outside, each with corners of its own."""

    corners: Array
    """(3n, 3), m"""
    normals: Array
    """(3n, 3), of the corner's triangle."""


@cache
def surface(box: Box, holes: tuple[Hole, ...]) -> Surface:
    """What can be seen of a box with holes, their insides included."""
    hulls: list[tuple[Array, ConvexHull]] = []
    for piece, piece_in_fixture in layered_pieces(box, holes):
        points = piece_in_fixture.apply(np.array(piece.vertices))
        hulls.append((points, ConvexHull(points)))
    corners: list[Array] = []
    normals: list[Array] = []
    for n, (points, hull) in enumerate(hulls):
        outward = hull.equations[:, :3]
        triangles = points[hull.simplices]
        # Where the corners run clockwise from outside two of them change places.
        across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        clockwise = np.einsum("ij,ij->i", across, outward) < 0.0
        triangles[clockwise] = triangles[clockwise][:, ::-1]
        above = triangles.mean(axis=1) + ABOVE * outward
        hidden = np.zeros(len(triangles), dtype=np.bool_)
        for other, (_, solid) in enumerate(hulls):
            if other != n:
                hidden |= (solid.equations[:, :3] @ above.T + solid.equations[:, 3:] < TOUCHING).all(axis=0)
        corners.append(triangles[~hidden].reshape(-1, 3))
        normals.append(np.repeat(outward[~hidden], 3, axis=0))
    return Surface(np.vstack(corners), np.vstack(normals))
