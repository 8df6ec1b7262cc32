"""The target that cameras and tool are calibrated at, as the scene file has it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..world.causes import Failure
from ..world.causes import world as world_causes
from ..world.scene.calibration_targets import Tile
from ..world.shapes import Box
from ..world.values import Pose, Vector3

if TYPE_CHECKING:
    from collections.abc import Iterable

    from ..world.scene.description import Fixture


@dataclass(frozen=True, slots=True)
class Target:
    """A block with coloured squares on its top."""

    name: str
    pose: Pose
    """Of its centre in the world, as believed."""
    size: Vector3
    """m"""
    tiles: tuple[Tile, ...]


def targets(fixtures: Iterable[Fixture]) -> tuple[Target, ...]:
    """All that are among the fixtures."""
    return tuple(
        Target(str(f.id), f.pose, f.shape.size, f.tiles)
        for f in fixtures
        if f.tiles and isinstance(f.shape, Box)
    )


def target_named(fixtures: Iterable[Fixture], name: str) -> Target:
    """The target of that name. Raises Failure(world.unknown_object) when there is none."""
    known = targets(fixtures)
    for target in known:
        if target.name == name:
            return target
    raise Failure(
        world_causes.UNKNOWN_OBJECT,
        f"there is no target {name!r}: it is a fixture with 'marker'",
        known=[target.name for target in known],
    )
