"""What a motion is worth as time, before it is planned."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ...planning.kinematics.posture import discomfort
from ...world.values import Array, Pose

if TYPE_CHECKING:
    from ...robots.model import RobotModel

DETOUR = 0.4
"""What a radian of detour (`posture.discomfort`) is worth as time, s."""


def travel(robot: RobotModel, a: Array, b: Array) -> float:
    """The least time from a to b (n,), and what an uncomfortable b is worth, s."""
    return float(np.max(np.abs(b - a) / robot.velocity_limit)) + DETOUR * discomfort(robot, b)


def slewed(robot: RobotModel, a: Pose, x: float, y: float) -> float:
    """The part of `guessed` that is known of a point before the hand's direction there is, s."""
    base = robot.description.base_in_world.inverse()
    there = base.apply(np.array([x, y, 0.0]))
    facing = math.atan2(float(there[1]), float(there[0]))
    return abs(_wrapped(facing - _turns(base @ a)[0])) / float(robot.velocity_limit[0])


def guessed(robot: RobotModel, a: Pose, b: Pose) -> float:
    """The time from one TCP pose to another before any configuration is known, s. It only says what to look
    at first: an arm on an upright base turns its first joint to face a point, its last to turn the hand."""
    base = robot.description.base_in_world.inverse()
    (facing_a, yaw_a), (facing_b, yaw_b) = (_turns(base @ pose) for pose in (a, b))
    slew = _wrapped(facing_b - facing_a) / float(robot.velocity_limit[0])
    turn = _wrapped((yaw_b - facing_b) - (yaw_a - facing_a)) / float(robot.velocity_limit[-1])
    return max(abs(slew), abs(turn))


def _turns(tcp: Pose) -> tuple[float, float]:
    """Azimuth of a position, and the direction of the TCP's y axis, seen from above, rad."""
    x, y, _ = tcp.position
    closing = tcp.rotation()[:, 1]
    return math.atan2(y, x), math.atan2(float(closing[1]), float(closing[0]))


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi
