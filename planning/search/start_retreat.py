"""Start retreat: a path out of a narrow place, back along the tool for as long as that is free."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...robots.model import RobotModel
from ...world.values import Array

RETREAT_STEP = 0.03
"""Travel of the TCP in a step, m."""
MAX_RETREAT_LENGTH = 0.45
"""Greatest travel in one direction, m."""
ENOUGH_STEPS = 3
"""Number of steps from which on no other directions are tried."""
MAX_JOINT_SWING = 0.5
"""Greatest change of a joint in a step, rad: more means a singularity."""
RETREAT_DAMPING = 1e-4

EdgeFree = Callable[[Array, Array], bool]


def retreat_path(model: RobotModel, edge: EdgeFree, q: Array) -> list[Array]:
    """Return configurations (n,) behind q, one after the other with free edges.

    They are no nearer to the limits than planned ones, or than q. The TCP goes back against the direction in
    which the tool points, its orientation kept. Where that ends soon, it goes up and then towards the axis of
    the base, turning on the way.
    """
    lower, upper = np.minimum(model.planned_lower, q), np.maximum(model.planned_upper, q)
    walk = _Walk(model, edge, lower, upper)
    chain = walk.along(q, -model.tcp(q).rotation()[:, 2], upright=True)
    for towards in (_upwards, _towards_base):
        if len(chain) >= ENOUGH_STEPS:
            break
        at = chain[-1] if chain else q
        chain += walk.along(at, towards(model, at), upright=False)
    return chain


class _Walk:
    def __init__(self, model: RobotModel, edge: EdgeFree, lower: Array, upper: Array) -> None:
        self._model = model
        self._edge = edge
        self._lower = lower
        self._upper = upper

    def along(self, q: Array, direction: Array, *, upright: bool) -> list[Array]:
        """Walk as far as it is free in that direction (3,) of the world; `upright`: without turning the tool.

        Damped least squares of first order: the line is roughly straight, which is enough for a retreat.
        """
        rows = 6 if upright else 3
        wanted: Array = np.zeros(rows)
        wanted[:3] = direction * RETREAT_STEP
        chain, at = list[Array](), q
        for _ in range(round(MAX_RETREAT_LENGTH / RETREAT_STEP)):
            jacobian = self._model.jacobian(at)[:rows]
            damped: Array = jacobian @ jacobian.T
            damped[np.diag_indices(rows)] += RETREAT_DAMPING
            step: Array = jacobian.T @ np.asarray(np.linalg.solve(damped, wanted), np.float64)
            behind: Array = np.minimum(np.maximum(at + step, self._lower), self._upper)
            swing = float(np.abs(behind - at).max())
            if not 1e-3 < swing < MAX_JOINT_SWING or not self._edge(at, behind):
                break
            chain.append(behind)
            at = behind
        return chain


def _upwards(_: RobotModel, __: Array) -> Array:
    return np.array([0.0, 0.0, 1.0])


def _towards_base(model: RobotModel, q: Array) -> Array:
    x, y, _ = model.tcp(q).position
    base_x, base_y, _ = model.description.base_in_world.position
    away = float(np.hypot(x - base_x, y - base_y))
    return np.array([base_x - x, base_y - y, 0.0]) / max(away, 1e-9)
