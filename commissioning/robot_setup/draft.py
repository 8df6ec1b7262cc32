"""Draft of a robot file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ...robots.gripper_mounting import GripperMount, LinkInertia
from .gripper_measurement import MeasuredGripper
from .inertias import InertiaFinding
from .joint_groups import ArmGroup, HandGroup
from .joint_limits import ProposedLimits
from .named_poses import NamedPose
from .self_collision import SelfCollisionReport


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
    findings: tuple[InertiaFinding, ...]
    inertias: Mapping[str, LinkInertia]
    poses: tuple[NamedPose, ...] = ()
    collision: SelfCollisionReport | None = None
    notes: tuple[str, ...] = ()
