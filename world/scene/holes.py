"""Holes in fixtures, into which parts are put by feeling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from ..values import ObjectId, Pose

HoleForm: TypeAlias = Literal["round", "square", "slot"]


@dataclass(frozen=True, slots=True)
class Hole:
    """A hole with straight walls, from the top face of its fixture downwards."""

    id: ObjectId
    """Fixture and name: `board/left`."""
    form: HoleForm
    size: tuple[float, float]
    """Free inside along its own x and y, m. Of a round one both are the diameter of the circle inscribed
    in its segments, at least 32, so that clearance counts to what is really free."""
    depth: float
    """From the mouth to the bottom, m."""
    chamfer: float
    """Height and width of the bevel around the mouth, m; 0 for a sharp edge."""
    pose: Pose
    """Of the middle of its mouth in the fixture's frame: z points out of the hole, x along a slot."""


@dataclass(frozen=True, slots=True)
class PlacementUncertainty:
    """How far a fixture may really stand from where the scene says: drawn from the seed, evenly."""

    position: float = 0.0
    """Along each of the fixture's x and y at most, m."""
    angle: float = 0.0
    """About its own z, and of its tilt about a horizontal axis, at most, rad."""


CERTAIN = PlacementUncertainty()
