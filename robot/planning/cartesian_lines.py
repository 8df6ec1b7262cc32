"""Cartesian lines: straight motion of the TCP in small steps, each solved from the one before."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from picktree.world import Array, Pose, Quaternion
from picktree.world.robot_model import RobotModel

from .inverse_kinematics import InverseKinematics
from .trajectory_check import StartTolerance

MAX_LINE_STEP = 0.005
"""Greatest travel of the TCP in a step, m."""
MAX_LINE_TURN = 0.05
"""Greatest turn of the TCP in a step, rad."""
MAX_JOINT_JUMP = 0.2
"""Greatest change of a joint in one step, rad: more means another branch of the kinematics."""


@dataclass(frozen=True, slots=True, eq=False)
class LineResult:
    """Result of a line: `path` (m, n) rad up to its end, and the reason of an early end."""

    path: Array
    fraction: float
    ended_by: str
    """Reason of the end: "" for a whole line, or `reach`, `jump`, `collision`."""
    blocked: Array | None = None
    """Configuration (n,), rad, that was not free; None unless a collision ended the line."""
    ended_at: Pose | None = None
    """Next pose of the TCP where the line ended early; None for a whole line."""


def plan_line(
    model: RobotModel, ik: InverseKinematics, way: StartTolerance, start: Array, tcp_in_world: Pose
) -> LineResult:
    """Plan a line from start (n,) straight to a pose, its orientation turned evenly (slerp).

    Steps of the TCP are at most MAX_LINE_STEP and MAX_LINE_TURN; each is solved from the one before.
    """
    begin = model.tcp(start)
    length, turn = begin.distance(tcp_in_world), begin.angle(tcp_in_world)
    count = max(1, math.ceil(length / MAX_LINE_STEP - 1e-9), math.ceil(turn / MAX_LINE_TURN - 1e-9))
    path = [start]
    ended_by, blocked, pose = "", None, None
    for k in range(1, count + 1):
        pose = interpolate_pose(begin, tcp_in_world, k / count) if k < count else tcp_in_world
        at = path[-1]
        q = ik.descend(pose, at)
        if q is None:
            ended_by = "reach"
        elif np.abs(q - at).max() > MAX_JOINT_JUMP:
            ended_by = "jump"
        elif not way.free(q):
            ended_by, blocked = "collision", q
        else:
            path.append(q)
            continue
        break
    ended_at = pose if ended_by else None
    return LineResult(np.array(path), (len(path) - 1) / count, ended_by, blocked, ended_at)


def interpolate_pose(a: Pose, b: Pose, share: float) -> Pose:
    """Return the pose at `share` (0 … 1) between two: straight for the position, slerp for the
    orientation."""
    x, y, z = (p + (q - p) * share for p, q in zip(a.position, b.position, strict=True))
    return Pose((x, y, z), slerp(a.orientation, b.orientation, share))


def slerp(a: Quaternion, b: Quaternion, share: float) -> Quaternion:
    """Interpolate on the shorter great arc (Shoemake, SIGGRAPH 1985)."""
    if a == b:
        return a
    dot = sum(p * q for p, q in zip(a, b, strict=True))
    sign = -1.0 if dot < 0.0 else 1.0
    angle = math.acos(min(1.0, abs(dot)))
    if angle < 1e-6:
        of_a, of_b = 1.0 - share, share
    else:
        of_a, of_b = math.sin((1.0 - share) * angle), math.sin(share * angle)
    x, y, z, w = (of_a * p + sign * of_b * q for p, q in zip(a, b, strict=True))
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    return (x / norm, y / norm, z / norm, w / norm)
