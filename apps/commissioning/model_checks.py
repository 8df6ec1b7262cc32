"""Checks of a robot file against its URDF, without a simulation: masses, limits, home, fingers, tool."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from picktree.robot.planning import CollisionChecker
from picktree.world import Array, PlanningScene, Pose, Vector3, corners
from picktree.world.robot_model import LinkageFingers, RobotDescription, RobotModel, urdf_parser

from .inertias import check_inertias
from .joints import JointLoads, is_placeholder
from .link_geometry import LinkGeometry, read_solids

MIN_RANGE = np.radians(20.0)
"""Least range of a joint of an arm, rad; less is a mistake in the limits."""
LIMIT_TOLERANCE = 1e-3
"""Distance by which a limit may exceed the URDF's, rad."""
SHARE_TOLERANCE = 0.1
"""Share by which a speed or a torque may exceed the URDF's: data sheets and URDFs round."""
CONFIGURATION_COUNT = 200
"""Number of random configurations in which gravity is compared with the torques."""
MAX_PAD_OFFSET = 0.004
"""Greatest distance of the middle between the pads from the TCP, across the fingers, m."""
MAX_OPENING_ERROR = 0.002
"""Greatest difference between the gap of the pads and the opening, m."""
MAX_FINGER_OVERLAP = 0.01
"""Greatest motion of sliding fingers beyond the contact of the pads that the URDF may allow, m."""
MAX_LINKAGE_OVERLAP_SHARE = 0.5
"""Greatest such motion of a linkage, as a share of its opening: ranges of motors often extend further."""
MAX_SHARE_BESIDE_HAND = 0.05
"""Greatest share of the last two links' points that are further out than the palm."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Verdict of one line of a self-test."""

    name: str
    good: bool
    measured: str
    """Measured values, with units."""
    change: str = ""
    """Sentence on the necessary change and its file; empty when the verdict is good."""


@dataclass(frozen=True, slots=True)
class RobotUnderTest:
    """Robot under test: description, model, links and their geometry, and its file as messages name it."""

    description: RobotDescription
    model: RobotModel
    skeleton: urdf_parser.UrdfTree
    solids: dict[str, LinkGeometry]
    file: str

    @classmethod
    def of(cls, robot: RobotDescription) -> RobotUnderTest:
        """Read a robot's URDF. Raises PicktreeError when its geometry cannot be used."""
        path = Path(robot.urdf)
        file = Path(robot.source).name
        return cls(robot, RobotModel(robot), urdf_parser.read_skeleton(path), dict(read_solids(path)), file)


def check_model(tested: RobotUnderTest) -> tuple[Verdict, ...]:
    """Return the verdict of each check; a fault may explain the faults after it."""
    return tuple(check(tested) for check in CHECKS)


def _masses(tested: RobotUnderTest) -> Verdict:
    urdf = urdf_parser.parsed_urdf(Path(tested.description.urdf))
    findings = check_inertias(urdf, tested.skeleton, tested.solids)
    wrong = [f for f in findings if f.kind != "implausible"]
    if wrong:
        measured = "; ".join(f"{f.link} {f.sentence.partition(':')[0]}" for f in wrong)
        names = ", ".join(f.link for f in wrong)
        change = (
            f"give {names} a correct <inertial> in the URDF, or an entry under 'inertias:' in {tested.file}"
        )
        return Verdict("masses", False, measured, change)
    total = sum(inertia.mass for inertia in tested.model.full.inertias)
    measured = f"{total:.1f} kg move; the hand is {tested.model.hand_mass:.2f} kg of that"
    if findings:
        measured += f"; large for the size of the link: the inertias of {', '.join(f.link for f in findings)}"
    return Verdict("masses", True, measured)


def _limits(tested: RobotUnderTest) -> Verdict:
    faults = [*_beyond_urdf(tested), *_too_weak(tested)]
    if faults:
        change = f"compare 'joints:' in {tested.file} and <limit> in the URDF with the data sheet"
        return Verdict("limits", False, "; ".join(faults), change)
    share = (_gravity(tested.model) / tested.model.torque_limit).max()
    return Verdict(
        "limits",
        True,
        f"within the URDF's limits; gravity takes at most {100 * share:.0f} % of a joint's torque",
    )


def _beyond_urdf(tested: RobotUnderTest) -> Iterator[str]:
    robot, loads = tested.description, JointLoads.of(tested.model)
    guesses = loads.torques(tested.model.velocity_limit).tolist()
    for name, limit, weight, guess in zip(
        robot.joints, robot.limits, loads.gravity.tolist(), guesses, strict=True
    ):
        joint = tested.skeleton.joints[name]
        if limit.upper - limit.lower < MIN_RANGE:
            yield f"{name} turns {np.degrees(limit.upper - limit.lower):.1f} deg in all"
        if joint.type != "continuous" and joint.lower is not None and joint.upper is not None:
            if joint.lower >= joint.upper:
                yield f"{name}: the URDF's limits, {joint.lower:g} … {joint.upper:g} rad, leave no range"
            elif limit.lower < joint.lower - LIMIT_TOLERANCE or limit.upper > joint.upper + LIMIT_TOLERANCE:
                yield (
                    f"{name} turns from {limit.lower:g} to {limit.upper:g} rad, beyond the URDF's "
                    f"{joint.lower:g} … {joint.upper:g} rad"
                )
        effort = None if is_placeholder(joint.effort or 0.0, weight, guess) else joint.effort
        for what, mine, theirs, unit in (
            ("moves at", limit.velocity, joint.velocity, "rad/s"),
            ("exerts", limit.torque, effort, "Nm"),
        ):
            if theirs is not None and 0.0 < theirs * (1 + SHARE_TOLERANCE) < mine:
                yield f"{name} {what} {mine:g} {unit}, beyond the URDF's {theirs:g} {unit}"


def _too_weak(tested: RobotUnderTest) -> Iterator[str]:
    model = tested.model
    for name, weight, most in zip(
        tested.description.joints, _gravity(model).tolist(), model.torque_limit.tolist(), strict=True
    ):
        if weight > most:
            yield f"{name} exerts {most:g} Nm, and gravity alone needs {weight:.1f} Nm"


def _gravity(model: RobotModel) -> Array:
    """Return the greatest torque (n,) that gravity needs in random configurations and the named ones, Nm."""
    generator = np.random.default_rng(0)
    drawn = [generator.uniform(model.lower, model.upper) for _ in range(CONFIGURATION_COUNT)]
    named = [np.array(q) for q in model.description.named.values()]
    return np.max([np.abs(model.gravity(q)) for q in (*drawn, *named)], axis=0)


def _home(tested: RobotUnderTest) -> Verdict:
    home, checker = tested.model.named("home"), CollisionChecker(tested.model)
    for width, fingers in ((tested.description.gripper.max_width, "open"), (0.0, "shut")):
        checker.update(PlanningScene((), ()), width)
        touching = checker.contacts(home)
        if touching:
            measured = "; ".join(f"{c.a} and {c.b} are {_depth(c.distance)}" for c in touching[:3])
            change = f"choose another 'home' under 'poses:' in {tested.file}"
            change += "; `picktree robot new` proposes one"
            return Verdict("home", False, f"{measured} at home, with {fingers} fingers", change)
    nearest = checker.nearest(home, 0.3, itself=True)
    gap = "further than 300 mm" if nearest is None else f"{1000 * nearest.distance:.0f} mm"
    gap += " apart" if nearest is None else " apart or more"
    return Verdict("home", True, f"the checked links are {gap}")


def _depth(distance: float) -> str:
    return (
        f"{-1000 * distance:.1f} mm in each other"
        if distance < 0.0
        else f"only {1000 * distance:.1f} mm apart"
    )


def _pads(tested: RobotUnderTest, width: float) -> tuple[Array, Array]:
    """Return the corners (8, 3) of the two pads in the TCP frame at that opening, m."""
    model, gripper = tested.model, tested.description.gripper
    home = model.named("home")
    poses, to_tcp = model.link_poses(home, width), model.tcp(home).inverse()
    one, other = (
        (to_tcp @ poses[link] @ pose).apply(corners(box))
        for link, (box, pose) in zip(gripper.fingers, gripper.pads, strict=True)
    )
    return one, other


def _fingers(tested: RobotUnderTest) -> Verdict:
    gripper = tested.description.gripper
    worst = 0.0
    least = max(gripper.min_width, 0.1 * gripper.max_width)
    for width in np.linspace(least, gripper.max_width, 5):
        one, other = _pads(tested, float(width))
        if float(one[:, 1].mean()) < float(other[:, 1].mean()):
            measured = f"{gripper.fingers[0]} is on the TCP's -y side at an opening of {1000 * width:.0f} mm"
            change = (
                f"swap the names in 'links:', 'joints:' and 'pads:' under 'gripper:' in {tested.file}, or "
                "turn its 'tcp:' by 180 deg about z; where the URDF has the fingers' axes wrong, mend it"
            )
            return Verdict("fingers", False, measured, change)
        worst = max(worst, abs(float(one[:, 1].min() - other[:, 1].max()) - float(width)))
    if worst > MAX_OPENING_ERROR:
        measured = f"the pads' gap differs from the opening by {1000 * worst:.1f} mm"
        change = (
            f"measure 'pads:' under 'gripper:' in {tested.file} again, and look at the axes of the fingers' "
            "joints in the URDF"
        )
        return Verdict("fingers", False, measured, change)
    through = _overlap(tested)
    if through > (
        MAX_FINGER_OVERLAP if gripper.linkage is None else MAX_LINKAGE_OVERLAP_SHARE * gripper.max_width
    ):
        measured = (
            f"the fingers pass {1000 * through:.0f} mm through each other at the end of their joints' range"
        )
        change = (
            "mend <axis> of the fingers' joints in the URDF, which look swapped, or their <limit>; then call "
            "`picktree robot new` again"
        )
        return Verdict("fingers", False, measured, change)
    return Verdict("fingers", True, f"the pads' gap equals the opening within {1000 * worst:.2f} mm")


def _overlap(tested: RobotUnderTest) -> float:
    """Return the motion beyond the contact of the pads that the URDF allows, m; 0: they stop there."""
    gripper, joints = tested.description.gripper, tested.skeleton.joints
    if gripper.linkage is None:
        return sum(max(0.0, -(joints[name].lower or 0.0)) for name in gripper.joints)
    drive, shut = joints[gripper.linkage.drive], gripper.linkage.angles[0]
    end = drive.upper if shut > gripper.linkage.angles[-1] else drive.lower
    beyond = 0.0 if end is None else abs(end - shut)
    return beyond * abs(LinkageFingers(gripper.linkage).opening_per_rad(shut))


def _tool_frame(tested: RobotUnderTest) -> Verdict:
    robot, model = tested.description, tested.model
    points = np.concatenate(_pads(tested, robot.gripper.max_width / 2))
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    home = model.named("home")
    palm = model.tcp(home).inverse() @ model.flange(home)
    if np.abs(middle[:2]).max() > MAX_PAD_OFFSET or not low[2] <= 0.0 <= high[2]:
        x, y, z = (round(float(c), 4) for c in middle)
        at = (robot.tcp_in_link @ Pose((x, y, z))).position
        measured = (
            f"the middle between the pads is at {_millimetres((x, y, z))} mm from the TCP, not at the TCP"
        )
        change = (
            f"set 'at:' to {_millimetres(at)} mm under 'tcp:' in {tested.file}, or mend the frame in the URDF"
        )
        return Verdict("tool frame", False, measured, change)
    if palm.position[2] > 0.0:
        measured = (
            f"z of the TCP points back at the flange, which is {1000 * palm.position[2]:.0f} mm "
            "ahead of the TCP"
        )
        change = f"turn 'rpy:' under 'tcp:' in {tested.file}: z points out of the hand, y along the closing"
        return Verdict("tool frame", False, measured, change)
    share = _share_beside_hand(tested)
    if share > MAX_SHARE_BESIDE_HAND:
        measured = (
            f"the hand points back at the arm: {100 * share:.0f} % of its last links is ahead of the palm"
        )
        change = f"turn 'rpy:' under 'mount:' in {tested.file} by 180 deg, or the flange's frame in the URDF"
        return Verdict("tool frame", False, measured, change)
    return Verdict(
        "tool frame", True, f"the TCP is between the pads, within {1000 * np.abs(middle[:2]).max():.1f} mm"
    )


def _millimetres(numbers: Vector3) -> str:
    return ", ".join(f"{1000 * number + 0.0:.1f}" for number in numbers)


def _share_beside_hand(tested: RobotUnderTest) -> float:
    """Return the share of the points of the arm's last two links further out than the palm, 0 … 1."""
    robot, model, tree = tested.description, tested.model, tested.skeleton
    hand = set(tree.below(tree.joints[robot.flange_joint].child))
    last = [link for link in tree.below(tree.joints[robot.joints[-2]].child) if link not in hand]
    home = model.named("home")
    poses, to_tcp = model.link_poses(home, 0.0), model.tcp(home).inverse()
    found = [
        (to_tcp @ poses[link]).apply(tested.solids[link].points) for link in last if link in tested.solids
    ]
    if not found:
        return 0.0
    return float((np.concatenate(found)[:, 2] > -robot.gripper.palm).mean())


CHECKS: tuple[Callable[[RobotUnderTest], Verdict], ...] = (_masses, _limits, _home, _fingers, _tool_frame)
