"""Visual meshes of a robot's links from its URDF, reduced in size for every log, and shapes of recorded
bodies."""

from __future__ import annotations

from functools import lru_cache
from importlib.util import find_spec

from ...errors import PicktreeError
from ...robots.urdf_tree import UrdfMesh as MeshFile
from ...robots.urdf_tree import UrdfPrimitive, link_geometry
from ...world.shapes import Box, Shape
from ...world.values import Pose
from ..schema.records import BodyRecord, LinkMesh
from .binary_gltf import write_glb
from .triangle_meshes import Mesh, join_meshes, load_mesh, shape_mesh


def parts_of(body: BodyRecord) -> tuple[tuple[Shape, Pose], ...]:
    """Return convex shapes with their poses in the body's frame."""
    if not body.blocks:
        return ((body.shape, Pose()),)
    return tuple((Box(block.size), Pose(block.at)) for block in body.blocks)


MAX_LINK_FACES = 2000


def _visible_geometry(urdf: str) -> list[MeshFile | UrdfPrimitive]:
    """Return the visual geometry, or the collision geometry of links whose visual meshes no installed library
    reads."""
    visual = link_geometry(urdf, "visual")
    unread = {e.link for e in visual if isinstance(e, MeshFile) and not _is_readable(e.path)}
    plain = [e for e in link_geometry(urdf, "collision") if e.link in unread] if unread else []
    return [*(e for e in visual if e.link not in unread), *plain]


def _is_readable(path: str) -> bool:
    return not path.lower().endswith(".dae") or find_spec("collada") is not None


@lru_cache(maxsize=4)
def link_meshes(urdf: str) -> tuple[LinkMesh, ...]:
    """Return a mesh for each link that has a visual element. Raises PicktreeError for an unreadable mesh.

    A link whose meshes only an absent library reads gets its collision geometry.
    """
    parts: dict[str, list[Mesh]] = {}
    files: dict[str, Mesh] = {}
    for element in _visible_geometry(urdf):
        if isinstance(element, MeshFile):
            if element.path not in files:
                try:
                    files[element.path] = load_mesh(element.path, MAX_LINK_FACES)
                except (OSError, ValueError) as error:
                    raise PicktreeError(f"{element.path}: the mesh cannot be read: {error}") from None
            mesh = files[element.path].placed(element.pose_in_link, element.scale)
        else:
            mesh = shape_mesh(element.shape).placed(element.pose_in_link)
        parts.setdefault(element.link, []).append(mesh)
    return tuple(LinkMesh(link, write_glb(join_meshes(meshes))) for link, meshes in parts.items())
