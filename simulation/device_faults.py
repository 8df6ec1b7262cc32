"""Active faults of a simulated robot's devices, and the protocol of a robot in which faults can be
injected."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from picktree.world import (
    Clock,
    Gripper,
    GripperCommand,
    ObjectId,
    Pose,
    Quaternion,
    Vector3,
    Wrench,
    rotated,
)
from picktree.world.scene import Fixture

from .fault_entries import (
    CameraDrop,
    CameraFaults,
    CameraMislabel,
    CameraNoise,
    CameraShift,
    GripperJam,
    GripperWeak,
    JointWeak,
    LastingFault,
    NoPlan,
    Stall,
    WrenchBias,
    WrenchDead,
)
from .truth import TrueBody, TrueObstacle

JAM_SQUEEZE_DEPTH = 1e-3
"""Depth inside the gripped item at which jammed fingers aim, so that they keep pressing, m."""


@dataclass(frozen=True, slots=True)
class FrozenReading:
    """Last reading of a silent sensor, and its time, s."""

    wrench: Wrench
    since: float


@dataclass(frozen=True, slots=True)
class CameraFaultState:
    """Active faults of one camera."""

    drops: tuple[int, ...] = ()
    """Numbers of the faults that drop its images."""
    moved: Pose = field(default_factory=Pose)
    """True optical frame in the frame before the fault."""
    noise: float = 1.0
    """Factor on the camera's noise."""
    shown: Mapping[str, str] = field(default_factory=dict[str, str])
    """Colours that are shown as others: true colour to shown colour."""


class DeviceFaults:
    """Active faults of devices by their number in the fault file, and their joint effect. A backend holds it;
    its devices read it."""

    def __init__(self, cameras: Iterable[str]) -> None:
        self._names = tuple(cameras)
        self._active: dict[int, LastingFault] = {}
        self._held: dict[int, tuple[float, ...]] = {}
        self._sum_up()

    def begin(self, number: int, fault: LastingFault, held: tuple[float, ...]) -> None:
        """Begin a fault. `held` is the device's state at that moment.

        For a jam: opening, m, and force, N, that the drives keep. For a silent sensor: its last reading (6,)
        and its time, s. For a counted fault: the count.
        """
        self._active[number] = fault
        self._held[number] = held
        self._sum_up()

    def end(self, number: int) -> None:
        del self._active[number], self._held[number]
        self._sum_up()

    @property
    def any(self) -> bool:
        """Whether any fault is active."""
        return bool(self._active)

    def held(self, number: int) -> tuple[float, ...]:
        """Return the `held` of `begin`, counted up to now; empty for a fault that is not active."""
        return self._held.get(number, ())

    def spent(self, number: int) -> bool:
        """Return whether a counted fault has used up its number of images or requests."""
        fault = self._active.get(number)
        match fault:
            case CameraDrop(images=int(most)) | NoPlan(requests=int(most)):
                return self._held[number][0] >= most
            case _:
                return False

    def dropped(self, camera: str) -> bool:
        """Return whether the next image of a camera is dropped, and count it. Called once for each image."""
        trouble = self.cameras.get(camera)
        return trouble is not None and self._counted(trouble.drops)

    def no_plan(self) -> bool:
        """Return whether the planner finds nothing for the next request, and count it. Called once for each
        request."""
        return self._counted(self._planless)

    def wrench_bias(self, turn: Quaternion) -> tuple[float, ...]:
        """Return the bias of the wrist's sensor, (6,), N and Nm, in the world's axes; `turn` is the sensor's
        orientation in the world."""
        force, torque = self.bias
        return (*rotated(turn, force), *rotated(turn, torque))

    def _counted(self, numbers: Iterable[int]) -> bool:
        """Return whether any of these counted faults is not used up; counts one more for each of them."""
        lasting = [number for number in numbers if not self.spent(number)]
        for number in lasting:
            self._held[number] = (self._held[number][0] + 1.0,)
        return bool(lasting)

    def _sum_up(self) -> None:
        """Compute the joint effect of all active faults."""
        faults = self._active
        self.stalled = any(isinstance(f, Stall) for f in faults.values())
        jams = [n for n, f in faults.items() if isinstance(f, GripperJam)]
        self.jam: GripperCommand | None = GripperCommand(*self._held[jams[0]]) if jams else None
        """Command that jammed fingers follow in place of the received one; None: no jam."""
        self.grip_share = math.prod(f.share for f in faults.values() if isinstance(f, GripperWeak))
        self.torque_shares: dict[str, float] = {}
        for fault in faults.values():
            if isinstance(fault, JointWeak):
                self.torque_shares[fault.joint] = self.torque_shares.get(fault.joint, 1.0) * fault.share
        silent = [self._held[n] for n, f in faults.items() if isinstance(f, WrenchDead)]
        self.silence = _frozen_reading(silent[0]) if silent else None
        biases = [f for f in faults.values() if isinstance(f, WrenchBias)]
        self.biased = bool(biases)
        self.bias = (_total(f.force for f in biases), _total(f.torque for f in biases))
        self._planless = [n for n, f in faults.items() if isinstance(f, NoPlan)]
        self.cameras: dict[str, CameraFaultState] = {}
        for name in self._names:
            of = {n: f for n, f in faults.items() if isinstance(f, CameraFaults) and f.camera in (None, name)}
            if of:
                self.cameras[name] = _camera_state(of)


def jam_command(command: GripperCommand, width: float, most: float) -> tuple[float, float]:
    """Return opening, m, and force, N, that the drives of fingers keep when they jam at opening `width`, m.
    `most`: greatest force, N."""
    if command.width < width - JAM_SQUEEZE_DEPTH:
        return max(width - JAM_SQUEEZE_DEPTH, 0.0), command.force
    return width, most


def _frozen_reading(held: tuple[float, ...]) -> FrozenReading:
    fx, fy, fz, tx, ty, tz, since = held
    return FrozenReading(Wrench((fx, fy, fz), (tx, ty, tz)), since)


def _total(vectors: Iterable[Vector3]) -> Vector3:
    x, y, z = 0.0, 0.0, 0.0
    for a, b, c in vectors:
        x, y, z = x + a, y + b, z + c
    return x, y, z


def _camera_state(faults: Mapping[int, CameraFaults]) -> CameraFaultState:
    moved, noise = Pose(), 1.0
    shown: dict[str, str] = {}
    for fault in faults.values():
        match fault:
            case CameraShift(moved=more):
                moved = moved @ more
            case CameraNoise(factor=factor):
                noise *= factor
            case CameraMislabel(colour=colour, shown_as=other, swapped=swapped):
                shown |= {colour: other, other: colour} if swapped else {colour: other}
            case CameraDrop():
                pass
    drops = tuple(n for n, fault in faults.items() if isinstance(fault, CameraDrop))
    return CameraFaultState(drops, moved, noise, shown)


class InjectableRobot(Protocol):
    """Protocol of a simulated robot and its surroundings in which faults can be injected."""

    @property
    def clock(self) -> Clock: ...
    @property
    def gripper(self) -> Gripper: ...
    @property
    def faults(self) -> DeviceFaults:
        """Active faults of its devices."""
        ...

    def recent_truth(self) -> tuple[TrueBody, ...]:
        """Return the ground truth of the items that did not leave, and of those that left with the latest
        exchange of each bin."""
        ...

    def true_tcp(self) -> Pose: ...
    def in_hand(self) -> ObjectId | None:
        """Return the item that the fingers truly hold; None: nothing."""
        ...

    def remove(self, item: str) -> None: ...
    def change_dynamics(
        self, item: str, friction: float | None = None, mass: float | None = None
    ) -> None: ...
    def friction_of(self, item: str) -> float:
        """Return the item's present coefficient of friction."""
        ...

    def bump(self, item: str, velocity: Vector3, spin: Vector3 = (0.0, 0.0, 0.0)) -> None: ...
    def lubricate(self, item: str, friction: float | None, *, again: bool = False) -> None:
        """Give the item another friction; None: its own again. `again`: it had that friction already when the
        checkpoint was taken."""
        ...

    def enlarge(self, item: str, factor: float) -> bool:
        """Scale the item by `factor`; False: there is no room for that now."""
        ...

    def appear(self, kind: str, colour: str, place: tuple[float, float], yaw: float) -> ObjectId | None:
        """Add an item at `place`; None: something is there now. Raises PicktreeError where nothing is
        below."""
        ...

    def obstacles(self) -> tuple[TrueObstacle, ...]: ...
    def room_for(self, body: Fixture) -> bool: ...
    def put_obstacle(self, body: Fixture) -> ObjectId: ...
    def take_obstacle(self, name: ObjectId) -> None: ...
    def afflict(self, number: int, fault: LastingFault, held: tuple[float, ...] | None = None) -> None:
        """Begin a fault of a device. `held` is given on restore: the device's state when the fault began."""
        ...

    def relieve(self, number: int) -> None:
        """End a fault of a device."""
        ...
