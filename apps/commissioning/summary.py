"""Summary of a robot file, for `picktree robot show` and `new`."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace

from picktree.files import listed
from picktree.world.robot_model import JointLimits, RobotDescription, RobotModel, urdf_parser

from .proposal import Proposal
from .robot_test import RobotTestResult
from .self_collision import summary


@dataclass(frozen=True, slots=True)
class JointLine(JointLimits):
    """Limits of one joint with its name."""

    name: str


@dataclass(frozen=True, slots=True)
class RobotSummary:
    """Answer of `picktree robot show`, and of `new` with its findings."""

    name: str
    file: str
    urdf: str
    joints: tuple[JointLine, ...]
    hand: str
    opening: float
    """Opening of the gripper, m."""
    least_opening: float
    """Opening of the shut gripper, m."""
    grip_force: float
    """Grip force, N."""
    hand_mass: float
    """Mass of all links beyond the flange, kg."""
    tcp_at_home: tuple[float, float, float]
    """TCP position at `home` in the world, m."""
    poses: tuple[str, ...]
    unchecked_pairs: int
    samples: int = 0
    """Number of samples of self-collision; 0: nothing was sampled."""
    unchecked: tuple[tuple[str, int], ...] = ()
    """Number of pairs without a check, by reason."""
    checked_pairs: int = 0
    seen_only: tuple[str, ...] = ()
    """Links without collision geometry, which collide with their visual geometry."""
    findings: tuple[str, ...] = ()
    picture: str = ""
    test: RobotTestResult | None = None
    """Self-test; None: not requested."""

    def to_text(self) -> str:
        lines = [f"{self.name}: an arm of {len(self.joints)} joints, {self.file}", f"urdf        {self.urdf}"]
        width = max(len(joint.name) for joint in self.joints)
        for k, joint in enumerate(self.joints):
            head = "joints" if k == 0 else ""
            lines.append(
                f"{head:<12}{joint.name:<{width}}  {joint.lower:+.2f} … {joint.upper:+.2f} rad, "
                f"{joint.velocity:.2f} rad/s, {joint.acceleration:g} rad/s², {joint.torque:g} Nm"
            )
        x, y, z = self.tcp_at_home
        least = f"{1000 * self.least_opening:.0f} … " if self.least_opening > 1e-3 else ""
        lines.append(
            f"gripper     {self.hand}: opens {least}{1000 * self.opening:.0f} mm, "
            f"presses {self.grip_force:.0f} N, weighs {self.hand_mass:.2f} kg"
        )
        lines.append(
            f"poses       {', '.join(self.poses)}; at home the tool is at {x:.2f}, {y:.2f}, {z:.2f} m"
        )
        if self.samples:
            counts = ", ".join(f"{count} {reason}" for reason, count in self.unchecked if count)
            lines.append(
                f"collision   {self.checked_pairs} pairs of links checked, {self.unchecked_pairs} not "
                f"checked ({counts}); from {self.samples:,} samples"
            )
        else:
            lines.append(f"collision   {self.unchecked_pairs} pairs of links are not checked")
        if self.seen_only:
            links = listed(self.seen_only, 6)
            lines.append(f"shapes      without <collision>, using <visual> for collisions: {links}")
        for k, finding in enumerate(self.findings):
            lines.append(f"{'look at' if k == 0 else '':<12}{finding}")
        if self.picture:
            lines.append(f"picture     {self.picture}")
        if self.test is not None:
            lines.append(f"self-test   {self.test.summary}")
            lines += self.test.to_text().splitlines()[1:]
        return "\n".join(lines)

    def to_json_text(self) -> str:
        return json.dumps(asdict(self), ensure_ascii=False)


def summary_of(robot: RobotDescription) -> RobotSummary:
    model = RobotModel(robot)
    return RobotSummary(
        robot.name,
        robot.source,
        robot.urdf,
        tuple(JointLine(**asdict(j), name=name) for name, j in zip(robot.joints, robot.limits, strict=True)),
        robot.tcp_link,
        robot.gripper.max_width,
        robot.gripper.min_width,
        robot.gripper.max_force,
        model.hand_mass,
        model.tcp(model.named("home")).position,
        tuple(robot.named),
        len(robot.disabled_pairs),
        seen_only=urdf_parser.links_seen_only(robot.urdf),
    )


def summary_of_new(proposal: Proposal, picture: str, test: RobotTestResult | None = None) -> RobotSummary:
    """Return the summary of a proposal, with findings that its reader should examine."""
    draft = proposal.draft
    findings = [f"{f.link}: {f.sentence}" for f in draft.findings]
    findings += draft.notes
    findings += [f"torque of {limit.name}: {limit.guess}" for limit in draft.limits if limit.guess]
    if draft.base is not None:
        x, y, z = draft.base.at
        findings.append(f"base: at [{x:g}, {y:g}, {z:g}] m, a proposal: {draft.base.sentence}")
    if draft.gripper.force_guessed:
        findings.append(f"max_force: {draft.gripper.force_comment}")
    collision = draft.collision
    return replace(
        summary_of(proposal.robot),
        seen_only=(),  # among the findings
        samples=collision.samples if collision else 0,
        unchecked=tuple(summary(collision).items()) if collision else (),
        checked_pairs=len(collision.checked) if collision else 0,
        findings=tuple(findings),
        picture=picture,
        test=test,
    )
