"""Roll, pitch and yaw, as URDFs and robot files write rotations."""

from __future__ import annotations

import math

from ..world.values import Pose, Vector3


def rpy_of(pose: Pose) -> Vector3:
    """Roll, pitch, yaw about the fixed axes, rad."""
    r = pose.rotation()
    pitch = math.atan2(-float(r[2, 0]), math.hypot(float(r[0, 0]), float(r[1, 0])))
    if math.cos(pitch) < 1e-9:
        return math.atan2(-float(r[1, 2]), float(r[1, 1])), pitch, 0.0
    return (
        math.atan2(float(r[2, 1]), float(r[2, 2])),
        pitch,
        math.atan2(float(r[1, 0]), float(r[0, 0])),
    )
