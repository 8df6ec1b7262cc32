"""Simulation backends behind one protocol: physics (pybullet), and kinematic without physics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

from picktree.world import Hardware, JournalEvent
from picktree.world.robot_model import RobotDescription
from picktree.world.scene import Fixture, SceneDescription

from .checkpoints import Backend, Checkpoint, KinematicState
from .device_faults import InjectableRobot
from .truth import TrueBody


class Simulation(Hardware, InjectableRobot, Protocol):
    """Simulated hardware: it knows the ground truth, carries out faults, can be saved and reports its
    settings."""

    def take_events(self) -> tuple[JournalEvent, ...]:
        """Return the events of feed and bin exchange since the last call."""
        ...

    def truth(self) -> tuple[TrueBody, ...]:
        """Return the ground truth of every item that ever came, in the order of their numbers."""
        ...

    @property
    def item_count(self) -> int:
        """Number of items that ever came."""
        ...

    def true_fixtures(self) -> tuple[Fixture, ...]:
        """Return the scene's fixtures at their true poses."""
        ...

    def vary_noise(self, variant: int) -> None:
        """Draw the noise of the sensors from that variant of their streams; a bias does not change."""
        ...

    def checkpoint(self) -> Checkpoint | KinematicState:
        """Save the state and continue from the saved state."""
        ...

    def snapshot(self) -> Checkpoint | KinematicState:
        """Return the state at any moment, without side effects. A run that continues from it is not
        bit-exact."""
        ...


def build_hardware(
    backend: Backend,
    scene: SceneDescription,
    robot: RobotDescription,
    seed: int,
    start: Mapping[str, Any] | None = None,
) -> Simulation:
    """Build a simulation of the scene: with items spawned by `seed`, or from a checkpoint's plain values.

    Raises PicktreeError for a checkpoint of another backend, scene or seed.
    """
    robot = replace(robot, tool=scene.tool_error)
    if backend == "kinematic":
        from picktree.simulation.kinematic import KinematicHardware

        if start is None:
            return KinematicHardware(scene, robot, seed)
        return KinematicHardware.resume(scene, robot, seed, KinematicState.from_plain(start))
    from picktree.simulation.physics import PhysicsHardware

    return PhysicsHardware(scene, robot, seed, None if start is None else Checkpoint.from_plain(start))
