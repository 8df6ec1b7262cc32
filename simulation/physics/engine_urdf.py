"""URDF as the engine loads it: collision bodies, widened followers, and links without mass."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from picktree.files import PicktreeError
from picktree.world import (
    COLOURS,
    Box,
    ConvexMesh,
    Cylinder,
    Pose,
    Sphere,
    mesh_reader,
)
from picktree.world.robot_model import (
    GripperDescription,
    LinkShape,
    RobotDescription,
    gripper_mounting,
    link_shapes,
    urdf_parser,
)


def patched_urdf(robot: RobotDescription, folder: Path) -> str:
    """Return the text of the robot's URDF for the engine. Raises PicktreeError for unusable geometry or
    missing links.

    Links have the convex bodies that the planner takes, hulls as files in `folder`: the engine reads no mesh
    of others. Every link shows its *collision* geometry: the camera sees the collision geometry, which also
    renders ten times faster than the visual meshes. A link without <inertial> gets one of no mass, as the
    planner's dynamics take it: the engine would give it 1 kg. No joint keeps its <dynamics>: damping and
    friction are in neither simulation nor controller. A joint that follows the gripper's motor is limited by
    the motor alone.
    """
    shapes = link_shapes(robot.urdf)
    root = urdf_parser.parsed_urdf(Path(robot.urdf))
    _widen_followers(root, robot.gripper)
    for joint in root.findall("joint"):
        # The engine adds damping explicitly, which spins light links up, and has no joint friction.
        for dynamics in joint.findall("dynamics"):
            joint.remove(dynamics)
    gripper_mounting.mount_tool(root, robot)
    links = {link.get("name", ""): link for link in root.findall("link")}
    for link in links.values():
        for old in (*link.findall("visual"), *link.findall("collision")):
            link.remove(old)
    for n, part in enumerate(shapes):
        _put_shape(links[part.link], part, folder / f"hull_{n}.obj")
    for link in links.values():
        _add_collision_visuals(link)
        if link.find("inertial") is None:
            _add_no_mass(link)
    for n, name in enumerate(robot.gripper.fingers):
        if name not in links:
            raise PicktreeError(f"{robot.source or robot.name}: finger link {name!r} is not in {robot.urdf}")
        _put_finger(links[name], n, robot.gripper)
    return ElementTree.tostring(root, encoding="unicode")


def _widen_followers(root: ElementTree.Element, gripper: GripperDescription) -> None:
    """Widen the limits of joints that follow the gripper's motor, as far as the motor moves them.

    Many URDFs repeat the motor's limits for a joint that turns the other way. The engine would stop there.
    """
    linkage = gripper.linkage
    if linkage is None:
        return
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    for follower in linkage.followers:
        ends = [follower.multiplier * linkage.angles[k] + follower.offset for k in (0, -1)]
        limit = None if follower.joint not in joints else joints[follower.joint].find("limit")
        if limit is not None:
            limit.set("lower", repr(min(float(limit.get("lower", "0")), *ends)))
            limit.set("upper", repr(max(float(limit.get("upper", "0")), *ends)))


def _put_shape(link: ElementTree.Element, part: LinkShape, file: Path) -> None:
    """Add a body to a link; the hull of a mesh is written to `file`."""
    geometry = _collision(link, part.pose_in_link)
    match part.shape:
        case Box(size):
            ElementTree.SubElement(geometry, "box", size=urdf_parser.numbers_text(size))
        case Cylinder(radius, height):
            ElementTree.SubElement(geometry, "cylinder", radius=repr(radius), length=repr(height))
        case Sphere(radius):
            ElementTree.SubElement(geometry, "sphere", radius=repr(radius))
        case ConvexMesh():
            file.write_text(mesh_reader.hulls_text([np.array(part.shape.vertices)]), encoding="ascii")
            ElementTree.SubElement(geometry, "mesh", filename=str(file))


def _collision(link: ElementTree.Element, pose: Pose) -> ElementTree.Element:
    """Add a collision element to a link and return its <geometry>."""
    collision = ElementTree.SubElement(link, "collision")
    origin = {"xyz": urdf_parser.numbers_text(pose.position), "rpy": urdf_parser.numbers_text(pose.rpy())}
    ElementTree.SubElement(collision, "origin", origin)
    return ElementTree.SubElement(collision, "geometry")


def _add_collision_visuals(link: ElementTree.Element) -> None:
    for collision in link.findall("collision"):
        visual = copy.deepcopy(collision)
        visual.tag = "visual"
        for material in visual.findall("material"):
            visual.remove(material)
        red, green, blue = COLOURS["light_grey"]
        material = ElementTree.SubElement(visual, "material", name="robot_grey")
        ElementTree.SubElement(material, "color", rgba=f"{red} {green} {blue} 1")
        link.append(visual)


def _add_no_mass(link: ElementTree.Element) -> None:
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "mass", value="0")
    ElementTree.SubElement(
        inertial, "inertia", dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0")
    )


def _put_finger(link: ElementTree.Element, n: int, gripper: GripperDescription) -> None:
    """Replace the collision geometry of a finger link by the pad of finger `n` and the bodies behind it."""
    for old in [*link.findall("collision"), *link.findall("contact")]:
        link.remove(old)
    for box, pose in (gripper.pads[n], *gripper.bodies_of(n)):
        ElementTree.SubElement(_collision(link, pose), "box", size=urdf_parser.numbers_text(box.size))
    contact = ElementTree.SubElement(link, "contact")
    ElementTree.SubElement(contact, "friction_anchor")
    for tag, value in (
        ("stiffness", gripper.pad_contact.stiffness),
        ("damping", gripper.pad_contact.damping),
        ("lateral_friction", gripper.pad_contact.friction),
        ("spinning_friction", gripper.pad_contact.spinning_friction),
    ):
        ElementTree.SubElement(contact, tag, value=repr(value))
