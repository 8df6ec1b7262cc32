"""Looking at a hole with the camera on the hand, so that what is put into it comes over its mouth."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING

from ..values import ObjectId, Pose

if TYPE_CHECKING:
    from ..world import World


def look_at_hole(world: World, hole_id: ObjectId, node: str) -> Generator[None, None, Pose | None]:
    """The pose of a hole's mouth in the world (z out of the hole, x along a slot), as a camera on the hand
    sees it; None where it cannot tell, or where there is no such camera."""
    yield from ()
    return None
