"""Mounting of a gripper from another URDF: link of the arm, distance and orientation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...robots.gripper_mounting import GripperMount
from ...robots.urdf_tree import MOVING, UrdfTree
from ...world.values import Array, Pose
from .joint_groups import ArmGroup, find_hand, require_link
from .link_geometry import LinkGeometry
from .urdf_source import UrdfSource

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
    carrier = to or _flange(arm_source.skeleton, arm)
    skeleton = arm_source.skeleton
    missing = f"a link {carrier!r} for --mount"
    require_link(arm_source.text, skeleton, carrier, missing, "name the link at the end of the arm")
    taken = {*skeleton.links, *skeleton.joints}
    below = gripper.skeleton.below(first)
    names = {*below, *(n for n, j in gripper.skeleton.joints.items() if j.parent in below)}
    prefix = GRIPPER_PREFIX if names & taken else ""
    joint = MOUNT_JOINT if MOUNT_JOINT not in taken else f"{GRIPPER_PREFIX}{MOUNT_JOINT}"
    return GripperMount(gripper.urdf, first, carrier, _face(skeleton, arm, solids, carrier), joint, prefix)


def _flange(skeleton: UrdfTree, arm: ArmGroup) -> str:
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
    fixed = [link for link in skeleton.below(last.child) if link in solids]
    points = [
        (at.inverse() @ skeleton.pose(link, {})).apply(solids[link].points)
        for link in fixed
        if not _moves(skeleton, last.child, link)
    ]
    # Outwards is from the joint to the flange; where both coincide, from the joint to the links' points.
    ahead = -origin @ axis
    if abs(ahead) < 1e-4 and points:
        ahead = float((np.concatenate(points) @ axis).mean() - origin @ axis)
    out: Array = axis if ahead >= 0.0 else -axis
    height = 0.0
    if carrier in solids:
        own = solids[carrier].points
        height = max(float((own @ out).max()), 0.0)
    if float(out[2]) > 0.999:
        return Pose((0.0, 0.0, round(height, 4)))
    side = np.array([1.0, 0.0, 0.0]) if abs(float(out[0])) < 0.9 else np.array([0.0, 1.0, 0.0])
    y = np.cross(out, side)
    y = y / np.linalg.norm(y)
    rotation = np.column_stack([np.cross(y, out), y, out])
    x0, y0, z0 = (round(float(c), 4) for c in out * height)
    return Pose.from_rotation((x0, y0, z0), rotation)
