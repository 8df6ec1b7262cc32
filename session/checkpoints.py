"""Checkpoints: the complete state of a run at a quiescent moment, as numbers and names, exact in JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from picktree.files import PicktreeError
from picktree.logs import Digest, log_records
from picktree.logs.recording import RecordingState
from picktree.robot import World
from picktree.robot.control import ControlLoopState, FollowedPath, GripperProgress
from picktree.robot.perception import BinView, PictureMemory, PictureState
from picktree.simulation import FaultInjector, FaultState, Simulation, checkpoints
from picktree.trees import BehaviourTree
from picktree.world import SceneSnapshot, heap_geometry, world_facts

from .run_tally import RunCounters

NOTHING_RECORDED: Final = RecordingState(
    believed=-1.0, true=-1.0, failing=(), cameras=(), digest=Digest().hex
)
"""State of the recording of a run that has no log yet."""


@dataclass(frozen=True, slots=True)
class BeliefState:
    """Planning scene, and the counters from which it makes new ids."""

    scene: SceneSnapshot
    numbers: dict[str, int]


@dataclass(frozen=True, slots=True)
class RunState:
    """Complete state that determines the future of a run and of its log, together with its recipe.

    Fields with a default are missing in checkpoints of older logs.
    """

    time: float
    """Time of the checkpoint, simulated s."""
    items_done: int
    simulation: dict[str, Any]
    """Checkpoint of the backend as plain values."""
    faults: tuple[FaultState, ...]
    control: dict[str, Any]
    belief: BeliefState
    tree: dict[str, Any]
    attempts: dict[str, list[str]]
    streams: dict[str, int]
    thinking_owed: float
    looks: int
    bins_seen: dict[str, list[list[float | None]]]
    """Heights in the cells of each bin, m; None for a cell that no image has shown."""
    way: FollowedPath | None = None
    """Path that the arm followed last, for the retreat; None: unknown."""
    grip: GripperProgress | None = None
    """Last command to the gripper; None: unknown, and the fingers do not move."""
    tally: RunCounters | None = None
    disagreements: int = 0
    """Number of trajectories that the verifier has rejected so far."""
    recording: RecordingState | None = None
    noticed: world_facts.FeedProgressState = field(default_factory=world_facts.FeedProgressState)
    """Events of the feed that the robot has received so far."""
    refusals: Mapping[str, world_facts.Refusal] = field(default_factory=dict[str, world_facts.Refusal])
    """Refusals of `AttemptMemory`."""
    heaps: Mapping[str, heap_geometry.Heap] = field(default_factory=dict[str, heap_geometry.Heap])
    """Last seen heaps of the totes."""
    pictures: Mapping[str, PictureState] = field(default_factory=dict[str, PictureState])
    """Memory of the pictures of each fixed camera."""

    def to_json(self) -> bytes:
        return checkpoints.json_bytes(self)

    @classmethod
    def from_json(cls, data: bytes) -> RunState:
        """Parse a checkpoint. Raises PicktreeError for other data."""
        try:
            return log_records.record_adapter(RunState).validate_json(data)
        except ValidationError as error:
            raise PicktreeError(f"this is no checkpoint: {error.errors()[0]['msg']}") from None


def take_checkpoint(
    world: World,
    tree: BehaviourTree,
    hardware: Simulation,
    injector: FaultInjector,
    tally: RunCounters,
    recording: RecordingState,
    disagreements: int = 0,
) -> RunState:
    """Save everything. The simulation then continues from the saved state, exactly as a resumed run does.

    Only at a quiescent moment: no skill runs, the arm is held at rest. Raises PicktreeError otherwise.
    """
    control = checkpoints.json_values(world.control.save())
    world.plan.forget()
    saved = hardware.checkpoint()
    snapshot, numbers = world.scene.state()
    return RunState(
        time=world.clock.now,
        items_done=tally.done,
        simulation=saved.to_plain(),
        faults=injector.state(),
        control=control,
        belief=BeliefState(snapshot, dict(numbers)),
        tree=tree.save(),
        attempts=world.attempts.state(),
        streams=world.streams.state(),
        thinking_owed=world.thinking.owed,
        looks=world.vision.observations,
        bins_seen={
            name: [[None if math.isnan(height) else height for height in row] for row in view.cells.tolist()]
            for name, view in world.vision.bins.items()
        },
        way=world.move.state(),
        grip=world.gripper.save(),
        tally=tally.state(),
        disagreements=disagreements,
        recording=recording,
        noticed=world.noticed.state(),
        refusals=dict(world.attempts.refusals),
        heaps=dict(world.vision.heaps),
        pictures={name: memory.state() for name, memory in world.vision.memories.items()},
    )


def restore_checkpoint(world: World, state: RunState) -> None:
    """Restore a world from the state; its hardware was built from the same state.

    Tree, faults and counters are restored by the caller, since they may differ now. Raises PicktreeError when
    the state does not fit such a world.
    """
    try:
        control = log_records.record_adapter(ControlLoopState).validate_python(state.control)
    except ValidationError as error:
        raise PicktreeError(f"this is no checkpoint: {error.errors()[0]['msg']}") from None
    world.control.restore(control)
    world.plan.forget()
    world.move.restore(state.way)
    if state.grip is not None:
        world.gripper.restore(state.grip)
    world.scene.restore(state.belief.scene, state.belief.numbers)
    world.attempts.restore(state.attempts)
    world.attempts.refusals = dict(state.refusals)
    world.streams.restore(state.streams)
    world.thinking.owed = state.thinking_owed
    world.journal.items_done = state.items_done
    world.noticed.restore(state.noticed)
    world.vision.observations = state.looks
    world.vision.heaps = dict(state.heaps)
    for name, picture in state.pictures.items():
        world.vision.memories[name] = PictureMemory.from_state(picture)
    world.vision.bins = {
        name: BinView(np.array([[math.nan if h is None else h for h in row] for row in rows]))
        for name, rows in state.bins_seen.items()
    }
