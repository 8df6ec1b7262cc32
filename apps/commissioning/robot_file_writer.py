"""Writer of robot files: a draft as YAML, with comments on the origin of the values."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from ...world.robot_model.gripper_mounting import GripperMount, LinkInertia
from ...world.shapes import Box
from ...world.values import Pose
from .arm_poses import NamedPose
from .base_pose import BaseProposal
from .gripper_measurement import MeasuredGripper
from .inertias import InertiaFinding
from .joint_groups import ArmGroup, HandGroup
from .joint_limits import ACCELERATION_TORQUE_SHARE, ProposedLimits
from .self_collision import ALWAYS_COLLIDING_SHARE, COLLISION_DISTANCE, REASONS, SelfCollisionReport


@dataclass(frozen=True, slots=True)
class RobotDraft:
    """Complete content of a robot file, before it is written."""

    name: str
    urdf: str
    """URDF as the robot file names it."""
    arm: ArmGroup
    hand: HandGroup
    mounting: GripperMount | None
    gripper_urdf: str
    limits: tuple[ProposedLimits, ...]
    gripper: MeasuredGripper
    flange_joint: str
    flange_behind: str | None
    """The arm's last joint, where the flange joint is put into the URDF; None: the URDF has it."""
    findings: tuple[InertiaFinding, ...]
    inertias: Mapping[str, LinkInertia]
    poses: tuple[NamedPose, ...] = ()
    collision: SelfCollisionReport | None = None
    notes: tuple[str, ...] = ()
    base: BaseProposal | None = None
    """Base from which the tool reaches more; None: it stands at the origin."""


_REASON_TEXTS = {
    "adjacent": "Adjacent: one joint between them, or none of the arm's; they may touch.",
    "default": "Default: two joints between them, and they touch with all joints in mid-range.",
    "always": f"Always in collision: in more than {100 * ALWAYS_COLLIDING_SHARE:.0f} % of the samples.",
    "never": "Never in collision in any sample.",
    "hulls": "Only their hulls collide, which are without the links' hollows; their meshes never do.",
}


def robot_file_text(draft: RobotDraft) -> str:
    """Return the text of the file."""
    return "\n".join(_lines(draft)) + "\n"


def _lines(draft: RobotDraft) -> Iterator[str]:
    arm, hand = draft.arm, draft.hand
    yield "picktree: 1"
    yield "kind: robot"
    yield ""
    yield '# Proposed by `picktree robot new`: look through it, above all at what says "see the data sheet".'
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
    yield "# Where the foot stands in the world; scenes have the table at z = 0."
    if draft.base is not None:
        yield f"# It is a proposal: {draft.base.sentence}."
    yield f"base: {{at: {_list((0.0, 0.0, 0.0) if draft.base is None else draft.base.at)}}}"
    yield ""
    yield "# Accelerations are estimated: at most what the torque left by gravity, times"
    yield (
        f"# {ACCELERATION_TORQUE_SHARE:g}, gives the largest inertia that the joint sees. See the data sheet."
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
    told = {finding.link: finding for finding in draft.findings}
    for finding in draft.findings:
        if finding.instead is None:
            yield f"# Look at {finding.link}: {finding.sentence}."
    if not draft.inertias:
        return
    yield ""
    yield "# Instead of what the URDF says of these links:"
    yield "inertias:"
    for link, inertia in draft.inertias.items():
        if link in told and told[link].instead is not None:
            yield f"  # {link}: {told[link].sentence}."
        else:
            yield f"  # {link}: heavier to turn, by what the motor's rotor adds through its gear."
        yield from _inertia(link, inertia)


def _inertia(link: str, inertia: LinkInertia) -> Iterator[str]:
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
        yield f"flange_behind: {_word(draft.flange_behind)}   # the URDF has no such joint: it is put in here"
    yield ""
    yield "gripper:"
    if g.sliders is not None:
        yield f"  joints: [{_word(g.sliders[0])}, {_word(g.sliders[1])}]"
    else:
        yield "  linkage:"
        yield f"    drive: {_word(g.drive)}"
        yield f"    opened: {_n(g.opened)}"
        yield f"    closed: {_n(g.closed)}"
        yield "    followers:"
        for name, by in g.followers.items():
            yield f"      {_word(name)}: {_n(by)}"
        if g.offsets:
            yield "    offsets:"
            for name, offset in g.offsets.items():
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
        f"# nearer than {1000 * COLLISION_DISTANCE:g} mm count as colliding; behind a pair, in how "
        "many samples."
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
