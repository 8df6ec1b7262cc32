"""URDF files read without a robotics library: checked XML, the tree of links and joints, geometry
elements, and the mesh files that they name.
"""

from __future__ import annotations

import math
import os
import re
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Final, Literal

from picktree.files import PicktreeError, XmlError, file_system, parse_xml
from picktree.files.yaml import file_text
from picktree.world import Box, Cylinder, Pose, Sphere, Vector3, vector3

from .urdf_faults import (
    MOVING,
    UrdfError,
    number_faults,
    number_of,
    numbers_of,
    origin_faults,
    urdf_faults,
    vector_faults,
)

PACKAGE = "package://"
SHARED_DATA = Path("cmeel.prefix", "share")
"""Data folder of packages that cmeel builds, beside the Python packages."""


def package_folder(package: str) -> Path | None:
    """Return the folder of an installed Python package, or of the data of a package that cmeel built.

    None: there is no such package. It is located, not imported: an import may run anything.
    """
    return _package_folder(package, tuple(sys.path))


@lru_cache(maxsize=64)
def _package_folder(package: str, path: tuple[str, ...]) -> Path | None:
    """Return the folder of a package; each mesh of a URDF names it again. `path`: where Python searches."""
    try:
        spec = find_spec(package) if package.isidentifier() else None
    except ValueError:
        spec = None
    roots = list(spec.submodule_search_locations or ()) if spec else []
    if not roots and package and "/" not in package and package not in (".", ".."):
        shared = (Path(folder) / SHARED_DATA / package for folder in path)
        roots = [str(folder) for folder in shared if folder.is_dir()]
    return Path(roots[0]) if roots else None


def mesh_file(urdf: Path, reference: str) -> Path | None:
    """Return the file of a mesh that a URDF names; None when it is not found.

    A plain path counts from the URDF's folder. `package://name/path` is searched in the installed Python
    package of that name, then from the URDF's folder upwards. There it may be `path` or `name/path`, as in
    ROS packages on a disk. Then come the packages of ROS_PACKAGE_PATH and of AMENT_PREFIX_PATH.
    """
    plain = Path(reference.removeprefix(PACKAGE).removeprefix("file://"))
    if not reference.startswith(PACKAGE):
        file = urdf.parent / plain
        return file if file_system.is_file(file) else None
    if not plain.parts:
        return None
    name, inside = plain.parts[0], Path(*plain.parts[1:])
    package = package_folder(name)
    if package is not None and file_system.is_file(package / inside):
        return package / inside
    for folder in chain((urdf.parent,), _parents(urdf)):
        for tail in (plain, inside):
            if file_system.is_file(folder / tail):
                return folder / tail
    return next(
        (folder / inside for folder in _ros_folders(name) if file_system.is_file(folder / inside)), None
    )


def _parents(file: Path) -> Iterator[Path]:
    """Yield the folders above the file that the path leads to."""
    yield from file.resolve().parents


ROS_PATH, AMENT_PATH = "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"
"""Variables of the environment that name folders of ROS packages, and prefixes of ROS 2 installations."""
MAX_ROS_DEPTH = 6
"""Greatest depth below a folder of ROS_PACKAGE_PATH at which packages are searched."""


def _ros_folders(package: str) -> Iterator[Path]:
    """Yield the folders of a ROS package by the environment, the most important first."""
    for folder in _listed_folders(ROS_PATH):
        if (found := _ros_packages(folder).get(package)) is not None:
            yield found
    for prefix in _listed_folders(AMENT_PATH):
        yield prefix / "share" / package


def _listed_folders(variable: str) -> Iterator[Path]:
    yield from (Path(part) for part in os.environ.get(variable, "").split(os.pathsep) if part)


@lru_cache(maxsize=16)
def _ros_packages(root: Path) -> Mapping[str, Path]:
    """Return the ROS packages at or below a folder by their names. Within a package none is searched."""
    found: dict[str, Path] = {}
    for folder, below, files in os.walk(root):
        here = Path(folder)
        if "package.xml" in files or "manifest.xml" in files:
            found.setdefault(_ros_name(here), here)
            below.clear()
        elif len(here.relative_to(root).parts) >= MAX_ROS_DEPTH or _IGNORED.intersection(files):
            below.clear()
        below[:] = sorted(name for name in below if not name.startswith("."))
    return found


_IGNORED = frozenset(("CATKIN_IGNORE", "COLCON_IGNORE", "AMENT_IGNORE"))
_NAME = re.compile(r"<name>\s*([^<\s]+)\s*</name>")


def _ros_name(folder: Path) -> str:
    """Return the name of the package in a folder: that of its package.xml, else that of the folder."""
    try:
        named = _NAME.search((folder / "package.xml").read_text(encoding="utf-8", errors="replace"))
    except OSError:
        named = None
    return folder.name if named is None else named[1]


MAX_BYTES = 5_000_000


def parsed_urdf(path: Path) -> ElementTree.Element:
    """Return the outermost element of a URDF file, without faults of links and joints.

    Raises UrdfError with all faults when the file is no XML or describes no usable robot. Tags keep their
    namespace prefix, as in other readers of URDFs. A robot without a name gets that of its file. Missing
    products of inertia are 0, and so is the inertia beside a lone mass. Fixed joints have no limits. Geometry
    is not checked here.
    """
    try:
        raw = file_text.read_bytes(path, MAX_BYTES)
    except file_text.Unreadable as error:
        raise UrdfError(error.message) from None
    return parse_urdf(raw, path.stem)


def parse_urdf(raw: bytes, name: str) -> ElementTree.Element:
    """Return the outermost element of a URDF's content, as `parsed_urdf` does; `name` if it has none."""
    try:
        root = parse_xml(raw)
    except XmlError as error:
        raise UrdfError(str(error)) from None
    if faults := _faults_of(raw):
        raise UrdfError(*faults)
    _complete(root, name)
    return root


def _complete(root: ElementTree.Element, name: str) -> None:
    """Add elements that strict libraries require, and remove elements that they reject."""
    if not root.get("name"):
        root.set("name", name)
    for inertial in root.iterfind("link/inertial"):
        if inertial.find("inertia") is None:
            ElementTree.SubElement(inertial, "inertia", dict.fromkeys(("ixx", "iyy", "izz"), "0"))
    for inertia in root.iter("inertia"):
        for key in ("ixy", "ixz", "iyz"):
            inertia.attrib.setdefault(key, "0")
    for joint in root.findall("joint"):
        if joint.get("type") not in MOVING:
            for tag in ("limit", "safety_controller", "mimic"):
                for element in joint.findall(tag):
                    joint.remove(element)
        for limit in joint.findall("limit"):
            for key, value in limit.attrib.items():
                limit.set(key, value.strip())
            for key in ("effort", "velocity"):
                limit.attrib.setdefault(key, "0")
        for controller in joint.findall("safety_controller"):
            controller.attrib.setdefault("k_velocity", "0")


@lru_cache(maxsize=16)
def _faults_of(raw: bytes) -> tuple[str, ...]:
    """Return the faults of a file; it is read several times for one robot, and checked once."""
    return urdf_faults(parse_xml(raw))


def origin_pose(origin: ElementTree.Element | None) -> Pose:
    """Return the pose of an <origin>, by default the identity. Raises ValueError for malformed numbers."""
    if origin is None:
        return Pose()
    return Pose.from_rpy(_numbers(origin.get("xyz", "0 0 0")), _numbers(origin.get("rpy", "0 0 0")))


def _numbers(text: str) -> Vector3:
    return vector3(map(float, text.split()))


def numbers_text(numbers: Vector3) -> str:
    """Return numbers as an attribute of a URDF gives them."""
    return " ".join(repr(n) for n in numbers)


@dataclass(frozen=True, slots=True)
class MimicJoint:
    """Mimic relation of a joint: its position is multiplier · (position of `joint`) + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """A joint between two links; `limited`: it has limits that are numbers.

    `child_in_parent` is the child link at position 0, `axis` a unit vector in the child's frame. Limits are
    rad or m, rad/s or m/s, Nm or N; None where the file gives none.
    """

    type: str
    parent: str
    child: str
    limited: bool
    child_in_parent: Pose = field(default_factory=Pose)
    axis: Vector3 = (1.0, 0.0, 0.0)
    lower: float | None = None
    upper: float | None = None
    soft_lower: float | None = None
    soft_upper: float | None = None
    velocity: float | None = None
    effort: float | None = None
    mimic: MimicJoint | None = None

    def at(self, position: float) -> Pose:
        """Return the pose of the child link in the parent link, with the joint at `position` rad or m."""
        if self.type == "prismatic":
            x, y, z = self.axis
            return self.child_in_parent @ Pose((position * x, position * y, position * z))
        if self.type in ("revolute", "continuous"):
            x, y, z = (c * math.sin(position / 2) for c in self.axis)
            return self.child_in_parent @ Pose((0.0, 0.0, 0.0), (x, y, z, math.cos(position / 2)))
        return self.child_in_parent


@dataclass(frozen=True, slots=True)
class UrdfTree:
    """All links, and the joints by name, in the order of the file."""

    links: tuple[str, ...]
    joints: Mapping[str, UrdfJoint]

    def above(self, joint: str) -> list[str]:
        """Return the joints between the root and this one, from the root on."""
        parents = {each.child: name for name, each in self.joints.items()}
        found: list[str] = []
        name = parents.get(self.joints[joint].parent)
        while name is not None and name not in found:
            found.insert(0, name)
            name = parents.get(self.joints[name].parent)
        return found

    def below(self, link: str) -> tuple[str, ...]:
        """Return the links below this one, itself first, in the order of the file."""
        found = {link}
        grown = True
        while grown:
            more = {j.child for j in self.joints.values() if j.parent in found} - found
            found |= more
            grown = bool(more)
        return (link, *(name for name in self.links if name in found and name != link))

    def joints_to(self, link: str) -> tuple[str, ...]:
        """Return the joints between the root and a link, from the root on."""
        for name, joint in self.joints.items():
            if joint.child == link:
                return (*self.above(name), name)
        return ()

    def joints_between(self, above: str, link: str) -> tuple[str, ...] | None:
        """Return the joints from one link down to another; None when the other is not below it."""
        start, names = self.joints_to(above), self.joints_to(link)
        return names[len(start) :] if names[: len(start)] == start else None

    def pose(self, link: str, positions: Mapping[str, float], base: str | None = None) -> Pose:
        """Return a link's pose in the root link, or in `base` above it. Joints that `positions` does not name
        are at 0.

        Mimic joints do not follow: `positions` names every joint that is not at 0.
        """
        pose = Pose()
        chain = self.joints_to(link)
        if base is not None:
            chain = chain[len(self.joints_to(base)) :]
        for name in chain:
            pose = pose @ self.joints[name].at(positions.get(name, 0.0))
        return pose


def read_skeleton(path: Path) -> UrdfTree:
    """Read links and joints of a URDF file. Raises UrdfError with all faults of the file."""
    return skeleton_of(parsed_urdf(path))


def skeleton_of(root: ElementTree.Element) -> UrdfTree:
    """Return links and joints of a URDF that `parsed_urdf` has returned: it has no faults."""
    links = tuple(link.get("name", "") for link in root.findall("link"))
    return UrdfTree(links, {joint.get("name", ""): _joint(joint) for joint in root.findall("joint")})


def _joint(element: ElementTree.Element) -> UrdfJoint:
    parent, child, limit = element.find("parent"), element.find("child"), element.find("limit")
    soft, mimic = element.find("safety_controller"), element.find("mimic")
    return UrdfJoint(
        element.get("type", ""),
        parent.get("link", "") if parent is not None else "",
        child.get("link", "") if child is not None else "",
        limit is not None and all(_number(limit, key, "0") is not None for key in ("lower", "upper"))
        and all(_number(limit, key) is not None for key in ("effort", "velocity")),
        origin_pose(element.find("origin")),
        _axis(element.find("axis")),
        _number(limit, "lower", "0"),
        _number(limit, "upper", "0"),
        _number(soft, "soft_lower_limit"),
        _number(soft, "soft_upper_limit"),
        _number(limit, "velocity"),
        _number(limit, "effort"),
        None if mimic is None else MimicJoint(
            mimic.get("joint", ""),
            _number(mimic, "multiplier", "1") or 0.0,
            _number(mimic, "offset", "0") or 0.0,
        ),
    )  # fmt: skip


def _axis(axis: ElementTree.Element | None) -> Vector3:
    x, y, z = _numbers("1 0 0" if axis is None else axis.get("xyz", "1 0 0"))
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length) if length > 0.0 else (x, y, z)


def _number(element: ElementTree.Element | None, key: str, default: str | None = None) -> float | None:
    return None if element is None else number_of(element.get(key, default))


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

    A link without collision geometry collides with its visual geometry, unless it is a marker. A capsule is a
    cylinder with a sphere at either end. Raises PicktreeError at the first unusable element.
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
    """Return the links that collide with their visual geometry, in the order of the file: those without
    collision geometry, except markers."""
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
