"""Configuration cost: a penalty near joint limits and singularities, for the motions that follow."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...world.values import Array

if TYPE_CHECKING:
    from ...world.robot_model.model import RobotModel

LIMIT_DISTANCE = 0.5
"""Distance to a joint's limit below which a configuration becomes uncomfortable, rad."""
SINGULAR_VALUE_BOUND = 0.12
"""Smallest singular value of the Jacobian (m and rad mixed) below which a configuration becomes
uncomfortable."""
COST_WEIGHT = 2.0
"""Cost of being at one limit, or in a singularity, as a detour, rad."""


def configuration_cost(model: RobotModel, q: Array) -> float:
    """Return 0 for a comfortable configuration (n,), growing towards limits and singularities; in rad of
    detour."""
    room = np.minimum(q - model.lower, model.upper - q)
    limits = np.clip(1.0 - room / LIMIT_DISTANCE, 0.0, 1.0)
    least = float(np.linalg.svd(model.jacobian(q), compute_uv=False)[-1])
    singular = max(0.0, 1.0 - least / SINGULAR_VALUE_BOUND)
    return COST_WEIGHT * (float(limits @ limits) + singular * singular)
