"""What a path may be followed with: the joints' limits of velocity, acceleration, jerk and torque."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ...robots.model import RobotModel
from ...world.values import Array
from ..requests import Scaling

TORQUE = 0.7
"""Share of the torque limits that is planned with: the servo and a held object need the rest."""
RISE = 0.025
"""The jerk limit of a joint is its acceleration limit over this time, s."""
APART = 4
"""Torques are looked at at every so many samples of a motion: they cost more than the rest."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """How fast the path may be followed up to parameter `end`, rad."""

    end: float
    scaling: Scaling


class Limits:
    """Of one robot along one path. A stretch scales velocity and acceleration, not jerk and torque."""

    def __init__(self, model: RobotModel, stretches: Sequence[Stretch]) -> None:
        self.jerk: Array = model.acceleration_limit / RISE
        self._model = model
        self._data = model.arm.createData()
        self._ends = np.array([stretch.end for stretch in stretches[:-1]])
        self._velocity = np.array([stretch.scaling.velocity for stretch in stretches])
        self._acceleration = np.array([stretch.scaling.acceleration for stretch in stretches])

    def speed(self, s: Array, first: Array, window: float) -> Array:
        """The greatest speed (m,) of the parameter with which no joint is too fast, and from where none
        would be within `window` s; `first` (m, n) is the path's derivative at s (m,)."""
        here = least_ratio(self.kinematic(s)[0], first)
        around = self.around(s, first, window)
        return here if around is None else least_ratio(self.kinematic(s, around)[0], first)

    def around(self, s: Array, first: Array, window: float) -> Array | None:
        """How far the slower of two stretches reaches into the faster one, rad at each s (m,): the way that
        is done in `window` s. None where there is one stretch only."""
        if not len(self._ends):
            return None
        slowest = 2.0 * float(self._velocity.min()) * least_ratio(self._model.velocity_limit, first)
        return window * np.minimum(least_ratio(self.kinematic(s)[0], first), slowest)

    def kinematic(self, s: Array, around: Array | None = None) -> tuple[Array, Array]:
        """Of velocity and acceleration (m, n) at parameters (m,); less than `around` rad (m,) from where two
        stretches meet, the lower ones."""
        reach = np.full(len(s), 1e-9) if around is None else around
        first = np.searchsorted(self._ends, s - reach, side="left")
        last = np.searchsorted(self._ends, s + reach, side="right")
        velocity, acceleration = self._velocity[first], self._acceleration[first]
        for k in range(1, int((last - first).max(initial=0)) + 1):
            other = np.minimum(first + k, last)
            velocity = np.minimum(velocity, self._velocity[other])
            acceleration = np.minimum(acceleration, self._acceleration[other])
        model = self._model
        return velocity[:, None] * model.velocity_limit, acceleration[:, None] * model.acceleration_limit

    def torques(self, q: Array, first: Array, second: Array) -> tuple[Array, Array]:
        """What the parameter's acceleration and its squared speed take of the joints' torques that gravity
        leaves, as shares (m, n) of those; q, first, second (m, n): the path and its derivatives."""
        weight, along = self._weight(q), self._rnea(q, np.zeros_like(q), first)
        left = self._left(weight)
        return (along - weight) / left, (self._rnea(q, first, second) - weight) / left

    def excess(self, times: Array, s: Array, q: Array, v: Array, a: Array) -> Array:
        """By what factor (m,) time would have to be stretched at each sample of a motion to keep all limits.

        Stretched by k, the torques of inertia, Coriolis and centrifugal forces fall by k²; gravity stays.
        """
        velocity, acceleration = self.kinematic(s)
        dt = np.diff(times)[:, None]
        factor = (np.abs(v) / velocity).max(axis=1)
        squared = (np.abs(a) / acceleration).max(axis=1)
        # What the servo sees between samples are these differences.
        steps = (np.abs(np.diff(v, axis=0)) / (dt * acceleration[1:])).max(axis=1)
        squared[1:] = np.maximum(squared[1:], steps)
        some = slice(None, None, APART)
        weight = self._weight(q[some])
        moving = np.abs(self._rnea(q[some], v[some], a[some]) - weight) / self._left(weight)
        squared[some] = np.maximum(squared[some], moving.max(axis=1))
        factor = np.maximum(factor, np.sqrt(squared))
        jerk = (np.abs(np.diff(a, axis=0)) / (dt * self.jerk)).max(axis=1)
        factor[1:] = np.maximum(factor[1:], np.cbrt(jerk))
        return factor

    def _weight(self, q: Array) -> Array:
        arm, data = self._model.arm, self._data
        return np.array([pin.computeGeneralizedGravity(arm, data, each) for each in q])

    def _rnea(self, q: Array, v: Array, a: Array) -> Array:
        arm, data = self._model.arm, self._data
        return np.array([pin.rnea(arm, data, *each) for each in zip(q, v, a, strict=True)])

    def _left(self, weight: Array) -> Array:
        limit = self._model.torque_limit
        return np.maximum(TORQUE * limit - np.abs(weight), 0.1 * limit)


def least_ratio(limit: Array, each: Array) -> Array:
    """The greatest factor (m,) with which all joints of each row (m, n) stay within their limits."""
    return (limit / np.maximum(np.abs(each), 1e-9)).min(axis=1)
