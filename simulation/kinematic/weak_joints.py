"""Joints that give less torque than they should, in a simulation whose arm else goes where it is told."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...robots.model import RobotModel
from ...world.values import Array

STIFFNESS = 60.0
"""Of the servo of a joint that cannot follow exactly: natural frequency, rad/s; critically damped."""


class WeakJoints:
    """The weak joints move as their torque, gravity and the others' motion let them; the others exactly."""

    def __init__(self, model: RobotModel, period: float) -> None:
        self._model = model
        self._period = period

    def given(self, torque: Array, shares: Mapping[str, float]) -> Array:
        """What the joints give of a torque (n,), Nm."""
        most = self._model.torque_limit * self._shares(shares)
        return torque.clip(-most, most)

    def follow(
        self, q: Array, v: Array, aim: Array, rate: Array, shares: Mapping[str, float]
    ) -> tuple[Array, Array, Array]:
        """Where the arm is one period later, (n,) rad and rad/s, and what its joints gave, Nm: at (q, v) it
        was told to be at `aim` with `rate` then."""
        model, dt = self._model, self._period
        share = self._shares(shares)
        weak, strong = share < 1.0, share >= 1.0
        inertia, bias = model.mass_matrix(q), model.bias(q, v)
        others = (rate - v)[strong] / dt
        load = inertia[np.ix_(weak, strong)] @ others + bias[weak]
        own, most = inertia[np.ix_(weak, weak)], (model.torque_limit * share)[weak]
        error, behind = (aim - q)[weak], (rate - v)[weak]
        at_once = own @ ((error / dt - v[weak]) / dt) + load
        effort = model.gravity(q)
        if np.all(np.abs(at_once) <= most):
            effort[weak] = at_once
            return aim, rate, effort
        wanted = own @ (STIFFNESS**2 * error + 2.0 * STIFFNESS * behind) + load
        effort[weak] = wanted.clip(-most, most)
        gained = np.linalg.solve(own, effort[weak] - load)
        velocity, position = rate.copy(), aim.copy()
        velocity[weak] = v[weak] + gained * dt
        position[weak] = q[weak] + velocity[weak] * dt
        inside = np.minimum(np.maximum(position, model.lower), model.upper)
        velocity[inside != position] = 0.0
        return inside, velocity, effort

    def _shares(self, shares: Mapping[str, float]) -> Array:
        return np.array([shares.get(name, 1.0) for name in self._model.description.joints])
