"""Outlines of the finger pads in the plane of the table, for the planning and simulation of pushes."""

from __future__ import annotations

import numpy as np

from ..world.planar_geometry import PlanarOutline
from .description import GripperDescription


def tool_outline(gripper: GripperDescription, opening: float) -> tuple[PlanarOutline, PlanarOutline]:
    """Return the outlines of the two finger pads from above, the +y pad first. `opening` in m; frame: the
    TCP's planar frame, with y across the fingers."""
    depth, thick = gripper.pads[0][0].size[0] / 2, gripper.pads[0][0].size[1]
    near, far = opening / 2, opening / 2 + thick
    one = np.array([[-depth, near], [depth, near], [depth, far], [-depth, far]])
    other = np.array([[-depth, -far], [depth, -far], [depth, -near], [-depth, -near]])
    return PlanarOutline(one), PlanarOutline(other)
