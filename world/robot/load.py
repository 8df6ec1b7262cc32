"""Reading robot files. All faults come at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

from ..errors import PicktreeError
from ..files.checked import Checker, describe
from ..files.document import Document, Fault, FileError, Location, nearest, open_document, read_document
from ..files.shipped import find_file, is_file, shipped_names
from .description import GripperDescription, JointLimits, PadContact, RobotDescription
from .schema import RobotFile
from .skeleton import LIMITED, Skeleton, UrdfError, read_skeleton
from .urdf import link_geometry

SHIPPED = Path(__file__).parent.parent / "robots"


@dataclass(frozen=True, slots=True)
class RobotCheck:
    """What was found in a robot file: the robot, None when there are errors, and all faults."""

    robot: RobotDescription | None
    faults: tuple[Fault, ...]


def load_robot(name_or_path: str, beside: Path | None = None) -> RobotDescription:
    """The robot of that shipped name, or of a file whose path counts from `beside`.

    Raises FileError with all faults of the file, PicktreeError when there is no such file.
    """
    return _faultless(open_document(find_file(name_or_path, SHIPPED, beside, "robot"), "robot"))


def parse_robot(text: str, path: Path) -> RobotDescription:
    """The robot of a file's text, as a log keeps it; `path` is where the file stood."""
    return _faultless(read_document(text, path, "robot"))


def robot_names() -> tuple[str, ...]:
    """Names of the shipped robots."""
    return shipped_names(SHIPPED)


def check_robot(document: Document) -> RobotCheck:
    """Everything that can be said of a document of kind `robot`; never raises for what stands in it."""
    check = Checker(document)
    robot = check.read(RobotFile)
    urdf: Path | None = None
    with check.readable():
        urdf = _urdf(check, robot.urdf, document.path)
    _check_numbers(check, robot)
    if urdf is not None:
        _check_against(check, robot, urdf)
    if urdf is None or any(fault.severity == "error" for fault in check.faults):
        return RobotCheck(None, tuple(check.faults))
    return RobotCheck(_described(document, robot, urdf), tuple(check.faults))


def _faultless(document: Document) -> RobotDescription:
    found = check_robot(document)
    if found.robot is None:
        raise FileError(found.faults)
    return found.robot


def _described(document: Document, robot: RobotFile, urdf: Path) -> RobotDescription:
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
            check.fault(("urdf",), f"there is no installed package {describe(package)}", code="P501")
            return None
        path = Path(roots[0]) / inside
        if "\0" in inside or not path.resolve().is_relative_to(Path(roots[0]).resolve()):
            message = f"{describe(inside)} is outside of the package {package!r}"
            check.fault(("urdf",), message, code="P501")
            return None
    else:
        path = source.parent / text
    if not is_file(path):
        check.fault(("urdf",), f"there is no file {path}", code="P501")
        return None
    return path


def _check_numbers(check: Checker, robot: RobotFile) -> None:
    with check.readable():
        for name in robot.joints:
            with check.readable():
                joint = robot.joints[name]
                if joint.lower >= joint.upper:
                    upper = check.written(("joints", name, "upper"), joint.upper, "rad")
                    lower = check.written(("joints", name, "lower"), joint.lower, "rad")
                    message = f"the upper limit, {upper}, is not above the lower, {lower}"
                    check.fault(("joints", name, "upper"), message, code="P506")
    with check.readable():
        if "home" not in robot.poses:
            hint = "the pose to which the arm returns"
            check.fault(("poses",), "'home' is missing", hint, code="P507", key=True)
        for name in robot.poses:
            with check.readable():
                _check_pose(check, name, robot)


def _check_pose(check: Checker, name: str, robot: RobotFile) -> None:
    given = robot.poses[name]
    if len(given) != len(robot.joints):
        count = len(robot.joints)
        wanted = "1 value is" if count == 1 else f"{count} values are"
        message = f"{wanted} wanted, one for each joint, not {len(given)}"
        check.fault(("poses", name), message, code="P508")
        return
    for n, joint in enumerate(robot.joints):
        with check.readable():
            value, limit = given[n], robot.joints[joint]
            if limit.lower < limit.upper and not limit.lower <= value <= limit.upper:
                lower = check.written(("joints", joint, "lower"), limit.lower, "rad")
                upper = check.written(("joints", joint, "upper"), limit.upper, "rad")
                loc: Location = ("poses", name, n)
                message = f"{check.written(loc, value, 'rad')} is outside the limits of {joint}"
                check.fault(loc, message, f"{lower} … {upper}", code="P509")


def _check_against(check: Checker, robot: RobotFile, urdf: Path) -> None:
    """Whether the robot file and the URDF go together."""
    try:
        skeleton = read_skeleton(urdf)
    except UrdfError as error:
        check.fault(("urdf",), f"{urdf}: {error}", code="P502")
        return
    try:
        for which in ("visual", "collision"):
            link_geometry(str(urdf), which)
    except (PicktreeError, ValueError) as error:
        text = str(error).removeprefix(f"{urdf}: ")
        check.fault(("urdf",), f"{urdf}: the geometry cannot be used: {text}", code="P511")
    for loc, name in _link_names(check, robot):
        if name not in skeleton.links:
            hint = nearest(name, skeleton.links)
            check.fault(loc, f"the URDF has no link {describe(name)}", hint, code="P503")
    for loc, name, kinds in _joint_names(check, robot):
        _check_joint(check, loc, name, kinds, skeleton)
    with check.readable():
        _check_order(check, [name for name in robot.joints if name in skeleton.joints], skeleton)


def _check_joint(
    check: Checker, loc: Location, name: str, kinds: tuple[str, ...], skeleton: Skeleton
) -> None:
    key = loc[0] == "joints"
    joint = skeleton.joints.get(name)
    if joint is None:
        hint = nearest(name, skeleton.joints)
        check.fault(loc, f"the URDF has no joint {describe(name)}", hint, code="P504", key=key)
    elif joint.type not in kinds:
        message = f"{name!r} is {joint.type or 'of no type'}; {' or '.join(kinds)} is wanted"
        check.fault(loc, message, code="P505", key=key)
    elif joint.type in LIMITED and not joint.limited:
        hint = 'as <limit lower="-1" upper="1" effort="10" velocity="1"/>'
        check.fault(loc, f"the URDF gives {name!r} no limits", hint, code="P505", key=key)


def _check_order(check: Checker, joints: list[str], skeleton: Skeleton) -> None:
    for before, name in pairwise(joints):
        if before not in skeleton.above(name):
            message = f"{name!r} does not come behind {before!r} in the URDF"
            check.fault(
                ("joints", name),
                message,
                "the joints stand in order, from the base on",
                code="P510",
                key=True,
            )
            return


def _link_names(check: Checker, robot: RobotFile) -> Iterator[tuple[Location, str]]:
    with check.readable():
        yield ("tcp", "link"), robot.tcp.link
    for n in range(2):
        with check.readable():
            yield ("gripper", "links", n), robot.gripper.links[n]
    with check.readable():
        for n in range(len(robot.disabled_pairs)):
            for m in range(2):
                with check.readable():
                    yield ("disabled_pairs", n, m), robot.disabled_pairs[n][m]


def _joint_names(check: Checker, robot: RobotFile) -> Iterator[tuple[Location, str, tuple[str, ...]]]:
    with check.readable():
        yield from ((("joints", name), name, LIMITED) for name in robot.joints)
    for n in range(2):
        with check.readable():
            yield ("gripper", "joints", n), robot.gripper.joints[n], ("prismatic",)
    with check.readable():
        yield ("flange_joint",), robot.flange_joint, ("fixed",)
