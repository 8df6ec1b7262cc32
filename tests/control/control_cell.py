"""A Panda above a table on the kinematic backend, with everything that moves it."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import numpy as np
import pinocchio as pin

from picktree.robot.control import ArmMotion, ControlLoop, GripperControl, SafetyMonitor
from picktree.simulation.kinematic import KinematicHardware
from picktree.world import Array, Bounds, Box, Journal, JournalEvent, ObjectId, Pose, Trajectory
from picktree.world.robot_model import RobotDescription, RobotModel, load_robot
from picktree.world.scene import Bin, CatalogueEntry, Fixture, SafetyLimits, SceneDescription, Spawn

if TYPE_CHECKING:
    from picktree.simulation.physics import PhysicsHardware

T = TypeVar("T")
TICK = 0.05
DOWN = (1.0, 0.0, 0.0, 0.0)
"""Orientation of the TCP that looks straight down, fingers along y."""
BLOCK = CatalogueEntry("block", "box", Box((0.04, 0.04, 0.04)), 0.1, 0.6)
ROBOT = load_robot("panda")
MODEL = RobotModel(ROBOT)
HOME = MODEL.named("home")


def table_scene(items: int = 0, force: float = 60.0) -> SceneDescription:
    """A table whose top is at z = 0, a bin, and blocks."""
    return SceneDescription(
        name="table",
        robot="panda",
        fixtures=(Fixture(ObjectId("table"), Box((1.2, 1.6, 0.04)), Pose((0.5, 0.0, -0.02))),),
        bins=(Bin(ObjectId("red_bin"), (0.25, 0.2, 0.1), 0.005, Pose((0.35, 0.55, 0.0))),),
        cameras=(),
        catalogue=(BLOCK,),
        spawn=(Spawn({"block": items}, ("red",), ((0.4, -0.2), (0.6, 0.2))),) if items else (),
        destinations=(),
        limits=SafetyLimits(force=force, workspace=Bounds((-0.5, -1.0, -0.02), (1.0, 1.0, 1.5))),
    )


Backend: TypeAlias = (
    "Callable[[SceneDescription, RobotDescription, int], KinematicHardware | PhysicsHardware]"
)


class Cell:
    """Hardware, loop, motions and grip, and a way to run a generator tick by tick."""

    def __init__(self, items: int = 0, force: float = 60.0, backend: Backend = KinematicHardware) -> None:
        scene = table_scene(items, force)
        self.hardware = backend(scene, ROBOT, 7)
        self.model = RobotModel(ROBOT)
        self.journal = Journal()
        self.monitor = SafetyMonitor(self.model, scene.limits, self.journal)
        self.loop = ControlLoop(self.hardware, self.model, self.monitor)
        self.move = ArmMotion(self.loop, self.model, self.hardware.clock, self.journal)
        self.grip = GripperControl(self.hardware.gripper, self.hardware.clock, ROBOT.gripper)

    def run(self, doing: Generator[None, None, T], ticks: int = 400) -> T:
        """Run to the end; fails when it takes more than `ticks`."""
        for _ in range(ticks):
            try:
                next(doing)
            except StopIteration as end:
                return end.value
            self.loop.step_tick(TICK)
        raise AssertionError(f"not done after {ticks} ticks")

    def ticks(self, doing: Generator[None, None, object], count: int) -> None:
        """Run the first `count` ticks of it."""
        for _ in range(count):
            next(doing)
            self.loop.step_tick(TICK)

    def rest(self, ticks: int = 60) -> None:
        """Let time pass until the arm rests."""
        for _ in range(ticks):
            if self.loop.at_rest:
                return
            self.loop.step_tick(TICK)
        raise AssertionError(f"not at rest after {ticks} ticks")

    def go(self, x: float, y: float, z: float) -> None:
        """Move the TCP there, looking down."""
        start = self.loop.held_position
        goal = reach(Pose((x, y, z), DOWN), start)
        self.run(self.move.along(swing(start, goal, 2.0)))

    def events(self) -> list[JournalEvent]:
        return [entry for entry in self.journal.take() if isinstance(entry, JournalEvent)]


def swing(start: Array, end: Array, duration: float = 2.0) -> Trajectory:
    """From rest to rest with a polynomial of the fifth degree."""
    t = np.linspace(0.0, duration, round(duration / 0.01) + 1)
    x = (t / duration)[:, None]
    way = end - start
    return Trajectory(
        t,
        start + (10 * x**3 - 15 * x**4 + 6 * x**5) * way,
        (30 * x**2 - 60 * x**3 + 30 * x**4) / duration * way,
        (60 * x - 180 * x**2 + 120 * x**3) / duration**2 * way,
    )


def reach(tcp: Pose, near: Array) -> Array:
    """Inverse kinematics by damped least squares."""
    q = near.copy()
    for _ in range(500):
        at = MODEL.tcp(q)
        turn = np.asarray(pin.log3(tcp.rotation() @ at.rotation().T))
        error = np.concatenate([np.subtract(tcp.position, at.position), turn])
        if np.abs(error).max() < 1e-9:
            return q
        error *= min(1.0, 0.1 / float(np.linalg.norm(error)))
        jacobian = MODEL.jacobian(q)
        q = q + jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-6 * np.eye(6), error)
    raise AssertionError(f"cannot reach {tcp}")
