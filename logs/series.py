"""Time series of a log: ticks and images by number, and readings of joints, gripper, wrist and servo as
arrays."""

from __future__ import annotations

import bisect
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

from picktree.files import PicktreeError
from picktree.world import Array, Tick

from . import topics
from .optional_libraries import PandasTable
from .run_log import CameraImage, RunLog, Stamped

_TIME_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True, repr=False)
class TickAt:
    """Tick with its number, 0 for the first of the log, and its simulated time, s."""

    number: int
    time: float
    record: Tick

    def __repr__(self) -> str:
        at = f", {self.record.tip} runs" if self.record.tip else ""
        return f"<tick {self.number} at {self.time:.2f} s: {self.record.root_status}{at}>"


class TickSequence(Sequence[TickAt]):
    """Ticks of a log, decoded one by one on access.

    A loop over all of them (`for tick in ticks`, or a slice) is many times as fast as access to each.
    """

    def __init__(self, log: RunLog) -> None:
        self._log = log
        self.times: tuple[float, ...] = tuple(log.times(topics.TICK.name))
        """Times of the ticks, simulated s."""

    def __repr__(self) -> str:
        return f"<{len(self)} ticks{_span(self.times)}>"

    def __len__(self) -> int:
        return len(self.times)

    @overload
    def __getitem__(self, index: int) -> TickAt: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[TickAt, ...]: ...
    def __getitem__(self, index: int | slice) -> TickAt | tuple[TickAt, ...]:
        numbers = range(len(self))[index]
        if isinstance(numbers, range):
            return self._several(numbers)
        time = self.times[numbers]
        found = self._log.tick_at(time)
        assert found is not None
        return TickAt(numbers, time, found.record)

    def __iter__(self) -> Iterator[TickAt]:
        for number, at in enumerate(self._log.ticks()):
            yield TickAt(number, at.time, at.record)

    def number_at(self, time: float) -> int:
        """Return the number of the last tick at `time` (simulated s) or before; the first for a time before
        it.

        Raises PicktreeError when the log holds no tick.
        """
        if not self.times:
            raise PicktreeError(f"{self._log.path}: the log holds no tick")
        return max(bisect.bisect_right(self.times, time + _TIME_TOLERANCE) - 1, 0)

    def _several(self, numbers: range) -> tuple[TickAt, ...]:
        if not numbers:
            return ()
        low, high = min(numbers), max(numbers)
        read = self._log.ticks(self.times[low], self.times[high])
        span = {number: TickAt(number, at.time, at.record) for number, at in enumerate(read, low)}
        return tuple(span[number] for number in numbers)


class ImageSequence(Sequence[Stamped[CameraImage]]):
    """Images of a log, of all its cameras in order of time, decoded one by one on access."""

    def __init__(self, log: RunLog) -> None:
        self._log = log
        kinds = (topics.depth_topic, topics.colour_topic, topics.calibration_topic)
        index = [
            (time, camera)
            for camera in log.cameras
            for time in set[float].intersection(*(set(log.times(kind(camera).name)) for kind in kinds))
        ]
        index.sort(key=lambda shot: shot[0])
        self.times: tuple[float, ...] = tuple(time for time, _ in index)
        """Times of the images, simulated s."""
        self.cameras: tuple[str, ...] = tuple(camera for _, camera in index)
        """Camera of each image."""

    def __repr__(self) -> str:
        by = f" by {', '.join(sorted(set(self.cameras)))}" if self.cameras else ""
        return f"<{len(self)} images{by}{_span(self.times)}>"

    def __len__(self) -> int:
        return len(self.times)

    @overload
    def __getitem__(self, index: int) -> Stamped[CameraImage]: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Stamped[CameraImage], ...]: ...
    def __getitem__(self, index: int | slice) -> Stamped[CameraImage] | tuple[Stamped[CameraImage], ...]:
        if isinstance(index, slice):
            return tuple(self[number] for number in range(*index.indices(len(self))))
        number = range(len(self))[index]
        time = self.times[number]
        # The three messages of an image have one stamp.
        return next(self._log.images(self.cameras[number], time - _TIME_TOLERANCE, time + _TIME_TOLERANCE))

    def before(self, time: float, camera: str | None = None) -> Stamped[CameraImage] | None:
        """Return the last image at `time` (simulated s) or before, of that camera or any; None without
        one."""
        for number in range(bisect.bisect_right(self.times, time + _TIME_TOLERANCE) - 1, -1, -1):
            if camera is None or self.cameras[number] == camera:
                return self[number]
        return None


def _span(times: Sequence[float]) -> str:
    return f", {times[0]:.2f} … {times[-1]:.2f} s" if times else ""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class JointSeries(PandasTable):
    """Readings of the joints, one row for each: `times` (n,) s, the others (n, joints)."""

    names: tuple[str, ...]
    """Names of the columns: the arm's joints, then the fingers'."""
    times: NDArray[np.float64]
    """Times of the readings, simulated s."""
    positions: NDArray[np.float64]
    """Joint positions, rad; of fingers m."""
    velocities: NDArray[np.float64]
    """Joint velocities, rad/s; of fingers m/s."""
    efforts: NDArray[np.float64]
    """Joint efforts, Nm; of fingers N."""

    def column(self, name: str) -> int:
        """Return the column of a joint. Raises PicktreeError for an unknown name."""
        if name not in self.names:
            raise PicktreeError(f"no joint {name!r}; the log has: {', '.join(self.names) or 'none'}")
        return self.names.index(name)

    def columns_by_name(self) -> Mapping[str, NDArray[np.float64]]:
        """Return `time` and three columns a joint: `NAME.position`, `NAME.velocity`, `NAME.effort`."""
        readings = {"position": self.positions, "velocity": self.velocities, "effort": self.efforts}
        return {"time": self.times} | {
            f"{joint}.{name}": values[:, column]
            for column, joint in enumerate(self.names)
            for name, values in readings.items()
        }

    def __repr__(self) -> str:
        return f"<{len(self.times)} readings of {', '.join(self.names) or 'no joint'}>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GripperSeries(PandasTable):
    """Readings of the gripper: `times` (n,) s, `widths` (n,) m between the fingers, `forces` (n,) N.

    The force is that of the finger with the greater force.
    """

    times: NDArray[np.float64]
    widths: NDArray[np.float64]
    forces: NDArray[np.float64]

    def columns_by_name(self) -> Mapping[str, NDArray[np.float64]]:
        return {"time": self.times, "width": self.widths, "force": self.forces}

    def __repr__(self) -> str:
        return f"<{len(self.times)} readings of the gripper>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class WrenchSeries(PandasTable):
    """Readings of the external wrench at the wrist, in world axes.

    `times` (n,) s, `forces` (n, 3) N, `torques` (n, 3) Nm.
    """

    times: NDArray[np.float64]
    forces: NDArray[np.float64]
    torques: NDArray[np.float64]

    def columns_by_name(self) -> Mapping[str, NDArray[np.float64]]:
        parts = {"force": self.forces, "torque": self.torques}
        return {"time": self.times} | {
            f"{name}.{axis}": values[:, column]
            for name, values in parts.items()
            for column, axis in enumerate("xyz")
        }

    def __repr__(self) -> str:
        return f"<{len(self.times)} readings of the wrist>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ControlSeries:
    """Set points of the arm's servo: `times` (n,) s, `controllers` by tick, `references` and `errors` (n,
    joints) rad.

    NaN while torques were commanded. Empty for a log without this topic.
    """

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
    """Return the gripper's readings; empty without fingers. `fingers` are joints whose positions add up to
    the opening."""
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
    """Return a read-only view; a million numbers are not copied."""
    return (
        np.frombuffer(values).reshape((rows,) if columns is None else (rows, columns))
        if rows
        else (np.zeros((0,) if columns is None else (0, columns)))
    )
