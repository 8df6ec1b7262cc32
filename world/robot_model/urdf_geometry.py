"""Geometry elements of a URDF: meshes and primitives of its links, and their faults."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from ...files.errors import PicktreeError
from ..shapes import Box, Cylinder, Sphere
from ..values import Pose, Vector3, vector3
from .mesh_files import PACKAGE, mesh_file
from .urdf_faults import UrdfError, number_faults, numbers_of, origin_faults, vector_faults
from .urdf_text import parsed_urdf
from .urdf_tree import origin_pose


@dataclass(frozen=True, slots=True)
class UrdfMesh:
    """A mesh file that belongs to a link: scale its vertices, then place it by `pose_in_link`."""

    link: str
    path: str
    pose_in_link: Pose
    scale: Vector3 = (1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True)
class UrdfPrimitive:
    """A primitive that belongs to a link."""

    link: str
    shape: Box | Cylinder | Sphere
    pose_in_link: Pose


Geometry = UrdfMesh | UrdfPrimitive
Which = Literal["visual", "collision"]
_SIZES: Final = {
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "capsule": ("radius", "length"),
}
"""Attributes of each primitive."""
MAX_MARKER_SIZE = 0.02
"""Greatest size of a marker, m."""
_SHAPES = "one of <mesh>, <box>, <cylinder>, <sphere>, <capsule>"


def link_geometry(urdf: str, which: Which) -> tuple[Geometry, ...]:
    """Return all visual or collision elements of a URDF file, in the order of the file.

    A link that is seen and has no collision geometry collides as it is seen, unless it is a marker. A capsule
    is a cylinder with a sphere at either end. Raises PicktreeError at the first that cannot be used.
    """
    found: list[Geometry] = []
    for link, element in _elements(_root(urdf), which):
        for fault in _faults(Path(urdf), link, element):
            raise PicktreeError(f"{urdf}: {fault}")
        found += _parts(Path(urdf), link, element)
    return tuple(found)


def element_faults(urdf: str) -> tuple[str, ...]:
    """Return a sentence for each fault of a URDF's visual and collision elements, each once."""
    root = _root(urdf)
    elements = [each for which in ("visual", "collision") for each in _elements(root, which)]
    return tuple(
        dict.fromkeys(fault for link, element in elements for fault in _faults(Path(urdf), link, element))
    )


def mesh_paths(urdf: str, *which: Which) -> tuple[str, ...]:
    """Return the mesh files of a URDF's elements, each once: of both kinds unless `which` names one."""
    parts = [part for one in which or ("visual", "collision") for part in link_geometry(urdf, one)]
    return tuple(dict.fromkeys(part.path for part in parts if isinstance(part, UrdfMesh)))


def links_seen_only(urdf: str) -> tuple[str, ...]:
    """Return the links that collide as they are seen, in the order of the file: those without collision
    geometry, but for markers."""
    root = _root(urdf)
    seen = [
        link
        for link in root.findall("link")
        if link.find("collision") is None and link.find("visual") is not None
    ]
    markers = _markers(root)
    return tuple(name for link in seen if (name := link.get("name", "")) not in markers)


def _markers(root: ElementTree.Element) -> frozenset[str]:
    """Return the links that show a frame, as a small ball at the tool's: no bodies.

    Such a link has neither mass nor collision geometry, but one primitive of MAX_MARKER_SIZE at most. It is
    fixed to another link and carries none.
    """
    fixed, carriers = set[str](), set[str]()
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            carriers.add(parent.get("link", ""))
            if joint.get("type") == "fixed":
                fixed.add(child.get("link", ""))
    return frozenset(
        name
        for link in root.findall("link")
        if (name := link.get("name", "")) in fixed - carriers
        and link.find("inertial") is None
        and link.find("collision") is None
        and all(map(_is_small, link.findall("visual")))
    )


def _is_small(element: ElementTree.Element) -> bool:
    """Return whether a visual is a primitive of MAX_MARKER_SIZE at most."""
    shape = element.find("geometry/*")
    if shape is None or shape.tag not in _SIZES:
        return False
    sizes = {key: numbers_of(shape.get(key, "")) or (math.inf,) for key in _SIZES[shape.tag]}
    return all(
        (2.0 if key == "radius" else 1.0) * max(each) <= MAX_MARKER_SIZE for key, each in sizes.items()
    )


def _root(urdf: str) -> ElementTree.Element:
    try:
        return parsed_urdf(Path(urdf))
    except UrdfError as error:
        raise PicktreeError(f"{urdf}: {error}") from None


def _elements(root: ElementTree.Element, which: Which) -> Iterator[tuple[str, ElementTree.Element]]:
    markers = _markers(root) if which == "collision" else frozenset[str]()
    for link in root.findall("link"):
        if link.get("name", "") in markers:
            continue
        seen_only = which == "collision" and link.find("collision") is None
        for element in link.findall("visual" if seen_only else which):
            yield link.get("name", ""), element


def _faults(urdf: Path, link: str, element: ElementTree.Element) -> Iterator[str]:
    where, geometry = f"link {link!r}", element.find("geometry")
    yield from origin_faults(where, element.find("origin"))
    if geometry is None or len(geometry) != 1:
        yield f"{where}: the <geometry> of its <{element.tag}> must be one shape ({_SHAPES})"
        return
    shape = geometry[0]
    if shape.tag == "mesh":
        filename = shape.get("filename", "")
        if mesh_file(urdf, filename) is None:
            plain = filename.removeprefix(PACKAGE).removeprefix("file://")
            yield f"{where}: mesh {plain!r} not found: {urdf.parent / plain}"
        if "scale" in shape.attrib:
            scale = shape.get("scale", "")
            faults = [*vector_faults(where, shape, "scale", " ".join([*(scale.split()[:1] or "1")] * 3))]
            yield from faults
            if not faults and not all(numbers_of(scale) or ()):
                yield f'{where}: <mesh scale="{scale}"> must not be 0'
    elif shape.tag not in _SIZES:
        yield f"{where}: <{shape.tag}> is no shape that is read here ({_SHAPES})"
    for key in _SIZES.get(shape.tag, ()):
        if key == "size" and key in shape.attrib:
            faults = [*vector_faults(where, shape, key, "0.1 0.1 0.1")]
        else:
            faults = [*number_faults(where, shape, key, "m")]
        yield from faults
        if not faults and min(numbers_of(shape.get(key, "")) or (0.0,)) <= 0.0:
            yield f'{where}: <{shape.tag} {key}="{shape.get(key)}"> must be greater than 0'


def _parts(urdf: Path, link: str, element: ElementTree.Element) -> Iterator[Geometry]:
    """Yield the parts of an element without faults."""
    pose, shape = origin_pose(element.find("origin")), element.find("geometry")
    assert shape is not None  # or it had a fault
    shape = shape[0]
    sizes = [number for key in _SIZES.get(shape.tag, ()) for number in numbers_of(shape.get(key, "")) or ()]
    if shape.tag == "mesh":
        path = mesh_file(urdf, shape.get("filename", ""))
        scale = numbers_of(shape.get("scale", "1 1 1"))
        yield UrdfMesh(link, str(path), pose, vector3(scale or ()))
    elif shape.tag == "box":
        yield UrdfPrimitive(link, Box(vector3(sizes)), pose)
    elif shape.tag == "sphere":
        yield UrdfPrimitive(link, Sphere(*sizes), pose)
    else:
        yield UrdfPrimitive(link, Cylinder(*sizes), pose)
        if shape.tag == "capsule":
            radius, length = sizes
            for z in (length / 2, -length / 2):
                yield UrdfPrimitive(link, Sphere(radius), pose @ Pose((0.0, 0.0, z)))
