"""Stage of an execution: what only a simulation has, the ground truth, injected faults and saved states.

A run on a robot has none. It is scored by its belief.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from picktree.simulation import FaultInjector, Simulation, TrueBody, checkpoints, rests
from picktree.world import JournalEvent, extents
from picktree.world.scene import Fixture, SceneDescription


class Stage:
    """Simulation of an execution, and the faults that are injected into it."""

    def __init__(self, simulation: Simulation, injector: FaultInjector) -> None:
        self.simulation = simulation
        self.injector = injector

    def tick(self) -> tuple[JournalEvent, ...]:
        """Let due faults act, and return their events and those of the feed."""
        return (*self.injector.tick(), *self.simulation.take_events())

    def items_move(self, scene: SceneDescription) -> bool:
        """Return whether any item moves that is not on a belt."""
        belts = [scene.fixture(belt.id) for belt in scene.belts]
        moving = (body for body in self.simulation.recent_truth() if body.present and not rests(body))
        return not all(any(_is_over(belt, body) for belt in belts) for body in moving)

    def true_state(self, departed: int, wrist_bias: list[float]) -> dict[str, Any]:
        """Return the present state as plain values, without changing it.

        It has the faults and the wrist sensor's learnt bias, and leaves out the first `departed` items that
        left with bins.
        """
        faults = checkpoints.json_values(self.injector.state())
        return {**self.simulation.snapshot().to_plain(departed), "faults": faults, "wrist_bias": wrist_bias}


def _is_over(belt: Fixture, body: TrueBody) -> bool:
    low, high = extents(belt.shape, np.eye(3))
    x, y, z = (belt.pose.inverse() @ body.pose).position
    return bool(low[0] <= x <= high[0] and low[1] <= y <= high[1] and z > low[2])
