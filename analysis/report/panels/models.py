"""What stands in the scene as the page draws it: meshes of links, shapes of bodies, colours."""

from __future__ import annotations

import struct

import numpy as np

from ....logs.meshes.binary_gltf import read_glb
from ....logs.meshes.body_parts import parts_of
from ....logs.meshes.mesh_decimation import thinned
from ....logs.meshes.triangle_meshes import Mesh, joined, part_mesh, shape_mesh, smoothed
from ....logs.recording.foxglove_messages import UNKNOWN_COLOUR
from ....logs.schema.records import Body, LinkMesh, Part
from ....world.colours import COLOURS
from ....world.shapes import Box, ConvexMesh, Cylinder, Shape, Sphere
from ..page_data.packing import Packable, quantised

MOST_FACES = 3000
"""Of one link."""
GRAIN = 1e-4
"""To which vertices are rounded, m."""


def packed_link(model: LinkMesh) -> Packable:
    """The model of a link; None when it is of another kind than those that picktree writes."""
    try:
        mesh = read_glb(model.glb)
    except (ValueError, KeyError, IndexError, struct.error):
        return None
    if len(mesh.faces) > MOST_FACES:
        # The file has a vertex for each of its normals; corners that meet are to be one again.
        places, same = np.unique(np.round(mesh.vertices / GRAIN), axis=0, return_inverse=True)
        mesh = smoothed(*thinned(places * GRAIN, same.ravel()[mesh.faces], mesh.colours, MOST_FACES))
    return {"link": model.link, **packed_mesh(mesh)}


def packed_mesh(mesh: Mesh) -> dict[str, Packable]:
    """Corners that are alike are one vertex."""
    corners = np.concatenate(
        [
            np.round(mesh.vertices[mesh.faces.ravel()] / GRAIN),
            np.round(mesh.normals.reshape(-1, 3) * 127),
            np.round(mesh.colours.repeat(3, axis=0) * 255),
        ],
        axis=1,
    ).astype(np.int32)
    rows, faces = np.unique(corners, axis=0, return_inverse=True)
    return {
        "vertices": quantised(rows[:, :3] * GRAIN, GRAIN),
        "normals": rows[:, 3:6].astype(np.int8),
        "colours": rows[:, 6:].astype(np.uint8),
        "faces": faces.astype(np.uint16 if len(rows) < 1 << 16 else np.uint32),
    }


def packed_shape(shape: Shape) -> Packable:
    match shape:
        case Box(size):
            return {"box": list(size)}
        case Cylinder(radius, height):
            return {"cylinder": [radius, height]}
        case Sphere(radius):
            return {"sphere": radius}
        case ConvexMesh():
            return {"mesh": packed_mesh(shape_mesh(shape))}


def packed_part(part: Part) -> Packable:
    """The shape of a part that never moves; one with holes is a mesh."""
    if not part.holes:
        return packed_shape(part.shape)
    return {"mesh": packed_mesh(part_mesh(part.shape, part.holes))}


def packed_body(body: Body) -> Packable:
    """The shape of a body; an obstacle's blocks are one mesh."""
    if not body.blocks:
        return packed_shape(body.shape)
    mesh = joined(shape_mesh(shape).placed(pose) for shape, pose in parts_of(body))
    return {"mesh": packed_mesh(mesh)}


def rgb(name: str) -> list[Packable]:
    return list(COLOURS.get(name, UNKNOWN_COLOUR))
