"""What a robot file will say, before it is written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ...robots.gripper_mounting import LinkInertia, Mounting
from .gripper_measurement import MeasuredGripper
from .inertias import InertiaFinding
from .joint_groups import Arm, Hand
from .joint_limits import ProposedLimits
from .named_poses import NamedPose
from .self_collision import SelfCollision


@dataclass(frozen=True, slots=True)
class Draft:
    """All that the robot file will say."""

    name: str
    urdf: str
    """As the file names it."""
    arm: Arm
    hand: Hand
    mounting: Mounting | None
    gripper_urdf: str
    limits: tuple[ProposedLimits, ...]
    gripper: MeasuredGripper
    flange_joint: str
    findings: tuple[InertiaFinding, ...]
    inertias: Mapping[str, LinkInertia]
    poses: tuple[NamedPose, ...] = ()
    collision: SelfCollision | None = None
    notes: tuple[str, ...] = ()
