"""Reader of URDF files: bytes in any encoding, parsed as XML, checked, and returned as elements."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from functools import lru_cache
from pathlib import Path

from ...files.xml_text import XmlError, parse_xml
from ...files.yaml.file_text import Unreadable, read_bytes
from .urdf_faults import MOVING, UrdfError, urdf_faults

MAX_BYTES = 5_000_000


def parsed_urdf(path: Path) -> ElementTree.Element:
    """Return the outermost element of a URDF file, without faults of links and joints.

    Raises UrdfError with all faults when the file cannot be read as XML, or no robot can be built of it.
    Tags keep their namespace prefix, as in other readers of URDFs. A robot without a name gets that of its
    file. What is missing beside a lone mass and in products of inertia is 0, and joints that do not move have
    no limits. Geometry is not checked here.
    """
    try:
        raw = read_bytes(path, MAX_BYTES)
    except Unreadable as error:
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
    """Add what libraries miss that are stricter than others, and remove what they stumble over."""
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
