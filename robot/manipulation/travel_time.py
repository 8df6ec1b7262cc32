"""Travel time of the hand: estimates for candidates, and the order of items that keeps it short."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from picktree.robot.planning import configuration_cost
from picktree.world import Array, Pose, Vector3

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.world import BeliefObject
    from picktree.world.robot_model import RobotModel

CONFIGURATION_COST_WEIGHT = 0.4
"""Weight of a configuration's cost (`configuration_cost`), s for each radian."""


def joint_travel_time(robot: RobotModel, a: Array, b: Array) -> float:
    """Return the least time from a to b (n,), plus the weighted cost of configuration b, s."""
    return float(
        np.max(np.abs(b - a) / robot.velocity_limit)
    ) + CONFIGURATION_COST_WEIGHT * configuration_cost(robot, b)


def known_travel_time(robot: RobotModel, a: Pose, x: float, y: float) -> float:
    """Return the part of `estimated_travel_time` to a point that does not depend on the hand's direction
    there, s."""
    base = robot.description.base_in_world.inverse()
    there = base.apply(np.array([x, y, 0.0]))
    facing = math.atan2(float(there[1]), float(there[0]))
    return abs(_wrapped(facing - _turns(base @ a)[0])) / float(robot.velocity_limit[0])


def estimated_travel_time(robot: RobotModel, a: Pose, b: Pose) -> float:
    """Return the estimated time between two TCP poses before any configuration is known, s.

    It only orders the search. An arm on an upright base turns its first joint to face a point, and its last
    to turn the hand.
    """
    base = robot.description.base_in_world.inverse()
    (facing_a, yaw_a), (facing_b, yaw_b) = (_turns(base @ pose) for pose in (a, b))
    slew = _wrapped(facing_b - facing_a) / float(robot.velocity_limit[0])
    turn = _wrapped((yaw_b - facing_b) - (yaw_a - facing_a)) / float(robot.velocity_limit[-1])
    return max(abs(slew), abs(turn))


def _turns(tcp: Pose) -> tuple[float, float]:
    """Return the azimuth of a position, and the direction of the TCP's y axis seen from above, rad."""
    x, y, _ = tcp.position
    closing = tcp.rotation()[:, 1]
    return math.atan2(y, x), math.atan2(float(closing[1]), float(closing[0]))


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi


REACH_SPEED, REACH_ACCELERATION = 1.0, 5.0
"""Speed and acceleration of the hand towards the base and away from it, m/s and m/s²."""
MIN_GAIN = 1e-6
"""Least time that a change of the order saves, s."""


def travel_order(world: World, items: Sequence[BeliefObject]) -> list[BeliefObject]:
    """Return the items in an order that keeps the travel of the empty hand short.

    The held item comes first. Each next one is the nearest to the last release. Then single items change
    their place while that shortens the whole (Or 1976). Times are estimates; nothing is planned.
    """
    items = sorted(items, key=lambda o: (not o.attached, o.id))
    count = len(items)
    starts = [*(_release_position(world, item) for item in items), world.control.tcp.position]
    times = [[_travel_time(world, start, item.pose.position) for item in items] for start in starts]
    fixed = sum(item.attached for item in items)
    order, left = list(range(fixed)), list(range(fixed, count))
    while left:
        here = times[order[-1] if order else count]
        order.append(min(left, key=here.__getitem__))
        left.remove(order[-1])
    for _ in range(count):
        gain, taken, put = _best_move(times, order, fixed)
        if gain < MIN_GAIN:
            break
        order.insert(put, order.pop(taken))
    return [items[k] for k in order]


def _best_move(times: Sequence[Sequence[float]], order: list[int], fixed: int) -> tuple[float, int, int]:
    """Return the greatest gain of moving one item, s, its index, and the index to insert it at."""
    best = (0.0, 0, 0)
    for taken in range(fixed, len(order)):
        rest = [*order[:taken], *order[taken + 1 :]]
        before = _detour(times, rest, taken, order[taken])
        for put in range(fixed, len(order)):
            gain = before - _detour(times, rest, put, order[taken])
            if gain > best[0]:
                best = (gain, taken, put)
    return best


def _detour(times: Sequence[Sequence[float]], order: list[int], put: int, item: int) -> float:
    """Return the time that an item adds to an order when it is inserted at index `put`, s."""
    here = times[order[put - 1] if put else -1]
    if put == len(order):
        return here[item]
    return here[item] + times[item][order[put]] - here[order[put]]


def _release_position(world: World, item: BeliefObject) -> Vector3:
    """Return where the hand is after the item: at its destination; without one, where the item is."""
    into = world.scene.destination(item.id)
    if into is None:
        return item.pose.position
    body = world.scene.bins.get(into) or world.scene.fixtures.get(into.split("/")[0])
    return item.pose.position if body is None else body.pose.position


def _travel_time(world: World, start: Vector3, end: Vector3) -> float:
    """Return the estimated travel time between two points of the world, s: by the first joint, or by the
    reach."""
    robot = world.robot
    base = robot.description.base_in_world.inverse()
    (xa, ya, _), (xb, yb, _) = (base.apply(np.array(point)) for point in (start, end))
    turn = abs(math.atan2(yb, xb) - math.atan2(ya, xa))
    reach = abs(math.hypot(xb, yb) - math.hypot(xa, ya))
    speed, acceleration = float(robot.velocity_limit[0]), float(robot.acceleration_limit[0])
    return max(_ramp_time(turn, speed, acceleration), _ramp_time(reach, REACH_SPEED, REACH_ACCELERATION))


def _ramp_time(distance: float, speed: float, acceleration: float) -> float:
    """Return the least time from rest to rest over a distance, within limits of speed and acceleration, s."""
    if distance * acceleration < speed * speed:
        return 2.0 * math.sqrt(distance / acceleration)
    return distance / speed + speed / acceleration
