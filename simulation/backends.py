"""The two backends behind one protocol: physics, and a kinematic one without it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, Protocol, TypeAlias

from ..robots.description import RobotDescription
from ..world.journal import JournalEvent
from ..world.protocols import Hardware
from ..world.scene.description import Fixture, SceneDescription
from .faults.injector import InjectableRobot

Backend: TypeAlias = Literal["physics", "kinematic"]


class BackendCheckpoint(Protocol):
    """A backend's checkpoint."""

    def to_plain(self) -> dict[str, Any]: ...


class Simulation(Hardware, InjectableRobot, Protocol):
    """Simulated hardware: it knows the truth, lets faults happen, can be saved, says how it is set."""

    def take_events(self) -> tuple[JournalEvent, ...]:
        """What those who bring items and exchange bins have done since it was asked last."""
        ...

    def true_fixtures(self) -> tuple[Fixture, ...]:
        """The scene's fixtures where they really stand."""
        ...

    def checkpoint(self) -> BackendCheckpoint:
        """Save, and go on from what was saved."""
        ...

    def snapshot(self) -> BackendCheckpoint:
        """The state at any moment, without a change to anything; what goes on from it is not bit-exact."""
        ...

    def settings(self) -> Mapping[str, str]: ...


def build_hardware(
    backend: Backend,
    scene: SceneDescription,
    robot: RobotDescription,
    seed: int,
    start: Mapping[str, Any] | None = None,
) -> Simulation:
    """A simulation of the scene with everything spawned by `seed`, or as a checkpoint's plain values have it.

    Raises PicktreeError for a checkpoint of another backend, scene or seed.
    """
    robot = replace(robot, tool=scene.tool_error)
    if backend == "kinematic":
        from .checkpoints.kinematic_state import KinematicState
        from .kinematic.backend import KinematicHardware

        if start is None:
            return KinematicHardware(scene, robot, seed)
        return KinematicHardware.resume(scene, robot, seed, KinematicState.from_plain(start))
    from .checkpoints.physics_state import Checkpoint
    from .physics.backend import PhysicsHardware

    return PhysicsHardware(scene, robot, seed, None if start is None else Checkpoint.from_plain(start))
