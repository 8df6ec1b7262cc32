"""Checkpoints: the whole state of a run at a quiescent moment, as numbers and names, exact in JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from pydantic import TypeAdapter, ValidationError

from ..trees.runner import Tree
from ..world.control.loop import ControlState
from ..world.errors import PicktreeError
from ..world.scene.planning_scene import SceneSnapshot
from ..world.simulation.backends import Simulation
from ..world.simulation.faults import FaultState, Injector
from ..world.world import World


@dataclass(frozen=True, slots=True)
class BeliefState:
    """The planning scene, and the counters from which it makes new ids."""

    scene: SceneSnapshot
    numbers: dict[str, int]


@dataclass(frozen=True, slots=True)
class RunState:
    """Everything on which the future of a run depends, besides what it was made from."""

    time: float
    """Simulated seconds."""
    items_done: int
    simulation: dict[str, Any]
    """The backend's own checkpoint, as plain values."""
    faults: tuple[FaultState, ...]
    control: dict[str, Any]
    belief: BeliefState
    tree: dict[str, Any]
    attempts: dict[str, list[str]]
    streams: dict[str, int]
    thinking_owed: float
    looks: int
    bins_seen: dict[str, list[list[float | None]]]
    """Heights in the cells of each bin, m; None where nothing was seen."""

    def to_json(self) -> bytes:
        return _ADAPTER.dump_json(self)

    @classmethod
    def from_json(cls, data: bytes) -> RunState:
        """Raises PicktreeError when this is no checkpoint."""
        try:
            return _ADAPTER.validate_json(data)
        except ValidationError as error:
            raise PicktreeError(f"this is no checkpoint: {error.errors()[0]['msg']}") from None


_ADAPTER = TypeAdapter(RunState)
_CONTROL = TypeAdapter(ControlState)


def take(world: World, tree: Tree, hardware: Simulation, injector: Injector, items_done: int) -> RunState:
    """Save everything. The simulation goes on from what was saved, as a resumed run would.

    Only at a quiescent moment: no skill runs, the arm is held at rest. Raises PicktreeError otherwise.
    """
    control = _CONTROL.dump_python(world.control.save(), mode="json")
    saved = hardware.checkpoint()
    snapshot, numbers = world.scene.state()
    return RunState(
        time=world.clock.now,
        items_done=items_done,
        simulation=saved.to_plain(),
        faults=injector.state(),
        control=control,
        belief=BeliefState(snapshot, dict(numbers)),
        tree=tree.save(),
        attempts=world.attempts.state(),
        streams=world.streams.state(),
        thinking_owed=world.thinking.owed,
        looks=world.eyes.looks,
        bins_seen={
            name: [[None if math.isnan(height) else height for height in row] for row in view.cells.tolist()]
            for name, view in world.eyes.bins.items()
        },
    )
