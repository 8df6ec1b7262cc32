"""IK seeds: configurations spread over the joint space, looked up by the pose that they reach."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ...robots.model import RobotModel
from ...world.values import Array
from .levenberg_marquardt import IkDescent

SEED_COUNT = 2048
"""Number of configurations. Finding the nearest takes as long as two steps of a descent; twice as many save
no step."""
TURN_LEVER = 0.3
"""Weight of a turn relative to a travel, m/rad."""


class IkSeeds:
    """IK seeds of one robot, computed from it alone in 10 ms; the same in each process."""

    def __init__(self, model: RobotModel, descent: IkDescent) -> None:
        shares = np.random.default_rng(0).uniform(size=(SEED_COUNT, model.n))
        self.configurations: Array = model.planned_lower + shares * (
            model.planned_upper - model.planned_lower
        )
        """Configurations (SIZE, n), rad."""
        self._keys: Array = np.array([pose_key(descent.place(q)) for q in self.configurations])
        self._half_squares: Array = 0.5 * np.einsum("ij,ij->i", self._keys, self._keys)

    def nearest(self, wanted: Array) -> int:
        """Return the index of the configuration whose pose is nearest to the one with that key (12,)."""
        return int(self._nearness(wanted).argmax())

    def around(self, wanted: Array, count: int) -> Array:
        """Return the `count` configurations (count, n) whose poses are nearest to the one with that key
        (12,)."""
        nearness = self._nearness(wanted)
        some = np.argpartition(nearness, -count)[-count:]
        return self.configurations[some[np.argsort(-nearness[some], kind="stable")]]

    def _nearness(self, wanted: Array) -> Array:
        # |k - w|² = |k|² - 2 k·w + |w|², and the last is the same for all.
        return self._keys.dot(wanted) - self._half_squares


def pose_key(place: pin.SE3) -> Array:
    """Return a pose as a point (12,): equal distances (m) for equal travels and, for small turns, equal
    arcs."""
    point: Array = np.empty(12)
    point[:3] = place.translation
    # Two rotations that differ by a small angle a are 2^½ a apart in the Frobenius norm.
    point[3:] = (TURN_LEVER / 2**0.5) * place.rotation.ravel()
    return point
