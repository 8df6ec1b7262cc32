"""Soft limits for motions without a plan: joints under torque control, the tool on a straight line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from picktree.world import Array, Bounds, Vector3

if TYPE_CHECKING:
    from picktree.world.robot_model import RobotModel

SOFT_LIMIT_MARGIN = 0.005
"""Distance to its soft limit at which a joint under torque control stops, rad."""
STOPPING_ACCELERATION_SHARE = 0.5
"""Share of the acceleration limit that is available to stop before a limit. Gravity and contact take some."""
FREE_SPEED_SHARE = 0.7
"""Share of the fastest stoppable speed up to which a joint is left alone."""
SLOWDOWN_TIME = 0.02
"""Time in which a joint that exceeds its speed is slowed down, s."""
LIMIT_RETURN_TIME = 0.1
"""Time in which a joint beyond its limit comes back, s."""
MIN_LIMIT_APPROACH_TIME = 0.25
"""Least time in which a target may use up a joint's distance to its limit, s."""
MIN_TARGET_SPEED = 1e-3
"""Speed of a target below which a joint at its limit has ended the motion, m/s."""
MAX_STRAY_SHARE = 0.05
"""Greatest deviation of a motion without one joint, as a share of its speed; rad/s count as m/s."""
WORKSPACE_EDGE_MARGIN = 0.002
"""Distance to the edge of the workspace at which a straight line ends, m."""


@dataclass(frozen=True, slots=True)
class CartesianSpeedLimit:
    """Speed limit of a Cartesian target, m/s, and the joint whose limit ends the motion; empty: none."""

    most: float
    blocked_by: str


class SoftJointLimits:
    """Limiter that keeps joints under torque control within their soft limits and speeds.

    A joint may move towards its limit as fast as it can stop before it: v² = 2 a r. An acceleration that
    breaks this is cut; nothing else changes. After Prete, "Joint position and velocity bounds in
    discrete-time acceleration/torque control of robot manipulators", IEEE Robotics and Automation Letters 3
    (2018).
    """

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        self._lower: Array = model.lower + SOFT_LIMIT_MARGIN
        self._upper: Array = model.upper - SOFT_LIMIT_MARGIN
        self._deceleration: Array = STOPPING_ACCELERATION_SHARE * model.acceleration_limit
        self._calm: Array = FREE_SPEED_SHARE * FREE_SPEED_SHARE * 2.0 * self._deceleration
        self._slow: Array = FREE_SPEED_SHARE * model.velocity_limit

    def held(self, q: Array, v: Array, torque: Array) -> Array:
        """Return the torques (n,) that keep the limits and are closest to the wanted ones, Nm."""
        room = np.minimum(self._upper - q, q - self._lower)
        # Joints far from their limits pass this quick test, whichever way they move.
        if bool(((v * v < self._calm * room) & (np.abs(v) < self._slow)).all()):
            return torque
        up, down = self._fastest(self._upper - q), self._fastest(q - self._lower)
        if bool((v < FREE_SPEED_SHARE * up).all() and (v > -FREE_SPEED_SHARE * down).all()):
            return torque
        model = self._model
        mass, bias = model.mass_matrix(q), model.bias(q, v)
        wanted: Array = np.asarray(np.linalg.solve(mass, torque - bias), np.float64)
        slowing = self._deceleration
        most = (up - v) / SLOWDOWN_TIME - slowing * np.clip(v / np.maximum(np.abs(up), 1e-3), 0.0, 1.0)
        least = (-down - v) / SLOWDOWN_TIME - slowing * np.clip(v / np.maximum(np.abs(down), 1e-3), -1.0, 0.0)
        cut = np.minimum(np.maximum(wanted, np.minimum(least, most)), np.maximum(most, least))
        if np.array_equal(cut, wanted):
            return torque
        return np.clip(mass @ cut + bias, -model.torque_limit, model.torque_limit)

    def target_speed(
        self, q: Array, mass: Array, jacobian: Array, direction: Array, share: float
    ) -> CartesianSpeedLimit:
        """Return the speed limit of a target along a unit vector (3,) for a tool with joint-space inertia
        `mass` (n, n).

        `share` of the joints' speed limits is never exceeded.

        A joint that reaches its limit stays there, and the motion continues with the others as far as they
        suffice. After Flacco, De Luca and Khatib, "Control of redundant robots under hard joint constraints:
        saturation in the null space", IEEE Transactions on Robotics 31 (2015).
        """
        free = np.ones(self._model.n, dtype=np.bool_)
        fastest = share * self._model.velocity_limit
        wanted = np.concatenate([direction, np.zeros(3)])
        best, held = -1.0, -1
        while True:
            rates = _rates(mass, jacobian, direction, free)
            if held >= 0 and float(np.abs(jacobian @ rates - wanted).max()) > MAX_STRAY_SHARE:
                break
            room = np.maximum(np.where(rates > 0.0, self._upper - q, q - self._lower), 0.0)
            speeds = np.minimum(fastest, room / MIN_LIMIT_APPROACH_TIME) / np.maximum(np.abs(rates), 1e-6)
            k = int(speeds.argmin())
            if float(speeds[k]) > best:
                best, held = float(speeds[k]), k if room[k] / MIN_LIMIT_APPROACH_TIME < fastest[k] else -1
            if room[k] / MIN_LIMIT_APPROACH_TIME >= fastest[k] or int(free.sum()) <= 6:
                break
            free[k] = False
        blocked = held >= 0 and best < MIN_TARGET_SPEED
        return CartesianSpeedLimit(best, self._model.description.joints[held] if blocked else "")

    def at_limit(self, q: Array) -> str:
        """Return the name of a joint at its limit; empty without one."""
        room = np.minimum(self._upper - q, q - self._lower)
        k = int(room.argmin())
        return self._model.description.joints[k] if float(room[k]) < SOFT_LIMIT_MARGIN else ""

    def _fastest(self, room: Array) -> Array:
        """Return the speed (n,) towards a limit from which each joint can stop before it, rad/s. Beyond the
        limit: backwards."""
        inside = np.sqrt(2.0 * self._deceleration * np.maximum(room, 0.0))
        return np.where(room > 0.0, np.minimum(inside, self._model.velocity_limit), room / LIMIT_RETURN_TIME)


def _rates(mass: Array, jacobian: Array, direction: Array, free: NDArray[np.bool_]) -> Array:
    """Return joint speeds (n,), rad/s, when only the free joints move the tool along (3,) at 1 m/s without
    rotation."""
    some = jacobian[:, free]
    by_mass: Array = np.asarray(np.linalg.solve(mass[np.ix_(free, free)], some.T), np.float64)
    inertia = np.linalg.inv(some @ by_mass + 1e-6 * np.eye(6))
    rates = np.zeros(len(free))
    rates[free] = by_mass @ (inertia[:, :3] @ direction)
    return rates


def distance_to_workspace_edge(workspace: Bounds, tool: Vector3, direction: Array) -> float:
    """Return the distance from a point along a unit vector (3,) to the edge of the workspace, m.

    A side that the point is already beyond counts only for motion further out: the result is then 0.
    """
    way = math.inf
    for low, at, high, along in zip(workspace.min, tool, workspace.max, direction.tolist(), strict=True):
        if along > 1e-9:
            way = min(way, max(0.0, high - WORKSPACE_EDGE_MARGIN - at) / along)
        elif along < -1e-9:
            way = min(way, max(0.0, at - low - WORKSPACE_EDGE_MARGIN) / -along)
    return way
