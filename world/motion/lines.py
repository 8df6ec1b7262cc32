"""Straight lines of the TCP: small steps, each solved from the one before."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..robot.model import RobotModel
from ..values import Array, Pose, Quaternion
from .ik import InverseKinematics
from .way import Way

STEP = 0.005
"""m"""
TURN = 0.05
"""rad"""
JUMP = 0.2
"""Greatest change of a joint in one step: more means another branch of the kinematics, rad."""


@dataclass(frozen=True, slots=True, eq=False)
class LineFound:
    """How far a line got: `path` (m, n) rad up to there, and what ended it before its end."""

    path: Array
    fraction: float
    ended_by: str
    """"" or `reach`, `jump`, `collision`."""
    blocked: Array | None = None
    """Configuration (n,) that was not free."""


def straight(
    model: RobotModel, ik: InverseKinematics, way: Way, start: Array, tcp_in_world: Pose
) -> LineFound:
    """From start (n,) straight to a pose, its orientation turned evenly (slerp)."""
    begin = model.tcp(start)
    length, turn = begin.distance(tcp_in_world), begin.angle(tcp_in_world)
    count = max(1, math.ceil(length / STEP - 1e-9), math.ceil(turn / TURN - 1e-9))
    path = [start]
    ended_by, blocked = "", None
    for k in range(1, count + 1):
        q = ik.descend(between(begin, tcp_in_world, k / count), path[-1])
        if q is None:
            ended_by = "reach"
        elif float(np.abs(q - path[-1]).max()) > JUMP:
            ended_by = "jump"
        elif not way.free(q):
            ended_by, blocked = "collision", q
        else:
            path.append(q)
            continue
        break
    return LineFound(np.array(path), (len(path) - 1) / count, ended_by, blocked)


def between(a: Pose, b: Pose, share: float) -> Pose:
    """The pose at `share` (0 … 1) of the way: straight for the position, slerp for the orientation."""
    x, y, z = (p + (q - p) * share for p, q in zip(a.position, b.position, strict=True))
    return Pose((x, y, z), slerp(a.orientation, b.orientation, share))


def slerp(a: Quaternion, b: Quaternion, share: float) -> Quaternion:
    """Shoemake's interpolation on the shorter great arc (SIGGRAPH 1985)."""
    p, q = np.array(a), np.array(b)
    dot = float(p @ q)
    if dot < 0.0:
        q, dot = -q, -dot
    angle = math.acos(min(1.0, dot))
    if angle < 1e-6:
        mixed = p + (q - p) * share
    else:
        mixed = (math.sin((1 - share) * angle) * p + math.sin(share * angle) * q) / math.sin(angle)
    mixed = mixed / np.linalg.norm(mixed)
    x, y, z, w = (float(c) for c in mixed)
    return (x, y, z, w)
