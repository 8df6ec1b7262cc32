"""Where an item comes to be that faults bring or enlarge: on what is below it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from ...errors import PicktreeError
from ...world.scene.description import CatalogueEntry, SceneDescription
from ...world.shapes import Shape, bottom, scaled
from ...world.values import ObjectId, Pose
from ..common.footprints import support_height
from .spawn import SpawnedItem

OF_A_FAULT = -1
"""In the place of the entry of a feed that brought an item."""
GAP = 5e-4
"""How far above its support it appears, m."""
TIGHT = 5e-4
"""What becomes larger needs no more room than this around it, m."""


def arriving(
    scene: SceneDescription, name: ObjectId, kind: str, colour: str, place: tuple[float, float], yaw: float
) -> SpawnedItem:
    """An item of the catalogue, its centre over `place` (x, y), m, turned by `yaw` about z, rad.

    Raises PicktreeError when no fixture is below.
    """
    x, y = place
    height = support_height(scene.fixtures, x, y)
    if height is None:
        raise PicktreeError(f"nothing is below ({x:.3f}, {y:.3f})")
    entry = scene.entry(kind)
    turn = Pose(orientation=(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))
    pose = turn.shifted((x, y, height - bottom(entry.shape, turn) + GAP))
    return SpawnedItem(name, entry, colour, pose, dropped=False, brought_by=OF_A_FAULT)


def grown(entry: CatalogueEntry, pose: Pose, factor: float) -> tuple[CatalogueEntry, Pose]:
    """An item that is so many times as large, and where it is then: its lowest point stays as high."""
    larger = replace(entry, shape=scaled(entry.shape, factor))
    lift = bottom(entry.shape, pose) - bottom(larger.shape, pose)
    return larger, pose.shifted((0.0, 0.0, lift))


def walls(scene: SceneDescription) -> Iterable[tuple[Shape, Pose]]:
    """The parts of the bins: nothing appears in one."""
    return ((box, pose) for each in scene.bins for box, pose in each.parts())
