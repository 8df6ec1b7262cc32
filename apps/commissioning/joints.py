"""Joints of a URDF: planning groups of the arm and the fingers, as MoveIt calls them, and proposals for
limits and torques.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from picktree.files import suggest_name
from picktree.world import Array
from picktree.world.robot_model import MOVING, JointLimits, RobotModel, urdf_parser

from .link_geometry import UnsuitableUrdf

MIN_ARM_JOINTS = 5
"""Least number of joints of an arm that puts its tool upright at any place and turns it."""
MIN_LIMB_JOINTS = 3
"""Least number of joints of a chain that is reported as a limb."""
_JAW = re.compile(r"jaw|gripper|finger|claw", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class HandGroup:
    """Joints that move fingers, all mounted on `palm`."""

    palm: str
    drives: tuple[str, ...]
    """Joints that do not mimic another one."""
    followers: tuple[str, ...]
    """Joints that mimic one of `drives`."""

    @property
    def joints(self) -> tuple[str, ...]:
        return (*self.drives, *self.followers)


@dataclass(frozen=True, slots=True)
class ArmGroup:
    """Joints of an arm from the base on, and the link that the last one moves."""

    joints: tuple[str, ...]
    base: str
    tip: str


@dataclass(frozen=True, slots=True)
class PlanningGroups:
    """Arm, and the hand at its end; None: there is no hand."""

    arm: ArmGroup
    hand: HandGroup | None


def find_groups(
    source: str, skeleton: urdf_parser.UrdfTree, base: str | None = None, tip: str | None = None
) -> PlanningGroups:
    """Find the arm and its hand.

    `base`, `tip`: links between which the arm is, instead of a search. Raises UnsuitableUrdf when there is no
    arm, when there are several, or when the arm is unsuitable.
    """
    for name in (base, tip):
        require_link(
            source, skeleton, name, f"a link {name!r}", "take --base and --tip from the names of its links"
        )
    for name, joint in skeleton.joints.items():
        if joint.type in ("floating", "planar"):
            raise UnsuitableUrdf(
                source,
                f"the joint {name!r} is {joint.type}: the robot drives, flies or walks",
                "an arm on a base that does not move",
                f'make that joint type="fixed" in a copy of the URDF, if {joint.child!r} does not move',
            )
    hands = tuple(_hands(skeleton))
    if tip is None and len(hands) == 0:
        arm = _only_chain(source, skeleton, base)
    else:
        arm = _arm_to(source, skeleton, base, tip, hands)
    hand = next((h for h in hands if _carries(skeleton, arm.tip, h.palm)), None)
    _refuse_mimics(source, skeleton, arm)
    _refuse_unfit(source, skeleton, arm, jaw_allowed=tip is not None or hand is not None)
    return PlanningGroups(arm, hand)


def find_hand(source: str, skeleton: urdf_parser.UrdfTree, link: str | None) -> tuple[HandGroup, str]:
    """Return the hand of a gripper's URDF, and its first link. Raises UnsuitableUrdf without such a hand."""
    helps = "name the gripper's first link behind the colon of --gripper"
    require_link(source, skeleton, link, f"a link {link!r}", helps)
    hands = [h for h in _hands(skeleton) if link is None or _carries(skeleton, link, h.palm)]
    if len(hands) != 1:
        many = ", ".join(h.palm for h in hands)
        raise UnsuitableUrdf(
            source,
            f"{len(hands)} grippers: on {many}" if hands else "no two fingers that move against each other",
            "one gripper with two fingers",
            "name its first link: --gripper URDF:LINK" if hands else "another URDF for --gripper",
        )
    return hands[0], link or hands[0].palm


def require_link(
    source: str, skeleton: urdf_parser.UrdfTree, name: str | None, missing: str, helps: str
) -> None:
    """Raise UnsuitableUrdf when the URDF lacks the link `name`; None asks for none."""
    if name is not None and name not in skeleton.links:
        hint = suggest_name(name, skeleton.links)
        missing += f" ({hint})" if hint else ""
        raise UnsuitableUrdf(source, f"{len(skeleton.links)} links", missing, helps)


def _hands(skeleton: urdf_parser.UrdfTree) -> Iterator[HandGroup]:
    """Return every set of finger joints: leaves of the tree that mimic each other, or two that move alike."""
    found: list[set[str]] = []
    for name, joint in skeleton.joints.items():
        if joint.mimic is not None and joint.type in MOVING:
            group = next((g for g in found if {name, joint.mimic.joint} & g), None)
            if group is None:
                group = set[str]()
                found.append(group)
            group |= {name, joint.mimic.joint}
    taken: set[str] = {name for group in found for name in group}
    leaves = [name for name in skeleton.joints if name not in taken and _is_finger(skeleton, name)]
    by_palm: dict[str, list[str]] = {}
    for name in leaves:
        by_palm.setdefault(_mount(skeleton, name), []).append(name)
    found += [
        set(names)
        for names in by_palm.values()
        if len(names) == 2 and len({skeleton.joints[name].type for name in names}) == 1
    ]
    together: dict[str, set[str]] = {}
    for group in found:
        if known := [name for name in skeleton.joints if name in group]:
            together.setdefault(_common(skeleton, known), set()).update(known)
    for group in together.values():
        known = [name for name in skeleton.joints if name in group and skeleton.joints[name].type in MOVING]
        drives = tuple(n for n in known if skeleton.joints[n].mimic is None)
        if drives:
            yield HandGroup(_common(skeleton, known), drives, tuple(n for n in known if n not in drives))


def _is_finger(skeleton: urdf_parser.UrdfTree, name: str) -> bool:
    """Whether a joint moves a leaf of the tree, and slides or is mounted on a moved link."""
    joint = skeleton.joints[name]
    if joint.type not in ("prismatic", "revolute"):
        return False
    beyond = skeleton.below(joint.child)
    if any(j.parent in beyond and j.type in MOVING for j in skeleton.joints.values()):
        return False
    carried = any(skeleton.joints[above].type in MOVING for above in skeleton.above(name))
    return carried or joint.type == "prismatic"


def _mount(skeleton: urdf_parser.UrdfTree, name: str) -> str:
    """Return the link that carries a joint, with fixed joints in between skipped."""
    link = skeleton.joints[name].parent
    while True:
        holder = next((j for j in skeleton.joints.values() if j.child == link), None)
        if holder is None or holder.type in MOVING:
            return link
        link = holder.parent


def _common(skeleton: urdf_parser.UrdfTree, joints: list[str]) -> str:
    """Return the last link that carries all of these joints."""
    chains = [[skeleton.joints[j].parent for j in (*skeleton.above(name), name)] for name in joints]
    return [link for link in chains[0] if all(link in chain for chain in chains[1:])][-1]


def _carries(skeleton: urdf_parser.UrdfTree, link: str, other: str) -> bool:
    """Return whether `other` is `link` or is mounted on it by fixed joints alone."""
    between = skeleton.joints_between(link, other)
    return between is not None and all(skeleton.joints[name].type not in MOVING for name in between)


def _moving_to(skeleton: urdf_parser.UrdfTree, link: str, base: str | None) -> tuple[str, ...]:
    names = skeleton.joints_to(link) if base is None else skeleton.joints_between(base, link) or ()
    return tuple(
        name for name in names if skeleton.joints[name].type in MOVING and skeleton.joints[name].mimic is None
    )


def _arm_to(
    source: str,
    skeleton: urdf_parser.UrdfTree,
    base: str | None,
    tip: str | None,
    hands: tuple[HandGroup, ...],
) -> ArmGroup:
    if tip is not None:
        joints = _moving_to(skeleton, tip, base)
        palm = next((h.palm for h in hands if _carries(skeleton, tip, h.palm)), tip)
        return _arm_group(source, skeleton, joints, base, palm)
    fitting = [(h, _moving_to(skeleton, h.palm, base)) for h in hands]
    long = [(h, joints) for h, joints in fitting if len(joints) >= MIN_LIMB_JOINTS]
    if len(long) > 1:
        listed = "; ".join(f"{len(joints)} joints to {h.palm}" for h, joints in long)
        raise UnsuitableUrdf(
            source,
            f"{len(long)} arms with a gripper: {listed}",
            "the choice of one arm",
            "choose by " + " or ".join(f"--tip {h.palm}" for h, _ in long),
        )
    hand, joints = long[0] if long else max(fitting, key=lambda pair: len(pair[1]))
    if not joints:
        raise UnsuitableUrdf(
            source,
            f"a gripper alone: {_listed(hand.joints)} on {hand.palm}",
            "an arm that carries it",
            f"take the arm's URDF, and this one by --gripper {source}:{hand.palm}",
        )
    return _arm_group(source, skeleton, joints, base, hand.palm)


def _only_chain(source: str, skeleton: urdf_parser.UrdfTree, base: str | None) -> ArmGroup:
    """Return the longest chain of joints as the arm. Raises UnsuitableUrdf when others are as long."""
    parents = {joint.parent for joint in skeleton.joints.values()}
    leaves = [link for link in skeleton.links if link not in parents]
    chains = {_moving_to(skeleton, leaf, base): leaf for leaf in reversed(leaves)}
    listed = sorted(chains, key=lambda names: -len(names))
    longest = listed[0] if listed else ()
    if len(longest) == 0:
        raise UnsuitableUrdf(
            source, f"{len(skeleton.links)} links and no joint that moves", "an arm", "another URDF"
        )
    if len(longest) < MIN_LIMB_JOINTS and len([chain for chain in listed if chain]) > 1:
        raise UnsuitableUrdf(
            source,
            f"chains of {_joints(len(longest))} at most: {_listed(tuple(c[0] for c in listed if c))}",
            "an arm; this may be a gripper alone, a vehicle or a toy",
            f"if it is a gripper: take the URDF of an arm, and this one by --gripper {source}:LINK",
        )
    limbs = [chain for chain in listed if len(chain) >= max(MIN_LIMB_JOINTS, len(longest) - 1)]
    apart = [chain for chain in limbs if not set(chain[: len(chain) - 1]) <= set(longest)]
    if apart:
        ends = [skeleton.joints[chain[-1]].child for chain in limbs]
        chains_text = ", ".join(
            f"{len(chain)} joints to {end}" for chain, end in zip(limbs, ends, strict=True)
        )
        what = "legs, or arms without grippers" if len(longest) < MIN_ARM_JOINTS else "arms or legs"
        raise UnsuitableUrdf(
            source,
            f"{len(limbs)} limbs of about the same length ({what}): {chains_text}",
            "one arm with a gripper",
            "--base LINK --tip LINK choose one of them, --gripper URDF:LINK --mount LINK gives it a gripper"
            if len(longest) >= MIN_ARM_JOINTS
            else "take another URDF: an arm for grasping has six or seven joints",
        )
    return _arm_group(source, skeleton, longest, base, skeleton.joints[longest[-1]].child)


def _arm_group(
    source: str, skeleton: urdf_parser.UrdfTree, joints: tuple[str, ...], base: str | None, tip: str
) -> ArmGroup:
    if not joints:
        raise UnsuitableUrdf(
            source,
            f"no joint that moves between {base or 'the root'} and {tip}",
            "an arm",
            "--base and --tip name links at its two ends, the base first",
        )
    return ArmGroup(joints, base or skeleton.joints[joints[0]].parent, tip)


def _refuse_mimics(source: str, skeleton: urdf_parser.UrdfTree, arm: ArmGroup) -> None:
    """Raise UnsuitableUrdf when a joint between the links of the arm follows another one."""
    inside = skeleton.joints_between(arm.base, arm.tip) or arm.joints
    mimics = [(name, mimic) for name in inside if (mimic := skeleton.joints[name].mimic) is not None]
    if sentences := [f"{name} mimics {mimic.joint}" for name, mimic in mimics]:
        raise UnsuitableUrdf(
            source,
            f"an arm of {len(arm.joints)} joints that move on their own, and in it "
            f"{_listed(tuple(sentences))}",
            "an arm without <mimic>: each of its joints has a motor of its own",
            f"remove <mimic> from {mimics[0][0]} if a motor turns it; picktree cannot plan for a "
            "parallelogram",
        )


def _refuse_unfit(source: str, skeleton: urdf_parser.UrdfTree, arm: ArmGroup, *, jaw_allowed: bool) -> None:
    sliding = [name for name in arm.joints if skeleton.joints[name].type == "prismatic"]
    turning = [name for name in arm.joints if name not in sliding]
    if sliding and len(turning) >= MIN_ARM_JOINTS:
        behind = skeleton.joints[sliding[-1]].child
        raise UnsuitableUrdf(
            source,
            f"an arm of {len(turning)} hinges behind the sliding joint {_listed(tuple(sliding))}",
            "an arm whose joints all turn",
            f"--base {behind} keeps the joints before {behind} fixed",
        )
    if len(turning) < MIN_ARM_JOINTS:
        slid = f" and {len(sliding)} that slide" if sliding else ""
        raise UnsuitableUrdf(
            source,
            f"a chain of {_joints(len(turning))} that turn{slid}: {_listed(arm.joints)}",
            f"an arm that puts its tool anywhere, upright and turned: {MIN_ARM_JOINTS} joints at least, "
            "better 6",
            "take another URDF; picktree cannot plan for a SCARA or a pendulum",
        )
    last = skeleton.joints[arm.joints[-1]]
    if not jaw_allowed and _JAW.search(f"{arm.joints[-1]} {last.child}"):
        raise UnsuitableUrdf(
            source,
            f"an arm of {len(arm.joints) - 1} joints; joint {arm.joints[-1]!r} moves one jaw "
            "against a fixed jaw",
            "a gripper with two fingers that both move",
            f"--tip {last.parent} --gripper URDF:LINK --mount {last.parent} gives the arm another gripper",
        )
    endless = [name for name in arm.joints if skeleton.joints[name].type == "continuous"]
    if len(endless) == len(arm.joints):
        raise UnsuitableUrdf(
            source,
            f"{len(endless)} joints that all turn without end: {_listed(arm.joints)}",
            "joints with limits: this looks like wheels or a toy",
            'give the arm\'s joints type="revolute" and <limit lower=… upper=… effort=… velocity=…/>',
        )
    bounded = {name: joint for name in arm.joints if (joint := skeleton.joints[name]).type != "continuous"}
    unlimited = [
        name
        for name, joint in bounded.items()
        if not joint.limited or joint.lower is None or joint.upper is None or joint.lower >= joint.upper
    ]
    if unlimited:
        raise UnsuitableUrdf(
            source,
            f"an arm of {len(arm.joints)} joints",
            f"limits of {_listed(tuple(unlimited))}",
            'write <limit lower="-3" upper="3" effort="50" velocity="2"/> inside of each such <joint>',
        )


def _joints(count: int) -> str:
    return f"{count} joint" if count == 1 else f"{count} joints"


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(names) if len(names) <= 8 else ", ".join(names[:7]) + f" and {len(names) - 7} more"


LIMIT_RESERVE = math.radians(2.0)
"""Distance kept from limits where the URDF has no soft limits, rad; never more than RESERVE_SHARE."""
RESERVE_SHARE = 0.01
"""Greatest distance kept from a joint's limits, as a share of its range."""
CONTINUOUS_RANGE = 2 * math.pi
"""Range to either side of a joint without limits, rad: cables do not turn without end."""
MAX_VELOCITY = math.pi
"""Greatest plausible velocity, rad/s; a higher one of the URDF is replaced."""
MIN_VELOCITY = 0.01
"""Least plausible velocity, rad/s; a lower one of the URDF is replaced."""
DEFAULT_VELOCITY = 1.0
"""Velocity of a joint for which the URDF gives none, rad/s."""
ACCELERATION_TORQUE_SHARE = 0.5
"""Share of the torque left by gravity with which an acceleration is estimated."""
MIN_SPEED_UP_TIME = 0.3
"""Least time in which a joint reaches its velocity, s: it bounds the estimated acceleration."""
MIN_ACCELERATION = 0.5
"""Least acceleration that is proposed for a joint, rad/s²."""
CONFIGURATION_COUNT = 300
GRAVITY_RESERVE = 1.5
"""Guessed torque of a joint for gravity, as a multiple of the maximum gravity torque."""
MIN_TORQUE_GUESS = 1.0
"""Part of a guessed torque for friction and other loads beyond inertias, Nm."""
MIN_MASS_SHARE, MASS_SHARE_STEP = 0.3, 0.05
"""Least share of guessed masses, and step of the shares that are tried."""
PLACEHOLDER_TORQUE = 1.0
"""Placeholder torque of many URDFs, Nm; 0 is another one."""
MAX_TORQUE, MAX_TORQUE_RATIO = 1000.0, 20.0
"""Torque, Nm, and ratio to the guess, from which on both a URDF's torque counts as wrong."""


@dataclass(frozen=True, slots=True)
class ProposedLimits(JointLimits):
    """Proposed limits of one joint; `comment` gives the origin of the values."""

    name: str
    comment: str
    guess: str = ""
    """Sentence on why the torque is a guess; empty: it is the URDF's."""


def propose_limits(skeleton: urdf_parser.UrdfTree, joints: tuple[str, ...]) -> tuple[ProposedLimits, ...]:
    """Propose limits from the URDF alone; accelerations and missing torques are estimated later."""
    return tuple(_proposed(name, skeleton.joints[name]) for name in joints)


def _proposed(name: str, joint: urdf_parser.UrdfJoint) -> ProposedLimits:
    comments: list[str] = []
    if joint.soft_lower is not None and joint.soft_upper is not None and joint.soft_lower < joint.soft_upper:
        lower, upper = joint.soft_lower, joint.soft_upper
        comments.append("soft limits of the URDF")
    elif joint.type == "continuous" or joint.lower is None or joint.upper is None:
        lower, upper = -CONTINUOUS_RANGE, CONTINUOUS_RANGE
        comments.append("continuous joint: limited to one turn to either side, to spare the cables")
    else:
        reserve = min(LIMIT_RESERVE, RESERVE_SHARE * (joint.upper - joint.lower))
        lower, upper = joint.lower + reserve, joint.upper - reserve
        comments.append(f"the URDF's limits, each moved inwards by {math.degrees(reserve):.1f} deg")
    if lower < -CONTINUOUS_RANGE or upper > CONTINUOUS_RANGE:
        lower, upper = max(lower, -CONTINUOUS_RANGE), min(upper, CONTINUOUS_RANGE)
        comments.append("at most one turn to either side")
    velocity = joint.velocity or 0.0
    if velocity <= 0.0:
        velocity = DEFAULT_VELOCITY
        comments.append("the URDF gives no velocity: a low one is assumed")
    elif velocity < MIN_VELOCITY:
        comments.append(f"the URDF's {velocity:g} rad/s are implausible: a low velocity is assumed")
        velocity = DEFAULT_VELOCITY
    elif velocity > MAX_VELOCITY:
        comments.append(f"the URDF's {velocity:g} rad/s are implausible")
        velocity = MAX_VELOCITY
    torque = joint.effort or 0.0
    return ProposedLimits(
        round(lower, 5), round(upper, 5), velocity, MIN_ACCELERATION, torque, name, "; ".join(comments)
    )


@dataclass(frozen=True, slots=True)
class JointLoads:
    """Largest loads (n,) of the arm's joints in random configurations: gravity, Nm, and inertia, kg·m²."""

    gravity: Array
    inertia: Array

    @classmethod
    def of(cls, model: RobotModel, seed: int = 0) -> JointLoads:
        generator = np.random.default_rng([seed, 3])
        gravity: Array = np.zeros(model.n)
        inertia: Array = np.full(model.n, 1e-6)
        for _ in range(CONFIGURATION_COUNT):
            q = generator.uniform(model.lower, model.upper)
            gravity = np.maximum(gravity, np.abs(model.gravity(q)))
            inertia = np.maximum(inertia, np.diag(model.mass_matrix(q)))
        return cls(gravity, inertia)

    def torques(self, velocity: Array) -> Array:
        """Return torques (n,) that carry the arm and move it, Nm, for joints of these velocities, rad/s.

        They include the torque that accelerates each joint to its velocity in MIN_SPEED_UP_TIME.
        """
        moving = self.inertia * velocity / MIN_SPEED_UP_TIME / ACCELERATION_TORQUE_SHARE
        return GRAVITY_RESERVE * self.gravity + moving + MIN_TORQUE_GUESS


def is_placeholder(effort: float, gravity: float, guess: float) -> bool:
    """Whether the URDF's effort of a joint, Nm, cannot be its motor's.

    It is 0 or 1, less than 1 and less than the gravity torque, or far beyond the torque that the arm needs.
    """
    if effort <= PLACEHOLDER_TORQUE:
        return effort <= 0.0 or effort == PLACEHOLDER_TORQUE or effort < gravity
    return effort >= max(MAX_TORQUE, MAX_TORQUE_RATIO * guess)


def borne_share(
    whole: RobotModel, half: RobotModel, given: tuple[ProposedLimits, ...], seed: int = 0
) -> float:
    """Return the share of the guessed masses that the URDF's torques carry with GRAVITY_RESERVE, 0 … 1.

    1 also when no share of at least MIN_MASS_SHARE is carried. `half`: the model with half of the guesses.
    """
    loads = JointLoads.of(whole, seed)
    guesses = loads.torques(np.array([limit.velocity for limit in given]))
    most: Array = np.array(
        [
            np.inf if is_placeholder(limit.torque, weight, guess) else limit.torque / GRAVITY_RESERVE
            for limit, weight, guess in zip(given, loads.gravity.tolist(), guesses.tolist(), strict=True)
        ]
    )
    generator = np.random.default_rng([seed, 3])
    drawn = [generator.uniform(whole.lower, whole.upper) for _ in range(CONFIGURATION_COUNT)]
    total: Array = np.array([whole.gravity(q) for q in drawn])
    guessed = 2.0 * (total - np.array([half.gravity(q) for q in drawn]))
    for share in np.arange(1.0, MIN_MASS_SHARE - 1e-9, -MASS_SHARE_STEP).tolist():
        if (np.abs(total - (1.0 - share) * guessed) <= most).all():
            return round(share, 2)
    return 1.0


def estimate(
    model: RobotModel, given: tuple[ProposedLimits, ...], seed: int = 0
) -> tuple[ProposedLimits, ...]:
    """Estimate accelerations, and torques where the URDF gives none that can be right.

    An acceleration takes half of the torque that gravity leaves, over the largest inertia that the joint
    sees. No joint reaches its velocity in less than MIN_SPEED_UP_TIME.
    """
    loads = JointLoads.of(model, seed)
    guesses = loads.torques(np.array([limit.velocity for limit in given]))
    found: list[ProposedLimits] = []
    for limit, weight, seen, guess in zip(
        given, loads.gravity.tolist(), loads.inertia.tolist(), guesses.tolist(), strict=True
    ):
        torque, comment, why = limit.torque, limit.comment, ""
        if is_placeholder(torque, weight, guess):
            torque = float(f"{guess:.2g}")
            why = (
                f"{torque:g} Nm are a guess from gravity and inertia, because the URDF's effort of "
                f"{limit.torque:g} Nm is implausible: see the data sheet"
            )
            comment += f"; torque: {why}"
        elif torque <= weight:
            comment += f"; gravity alone needs {weight:.1f} Nm"
        acceleration = min(
            ACCELERATION_TORQUE_SHARE * max(torque - weight, 0.0) / seen, limit.velocity / MIN_SPEED_UP_TIME
        )
        acceleration = float(f"{max(acceleration, MIN_ACCELERATION):.2g}")
        found.append(replace(limit, torque=torque, acceleration=acceleration, comment=comment, guess=why))
    return tuple(found)
