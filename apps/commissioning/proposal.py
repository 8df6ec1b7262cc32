"""Robot file proposed for a URDF, as MoveIt's Setup Assistant proposes a configuration."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...files.errors import PicktreeError
from ...files.marks import FileError
from ...files.value_wording import listed
from ...logs.binary_gltf import link_meshes
from ...world.robot_model.description import RobotDescription
from ...world.robot_model.gripper_mounting import (
    GripperMount,
    InsertedFlange,
    NamedUrdf,
    write_composed_urdf,
)
from ...world.robot_model.loading import parse_robot
from ...world.robot_model.model import RobotModel
from ...world.robot_model.urdf_faults import MOVING, UrdfError
from ...world.robot_model.urdf_geometry import links_seen_only
from ...world.robot_model.urdf_text import parsed_urdf
from ...world.robot_model.urdf_tree import UrdfTree, read_skeleton
from ...world.values import Array, Pose
from .arm_poses import NamedPose, propose_poses
from .base_pose import propose_base
from .free_space import SpaceOverTable
from .gripper_measurement import GripperMeter
from .inertias import check_inertias, lightened, rotor_inertias
from .joint_groups import ArmGroup, HandGroup, find_groups, find_hand, require_link
from .joint_limits import borne_share, estimate, propose_limits
from .link_geometry import (
    LinkGeometry,
    UnsuitableUrdf,
    UrdfSource,
    find_source,
    read_solids,
    refuse_missing_meshes,
)
from .robot_file_writer import RobotDraft, robot_file_text
from .self_collision import SAMPLE_COUNT, sample_links

MOUNT_JOINT = "mount"
"""Name of the joint that holds the gripper."""
GRIPPER_PREFIX = "gripper_"
"""Prefix of the gripper's names when the arm has the same ones."""
FLANGE_NAMES = ("tool0", "flange", "ee_link", "tool", "tcp", "hand", "ee")
"""Usual names of flange links, the best first."""


def find_mounting(
    arm_source: UrdfSource,
    arm: ArmGroup,
    solids: Mapping[str, LinkGeometry],
    gripper: UrdfSource,
    link: str | None,
    to: str | None,
) -> GripperMount:
    """Find the mounting of a gripper on an arm. Raises UnsuitableUrdf when the gripper is none, or the arm
    has no such link."""
    _, first = find_hand(gripper.text, gripper.skeleton, link)
    carrier = to or _mount_flange(arm_source.skeleton, arm)
    skeleton = arm_source.skeleton
    missing = f"a link {carrier!r} for --mount"
    require_link(arm_source.text, skeleton, carrier, missing, "name the link at the end of the arm")
    taken = {*skeleton.links, *skeleton.joints}
    below = gripper.skeleton.below(first)
    names = {*below, *(n for n, j in gripper.skeleton.joints.items() if j.parent in below)}
    prefix = GRIPPER_PREFIX if names & taken else ""
    joint = MOUNT_JOINT if MOUNT_JOINT not in taken else f"{GRIPPER_PREFIX}{MOUNT_JOINT}"
    return GripperMount(gripper.urdf, first, carrier, _face(skeleton, arm, solids, carrier), joint, prefix)


def _mount_flange(skeleton: UrdfTree, arm: ArmGroup) -> str:
    """Return the link with a flange's name that is fixed to the last link; else the last link."""
    fixed = [link for link in skeleton.below(arm.tip) if not _moves(skeleton, arm.tip, link)]
    for name in FLANGE_NAMES:
        for link in fixed:
            if link.lower().endswith(name):
                return link
    return arm.tip


def _moves(skeleton: UrdfTree, above: str, link: str) -> bool:
    return any(skeleton.joints[name].type in MOVING for name in skeleton.joints_between(above, link) or ())


def _face(skeleton: UrdfTree, arm: ArmGroup, solids: Mapping[str, LinkGeometry], carrier: str) -> Pose:
    """Return the gripper's pose on the carrier: z out along the axis of the last joint, on the outer face."""
    last = skeleton.joints[arm.joints[-1]]
    moved = skeleton.pose(last.child, {})
    at = skeleton.pose(carrier, {})
    axis: Array = at.rotation().T @ moved.rotation() @ np.array(last.axis)
    origin = at.inverse().apply(np.array(moved.position))

    def middle(links: Iterable[str]) -> float | None:
        """Return how far ahead along the axis the middle of these links' points is, m."""
        points = [
            (at.inverse() @ skeleton.pose(link, {})).apply(solids[link].points) @ axis
            for link in links
            if link in solids
        ]
        return float(np.mean([(p.min() + p.max()) / 2 for p in points])) if points else None

    # Outwards is from the joint to the flange; where both coincide, from the link before to the last one. The
    # last link's own points do not tell: its frame may be at its inner or at its outer face.
    ahead = -origin @ axis
    own = middle(x for x in skeleton.below(last.child) if not _moves(skeleton, last.child, x))
    if abs(ahead) < 1e-4 and own is not None:
        before = middle((last.parent,))
        ahead = own - (origin @ axis if before is None else before)
    out: Array = axis if ahead >= 0.0 else -axis
    height = 0.0
    if carrier in solids:
        height = max(float((solids[carrier].points @ out).max()), 0.0)
    if float(out[2]) > 0.999:
        return Pose((0.0, 0.0, round(height, 4)))
    side = np.array([1.0, 0.0, 0.0]) if abs(float(out[0])) < 0.9 else np.array([0.0, 1.0, 0.0])
    y = np.cross(out, side)
    y = y / np.linalg.norm(y)
    rotation = np.column_stack([np.cross(y, out), y, out])
    x0, y0, z0 = (round(float(c), 4) for c in out * height)
    return Pose.from_rotation((x0, y0, z0), rotation)


@dataclass(frozen=True, slots=True)
class ProposalRequest:
    """Request for a proposed robot file."""

    urdf: str
    """URDF: a path, or `package:path`."""
    file: Path
    """Path of the robot file; paths in it are relative to its folder."""
    gripper: str | None = None
    """Gripper to mount, `URDF` or `URDF:LINK`; None: the URDF's own."""
    mount: str | None = None
    """Link of the arm that carries the gripper; None: the flange."""
    base: str | None = None
    tip: str | None = None
    samples: int = SAMPLE_COUNT
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Proposal:
    """Proposed robot file: a draft, its text, and the description read back from it."""

    draft: RobotDraft
    text: str
    robot: RobotDescription


def propose(wish: ProposalRequest) -> Proposal:
    """Propose a robot file. The same request gives the same text, in any process.

    Raises UnsuitableUrdf for an unsuitable URDF, PicktreeError for missing files.
    """
    draft = _borne(_find_draft(wish), wish)
    model = _model(draft, wish)
    draft = replace(draft, limits=estimate(model, draft.limits, wish.seed))
    path = Path(model.description.urdf)
    tree, solids = read_skeleton(path), read_solids(path)
    draft = replace(draft, collision=sample_links(model, solids, wish.samples, wish.seed))
    model = _model(draft, wish)
    draft = replace(draft, base=propose_base(model, tree, solids))
    model = model if draft.base is None else _model(draft, wish)
    space = SpaceOverTable(model, tree, solids)
    poses = propose_poses(model, space, wish.seed)
    if poses is None:
        raise UnsuitableUrdf(
            wish.urdf,
            f"an arm of {model.n} joints and a gripper; {space.obstacle(wish.seed)}",
            "a free pose: above the table at z = 0, in front of the first joint, no links in each other",
            "look at <collision> of both and at the joints between them, or at the height of the base",
        )
    draft = replace(draft, poses=poses)
    text = robot_file_text(draft)
    return Proposal(draft, text, _parsed(text, wish))


def _model(draft: RobotDraft, wish: ProposalRequest) -> RobotModel:
    return RobotModel(_parsed(robot_file_text(replace(draft, poses=(_middle(draft),))), wish))


def _borne(draft: RobotDraft, wish: ProposalRequest) -> RobotDraft:
    """Return the draft with guessed masses that the URDF's torques carry."""
    if not any(finding.density for finding in draft.findings):
        return draft

    def lighter(share: float) -> RobotDraft:
        findings, inertias = lightened(draft.findings, draft.inertias, share)
        return replace(draft, findings=findings, inertias=inertias)

    share = borne_share(_model(draft, wish), _model(lighter(0.5), wish), draft.limits, wish.seed)
    return draft if share == 1.0 else lighter(share)


def _find_draft(wish: ProposalRequest) -> RobotDraft:
    source = find_source(wish.urdf)
    refuse_missing_meshes(wish.urdf, source.urdf.path)
    if wish.gripper is None:
        groups = find_groups(wish.urdf, source.skeleton, wish.base, wish.tip)
        if groups.hand is None:
            raise UnsuitableUrdf(
                wish.urdf,
                f"an arm of {len(groups.arm.joints)} joints, {groups.arm.joints[0]} to "
                f"{groups.arm.joints[-1]}, with {groups.arm.tip!r} at its end",
                "a gripper with two fingers that move against each other",
                f"--gripper URDF:LINK --mount {groups.arm.tip} mounts one, as the Franka hand: "
                "--gripper pybullet_data:franka_panda/panda.urdf:panda_hand",
            )
        return _draft(wish, source, source.urdf.path, groups.arm, groups.hand, None, "")
    groups = find_groups(wish.urdf, source.skeleton, wish.base, wish.tip)
    if groups.hand is not None and wish.mount is None:
        raise UnsuitableUrdf(
            wish.urdf,
            f"a gripper at the end of the arm already, on {groups.hand.palm!r}",
            "a place for another one",
            "leave --gripper out, or say by --mount LINK where the other one goes",
        )
    text, link = _gripper_named(wish.gripper)
    gripper = find_source(text)
    refuse_missing_meshes(text, gripper.urdf.path)
    mounting = find_mounting(source, groups.arm, read_solids(source.urdf.path), gripper, link, wish.mount)
    try:
        path = write_composed_urdf(source.urdf, mounting)
    except UrdfError as error:
        raise PicktreeError(f"{wish.urdf}: the gripper {text} cannot be mounted: {error}") from None
    hand, _ = find_hand(text, gripper.skeleton, mounting.link)
    prefix = mounting.prefix
    named = HandGroup(
        prefix + hand.palm,
        tuple(prefix + name for name in hand.drives),
        tuple(prefix + name for name in hand.followers),
    )
    return _draft(wish, source, path, groups.arm, named, mounting, text)


def _gripper_named(text: str) -> tuple[str, str | None]:
    """Split `URDF:LINK`; a colon before a path is that of a package."""
    head, colon, tail = text.rpartition(":")
    if colon and "/" not in tail and not tail.endswith((".urdf", ".xacro")):
        return head, tail
    return text, None


def _draft(
    wish: ProposalRequest,
    source: UrdfSource,
    path: Path,
    arm: ArmGroup,
    hand: HandGroup,
    mounting: GripperMount | None,
    gripper_urdf: str,
) -> RobotDraft:
    skeleton = read_skeleton(path)
    behind: str | None = None
    if _fixed_joints(skeleton, arm, hand) == ():
        behind = arm.joints[-1]
        flange = InsertedFlange(behind, _free_name(skeleton))
        path = write_composed_urdf(source.urdf, mounting, flange=flange)
        skeleton = read_skeleton(path)
    solids = read_solids(path)
    link_meshes(str(path))  # raises for what is only seen, too
    flange_joint = _flange(wish.urdf, skeleton, arm, hand, solids)
    meter = GripperMeter(wish.urdf, skeleton, solids, hand, _behind(skeleton, flange_joint, hand))
    measured = meter.measure()
    findings = check_inertias(parsed_urdf(path), skeleton, solids)
    inertias = {f.link: f.instead for f in findings if f.instead is not None}
    if measured.sliders is None:
        inertias |= rotor_inertias(parsed_urdf(path), skeleton, meter.ratios, inertias)
    notes: list[str] = []
    if seen_only := links_seen_only(str(path)):
        notes.append(f"without <collision>, colliding as they are seen: {listed(seen_only, 6)}")
    if len(arm.joints) == 5:
        notes.append("the arm has five joints: it reaches poses with the tool upright, and few others")
    return RobotDraft(
        name=wish.file.stem,
        urdf=_named(wish.urdf, source.urdf, wish.file),
        arm=arm,
        hand=hand,
        mounting=mounting,
        gripper_urdf=_named(gripper_urdf, mounting.gripper, wish.file) if mounting is not None else "",
        limits=propose_limits(skeleton, arm.joints),
        gripper=measured,
        flange_joint=flange_joint,
        flange_behind=behind,
        findings=findings,
        inertias=inertias,
        notes=tuple(notes),
    )


def _named(text: str, urdf: NamedUrdf, file: Path) -> str:
    """Return a URDF's name in the robot file: `package:path` as given, else a path relative to the file's
    folder."""
    if urdf.package:
        return text
    return Path(os.path.relpath(urdf.path.resolve(), file.resolve().parent)).as_posix()


def _flange(
    source: str, skeleton: UrdfTree, arm: ArmGroup, hand: HandGroup, solids: Mapping[str, LinkGeometry]
) -> str:
    """Return the fixed joint between arm and hand. Raises UnsuitableUrdf when the arm does not carry it.

    It is the one nearest to the palm beyond which the hand has a body, as the bar on which fingers slide.
    """
    fixed = _fixed_joints(skeleton, arm, hand)
    if not fixed:
        raise UnsuitableUrdf(
            source,
            f"an arm that ends with {arm.joints[-1]!r}, and a hand {hand.palm!r} elsewhere",
            "a hand at the end of the arm",
            "--base and --tip name links at the two ends of the arm",
        )
    bodies = (name for name in reversed(fixed) if solids.keys() & {*_behind(skeleton, name, hand)})
    return next(bodies, fixed[-1])


def _fixed_joints(skeleton: UrdfTree, arm: ArmGroup, hand: HandGroup) -> tuple[str, ...] | None:
    """Return the fixed joints between arm and palm; None when the arm's last joint does not move the palm."""
    names = skeleton.joints_to(hand.palm)
    if arm.joints[-1] not in names:
        return None
    behind = names[names.index(arm.joints[-1]) + 1 :]
    return tuple(name for name in behind if skeleton.joints[name].type == "fixed")


def _free_name(skeleton: UrdfTree) -> str:
    """Return a name for an inserted flange that no link and no joint has."""
    taken = {*skeleton.links, *skeleton.joints}
    names = ("flange", *(f"flange_{n}" for n in range(2, len(taken) + 3)))
    return next(name for name in names if not {name, f"{name}_link"} & taken)


def _behind(skeleton: UrdfTree, flange: str, hand: HandGroup) -> tuple[str, ...]:
    """Return the links of the hand that no finger joint moves."""
    first = skeleton.joints[flange].child
    moved: set[str] = set()
    for name in hand.joints:
        moved.update(skeleton.below(skeleton.joints[name].child))
    return tuple(link for link in skeleton.below(first) if link not in moved)


def _middle(draft: RobotDraft) -> NamedPose:
    """Return the configuration nearest to 0 within the limits: a placeholder until poses are known."""
    joints = tuple(min(max(0.0, j.lower), j.upper) for j in draft.limits)
    return NamedPose("home", joints, "")


def _parsed(text: str, wish: ProposalRequest) -> RobotDescription:
    try:
        return parse_robot(text, wish.file)
    except FileError as error:
        told = "; ".join(fault.message for fault in error.faults[:3])
        raise UnsuitableUrdf(
            wish.urdf,
            f"an arm and a gripper, but the robot file made of them is refused: {told}",
            "a URDF that the checker takes",
            "mend what it says in a copy of the URDF",
        ) from None
