"""Mounting error of the hand: moves the URDF's flange joint so that the TCP is at its true or calibrated
pose."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree

from ..world.values import Pose, Vector3
from .description import RobotDescription


def rpy_of(pose: Pose) -> Vector3:
    """Return roll, pitch, yaw about the fixed axes, rad."""
    r = pose.rotation()
    pitch = math.atan2(-float(r[2, 0]), math.hypot(float(r[0, 0]), float(r[1, 0])))
    if math.cos(pitch) < 1e-9:
        return math.atan2(-float(r[1, 2]), float(r[1, 1])), pitch, 0.0
    return (
        math.atan2(float(r[2, 1]), float(r[2, 2])),
        pitch,
        math.atan2(float(r[1, 0]), float(r[0, 0])),
    )


def mount_tool(root: ElementTree.Element, robot: RobotDescription) -> None:
    """Move the flange joint of a URDF in place, with all that hangs on it. The TCP then sits at
    `robot.tool` in the frame of the TCP that the file states."""
    if robot.tool == Pose():
        return
    joints = {_child(joint): joint for joint in root.findall("joint")}
    flange = next(joint for joint in joints.values() if joint.get("name") == robot.flange_joint)
    tcp_in_hand = robot.tcp_in_link
    link = robot.tcp_link
    while link != _child(flange):
        # Between flange and TCP everything is fixed: a robot file whose TCP moved would have no such tool.
        joint = joints[link]
        tcp_in_hand = _origin(joint) @ tcp_in_hand
        link = joint.find("parent").get("link", "")  # pyright: ignore[reportOptionalMemberAccess]
    moved = _origin(flange) @ tcp_in_hand @ robot.tool @ tcp_in_hand.inverse()
    for old in flange.findall("origin"):
        flange.remove(old)
    ElementTree.SubElement(flange, "origin", xyz=_text(moved.position), rpy=_text(rpy_of(moved)))


def _child(joint: ElementTree.Element) -> str:
    child = joint.find("child")
    return "" if child is None else child.get("link", "")


def _origin(joint: ElementTree.Element) -> Pose:
    origin = joint.find("origin")
    if origin is None:
        return Pose()
    return Pose.from_rpy(_vector(origin.get("xyz", "0 0 0")), _vector(origin.get("rpy", "0 0 0")))


def _vector(text: str) -> Vector3:
    x, y, z = map(float, text.split())
    return x, y, z


def _text(numbers: Vector3) -> str:
    return " ".join(repr(n) for n in numbers)
