"""Straight edges in joint space: cut into small steps and asked about from the middle outwards."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from ...robots.model import RobotModel
from ...world.values import Array

RESOLUTION = 0.03
"""Greatest step along an edge, rad (Euclidean over the joints)."""
SWEEP = 0.1
"""Greatest way of any point of the arm in a step of a `EdgeSteps`, m, by an upper bound; the hand really
moves
about half of that. A path is checked far more finely when it has been timed: one in thirty then grazes and is
searched again in smaller steps, which costs less than smaller steps for all."""
TURN = 0.2
"""Greatest step of a `EdgeSteps` in joint space, rad (Euclidean)."""
BEYOND = 0.1
"""How far hand and held object reach beyond the tool centre point, m."""

Free = Callable[[Array], bool]


class EdgeSteps:
    """Edges in steps that are equally fine for every point of the arm: the wrist may turn further than the
    shoulder. `share` scales the steps."""

    def __init__(self, model: RobotModel, share: float = 1.0) -> None:
        self._levers: Array = joint_levers(model) / (SWEEP * share)
        self._turns = 1.0 / (TURN * share)

    def count(self, along: Array) -> int:
        """Into how many steps an edge along (n,) is cut."""
        turned = math.sqrt(float(along @ along)) * self._turns
        return max(1, math.ceil(max(turned, float(np.abs(along) @ self._levers))))

    def free(self, free: Free, a: Array, b: Array, *, ends_free: bool = False) -> bool:
        """Whether all steps from a (exclusive) to b (n,) are free; b itself is asked about, too, unless
        `ends_free` says that it is known to be."""
        along = b - a
        shares = _column(self.count(along))
        return all(map(free, a + along * (shares[1:] if ends_free else shares)))


def joint_levers(model: RobotModel) -> Array:
    """(n,): how far any point of the arm moves at most when a joint does, m/rad; m/m for one that slides."""
    arm = model.arm
    tool = float(np.linalg.norm(arm.frames[model.tcp_frame].placement.translation)) + BEYOND
    lengths = [float(np.linalg.norm(arm.jointPlacements[k].translation)) for k in range(2, model.n + 1)]
    reach: Array = np.cumsum([tool, *reversed(lengths)])[::-1].copy()
    slides = [arm.joints[k].shortname().startswith("JointModelP") for k in range(1, model.n + 1)]
    return np.where(slides, 1.0, reach)


def edge_free(free: Free, a: Array, b: Array, resolution: float = RESOLUTION) -> bool:
    """Whether all steps from a (exclusive) to b (inclusive), both (n,), are free."""
    along = b - a
    count = max(1, int(np.ceil(float(np.linalg.norm(along)) / resolution)))
    return all(free(a + along * share) for share in _shares(count))


@lru_cache(maxsize=512)
def bisection_order(count: int) -> tuple[int, ...]:
    """`count`, then the numbers below as halves, quarters, …, because collisions come in stretches."""
    order, spans = [count], [(0, count)]
    for low, high in spans:
        if high - low > 1:
            middle = (low + high) // 2
            order.append(middle)
            spans += [(low, middle), (middle, high)]
    return tuple(order)


@lru_cache(maxsize=512)
def _shares(count: int) -> tuple[float, ...]:
    """1/count … 1 in the order of `bisection_order`."""
    return tuple(k / count for k in bisection_order(count))


@lru_cache(maxsize=512)
def _column(count: int) -> Array:
    """(count, 1): the same."""
    column: Array = np.array(bisection_order(count))[:, None] / count
    return column
