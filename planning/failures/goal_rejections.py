"""Why a configuration that reaches the goal is no goal: what it touches, leaves or breaks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...robots.model import RobotModel
from ...world.values import Array, Bounds, Vector3
from ..collision.collision_checker import INSIDE, CollisionChecker
from ..path_constraints import ConstraintViolation, PathConstraints
from ..requests import ContactPair


@dataclass(frozen=True, slots=True)
class WorkspaceExcess:
    """The tool is outside of where planning may bring it: by how much it is beyond the workspace along which
    axis, m (less than nothing: within it, but nearer to its edge than planning goes), and where it is."""

    axis: str
    by: float
    at: Vector3


@dataclass(frozen=True, slots=True, eq=False)
class GoalRejection:
    """Of one configuration. All empty: it is at the very edge of a margin, where it may not come nearer."""

    q: Array
    """(n,)"""
    contacts: tuple[ContactPair, ...] = ()
    """Pairs that are closer than their margin, the deepest first."""
    outside: WorkspaceExcess | None = None
    broken: tuple[ConstraintViolation, ...] = ()


class GoalInspection:
    """Says of configurations why they are not free. Slow: for explanations."""

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
        """What is wrong with q (n,)."""
        tool = self._model.tcp(q).position
        return GoalRejection(q, self._collision.contacts(q), self.outside(tool), self._constraints.broken(q))

    def outside(self, tool: Vector3) -> WorkspaceExcess | None:
        """How far a point in the world is outside of where planning may bring the tool."""
        if self._workspace is None:
            return None
        low = np.array(self._workspace.min) + INSIDE - np.array(tool)
        high = np.array(tool) - np.array(self._workspace.max) + INSIDE
        over = np.maximum(low, high)
        axis = int(np.argmax(over))
        return WorkspaceExcess("xyz"[axis], float(over[axis]) - INSIDE, tool) if over[axis] > 0 else None
