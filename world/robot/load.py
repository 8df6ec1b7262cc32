"""Reading robot files."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from ..files.checked import Angle, Angles, Checker, FileModel, Force, Sizes, Vector, quantity
from ..files.document import Document, FileError, load_document, nearest, parse_document
from ..files.shipped import find_file, is_file, shipped_names
from ..shapes import Box
from ..values import Pose
from .description import GripperDescription, JointLimits, PadContact, RobotDescription

SHIPPED = Path(__file__).parent.parent / "robots"


class _Frame(FileModel):
    at: Vector = (0.0, 0.0, 0.0)
    rpy: Angles = (0.0, 0.0, 0.0)

    def pose(self) -> Pose:
        return Pose.from_rpy(self.at, self.rpy)


class _Tcp(_Frame):
    link: str


class _Box(_Frame):
    box: Sizes

    def placed(self) -> tuple[Box, Pose]:
        return Box(self.box), self.pose()


class _Joint(FileModel):
    lower: Angle
    upper: Angle
    velocity: Annotated[float, quantity("rad/s", above=0)]
    acceleration: Annotated[float, quantity("rad/s2", above=0)]
    torque: Annotated[float, quantity("Nm", above=0)]


class _PadContact(FileModel):
    stiffness: Annotated[float, quantity("N/m", above=0)] = PadContact().stiffness
    damping: Annotated[float, quantity("", above=0)] = PadContact().damping
    friction: Annotated[float, quantity("", above=0)] = PadContact().friction
    spinning_friction: Annotated[float, quantity("", least=0)] = PadContact().spinning_friction


class _Gripper(FileModel):
    joints: tuple[str, str]
    links: tuple[str, str]
    max_width: Annotated[float, quantity("m", above=0)]
    max_force: Force
    speed: Annotated[float, quantity("m/s", above=0)]
    gear: Annotated[float, quantity("")] = -1.0
    tip: Annotated[float, quantity("m", least=0)]
    palm: Annotated[float, quantity("m", above=0)]
    pads: tuple[_Box, _Box]
    pad_contact: _PadContact = _PadContact()
    hand: tuple[_Box, ...]
    finger: _Box


class _Robot(FileModel):
    urdf: str
    base: _Frame = _Frame()
    joints: dict[str, _Joint]
    poses: dict[str, tuple[Angle, ...]]
    tcp: _Tcp
    flange_joint: str
    gripper: _Gripper
    disabled_pairs: tuple[tuple[str, str], ...] = ()


def load_robot(name_or_path: str, beside: Path | None = None) -> RobotDescription:
    """The robot of that shipped name, or of a file whose path counts from `beside`.

    Raises FileError with all faults of the file, PicktreeError when there is no such file.
    """
    path = find_file(name_or_path, SHIPPED, beside, "robot")
    return _described(load_document(path, "robot"))


def parse_robot(text: str, path: Path) -> RobotDescription:
    """The robot of a file's text, as a log keeps it; `path` is where the file stood."""
    return _described(parse_document(text, path, "robot"))


def robot_names() -> tuple[str, ...]:
    """Names of the shipped robots."""
    return shipped_names(SHIPPED)


def _described(document: Document) -> RobotDescription:
    check = Checker(document)
    robot = check.read(_Robot)
    if robot is None:
        raise FileError(check.faults)
    urdf = _urdf(check, robot.urdf, document.path)
    _check_numbers(check, robot)
    if urdf is not None:
        _check_names(check, robot, urdf)
    check.finish()
    gripper = robot.gripper
    first, second = gripper.pads
    return RobotDescription(
        name=document.path.stem,
        urdf=str(urdf),
        base_in_world=robot.base.pose(),
        joints=tuple(robot.joints),
        limits=tuple(
            JointLimits(j.lower, j.upper, j.velocity, j.acceleration, j.torque) for j in robot.joints.values()
        ),
        named=robot.poses,
        tcp_link=robot.tcp.link,
        tcp_in_link=robot.tcp.pose(),
        flange_joint=robot.flange_joint,
        gripper=GripperDescription(
            joints=gripper.joints,
            fingers=gripper.links,
            max_width=gripper.max_width,
            max_force=gripper.max_force,
            speed=gripper.speed,
            pads=(first.placed(), second.placed()),
            pad_contact=PadContact(**gripper.pad_contact.model_dump()),
            gear=gripper.gear,
            tip=gripper.tip,
            palm=gripper.palm,
            hand=tuple(box.placed() for box in gripper.hand),
            finger_boxes=gripper.finger.placed(),
        ),
        disabled_pairs=robot.disabled_pairs,
        source=str(document.path),
        text=document.text,
    )


def _urdf(check: Checker, text: str, source: Path) -> Path | None:
    """The URDF's path: `package:path` inside an installed package, or a path beside the robot file."""
    package, colon, inside = text.partition(":")
    if colon:
        # Located, not imported: an import may run anything.
        try:
            spec = find_spec(package) if package.isidentifier() else None
        except ValueError:
            spec = None
        roots = list(spec.submodule_search_locations or ()) if spec else []
        if not roots:
            check.fault(("urdf",), f"there is no installed package {package!r}")
            return None
        path = Path(roots[0]) / inside
    else:
        path = source.parent / text
    if not is_file(path):
        check.fault(("urdf",), f"there is no file {path}")
        return None
    return path


def _check_numbers(check: Checker, robot: _Robot) -> None:
    for name, joint in robot.joints.items():
        if joint.lower >= joint.upper:
            message = f"the upper limit {joint.upper:g} rad is not above the lower, {joint.lower:g} rad"
            check.fault(("joints", name, "upper"), message)
    if "home" not in robot.poses:
        check.fault(("poses",), "'home' is missing", key=True)
    for name, pose in robot.poses.items():
        if len(pose) != len(robot.joints):
            message = f"{len(robot.joints)} values are wanted, one for each joint, not {len(pose)}"
            check.fault(("poses", name), message)
            continue
        for n, (value, (joint, limit)) in enumerate(zip(pose, robot.joints.items(), strict=True)):
            if not limit.lower <= value <= limit.upper:
                message = f"{value:g} rad is outside the limits of {joint}"
                check.fault(("poses", name, n), message, f"{limit.lower:g} … {limit.upper:g} rad")


def _check_names(check: Checker, robot: _Robot, urdf: Path) -> None:
    try:
        root = ElementTree.parse(urdf).getroot()
    except (ElementTree.ParseError, OSError, UnicodeError) as error:
        check.fault(("urdf",), f"{urdf} is not readable as XML: {error}")
        return
    links = [link.get("name", "") for link in root.findall("link")]
    joints = {joint.get("name", ""): joint.get("type", "") for joint in root.findall("joint")}
    for loc, name in _link_names(robot):
        if name not in links:
            check.fault(loc, f"the URDF has no link {name!r}", nearest(name, links))
    wanted = [
        *((("joints", name), name, ("revolute", "prismatic", "continuous")) for name in robot.joints),
        *((("gripper", "joints", n), name, ("prismatic",)) for n, name in enumerate(robot.gripper.joints)),
        (("flange_joint",), robot.flange_joint, ("fixed",)),
    ]
    for loc, name, kinds in wanted:
        if name not in joints:
            check.fault(loc, f"the URDF has no joint {name!r}", nearest(name, joints), key=loc[0] == "joints")
        elif joints[name] not in kinds:
            message = f"{name!r} is {joints[name]}; {' or '.join(kinds)} is wanted"
            check.fault(loc, message, key=loc[0] == "joints")


def _link_names(robot: _Robot) -> Iterator[tuple[tuple[str | int, ...], str]]:
    yield ("tcp", "link"), robot.tcp.link
    yield from ((("gripper", "links", n), name) for n, name in enumerate(robot.gripper.links))
    for n, pair in enumerate(robot.disabled_pairs):
        yield from ((("disabled_pairs", n, m), name) for m, name in enumerate(pair))
