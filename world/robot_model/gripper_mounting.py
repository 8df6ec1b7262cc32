"""URDF composition: a gripper mounted on the arm, its mounting error, and corrected inertias."""

from __future__ import annotations

import copy
import hashlib
import os
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field

from picktree.files import suggest_name
from picktree.files.yaml import file_models
from picktree.world import COLOURS, Box, Pose

from .description import RobotDescription
from .urdf_faults import UrdfError
from .urdf_parser import PACKAGE, mesh_file, numbers_text, parsed_urdf, skeleton_of

Moment = Annotated[float, file_models.quantity("")]


@dataclass(frozen=True, slots=True)
class NamedUrdf:
    """Path of a URDF, with the package that names it as `package:path` in a robot file."""

    path: Path
    package: str = ""
    folder: Path = Path()
    """Folder of the package."""


@dataclass(frozen=True, slots=True)
class GripperMount:
    """Mounting of a part of a gripper's URDF on a link of the arm, by a fixed joint named `joint`."""

    gripper: NamedUrdf
    link: str
    """First link of the gripper that is taken, with all below it; "": all links."""
    to: str
    """Link of the arm that carries the gripper."""
    pose: Pose
    """Pose of the gripper's link in the arm's link."""
    joint: str
    prefix: str = ""
    """Prefix of the names of the gripper's links and joints."""


@dataclass(frozen=True, slots=True)
class LinkInertia(file_models.FileValue):
    """Mass and inertia of a link, about its centre of mass in the axes of the link."""

    mass: file_models.Mass
    """Mass of the link."""
    com: Annotated[file_models.Vector, Field(alias="at")]
    """Centre of mass in the link's frame."""
    moments: tuple[Moment, Moment, Moment]
    """ixx, iyy, izz in kg·m²."""
    products: tuple[Moment, Moment, Moment] = (0.0, 0.0, 0.0)
    """ixy, ixz, iyz in kg·m²."""


@dataclass(frozen=True, slots=True)
class InsertedFlange:
    """Fixed joint that is put between the arm's last joint and the link that this one moves."""

    behind: str
    """The arm's last joint."""
    joint: str
    """Name of the fixed joint; its parent is a link of the same name with `_link` behind it."""


FLANGE_INERTIA = 1e-5
"""Moments of an inserted flange of 10 g, kg·m²: engines need a body behind each joint that moves."""

Attachments = Mapping[str, Sequence[tuple[Box, Pose]]]
"""Boxes that are fixed to links, by the link's name, each with its pose in the link."""


def write_composed_urdf(
    arm: NamedUrdf,
    mounting: GripperMount | None,
    inertias: Mapping[str, LinkInertia] | None = None,
    attachments: Attachments | None = None,
    flange: InsertedFlange | None = None,
) -> Path:
    """Write the composed URDF to a file and return its path. The same arguments always give the same text and
    the same file.

    Meshes of installed packages are named as `package://package/path`, so that the text does not depend on
    the folder of the packages. Raises UrdfError when arm and gripper do not fit together.
    """
    return _cached_file(
        composed_urdf(arm, mounting, inertias or {}, attachments or {}, flange), arm.path.stem
    )


def composed_urdf(
    arm: NamedUrdf,
    mounting: GripperMount | None,
    inertias: Mapping[str, LinkInertia],
    attachments: Attachments,
    flange: InsertedFlange | None = None,
) -> str:
    """Return the text that `write_composed_urdf` writes."""
    whole = parsed_urdf(arm.path)
    _name_meshes(whole, arm)
    if flange is not None:
        _insert_flange(whole, flange)
    if mounting is not None:
        _hang(whole, mounting)
    links = {link.get("name", ""): link for link in whole.findall("link")}
    for name in (*inertias, *attachments):
        if name not in links:
            hint = suggest_name(name, links)
            raise UrdfError(f"there is no link {name!r}" + (f" ({hint})" if hint else ""))
    for name, inertia in inertias.items():
        _put_inertia(links[name], inertia)
    for name, boxes in attachments.items():
        for box, pose in boxes:
            _attach(links[name], box, pose)
    ElementTree.indent(whole)
    return ElementTree.tostring(whole, encoding="unicode") + "\n"


def _insert_flange(whole: ElementTree.Element, flange: InsertedFlange) -> None:
    joints = {joint.get("name", ""): joint for joint in whole.findall("joint")}
    taken = {element.get("name") for element in whole if element.tag in ("link", "joint")}
    name = f"{flange.joint}_link"
    if flange.behind not in joints:
        hint = suggest_name(flange.behind, joints)
        raise UrdfError(f"there is no joint {flange.behind!r}" + (f" ({hint})" if hint else ""))
    if {flange.joint, name} & taken:
        raise UrdfError(
            f"the URDF has {flange.joint!r} or {name!r} already: give 'flange_joint' another name"
        )
    child = joints[flange.behind].find("child")
    assert child is not None  # or the reader had refused it
    held = ElementTree.SubElement(whole, "joint", name=flange.joint, type="fixed")
    ElementTree.SubElement(held, "parent", link=name)
    ElementTree.SubElement(held, "child", link=child.get("link", ""))
    child.set("link", name)
    moments = (FLANGE_INERTIA, FLANGE_INERTIA, FLANGE_INERTIA)
    link = ElementTree.SubElement(whole, "link", name=name)
    _put_inertia(link, LinkInertia(0.01, (0.0, 0.0, 0.0), moments, (0.0, 0.0, 0.0)))


def _put_inertia(link: ElementTree.Element, inertia: LinkInertia) -> None:
    for old in link.findall("inertial"):
        link.remove(old)
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=numbers_text(inertia.com), rpy="0 0 0")
    ElementTree.SubElement(inertial, "mass", value=repr(inertia.mass))
    keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    values = map(repr, (*inertia.moments, *inertia.products))
    ElementTree.SubElement(inertial, "inertia", dict(zip(keys, values, strict=True)))


def _attach(link: ElementTree.Element, box: Box, pose: Pose) -> None:
    """Fix a box to a link, to be seen and to be touched."""
    for tag in ("visual", "collision"):
        element = ElementTree.SubElement(link, tag)
        origin = {"xyz": numbers_text(pose.position), "rpy": numbers_text(pose.rpy())}
        ElementTree.SubElement(element, "origin", origin)
        geometry = ElementTree.SubElement(element, "geometry")
        ElementTree.SubElement(geometry, "box", size=numbers_text(box.size))
        if tag == "visual":
            red, green, blue = COLOURS["grey"]
            material = ElementTree.SubElement(element, "material", name=f"{link.get('name')}_attachment")
            ElementTree.SubElement(material, "color", rgba=f"{red} {green} {blue} 1")


def _hang(whole: ElementTree.Element, mounting: GripperMount) -> None:
    """Mount the gripper on the arm, whose mesh paths are complete already."""
    hand = parsed_urdf(mounting.gripper.path)
    arm_tree, hand_tree = skeleton_of(whole), skeleton_of(hand)
    if mounting.to not in arm_tree.links:
        hint = suggest_name(mounting.to, arm_tree.links)
        raise UrdfError(f"the arm has no link {mounting.to!r}" + (f" ({hint})" if hint else ""))
    first = mounting.link or hand_tree.links[0]
    if not mounting.link:
        children = {joint.child for joint in hand_tree.joints.values()}
        first = next(link for link in hand_tree.links if link not in children)
    if first not in hand_tree.links:
        hint = suggest_name(first, hand_tree.links)
        raise UrdfError(f"the gripper has no link {first!r}" + (f" ({hint})" if hint else ""))
    _name_meshes(hand, mounting.gripper)
    wanted = set(hand_tree.below(first))
    parts = [link for link in hand.findall("link") if link.get("name") in wanted]
    parts += [
        joint for joint in hand.findall("joint") if hand_tree.joints[joint.get("name", "")].parent in wanted
    ]
    for part in parts:
        _renamed(part, mounting.prefix)
    taken = {e.get("name") for e in whole if e.tag in ("link", "joint")}
    doubled = [str(part.get("name")) for part in parts if part.get("name") in taken]
    if mounting.joint in taken or any(part.get("name") == mounting.joint for part in parts):
        doubled.append(mounting.joint)
    if doubled:
        raise UrdfError(f"arm and gripper both have {doubled[0]!r}: give the gripper's names a prefix")
    holder = ElementTree.SubElement(whole, "joint", name=mounting.joint, type="fixed")
    origin = {"xyz": numbers_text(mounting.pose.position), "rpy": numbers_text(mounting.pose.rpy())}
    ElementTree.SubElement(holder, "origin", origin)
    ElementTree.SubElement(holder, "parent", link=mounting.to)
    ElementTree.SubElement(holder, "child", link=mounting.prefix + first)
    known = {material.get("name") for material in whole.findall("material")}
    for material in hand.findall("material"):
        if material.get("name") not in known:
            whole.append(copy.deepcopy(material))
    whole.extend(parts)


def _renamed(part: ElementTree.Element, prefix: str) -> None:
    part.set("name", prefix + part.get("name", ""))
    for tag, key in (("parent", "link"), ("child", "link"), ("mimic", "joint")):
        for element in part.findall(tag):
            element.set(key, prefix + element.get(key, ""))


def _name_meshes(root: ElementTree.Element, urdf: NamedUrdf) -> None:
    for mesh in root.iter("mesh"):
        file = mesh_file(urdf.path, mesh.get("filename", ""))
        if file is None:
            continue
        if urdf.package and file.is_relative_to(urdf.folder):
            mesh.set("filename", f"{PACKAGE}{urdf.package}/{file.relative_to(urdf.folder).as_posix()}")
        else:
            mesh.set("filename", str(file.resolve()))


def mount_tool(root: ElementTree.Element, robot: RobotDescription) -> None:
    """Move the flange joint of a URDF in place, with all links beyond it. The TCP then sits at `robot.tool`
    in the frame of the TCP that the file states."""
    if robot.tool == Pose():
        return
    tree = skeleton_of(root)
    flange = tree.joints[robot.flange_joint]
    # Between flange and TCP everything is fixed: a robot file whose TCP moved would have no such tool.
    tcp_in_hand = tree.pose(robot.tcp_link, {}, base=flange.child) @ robot.tcp_in_link
    moved = flange.child_in_parent @ tcp_in_hand @ robot.tool @ tcp_in_hand.inverse()
    element = next(joint for joint in root.findall("joint") if joint.get("name") == robot.flange_joint)
    for old in element.findall("origin"):
        element.remove(old)
    ElementTree.SubElement(element, "origin", xyz=numbers_text(moved.position), rpy=numbers_text(moved.rpy()))


def _cached_file(text: str, stem: str) -> Path:
    """Return a file with that text, named by its hash; an existing one is used again."""
    data = text.encode()
    folder = Path(tempfile.gettempdir()) / f"picktree-{os.getuid()}"
    name = f"{stem}-{hashlib.sha256(data).hexdigest()[:16]}.urdf"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        if folder.stat().st_uid != os.getuid():
            raise UrdfError(f"the folder {folder} belongs to somebody else")
        file = folder / name
        if not file.is_file() or file.read_bytes() != data:
            beside = folder / f"{name}.{os.getpid()}"
            beside.write_bytes(data)
            beside.replace(file)
    except OSError as error:
        raise UrdfError(f"the URDF cannot be written to {folder}: {error.strerror}") from None
    return file
