"""Static bodies in pybullet: fixtures, bins and obstacles."""

from __future__ import annotations

from picktree.simulation import HiddenObstacles
from picktree.world import (
    ObjectId,
    Pose,
)
from picktree.world.scene import Fixture, SceneDescription

from .bodies import add_fixed, add_obstacle
from .engine import pb


class StaticBodies:
    """Bodies of one client that never move, with their names."""

    def __init__(self, scene: SceneDescription, base_in_world: Pose, client: int) -> None:
        """`scene`: with the fixtures at their true poses."""
        self._scene = scene
        self._base_in_world = base_in_world
        self._client = client
        self._numbers: dict[ObjectId, int] = {}
        self.names: dict[int, str] = {}
        """Names of floor, fixtures, bins, belts and obstacles by pybullet's body number."""
        self.obstacles = HiddenObstacles(self._add, self._remove)
        """Obstacles that are unknown to the robot."""

    def load(self) -> None:
        """Add floor, fixtures and bins to an empty simulation."""
        self.names = add_fixed(self._scene, self._base_in_world, self._client)

    def number(self, obstacle: ObjectId) -> int:
        """Return pybullet's body number of an obstacle."""
        return self._numbers[obstacle]

    @property
    def holed(self) -> list[int]:
        """pybullet's body numbers of the fixtures with holes."""
        boards = {fixture.id for fixture in self._scene.fixtures if fixture.holes}
        return [number for number, name in self.names.items() if name in boards]

    def _add(self, body: Fixture) -> None:
        number = self._numbers[body.id] = add_obstacle(body, self._client)
        self.names[number] = body.id

    def _remove(self, name: ObjectId) -> None:
        number = self._numbers.pop(name)
        del self.names[number]
        pb.removeBody(number, self._client)
