"""Limits of planned configurations: the box of the world for the tool, and the excess of a start over it.

Near joint limits and singularities a configuration costs more, for the motions that follow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from picktree.world import Array, Bounds, Vector3, WorkspaceExcess, workspace_excess
from picktree.world.robot_model import JointExcess, joint_excesses

if TYPE_CHECKING:
    from picktree.world.robot_model import RobotModel

WORKSPACE_MARGIN = 0.002
"""Distance of the tool to the edges of the workspace that planning keeps, m."""
START_LIMIT_TOLERANCE = 1e-3
"""Greatest excess of a joint over its soft limit that is ignored at a start, rad; for a slider m.

An arm at its limit is off by less.
"""
ROUNDING_MARGIN = 1e-9
"""Widening of a room beyond the tool that it is widened to, m, for rounding."""


@dataclass(frozen=True, slots=True)
class ToolRoom:
    """Box of the world between two corners, m."""

    low: Vector3
    high: Vector3

    @classmethod
    def of(cls, workspace: Bounds) -> ToolRoom:
        """Return the room of a workspace, narrowed by the margin that planning keeps."""
        (left, front, low), (right, back, high) = workspace.min, workspace.max
        return cls(
            (left + WORKSPACE_MARGIN, front + WORKSPACE_MARGIN, low + WORKSPACE_MARGIN),
            (right - WORKSPACE_MARGIN, back - WORKSPACE_MARGIN, high - WORKSPACE_MARGIN),
        )

    def holds(self, point: Array, reach: float = 0.0) -> bool:
        """Whether everything up to `reach` m from a point (3,) is in the room."""
        (left, front, low), (right, back, high) = self.low, self.high
        x, y, z = point.tolist()
        return (
            left + reach <= x <= right - reach
            and front + reach <= y <= back - reach
            and low + reach <= z <= high - reach
        )

    def excess(self, point: Array) -> float:
        """Return the distance of a point (3,) from the room along the worst axis, m; 0: it is inside."""
        return max(0.0, float(np.maximum(self.low - point, point - self.high).max()))

    def widened(self, point: Array) -> ToolRoom:
        """Return the smallest room around this one that holds a point (3,)."""
        if self.holds(point):
            return self
        x, y, z = (np.minimum(self.low, point - ROUNDING_MARGIN)).tolist()
        u, v, w = (np.maximum(self.high, point + ROUNDING_MARGIN)).tolist()
        return ToolRoom((x, y, z), (u, v, w))


@dataclass(frozen=True, slots=True)
class StartExcess:
    """Excess of a start over soft limits and workspace."""

    joints: tuple[JointExcess, ...]
    tool: WorkspaceExcess | None

    @property
    def more_than_a_turn(self) -> bool:
        """Whether a hinge is beyond its limit by more than 2π: the start was probably meant in degrees."""
        return any(one.more_than_a_turn for one in self.joints)


def start_excess(model: RobotModel, workspace: Bounds | None, q: Array) -> StartExcess | None:
    """Return the excess of q (n,), rad, over soft limits and workspace; None: it is within both."""
    joints = joint_excesses(model, q, START_LIMIT_TOLERANCE)
    tool = None if workspace is None else workspace_excess(workspace, model.tcp(q).position, WORKSPACE_MARGIN)
    return StartExcess(joints, tool) if joints or tool is not None else None


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
