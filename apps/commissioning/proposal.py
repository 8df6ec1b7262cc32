"""Robot file proposed for a URDF, as MoveIt's Setup Assistant proposes a configuration, and its YAML text
with origins of values.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from picktree.files import FileError, PicktreeError, listed
from picktree.logs import binary_gltf
from picktree.world import Array, Box, Pose
from picktree.world.robot_model import (
    MOVING,
    RobotDescription,
    RobotModel,
    UrdfError,
    gripper_mounting,
    parse_robot,
    urdf_parser,
)

from .arm_poses import NamedPose, propose_poses
from .base_pose import BaseProposal, propose_base
from .free_space import SpaceOverTable
from .gripper import GripperMeter, MeasuredGripper
from .inertias import InertiaFinding, check_inertias, lightened, rotor_inertias
from .joints import (
    ACCELERATION_TORQUE_SHARE,
    ArmGroup,
    HandGroup,
    ProposedLimits,
    borne_share,
    estimate,
    find_groups,
    find_hand,
    propose_limits,
    require_link,
)
from .link_geometry import (
    LinkGeometry,
    UnsuitableUrdf,
    UrdfSource,
    find_source,
    read_solids,
    refuse_missing_meshes,
)
from .self_collision import (
    ALWAYS_COLLIDING_SHARE,
    COLLISION_DISTANCE,
    REASONS,
    SAMPLE_COUNT,
    SelfCollisionReport,
    sample_links,
)


@dataclass(frozen=True, slots=True)
class RobotDraft:
    """Complete content of a robot file, before it is written."""

    name: str
    urdf: str
    """URDF as the robot file names it."""
    arm: ArmGroup
    hand: HandGroup
    mounting: gripper_mounting.GripperMount | None
    gripper_urdf: str
    limits: tuple[ProposedLimits, ...]
    gripper: MeasuredGripper
    flange_joint: str
    flange_behind: str | None
    """The arm's last joint, where the flange joint is put into the URDF; None: the URDF has it."""
    findings: tuple[InertiaFinding, ...]
    inertias: Mapping[str, gripper_mounting.LinkInertia]
    poses: tuple[NamedPose, ...] = ()
    collision: SelfCollisionReport | None = None
    notes: tuple[str, ...] = ()
    base: BaseProposal | None = None
    """Base from which the tool reaches more; None: the origin."""


_REASON_TEXTS = {
    "adjacent": "Adjacent: one joint between them, or none of the arm's; they may touch.",
    "default": "Default: two joints between them, and they touch with all joints in mid-range.",
    "always": f"Always in collision: in more than {100 * ALWAYS_COLLIDING_SHARE:.0f} % of the samples.",
    "never": "Never in collision in any sample.",
    "hulls": "Only the links' convex hulls collide; their meshes never do.",
}


def robot_file_text(draft: RobotDraft) -> str:
    return "\n".join(_lines(draft)) + "\n"


def _lines(draft: RobotDraft) -> Iterator[str]:
    arm, hand = draft.arm, draft.hand
    yield "picktree: 1"
    yield "kind: robot"
    yield ""
    yield '# Proposed by `picktree robot new`: check it, above all the lines with "see the data sheet".'
    yield f"# The arm: {len(arm.joints)} joints, {arm.joints[0]} to {arm.joints[-1]}. The hand: {hand.palm}."
    for note in draft.notes:
        yield f"# Note: {note}."
    yield f"urdf: {_word(draft.urdf)}"
    if draft.mounting is not None:
        mounting = draft.mounting
        yield "mount:                     # the gripper, from another URDF"
        yield f"  urdf: {_word(draft.gripper_urdf)}"
        yield f"  link: {_word(mounting.link)}"
        yield f"  to: {_word(mounting.to)}"
        yield f"  {_frame(mounting.pose, spread='  ')}"
        yield f"  joint: {_word(mounting.joint)}"
        if mounting.prefix:
            yield f"  prefix: {_word(mounting.prefix)}"
    yield from _inertias(draft)
    yield ""
    yield "# Position of the foot in the world; scenes have the table at z = 0."
    if draft.base is not None:
        yield f"# This position is a proposal: {draft.base.sentence}."
    yield f"base: {{at: {_list((0.0, 0.0, 0.0) if draft.base is None else draft.base.at)}}}"
    yield ""
    yield "# Accelerations are estimated: gravity is subtracted from the torque, and at most"
    yield (
        f"# {ACCELERATION_TORQUE_SHARE:g} of the rest accelerates the joint's largest inertia. See "
        "the data sheet."
    )
    yield "joints:"
    common = {limit.comment for limit in draft.limits}
    if len(common) == 1:
        yield f"  # Angles: {common.pop()}."
    for limit in draft.limits:
        yield (
            f"  {_word(limit.name)}: {{lower: {_n(limit.lower)}, upper: {_n(limit.upper)}, "
            f"velocity: {_n(limit.velocity)}, acceleration: {_n(limit.acceleration)}, "
            f"torque: {_n(limit.torque if limit.torque > 0.0 else 1.0)}}}"
        )
        if common:
            yield f"    # {limit.comment}"
    yield ""
    yield "poses:"
    for pose in draft.poses:
        if pose.comment:
            yield f"  # {pose.comment}"
        yield f"  {pose.name}: [{', '.join(_n(v) for v in pose.joints)}]"
    yield ""
    yield from _gripper(draft)
    yield from _pairs(draft.collision)


def _inertias(draft: RobotDraft) -> Iterator[str]:
    findings = {finding.link: finding for finding in draft.findings}
    for finding in draft.findings:
        if finding.instead is None:
            yield f"# Look at {finding.link}: {finding.sentence}."
    if not draft.inertias:
        return
    yield ""
    yield "# These inertias replace those of the URDF:"
    yield "inertias:"
    for link, inertia in draft.inertias.items():
        if link in findings and findings[link].instead is not None:
            yield f"  # {link}: {findings[link].sentence}."
        else:
            yield f"  # {link}: the inertia includes the motor's rotor, as the gear multiplies it."
        yield from _inertia(link, inertia)


def _inertia(link: str, inertia: gripper_mounting.LinkInertia) -> Iterator[str]:
    yield f"  {_word(link)}:"
    yield f"    mass: {_n(inertia.mass)}"
    yield f"    at: {_list(inertia.com)}"
    yield f"    moments: {_list(inertia.moments)}"
    if any(inertia.products):
        yield f"    products: {_list(inertia.products)}"


def _gripper(draft: RobotDraft) -> Iterator[str]:
    g = draft.gripper
    yield f"# {g.tcp_comment}."
    yield "# z points out of the hand, the fingers move along y."
    yield f"tcp: {{link: {_word(draft.hand.palm)}, {_frame(g.tcp_in_palm)}}}"
    yield f"flange_joint: {_word(draft.flange_joint)}   # where the wrist sensor sits"
    if draft.flange_behind is not None:
        yield (
            f"flange_behind: {_word(draft.flange_behind)}   # the URDF has no such joint: it is inserted here"
        )
    yield ""
    yield "gripper:"
    if g.sliders is not None:
        yield f"  joints: [{_word(g.sliders[0])}, {_word(g.sliders[1])}]"
    else:
        yield "  linkage:"
        yield f"    drive: {_word(g.linkage.drive)}"
        yield f"    opened: {_n(g.linkage.opened)}"
        yield f"    closed: {_n(g.linkage.closed)}"
        yield "    followers:"
        for name, by in g.linkage.followers.items():
            yield f"      {_word(name)}: {_n(by)}"
        if g.linkage.offsets:
            yield "    offsets:"
            for name, offset in g.linkage.offsets.items():
                yield f"      {_word(name)}: {_n(offset)}"
    yield f"  links: [{_word(g.links[0])}, {_word(g.links[1])}]"
    if g.sliders is not None:
        yield f"  max_width: {_mm(g.max_width)}"
    else:
        least = f"from {1000 * g.min_width:.0f} " if g.min_width > 1e-3 else ""
        yield f"  # It opens {least}to {1000 * g.max_width:.0f} mm: computed from the pads."
    yield f"  max_force: {_n(round(g.max_force, 1))} N          # {g.force_comment}"
    yield f"  speed: {_mm(g.speed)}/s         # each finger, from the URDF"
    if g.sliders is not None:
        yield "  gear: -1"
    yield f"  tip: {_mm(g.tip)}"
    yield f"  palm: {_mm(g.palm)}"
    yield "  pads:                    # Measured on the meshes: the level faces that look at each other."
    for box, pose in g.pads:
        yield f"    - {_box(box, pose)}"
    if g.finger_bodies:
        yield "  finger_bodies:           # The rest of the fingers, behind the pads and beyond them."
        for box, pose in g.finger_bodies:
            yield f"    - {_box(box, pose)}"
    yield "  hand:                    # From the palm up."
    for box, pose in g.hand:
        yield f"    - {_box(box, pose)}"
    yield f"  finger: {_box(*g.finger)}"


def _pairs(found: SelfCollisionReport | None) -> Iterator[str]:
    if found is None:
        return
    yield ""
    yield f"# Self-collision, from {found.samples:,} configurations drawn evenly within the limits. Links"
    yield (
        f"# nearer than {1000 * COLLISION_DISTANCE:g} mm count as colliding. The number behind a pair "
        "counts the samples in which it collides."
    )
    yield "disabled_pairs:"
    if not found.disabled:
        yield "  []"
    for reason in REASONS:
        chosen = [pair for pair in found.disabled if pair.reason == reason]
        if not chosen:
            continue
        yield f"  # {_REASON_TEXTS[reason]}"
        for pair in chosen:
            count = f"   # {pair.collisions:,}" if pair.collisions else ""
            yield f"  - [{_word(pair.first)}, {_word(pair.second)}]{count}"
    yield ""
    yield f"# Checked, because they collide in some samples ({found.free:,} samples are free):"
    for first, second, count in found.checked:
        yield f"#   {first} and {second}: {count:,}"


def _box(box: Box, pose: Pose) -> str:
    size = ", ".join(_mm(max(s, 1e-4)) for s in box.size)
    return f"{{box: [{size}], {_frame(pose)}}}"


def _frame(pose: Pose, spread: str = "") -> str:
    """Return `at: …, rpy: …` without zero parts; on two lines when `spread` is an indent."""
    at = f"at: [{', '.join(_mm(c) for c in pose.position)}]"
    rpy = [0.0 if abs(a) < 1e-7 else a for a in pose.rpy()]
    if not any(rpy):
        return at
    turned = f"rpy: [{', '.join(_angle(a) for a in rpy)}]"
    return f"{at}\n{spread}{turned}" if spread else f"{at}, {turned}"


def _angle(rad: float) -> str:
    quarters = rad / (math.pi / 4)
    if abs(quarters - round(quarters)) < 1e-6:
        return "0" if round(quarters) == 0 else f"{45 * round(quarters)} deg"
    return _n(rad)


def _mm(metres: float) -> str:
    number = f"{1000 * metres:.2f}".rstrip("0").rstrip(".")
    return "0" if number in ("0", "-0") else f"{number} mm"


def _n(number: float) -> str:
    text = f"{number:.6g}"
    return "0" if text == "-0" else text


def _list(numbers: Sequence[float]) -> str:
    return f"[{', '.join(map(_n, numbers))}]"


def _word(text: str) -> str:
    """Return a string as YAML: plain where that is safe, else quoted."""
    plain = text.replace("_", "").replace(":", "").replace("/", "").replace(".", "").replace("-", "")
    safe = plain.isascii() and plain.isalnum() and text[0].isalpha() and ": " not in text
    keyword = text.lower() in ("true", "false", "null", "yes", "no", "on", "off", "y", "n")
    return text if safe and not keyword and not text.endswith(":") else json.dumps(text)


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
) -> gripper_mounting.GripperMount:
    """Find the mounting of a gripper. Raises UnsuitableUrdf without a gripper, or without such a link."""
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
    return gripper_mounting.GripperMount(
        gripper.urdf, first, carrier, _face(skeleton, arm, solids, carrier), joint, prefix
    )


def _mount_flange(skeleton: urdf_parser.UrdfTree, arm: ArmGroup) -> str:
    """Return the link with a flange's name that is fixed to the last link; else the last link."""
    fixed = [link for link in skeleton.below(arm.tip) if not _moves(skeleton, arm.tip, link)]
    for name in FLANGE_NAMES:
        for link in fixed:
            if link.lower().endswith(name):
                return link
    return arm.tip


def _moves(skeleton: urdf_parser.UrdfTree, above: str, link: str) -> bool:
    return any(skeleton.joints[name].type in MOVING for name in skeleton.joints_between(above, link) or ())


def _face(
    skeleton: urdf_parser.UrdfTree, arm: ArmGroup, solids: Mapping[str, LinkGeometry], carrier: str
) -> Pose:
    """Return the gripper's pose on the carrier: z out along the axis of the last joint, on the outer face."""
    last = skeleton.joints[arm.joints[-1]]
    moved = skeleton.pose(last.child, {})
    at = skeleton.pose(carrier, {})
    axis: Array = at.rotation().T @ moved.rotation() @ np.array(last.axis)
    origin = at.inverse().apply(np.array(moved.position))

    def middle(links: Iterable[str]) -> float | None:
        """Return the position of the middle of these links' points along the axis, m."""
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
    tree, solids = urdf_parser.read_skeleton(path), read_solids(path)
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
            "look at <collision> of the two links and at the joints between them, or at the height "
            "of the base",
        )
    draft = replace(draft, poses=poses)
    text = robot_file_text(draft)
    return Proposal(draft, text, _parsed(text, wish))


def _model(draft: RobotDraft, wish: ProposalRequest) -> RobotModel:
    return RobotModel(_parsed(robot_file_text(replace(draft, poses=(_middle(draft),))), wish))


def _borne(draft: RobotDraft, wish: ProposalRequest) -> RobotDraft:
    """Return the draft with guessed masses that the URDF's torques can carry."""
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
    groups = find_groups(wish.urdf, source.skeleton, wish.base, wish.tip)
    if wish.gripper is None:
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
    if groups.hand is not None and wish.mount is None:
        raise UnsuitableUrdf(
            wish.urdf,
            f"a gripper at the end of the arm already, on {groups.hand.palm!r}",
            "a place for another one",
            "leave --gripper out, or give the link for the second gripper by --mount LINK",
        )
    text, link = _gripper_named(wish.gripper)
    gripper = find_source(text)
    refuse_missing_meshes(text, gripper.urdf.path)
    mounting = find_mounting(source, groups.arm, read_solids(source.urdf.path), gripper, link, wish.mount)
    try:
        path = gripper_mounting.write_composed_urdf(source.urdf, mounting)
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
    mounting: gripper_mounting.GripperMount | None,
    gripper_urdf: str,
) -> RobotDraft:
    skeleton = urdf_parser.read_skeleton(path)
    behind: str | None = None
    if _fixed_joints(skeleton, arm, hand) == ():
        behind = arm.joints[-1]
        flange = gripper_mounting.InsertedFlange(behind, _free_name(skeleton))
        path = gripper_mounting.write_composed_urdf(source.urdf, mounting, flange=flange)
        skeleton = urdf_parser.read_skeleton(path)
    solids = read_solids(path)
    binary_gltf.link_meshes(str(path))  # raises for what is only seen, too
    flange_joint = _flange(wish.urdf, skeleton, arm, hand, solids)
    meter = GripperMeter(wish.urdf, skeleton, solids, hand, _behind(skeleton, flange_joint, hand))
    measured = meter.measure()
    findings = check_inertias(urdf_parser.parsed_urdf(path), skeleton, solids)
    inertias = {f.link: f.instead for f in findings if f.instead is not None}
    if measured.sliders is None:
        inertias |= rotor_inertias(urdf_parser.parsed_urdf(path), skeleton, meter.ratios, inertias)
    notes: list[str] = []
    if seen_only := urdf_parser.links_seen_only(str(path)):
        notes.append(f"without <collision>, using <visual> for collisions: {listed(seen_only, 6)}")
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


def _named(text: str, urdf: gripper_mounting.NamedUrdf, file: Path) -> str:
    """Return a URDF's name in the robot file: `package:path` as given, else a path relative to the file."""
    if urdf.package:
        return text
    return Path(os.path.relpath(urdf.path.resolve(), file.resolve().parent)).as_posix()


def _flange(
    source: str,
    skeleton: urdf_parser.UrdfTree,
    arm: ArmGroup,
    hand: HandGroup,
    solids: Mapping[str, LinkGeometry],
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


def _fixed_joints(skeleton: urdf_parser.UrdfTree, arm: ArmGroup, hand: HandGroup) -> tuple[str, ...] | None:
    """Return the fixed joints between arm and palm; None when the arm's last joint does not move the palm."""
    names = skeleton.joints_to(hand.palm)
    if arm.joints[-1] not in names:
        return None
    behind = names[names.index(arm.joints[-1]) + 1 :]
    return tuple(name for name in behind if skeleton.joints[name].type == "fixed")


def _free_name(skeleton: urdf_parser.UrdfTree) -> str:
    """Return a name for an inserted flange that no link and no joint has."""
    taken = {*skeleton.links, *skeleton.joints}
    names = ("flange", *(f"flange_{n}" for n in range(2, len(taken) + 3)))
    return next(name for name in names if not {name, f"{name}_link"} & taken)


def _behind(skeleton: urdf_parser.UrdfTree, flange: str, hand: HandGroup) -> tuple[str, ...]:
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
        messages = "; ".join(fault.message for fault in error.faults[:3])
        raise UnsuitableUrdf(
            wish.urdf,
            f"an arm and a gripper, but the robot file made of them is refused: {messages}",
            "a URDF that the checker takes",
            "mend these faults in a copy of the URDF",
        ) from None
