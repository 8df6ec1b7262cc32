"""Looking where an object is after a grasp that missed it, as far as that costs no motion."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING

from ..journal import Happened
from ..values import ObjectId

if TYPE_CHECKING:
    from ..world import World


def seen_again(world: World, object_id: ObjectId, node: str, why: str) -> Generator[None, None, bool]:
    """Look from where the arm is, through a camera on the hand first; whether the object was seen, so that it
    is worth another try. What the hand hides is not."""
    yield from world.control.settle()
    cameras = sorted(world.description.cameras, key=lambda camera: camera.on != "hand")
    for camera in cameras:
        summary = yield from world.eyes.look(camera.name)
        if object_id in summary.seen:
            world.journal.note(
                Happened(
                    "regrasp",
                    f"{object_id} is grasped once more: {why}",
                    node,
                    {"object": object_id, "camera": camera.name},
                )
            )
            return True
    return False
