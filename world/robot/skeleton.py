"""Links and joints of a URDF as a tree, read without a library of robots: to check a file, not to move it."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..files.opening import Unreadable, read_bytes

MAX_BYTES = 5_000_000
LIMITED = ("revolute", "prismatic")


class UrdfError(ValueError):
    """What keeps a URDF from being used, in one sentence."""


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """A joint between two links; `limited`: it has limits that are numbers."""

    type: str
    parent: str
    child: str
    limited: bool


@dataclass(frozen=True, slots=True)
class Skeleton:
    """All links, and the joints by name, in the order of the file."""

    links: tuple[str, ...]
    joints: Mapping[str, UrdfJoint]

    def above(self, joint: str) -> list[str]:
        """The joints between the root and this one, from the root on."""
        parents = {each.child: name for name, each in self.joints.items()}
        found: list[str] = []
        name = parents.get(self.joints[joint].parent)
        while name is not None and name not in found:
            found.insert(0, name)
            name = parents.get(self.joints[name].parent)
        return found


def read_skeleton(path: Path) -> Skeleton:
    """Raises UrdfError when the file is no URDF, or its links are not one tree."""
    try:
        raw = read_bytes(path, MAX_BYTES)
    except Unreadable as error:
        raise UrdfError(error.message) from None
    if b"<!ENTITY" in raw:
        raise UrdfError("entities (<!ENTITY) are not read")
    try:
        root = ElementTree.fromstring(raw)
    except (ElementTree.ParseError, UnicodeError, LookupError, ValueError) as error:
        raise UrdfError(f"not readable as XML: {error}") from None
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
    return Skeleton(links, joints)


def _joint(element: ElementTree.Element) -> UrdfJoint:
    parent, child, limit = element.find("parent"), element.find("child"), element.find("limit")
    return UrdfJoint(
        element.get("type", ""),
        parent.get("link", "") if parent is not None else "",
        child.get("link", "") if child is not None else "",
        limit is not None and all(_is_number(limit.get(key, "0")) for key in ("lower", "upper"))
        and all(_is_number(limit.get(key, "")) for key in ("effort", "velocity")),
    )  # fmt: skip


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
