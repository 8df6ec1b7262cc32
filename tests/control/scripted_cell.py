"""A cell without physics whose sensors say what a test says."""

from __future__ import annotations

from typing import cast

import numpy as np

from picktree.robot.control import ControlLoop
from picktree.robot.control.joint_controllers import TrajectoryController
from picktree.robot.control.motion_lease import Lease
from picktree.simulation.kinematic import KinematicHardware
from picktree.world import GRAVITY, Array, Hardware, JointState, Wrench

from .control_cell import HOME, MODEL, Backend, Cell, swing

STILL = np.zeros(7)
ASIDE = HOME + 0.3
PERIOD = 1 / 240


class FeelingHardware(KinematicHardware):
    """The kinematic backend, whose drives tell their efforts."""

    feels_effort = True  # type: ignore[assignment]


class Readings:
    """Arm and wrist sensor of a cell, which say what the test says, and do not follow their commands."""

    def __init__(self, cell: Cell) -> None:
        self.position, self.velocity = HOME.copy(), STILL
        self.force = np.zeros(3)
        """Beyond the weight of the hand, N in the world."""
        self.torque = STILL
        """Beyond the arm's own weight, Nm."""
        self.told: tuple[Array, Array] | None = None
        self.torque_told: Array | None = None
        hardware = cast("Hardware", _Scripted(cell.hardware, self))
        cell.loop = ControlLoop(hardware, cell.model, cell.monitor)

    def read(self) -> JointState:
        return JointState(self.position, self.velocity, MODEL.gravity(self.position) + self.torque)

    def follow(self, position: Array, velocity: Array, ahead: tuple[Array, ...] = ()) -> None:
        self.told = position, velocity

    def apply_torque(self, torque: Array) -> None:
        self.torque_told = torque


class _Scripted:
    """Hardware with another arm and another wrist sensor."""

    def __init__(self, hardware: Hardware, readings: Readings) -> None:
        self._hardware = hardware
        self.arm, self.wrench = readings, _Sensor(readings)

    def __getattr__(self, name: str) -> object:
        return getattr(self._hardware, name)


class _Sensor:
    def __init__(self, readings: Readings) -> None:
        self._readings = readings

    def read(self) -> Wrench:
        weight = np.array([0.0, 0.0, -MODEL.hand_mass * GRAVITY])
        lever = MODEL.flange(self._readings.position).rotation() @ np.array(MODEL.hand_com)
        x, y, z = (weight + self._readings.force).tolist()
        a, b, c = np.cross(lever, weight).tolist()
        return Wrench((x, y, z), (a, b, c))


def scripted(backend: Backend = KinematicHardware) -> tuple[Cell, Readings]:
    cell = Cell(backend=backend)
    return cell, Readings(cell)


def steps(cell: Cell, count: int) -> None:
    for _ in range(count):
        cell.loop.step()


def moving() -> tuple[Cell, Readings, TrajectoryController, Lease]:
    cell, readings = scripted()
    track = TrajectoryController(swing(HOME, ASIDE, 3.0), MODEL, cell.loop.period)
    lease = cell.loop.acquire("test")
    lease.run(track)
    steps(cell, 1)
    return cell, readings, track, lease


def flange_jacobian(q: Array) -> Array:
    """(6, n) about the sensor, world axes, by finite differences."""
    rows = np.zeros((6, 7))
    for k in range(7):
        step = 1e-6 * np.eye(7)[k]
        ahead, behind = MODEL.flange(q + step), MODEL.flange(q - step)
        rows[:3, k] = np.subtract(ahead.position, behind.position) / 2e-6
        turn = (ahead.rotation() @ behind.rotation().T) / 2e-6
        rows[3:, k] = (
            (turn[2, 1] - turn[1, 2]) / 2,
            (turn[0, 2] - turn[2, 0]) / 2,
            (turn[1, 0] - turn[0, 1]) / 2,
        )
    return rows
