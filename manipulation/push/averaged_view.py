"""A close look at one object: the mean of several pictures, because one is as noisy as an error to mend."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ...world.belief.planning_scene import BeliefObject
from ...world.planar_geometry import Planar, moved, outline, planar, wrapped
from ...world.values import ObjectId

if TYPE_CHECKING:
    from ...cell.world import World

T = TypeVar("T")
Doing = Generator[None, None, T]

GRID = 3e-4
"""What pictures of the same object err alike, m."""


def look_closely(world: World, camera: str, name: ObjectId, pictures: int) -> Doing[BeliefObject | None]:
    """What is believed of an object after so many pictures: its place is the mean of those that show it.
    None when most of them do not."""
    yield from world.control.settle()
    found: list[BeliefObject] = []
    for _ in range(pictures):
        summary = yield from world.eyes.look(camera)
        belief = world.scene.find(name)
        if name in summary.seen and belief is not None:
            found.append(belief)
    if 2 * len(found) <= pictures:
        return None
    last = found[-1]
    here = [b for b in found if b.kind == last.kind]
    places = [planar(b.shape, b.pose) for b in here]
    turn = outline(last.shape, last.pose).turn
    first = places[0]
    yaw = first.yaw + float(np.median([wrapped(p.yaw - first.yaw, turn) for p in places]))
    mean = Planar(float(np.mean([p.x for p in places])), float(np.mean([p.y for p in places])), wrapped(yaw))
    height = float(np.mean([b.pose.position[2] for b in here]))
    pose = moved(last.shape, last.pose, mean)
    pose = replace(pose, position=(mean.x, mean.y, height))
    sigma = math.hypot(last.sigma_position / math.sqrt(len(here)), GRID)
    mean_belief = replace(
        last, pose=pose, sigma_position=sigma, sigma_angle=last.sigma_angle / math.sqrt(len(here))
    )
    world.scene.put(mean_belief, f"the mean of {len(here)} pictures")
    return mean_belief
