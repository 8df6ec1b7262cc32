"""URDF as a tree of links and joints, and the files that it names, read without a robotics library."""

from __future__ import annotations

import math
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from itertools import chain
from pathlib import Path

from ..files.shipped_files import is_file
from ..files.yaml.file_text import Unreadable, read_bytes
from ..world.values import Pose, Vector3, vector3


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


MAX_BYTES = 5_000_000
LIMITED = ("revolute", "prismatic")
MOVING = ("revolute", "continuous", "prismatic")


ORIGIN = Pose()


class UrdfError(ValueError):
    """URDF that cannot be used; the text is one sentence."""


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
    child_in_parent: Pose = ORIGIN
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

        What a joint mimics is not followed: `positions` names every joint that is not at 0.
        """
        pose = Pose()
        chain = self.joints_to(link)
        if base is not None:
            chain = chain[len(self.joints_to(base)) :]
        for name in chain:
            pose = pose @ self.joints[name].at(positions.get(name, 0.0))
        return pose


def read_skeleton(path: Path) -> UrdfTree:
    """Read links and joints of a URDF file. Raises UrdfError when the file is no URDF, or its links are
    not one tree."""
    return skeleton_of(parsed_urdf(path))


def parsed_urdf(path: Path) -> ElementTree.Element:
    """Return the file's outermost element. Raises UrdfError when it cannot be read as XML."""
    try:
        raw = read_bytes(path, MAX_BYTES)
    except Unreadable as error:
        raise UrdfError(error.message) from None
    if b"<!ENTITY" in raw:
        raise UrdfError("entities (<!ENTITY) are not read")
    try:
        return ElementTree.fromstring(raw)
    except (ElementTree.ParseError, UnicodeError, LookupError, ValueError) as error:
        raise UrdfError(f"not readable as XML: {error}") from None


def skeleton_of(root: ElementTree.Element) -> UrdfTree:
    """Return links and joints of a parsed URDF. Raises UrdfError when they are not one tree."""
    if root.tag != "robot":
        raise UrdfError(f"the outermost element is <{root.tag}>, not <robot>")
    links = tuple(link.get("name", "") for link in root.findall("link"))
    joints = {joint.get("name", ""): _joint(joint) for joint in root.findall("joint")}
    for name, joint in joints.items():
        for end in (joint.parent, joint.child):
            if end not in links:
                raise UrdfError(f"joint {name!r} holds the link {end!r}, which is not there")
    children = [joint.child for joint in joints.values()]
    if twice := sorted({child for child in children if children.count(child) > 1}):
        raise UrdfError(f"the link {twice[0]!r} hangs on two joints")
    roots = [link for link in links if link not in children]
    if len(roots) != 1:
        raise UrdfError(f"one link must be the base of all others, not {len(roots)}")
    return UrdfTree(links, joints)


def _joint(element: ElementTree.Element) -> UrdfJoint:
    parent, child, limit = element.find("parent"), element.find("child"), element.find("limit")
    soft, mimic = element.find("safety_controller"), element.find("mimic")
    return UrdfJoint(
        element.get("type", ""),
        parent.get("link", "") if parent is not None else "",
        child.get("link", "") if child is not None else "",
        limit is not None and all(_number(limit, key, "0") is not None for key in ("lower", "upper"))
        and all(_number(limit, key) is not None for key in ("effort", "velocity")),
        _origin(element),
        _axis(element),
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


def _origin(joint: ElementTree.Element) -> Pose:
    origin = joint.find("origin")
    if origin is None:
        return Pose()
    return Pose.from_rpy(*(_vector(joint, origin, key, (0.0, 0.0, 0.0)) for key in ("xyz", "rpy")))


def _axis(joint: ElementTree.Element) -> Vector3:
    axis = joint.find("axis")
    x, y, z = (1.0, 0.0, 0.0) if axis is None else _vector(joint, axis, "xyz", (1.0, 0.0, 0.0))
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length) if length > 0.0 else (x, y, z)


def _vector(joint: ElementTree.Element, element: ElementTree.Element, key: str, default: Vector3) -> Vector3:
    text = element.get(key)
    if text is None:
        return default
    try:
        x, y, z = (float(word) for word in text.split())
    except ValueError:
        x = y = z = math.nan
    if not math.isfinite(x + y + z):
        name = joint.get("name", "")
        raise UrdfError(f"joint {name!r}: <{element.tag} {key}={text!r}> is not three numbers")
    return (x, y, z)


def _number(element: ElementTree.Element | None, key: str, default: str = "") -> float | None:
    if element is None:
        return None
    try:
        number = float(element.get(key, default))
    except ValueError:
        return None
    return number if math.isfinite(number) else None


PACKAGE = "package://"


SHARED_DATA = Path("cmeel.prefix", "share")
"""Where packages that cmeel builds keep their data, beside the Python packages."""


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
    """Return the file of a mesh that a URDF names; None when there is none.

    A plain path counts from the URDF's folder. `package://name/path` is searched in the installed Python
    package of that name, then from the URDF's folder upwards. There it may be `path` or `name/path`, as in
    ROS packages on a disk.
    """
    plain = Path(reference.removeprefix(PACKAGE).removeprefix("file://"))
    if not reference.startswith(PACKAGE):
        file = urdf.parent / plain
        return file if is_file(file) else None
    if not plain.parts:
        return None
    package = package_folder(plain.parts[0])
    if package is not None and is_file(inside := package.joinpath(*plain.parts[1:])):
        return inside
    inside = Path(*plain.parts[1:])
    for folder in chain((urdf.parent,), _parents(urdf)):
        for tail in (plain, inside):
            if is_file(folder / tail):
                return folder / tail
    return None


def _parents(file: Path) -> Iterator[Path]:
    """Yield the folders above the file that the path leads to."""
    yield from file.resolve().parents
