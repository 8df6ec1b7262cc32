"""Goal rejections: why a configuration that reaches the goal is no goal. It touches something, leaves the
workspace or violates a constraint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...robots.model import RobotModel
from ...world.values import Array, Bounds, Vector3
from ..collision.collision_checker import WORKSPACE_MARGIN, CollisionChecker
from ..path_constraints import ConstraintViolation, PathConstraints
from ..requests import ContactPair


@dataclass(frozen=True, slots=True)
class WorkspaceExcess:
    """Excess of the tool over the space in which planning may bring it: axis, excess over the workspace, m,
    and position.

    A negative excess: the tool is within the workspace, but nearer to its edge than planning goes.
    """

    axis: str
    by: float
    at: Vector3


@dataclass(frozen=True, slots=True, eq=False)
class GoalRejection:
    """Reasons against one configuration. All empty: it is at the very edge of a margin, where it may not come
    nearer."""

    q: Array
    """Configuration (n,), rad."""
    contacts: tuple[ContactPair, ...] = ()
    """Pairs that are closer than their margin, the deepest first."""
    outside: WorkspaceExcess | None = None
    broken: tuple[ConstraintViolation, ...] = ()


class GoalInspection:
    """Reasons why configurations are not free. Slow: for explanations."""

    def __init__(
        self,
        model: RobotModel,
        collision: CollisionChecker,
        constraints: PathConstraints,
        workspace: Bounds | None,
    ) -> None:
        self._model = model
        self._collision = collision
        self._constraints = constraints
        self._workspace = workspace

    def rejection(self, q: Array) -> GoalRejection:
        """Return the reasons against q (n,)."""
        tool = self._model.tcp(q).position
        return GoalRejection(q, self._collision.contacts(q), self.outside(tool), self._constraints.broken(q))

    def outside(self, tool: Vector3) -> WorkspaceExcess | None:
        """Return how far a point in the world is outside the planned workspace; None: it is inside."""
        if self._workspace is None:
            return None
        low = np.array(self._workspace.min) + WORKSPACE_MARGIN - np.array(tool)
        high = np.array(tool) - np.array(self._workspace.max) + WORKSPACE_MARGIN
        over = np.maximum(low, high)
        axis = int(np.argmax(over))
        return (
            WorkspaceExcess("xyz"[axis], float(over[axis]) - WORKSPACE_MARGIN, tool)
            if over[axis] > 0
            else None
        )
