"""Reading the convex meshes of a catalogue."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any, cast

import numpy as np

from ....files.yaml.bounded_open import Unreadable, read_bytes
from ...shapes import ConvexMesh

FORMATS = ("obj", "stl", "ply", "off")
"""Formats of one file that holds nothing but a mesh: none that names or packs other files."""
MAX_BYTES = 1_000_000
MAX_VERTICES = 256
"""Of the hull: contact costs grow with it."""
HOLLOW = 1.05
"""A hull that is larger than its mesh by this factor hides a hollow."""

_DAMAGED = "the mesh file is damaged, or of another format than its name says"


class MeshError(ValueError):
    """What is wrong with a mesh file, and what would be right."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message, self.hint = message, hint


def load_convex(path: Path, scale: float) -> ConvexMesh:
    """The convex hull of a mesh file, scaled to m and moved to its centre of mass. Raises MeshError."""
    # Imported here: trimesh costs 0.3 s, and few scenes have meshes.
    import trimesh

    suffix = path.suffix.lower().removeprefix(".")
    if suffix not in FORMATS:
        raise MeshError(f"{path.name} is no mesh file", f"known: {', '.join(FORMATS)}")
    try:
        raw = read_bytes(path, MAX_BYTES)
    except Unreadable as error:
        raise MeshError(f"{path}: {error.message}") from None
    # Handed over as bytes: nothing beside the file is looked for, such as materials and textures.
    options: dict[str, Any] = {"skip_materials": True} if suffix == "obj" else {}
    try:
        loaded = trimesh.load(io.BytesIO(raw), suffix, force="mesh", **options)  # pyright: ignore[reportUnknownMemberType]
        mesh = cast("trimesh.Trimesh", loaded)
        vertices = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3) * scale
        if not len(vertices):
            raise MeshError(_DAMAGED)
        if len(vertices) < 4 or not np.isfinite(vertices).all():
            raise MeshError("the mesh has no four finite vertices")
        mesh.vertices = vertices
        if np.linalg.matrix_rank(vertices - vertices.mean(axis=0), tol=1e-6) < 3:
            raise MeshError("the mesh is flat: it encloses no volume")
        hull = mesh.convex_hull
        volume, solid = float(hull.volume), float(mesh.volume)
        points = np.asarray(hull.vertices, dtype=np.float64) - np.asarray(hull.center_mass, dtype=np.float64)
        watertight = bool(mesh.is_watertight)
    except MeshError:
        raise
    except (
        ValueError, OSError, LookupError, TypeError, AttributeError, ArithmeticError,
        RuntimeError, struct.error,
    ) as error:  # fmt: skip
        said = str(error).strip().partition("\n")[0] or type(error).__name__
        raise MeshError(f"the mesh file cannot be read: {said}") from None
    except ImportError:  # trimesh looks for a library that guesses the encoding of a damaged file
        raise MeshError(_DAMAGED) from None
    size = points.max(axis=0) - points.min(axis=0)
    if volume < 1e-12 or float(size.min()) < 1e-4:
        raise MeshError("the mesh is flat: it encloses no volume")
    if float(size.max()) > 1.0:
        hint = "is it in millimetres? then 'scale: 0.001'"
        raise MeshError(f"the mesh is {float(size.max()):.3g} m large", hint)
    if watertight and solid > 0 and volume > HOLLOW * solid:
        share = 100 * (volume / solid - 1)
        raise MeshError(f"the mesh is not convex: its hull is {share:.0f} % larger", "convex parts only")
    if len(points) > MAX_VERTICES:
        raise MeshError(f"the hull has {len(points)} vertices", f"{MAX_VERTICES} at most; simplify the mesh")
    return ConvexMesh(tuple((float(x), float(y), float(z)) for x, y, z in points), str(path))
