"""What the links of a robot look like, from its URDF, light enough to stand in every log."""

from __future__ import annotations

from functools import lru_cache

from ..world.errors import PicktreeError
from ..world.robot.urdf import LinkMesh as MeshFile
from ..world.robot.urdf import link_geometry
from .glb import write_glb
from .meshes import Mesh, joined, load_mesh, shape_mesh
from .records import LinkMesh

MOST_FACES = 2000


@lru_cache(maxsize=4)
def link_meshes(urdf: str) -> tuple[LinkMesh, ...]:
    """A model for each link that has a visual element. Raises PicktreeError for an unreadable mesh."""
    parts: dict[str, list[Mesh]] = {}
    files: dict[str, Mesh] = {}
    for element in link_geometry(urdf, "visual"):
        if isinstance(element, MeshFile):
            if element.path not in files:
                try:
                    files[element.path] = load_mesh(element.path, MOST_FACES)
                except (OSError, ValueError) as error:
                    raise PicktreeError(f"{element.path}: the mesh cannot be read: {error}") from None
            mesh = files[element.path].placed(element.pose_in_link, element.scale)
        else:
            mesh = shape_mesh(element.shape).placed(element.pose_in_link)
        parts.setdefault(element.link, []).append(mesh)
    return tuple(LinkMesh(link, write_glb(joined(meshes))) for link, meshes in parts.items())
