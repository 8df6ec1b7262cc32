"""Workspace excess: the side on which a point is beyond a workspace, and by how much."""

from __future__ import annotations

from dataclasses import dataclass

from .values import Bounds, Vector3


@dataclass(frozen=True, slots=True)
class WorkspaceExcess:
    """Excess of a point over a workspace.

    A negative excess: the point is within the workspace, but nearer to its edge than the margin.
    """

    axis: str
    """Axis of the world: `x`, `y` or `z`."""
    by: float
    """Excess over the workspace along the axis, m."""
    at: Vector3
    """The point in the world, m."""
    limit: float
    """Edge of the workspace along the axis, m."""
    upper: bool
    """Whether the edge is the greatest value along the axis."""

    @property
    def side(self) -> str:
        """Position and edge in words, as `x = 883 mm, at most 800 mm`."""
        at, bound = self.at["xyz".index(self.axis)], "at most" if self.upper else "at least"
        return f"{self.axis} = {at * 1000:.0f} mm, {bound} {self.limit * 1000:.0f} mm"


def workspace_excess(workspace: Bounds, point: Vector3, margin: float = 0.0) -> WorkspaceExcess | None:
    """Return the excess of a point over the workspace narrowed by `margin` m, along its worst axis; None: it
    is inside."""
    worst: WorkspaceExcess | None = None
    for axis, low, at, high in zip("xyz", workspace.min, point, workspace.max, strict=True):
        for by, limit, upper in ((low - at, low, False), (at - high, high, True)):
            if by + margin > 0.0 and (worst is None or by > worst.by):
                worst = WorkspaceExcess(axis, by, point, limit, upper)
    return worst
