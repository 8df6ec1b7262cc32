"""The geometry that a URDF names: meshes and primitives of each link, with resolved file paths."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ..errors import PicktreeError
from ..world.shapes import Box, Cylinder, Sphere
from ..world.values import Pose, Vector3
from .mesh_files import mesh_file


@dataclass(frozen=True, slots=True)
class LinkMesh:
    """A mesh file that belongs to a link: scale its vertices, then place it by `pose_in_link`."""

    link: str
    path: str
    pose_in_link: Pose
    scale: Vector3 = (1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True)
class LinkShape:
    """A primitive that belongs to a link."""

    link: str
    shape: Box | Cylinder | Sphere
    pose_in_link: Pose


def link_geometry(urdf: str, which: Literal["visual", "collision"]) -> tuple[LinkMesh | LinkShape, ...]:
    """All visual or collision elements of a URDF file, in the order of the file."""
    root = ElementTree.parse(urdf).getroot()
    found: list[LinkMesh | LinkShape] = []
    for link in root.findall("link"):
        for element in link.findall(which):
            found.append(_element(urdf, link.get("name", ""), element))
    return tuple(found)


def _element(urdf: str, link: str, element: ElementTree.Element) -> LinkMesh | LinkShape:
    origin = element.find("origin")
    pose = Pose()
    if origin is not None:
        pose = Pose.from_rpy(_vector(origin.get("xyz", "0 0 0")), _vector(origin.get("rpy", "0 0 0")))
    geometry = element.find("geometry")
    if geometry is not None and len(geometry) == 1:
        kind = geometry[0]
        match kind.tag:
            case "mesh":
                path = _resolved(urdf, kind.get("filename", ""))
                return LinkMesh(link, path, pose, _vector(kind.get("scale", "1 1 1")))
            case "box":
                return LinkShape(link, Box(_vector(kind.get("size", ""))), pose)
            case "cylinder":
                shape = Cylinder(float(kind.get("radius", "")), float(kind.get("length", "")))
                return LinkShape(link, shape, pose)
            case "sphere":
                return LinkShape(link, Sphere(float(kind.get("radius", ""))), pose)
            case _:
                pass
    raise PicktreeError(f"{urdf}: link {link!r}: geometry must be one mesh, box, cylinder or sphere")


def _vector(text: str) -> Vector3:
    x, y, z = (float(word) for word in text.split())
    return (x, y, z)


def _resolved(urdf: str, filename: str) -> str:
    path = mesh_file(Path(urdf), filename)
    if path is None:
        plain = filename.removeprefix("package://").removeprefix("file://")
        raise PicktreeError(f"{urdf}: mesh {plain!r} not found: {Path(urdf).parent / plain}")
    return str(path)


def resolved_urdf(urdf: str) -> str:
    """The text of a URDF with the full path of every mesh, for libraries with other rules of where to look.

    Raises PicktreeError for a mesh that is not there.
    """
    root = ElementTree.parse(urdf).getroot()
    for mesh in root.iter("mesh"):
        mesh.set("filename", _resolved(urdf, mesh.get("filename", "")))
    return ElementTree.tostring(root, encoding="unicode")
