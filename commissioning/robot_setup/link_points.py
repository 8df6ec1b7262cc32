"""Link geometry as points: corners and triangles of the collision geometry in the frame of each link."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from ...errors import PicktreeError
from ...robots.urdf_tree import UrdfMesh, UrdfPrimitive, link_geometry, mesh_file, parsed_urdf
from ...world.shapes import corners
from ...world.values import Array
from .urdf_source import UnsuitableUrdf


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


def missing_meshes(urdf: Path) -> tuple[str, ...]:
    """Return the meshes that the URDF names and that do not exist, as it names them, each once."""
    root = parsed_urdf(urdf)
    named = dict.fromkeys(mesh.get("filename", "") for mesh in root.iter("mesh"))
    return tuple(name for name in named if mesh_file(urdf, name) is None)


def refuse_missing_meshes(source: str, urdf: Path) -> None:
    """Raise UnsuitableUrdf with all missing meshes, if there are any."""
    missing = missing_meshes(urdf)
    if not missing:
        return
    shown = ", ".join(missing[:6]) + (f" and {len(missing) - 6} more" if len(missing) > 6 else "")
    packages = sorted(
        {m.removeprefix("package://").split("/")[0] for m in missing if m.startswith("package://")}
    )
    helps = f"put the meshes where the URDF names them; plain paths count from {urdf.parent}"
    if packages:
        listed = " and ".join(packages)
        helps = f"put the ROS package {listed} beside {urdf.parent}, or into one of the folders above it"
    raise UnsuitableUrdf(source, f"{len(missing)} meshes that are not there: {shown}", "their files", helps)


def read_solids(urdf: Path) -> Mapping[str, LinkGeometry]:
    """Read the collision geometry by link; links without any are left out. Raises PicktreeError for unusable
    geometry."""
    parts: dict[str, list[LinkGeometry]] = {}
    for element in link_geometry(str(urdf), "collision"):
        parts.setdefault(element.link, []).append(_solid(element))
    return {link: _joined(solids) for link, solids in parts.items()}


def _solid(element: UrdfMesh | UrdfPrimitive) -> LinkGeometry:
    if isinstance(element, UrdfMesh):
        mesh = _loaded(element.path)
        points = np.asarray(mesh.vertices, dtype=np.float64) * np.array(element.scale)
        triangles = np.asarray(mesh.faces, dtype=np.int64)
    else:
        points = corners(element.shape)
        triangles = ConvexHull(points).simplices.astype(np.int64)
        faces = points[triangles]
        outward = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        turned = np.einsum("ij,ij->i", outward, faces.mean(axis=1) - points.mean(axis=0)) < 0
        triangles = np.where(turned[:, None], triangles[:, ::-1], triangles)
    return LinkGeometry(element.pose_in_link.apply(points), triangles)


def _loaded(path: str) -> trimesh.Trimesh:
    try:
        loaded = trimesh.load(path, force="mesh", skip_materials=True)  # pyright: ignore[reportUnknownMemberType]
    except ImportError as error:
        raise PicktreeError(
            f"{path}: this kind of mesh cannot be read here ({error}); "
            "or convert it to STL or OBJ, and name that in a copy of the URDF"
        ) from None
    except (OSError, ValueError, IndexError, KeyError) as error:
        raise PicktreeError(f"{path}: the mesh cannot be read: {error}") from None
    return cast("trimesh.Trimesh", loaded)


def _joined(solids: list[LinkGeometry]) -> LinkGeometry:
    starts = np.cumsum([0, *(len(solid.points) for solid in solids[:-1])]).tolist()
    return LinkGeometry(
        np.concatenate([solid.points for solid in solids]),
        np.concatenate([solid.triangles + start for solid, start in zip(solids, starts, strict=True)]),
    )
