"""URDF for the simulation: boxes for the fingers, absolute mesh paths, grey and cheap to draw."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from ....errors import PicktreeError
from ....robots.description import GripperDescription, RobotDescription
from ....robots.gripper_mounting import mount_tool, numbers_text
from ....robots.urdf_tree import mesh_file
from ....world.colours import COLOURS


def patched_urdf(robot: RobotDescription) -> str:
    """Return the text of the robot's URDF, patched. Raises PicktreeError for missing files, links or meshes.

    Every link shows its *collision* geometry: the camera sees what can be touched, which also renders ten
    times faster than the visual meshes.
    """
    path = Path(robot.urdf)
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise PicktreeError(f"{robot.source or robot.name}: urdf {robot.urdf}: {error}") from None
    for mesh in root.iter("mesh"):
        mesh.set("filename", str(_mesh_path(mesh.get("filename", ""), path, robot)))
    mount_tool(root, robot)
    links = {link.get("name"): link for link in root.findall("link")}
    for link in links.values():
        _show_what_collides(link)
    for n, name in enumerate(robot.gripper.fingers):
        if name not in links:
            raise PicktreeError(f"{robot.source or robot.name}: finger link {name!r} is not in {robot.urdf}")
        _put_finger(links[name], n, robot.gripper)
    return ElementTree.tostring(root, encoding="unicode")


def _mesh_path(reference: str, urdf: Path, robot: RobotDescription) -> Path:
    file = mesh_file(urdf, reference)
    if file is None:
        raise PicktreeError(
            f"{robot.source or robot.name}: mesh {reference!r} of {robot.urdf} does not exist"
        )
    return file.resolve()


def _show_what_collides(link: ElementTree.Element) -> None:
    for visual in link.findall("visual"):
        link.remove(visual)
    for collision in link.findall("collision"):
        visual = copy.deepcopy(collision)
        visual.tag = "visual"
        for material in visual.findall("material"):
            visual.remove(material)
        red, green, blue = COLOURS["light_grey"]
        material = ElementTree.SubElement(visual, "material", name="robot_grey")
        ElementTree.SubElement(material, "color", rgba=f"{red} {green} {blue} 1")
        link.append(visual)


def _put_finger(link: ElementTree.Element, n: int, gripper: GripperDescription) -> None:
    """Replace the collision geometry of a finger link by the pad of finger `n` and the body behind it."""
    for old in [*link.findall("collision"), *link.findall("contact")]:
        link.remove(old)
    for box, pose in (gripper.pads[n], *gripper.finger_bodies[n : n + 1]):
        collision = ElementTree.SubElement(link, "collision")
        origin = {"xyz": numbers_text(pose.position), "rpy": numbers_text(pose.rpy())}
        ElementTree.SubElement(collision, "origin", origin)
        geometry = ElementTree.SubElement(collision, "geometry")
        ElementTree.SubElement(geometry, "box", size=numbers_text(box.size))
    contact = ElementTree.SubElement(link, "contact")
    ElementTree.SubElement(contact, "friction_anchor")
    for tag, value in (
        ("stiffness", gripper.pad_contact.stiffness),
        ("damping", gripper.pad_contact.damping),
        ("lateral_friction", gripper.pad_contact.friction),
        ("spinning_friction", gripper.pad_contact.spinning_friction),
    ):
        ElementTree.SubElement(contact, tag, value=repr(value))
