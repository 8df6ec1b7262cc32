"""FreeSpot: a place on the table where the held object can be put down for a while."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from picktree.robot.manipulation import release_poses
from picktree.trees import In, Out, Skill, Steps, port
from picktree.world import Box, Failure, ObjectId, grasp, place, top
from picktree.world import world as world_causes

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.world import BeliefObject
    from picktree.world.scene import Fixture

GRID_SPACING = 0.03
"""Grid spacing of the tested places, m."""
MIN_EDGE_DISTANCE = 0.08
"""Least distance from an object that is put down to the edge of its table, m."""
HAND_CLEARANCE = 0.04
"""Clearance around the object, so that the hand fits around it again, m."""
MIN_REACH, MAX_REACH = 0.32, 0.70
"""Range of distances from the robot's base, m: a table-top arm can reach down there."""
MAX_TESTED_PLACES = 25
"""Maximum number of free places that are tested for reachability."""


@dataclass(frozen=True, slots=True)
class TableSpot:
    """A point on a table's top, named by its position."""

    name: str
    at: tuple[float, float, float]


class FreeSpot(Skill):
    """Find a place on a table where the held object can be put down, with room for the hand around it.

    It is the free place nearest to the hand, within reach, and away from edges, bins and believed objects.
    The next start gives another place. `Place` with `at` puts the object there.
    """

    example = """
    Sequence:
      - FreeSpot: {object: "{item}", at: "{spot}"}
      - Place: {object: "{item}", at: "{spot}"}
    """

    object: In[ObjectId] = port("the held object")
    at: Out[list[float]] = port("place of the object's underside: x, y, z in the world", unit="m")
    causes = (place.OCCUPIED, grasp.SLIPPED, world_causes.UNKNOWN_OBJECT)

    def run(self, world: World) -> Steps:
        held = world.scene.get(self.object)
        if held.object_in_tcp is None:
            raise Failure(grasp.SLIPPED, f"{self.object} is not in the hand", object=self.object)
        free = [spot for spot in self._spots(world) if self._has_room(world, held, spot)]
        for spot in world.attempts.remaining(self.path, self.object, free)[:MAX_TESTED_PLACES]:
            above = release_poses.put_down_poses(spot.at, held.shape, held.object_in_tcp)
            raised = (pose.shifted((0.0, 0.0, world.handling.approach)) for pose in above[::2])
            if any(world.plan.reachable(pose) is not None for pose in raised):
                world.attempts.failed(self.path, self.object, spot.name)
                yield from world.plan.charge()
                self.at = list(spot.at)
                return
        yield from world.plan.charge()
        raise Failure(
            place.OCCUPIED,
            f"there is no place within reach where {self.object} can be put down",
            object=self.object,
            free=len(free),
        )

    def _spots(self, world: World) -> list[TableSpot]:
        """Return the places on all tables, the nearest to the hand first."""
        hand = world.control.tcp.position
        found: list[TableSpot] = []
        for fixture in world.scene.fixtures.values():
            found += _on(fixture)
        return sorted(found, key=lambda spot: (math.dist(spot.at[:2], hand[:2]), spot.name))

    def _has_room(self, world: World, held: BeliefObject, spot: TableSpot) -> bool:
        assert held.object_in_tcp is not None
        pose = release_poses.put_down_poses(spot.at, held.shape, held.object_in_tcp)[0] @ held.object_in_tcp
        if not world.description.limits.workspace.contains(pose.position):
            return False
        below = {f.id for f in world.scene.fixtures.values() if _top(f) is not None}
        raised = pose.shifted((0.0, 0.0, release_poses.PLACE_TEST_HEIGHT))
        contacts = world.queries.free(held.shape, raised, ignore=(held.id,), margin=HAND_CLEARANCE)
        return all(contact.b in below and contact.distance > 0 for contact in contacts)


def _top(fixture: Fixture) -> float | None:
    """Return the height of a board's upper side, m; None for anything else."""
    if not isinstance(fixture.shape, Box) or fixture.shape.size[2] > min(fixture.shape.size[:2]):
        return None
    up = fixture.pose.rotation()[:, 2]
    return top(fixture.shape, fixture.pose) if up[2] > 0.9999 else None


def _on(fixture: Fixture) -> list[TableSpot]:
    """Return grid points on a board, in the part within reach of an arm at the origin."""
    height = _top(fixture)
    if height is None or not isinstance(fixture.shape, Box):
        return []
    half = [size / 2 - MIN_EDGE_DISTANCE for size in fixture.shape.size[:2]]
    if min(half) <= 0:
        return []
    axes = [
        np.arange(-math.floor(h / GRID_SPACING), math.floor(h / GRID_SPACING) + 1) * GRID_SPACING
        for h in half
    ]
    found: list[TableSpot] = []
    for a in axes[0]:
        for b in axes[1]:
            x, y, _ = (float(v) for v in fixture.pose.apply(np.array([a, b, 0.0])))
            if MIN_REACH < math.hypot(x, y) < MAX_REACH:
                found.append(TableSpot(f"{fixture.id} {x:.2f} {y:.2f}", (x, y, height)))
    return found
