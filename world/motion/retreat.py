"""Backing out of a narrow place: from a configuration as the hand came in, for as long as that is free."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..robot.model import RobotModel
from ..values import Array

STEP = 0.03
"""Way of the TCP in a step, m."""
REACH = 0.45
"""Greatest way, m."""
SWING = 0.5
"""Greatest change of a joint in a step, rad: more means a singularity."""
DAMPING = 1e-4

EdgeFree = Callable[[Array, Array], bool]


def retreat(model: RobotModel, edge: EdgeFree, q: Array, lower: Array, upper: Array) -> list[Array]:
    """Configurations (n,) behind q, one after the other with free edges, as the TCP goes back against the
    direction in which the tool points and keeps its orientation, roughly. Damped least squares, first order.
    """
    back = -model.tcp(q).rotation()[:, 2]
    wanted: Array = np.concatenate([back * STEP, np.zeros(3)])
    chain, at = list[Array](), q
    for _ in range(round(REACH / STEP)):
        jacobian = model.jacobian(at)
        damped: Array = jacobian @ jacobian.T
        damped[np.diag_indices(6)] += DAMPING
        step: Array = jacobian.T @ np.asarray(np.linalg.solve(damped, wanted), np.float64)
        behind: Array = np.minimum(np.maximum(at + step, lower), upper)
        swing = float(np.abs(behind - at).max())
        if not 1e-3 < swing < SWING or not edge(at, behind):
            break
        chain.append(behind)
        at = behind
    return chain
