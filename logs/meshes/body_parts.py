"""What a body is drawn as: one shape, or the blocks of an obstacle."""

from __future__ import annotations

from ...world.shapes import Box, Shape
from ...world.values import Pose
from ..schema.records import Body


def parts_of(body: Body) -> tuple[tuple[Shape, Pose], ...]:
    """Convex shapes with their poses in the body's frame."""
    if not body.blocks:
        return ((body.shape, Pose()),)
    return tuple((Box(block.size), Pose(block.at)) for block in body.blocks)
