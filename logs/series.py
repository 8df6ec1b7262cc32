"""Readings over time as arrays: joints, gripper, wrist, servo."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import PicktreeError
from ..world.values import Array
from .run_log import RunLog


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class JointSeries:
    """All readings of the joints, one row for each: `times` (n,) s, the others (n, joints)."""

    names: tuple[str, ...]
    """Of the columns: the arm's joints, then the fingers'."""
    times: NDArray[np.float64]
    """Simulated s."""
    positions: NDArray[np.float64]
    """rad, of fingers m."""
    velocities: NDArray[np.float64]
    """rad/s, of fingers m/s."""
    efforts: NDArray[np.float64]
    """Nm, of fingers N."""

    def column(self, name: str) -> int:
        """Where a joint stands in each row. Raises PicktreeError for an unknown name."""
        if name not in self.names:
            raise PicktreeError(f"no joint {name!r}; the log has: {', '.join(self.names) or 'none'}")
        return self.names.index(name)

    def __repr__(self) -> str:
        return f"<{len(self.times)} readings of {', '.join(self.names) or 'no joint'}>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GripperSeries:
    """All readings of the gripper: `times` (n,) s, `widths` (n,) m between the fingers, `forces` (n,) N of
    the finger that presses most."""

    times: NDArray[np.float64]
    widths: NDArray[np.float64]
    forces: NDArray[np.float64]

    def __repr__(self) -> str:
        return f"<{len(self.times)} readings of the gripper>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class WrenchSeries:
    """All readings of the external wrench at the wrist, in the world's axes: `times` (n,) s, `forces` (n, 3)
    N, `torques` (n, 3) Nm."""

    times: NDArray[np.float64]
    forces: NDArray[np.float64]
    torques: NDArray[np.float64]

    def __repr__(self) -> str:
        return f"<{len(self.times)} readings of the wrist>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ControlSeries:
    """What the arm's servo had been told: `times` (n,) s, `controllers` by tick, `references` and `errors`
    (n, joints) rad, NaN while torques were commanded. Empty for a log that does not tell."""

    times: NDArray[np.float64]
    controllers: tuple[str, ...]
    references: NDArray[np.float64]
    errors: NDArray[np.float64]

    def __repr__(self) -> str:
        return f"<{len(self.times)} readings of the arm's servo>"


def joint_series(log: RunLog) -> JointSeries:
    names: tuple[str, ...] = ()
    times, positions, velocities, efforts = array("d"), array("d"), array("d"), array("d")
    for at in log.joints():
        names = names or at.record.names
        times.append(at.time)
        positions.extend(at.record.position)
        velocities.extend(at.record.velocity)
        efforts.extend(at.record.effort)
    rows, columns = len(times), len(names)
    return JointSeries(
        names,
        _rows(times, rows),
        *(_rows(values, rows, columns) for values in (positions, velocities, efforts)),
    )


def gripper_series(joints: JointSeries, fingers: Iterable[str]) -> GripperSeries:
    """`fingers` are joints whose positions add up to the opening. Empty when there is none."""
    columns = [joints.column(name) for name in fingers]
    if not columns:
        none = np.zeros(0)
        return GripperSeries(none, none, none)
    return GripperSeries(
        joints.times, joints.positions[:, columns].sum(axis=1), joints.efforts[:, columns].max(axis=1)
    )


def wrench_series(log: RunLog) -> WrenchSeries:
    times, forces, torques = array("d"), array("d"), array("d")
    for at in log.wrenches():
        force, torque = at.record.force, at.record.torque
        times.append(at.time)
        forces.extend((force.x, force.y, force.z))
        torques.extend((torque.x, torque.y, torque.z))
    return WrenchSeries(_rows(times, len(times)), *(_rows(v, len(times), 3) for v in (forces, torques)))


def control_series(log: RunLog) -> ControlSeries:
    read = [(at.time, at.record) for at in log.controls()]
    joints = max((len(control.reference) for _, control in read), default=0)
    unknown = (float("nan"),) * joints
    return ControlSeries(
        np.array([time for time, _ in read]),
        tuple(control.controller for _, control in read),
        np.array([control.reference or unknown for _, control in read]).reshape(len(read), joints),
        np.array([control.error or unknown for _, control in read]).reshape(len(read), joints),
    )


def _rows(values: array[float], rows: int, columns: int | None = None) -> Array:
    """A read-only view; a million numbers are not copied."""
    return (
        np.frombuffer(values).reshape((rows,) if columns is None else (rows, columns))
        if rows
        else (np.zeros((0,) if columns is None else (0, columns)))
    )
