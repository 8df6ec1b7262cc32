"""The two backends behind one protocol: physics, and a kinematic one without it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, Protocol, TypeAlias

from ..protocols import Hardware
from ..robot.description import RobotDescription
from ..scene.description import SceneDescription
from .faults import Faulty

Backend: TypeAlias = Literal["physics", "kinematic"]


class Saved(Protocol):
    """A backend's checkpoint."""

    def to_plain(self) -> dict[str, Any]: ...


class Simulation(Hardware, Faulty, Protocol):
    """Simulated hardware: it knows the truth, lets faults happen, can be saved, says how it is set."""

    def checkpoint(self) -> Saved: ...
    def settings(self) -> Mapping[str, str]: ...


def build_hardware(
    backend: Backend, scene: SceneDescription, robot: RobotDescription, seed: int
) -> Simulation:
    """A simulation of the scene with everything spawned by `seed`."""
    if backend == "kinematic":
        from .kinematic import KinematicHardware

        return KinematicHardware(scene, robot, seed)
    from .physics import PhysicsHardware

    return PhysicsHardware(scene, robot, seed)
