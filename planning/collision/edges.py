"""Straight edges in joint space: cut into small steps that are checked from the middle outwards."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from ...robots.model import RobotModel
from ...world.values import Array

EDGE_RESOLUTION = 0.03
"""Greatest step along an edge, rad (Euclidean over the joints)."""
MAX_EDGE_SWEEP = 0.1
"""Greatest travel of any point of the arm in a step of `EdgeSteps`, m, by an upper bound. The hand really
travels about half of that.

A path is checked far more finely after timing. One in thirty then grazes and is searched again in smaller
steps, which costs less than smaller steps for all.
"""
MAX_EDGE_TURN = 0.2
"""Greatest step of `EdgeSteps` in joint space, rad (Euclidean)."""
REACH_BEYOND_TCP = 0.1
"""Reach of hand and held object beyond the tool centre point, m."""

Free = Callable[[Array], bool]


class EdgeSteps:
    """Edges in steps that are equally fine for every point of the arm: the wrist may turn further than the
    shoulder.

    `share` scales the steps.
    """

    def __init__(self, model: RobotModel, share: float = 1.0) -> None:
        self._levers: Array = joint_levers(model) / (MAX_EDGE_SWEEP * share)
        self._turns = 1.0 / (MAX_EDGE_TURN * share)

    def count(self, along: Array) -> int:
        """Return the number of steps into which an edge along (n,) is cut."""
        turned = math.sqrt(float(along @ along)) * self._turns
        return max(1, math.ceil(max(turned, float(np.abs(along) @ self._levers))))

    def free(self, free: Free, a: Array, b: Array, *, ends_free: bool = False) -> bool:
        """Whether all steps from a (exclusive) to b (n,) are free. With `ends_free` b is known to be free."""
        along = b - a
        shares = _column(self.count(along))
        return all(map(free, a + along * (shares[1:] if ends_free else shares)))


def joint_levers(model: RobotModel) -> Array:
    """Return upper bounds (n,) of the travel of any point of the arm by each joint, m/rad; m/m for a
    slider."""
    arm = model.arm
    tool = float(np.linalg.norm(arm.frames[model.tcp_frame].placement.translation)) + REACH_BEYOND_TCP
    lengths = [float(np.linalg.norm(arm.jointPlacements[k].translation)) for k in range(2, model.n + 1)]
    reach: Array = np.cumsum([tool, *reversed(lengths)])[::-1].copy()
    slides = [arm.joints[k].shortname().startswith("JointModelP") for k in range(1, model.n + 1)]
    return np.where(slides, 1.0, reach)


def edge_free(free: Free, a: Array, b: Array, resolution: float = EDGE_RESOLUTION) -> bool:
    """Whether all steps from a (exclusive) to b (inclusive), both (n,), are free."""
    along = b - a
    count = max(1, int(np.ceil(float(np.linalg.norm(along)) / resolution)))
    return all(free(a + along * share) for share in _shares(count))


@lru_cache(maxsize=512)
def bisection_order(count: int) -> tuple[int, ...]:
    """Return `count`, then the numbers below as halves, quarters, …: collisions come in stretches."""
    order, spans = [count], [(0, count)]
    for low, high in spans:
        if high - low > 1:
            middle = (low + high) // 2
            order.append(middle)
            spans += [(low, middle), (middle, high)]
    return tuple(order)


@lru_cache(maxsize=512)
def _shares(count: int) -> tuple[float, ...]:
    """Return 1/count … 1 in the order of `bisection_order`."""
    return tuple(k / count for k in bisection_order(count))


@lru_cache(maxsize=512)
def _column(count: int) -> Array:
    """Return the shares of `_shares` as a column (count, 1)."""
    column: Array = np.array(bisection_order(count))[:, None] / count
    return column
