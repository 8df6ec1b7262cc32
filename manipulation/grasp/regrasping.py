"""Whether a grasp that came to nothing is worth a second one at once: the object is seen again, or was lost
where it was gripped."""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import TYPE_CHECKING

from ...world.causes import Failure, grasp
from ...world.journal import Happened
from ...world.values import ObjectId, Vector3

if TYPE_CHECKING:
    from ...cell.world import World


NEAR = 0.03
"""From where it was gripped; an object that is lost no further away lies there, m."""


def found_again(
    world: World, object_id: ObjectId, node: str, failure: Failure, gripped: Vector3 | None
) -> Generator[None, None, bool]:
    """Look from where the arm is, which costs no motion, through a camera on the hand first. What the hand
    hides from the others is there when it slipped out over the place `gripped`, where it was taken."""
    yield from world.control.settle()
    cameras = sorted(world.description.cameras, key=lambda camera: camera.on != "hand")
    for camera in cameras:
        summary = yield from world.eyes.look(camera.name)
        if object_id in summary.seen:
            _note(world, object_id, node, failure, f"seen by {camera.name}")
            return True
    believed = next((o for o in world.scene.objects if o.id == object_id), None)
    if failure.cause is not grasp.SLIPPED or gripped is None or believed is None:
        return False
    if math.dist(believed.pose.position[:2], gripped[:2]) > NEAR:
        return False
    _note(world, object_id, node, failure, "it was lost where it was gripped")
    return True


def _note(world: World, object_id: ObjectId, node: str, failure: Failure, where: str) -> None:
    world.journal.note(
        Happened(
            "regrasp",
            f"{object_id} is grasped once more ({where}): {failure.message}",
            node,
            {"object": object_id, "where": where},
        )
    )
