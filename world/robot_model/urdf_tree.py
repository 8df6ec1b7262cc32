"""URDF as a tree of links and joints, and the files that it names, read without a robotics library."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..values import Pose, Vector3, vector3
from .urdf_faults import number_of
from .urdf_text import parsed_urdf


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


ORIGIN = Pose()


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
