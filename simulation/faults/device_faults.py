"""What is wrong with the devices of a simulated robot: nothing, unless a fault says so."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from ...world.protocols import Clock, Gripper
from ...world.scene.description import Fixture
from ...world.values import Array, ObjectId, Pose, Quaternion, Vector3, Wrench, rotated
from ..checkpoints.physics_state import GripperCommand
from ..fault_files.device_entries import (
    Ailing,
    CameraDrop,
    CameraFault,
    CameraMislabel,
    CameraNoise,
    CameraShift,
    GripperJam,
    GripperWeak,
    JointWeak,
    NoPlan,
    Stall,
    WrenchBias,
    WrenchDead,
)
from ..scoring.truth import TrueBody, TrueObstacle

SQUEEZE = 1e-3
"""Fingers that jam while they press go on pressing: they aim so far inside of what they hold, m."""


@dataclass(frozen=True, slots=True)
class FrozenReading:
    """The last that a sensor has said, and when, s."""

    wrench: Wrench
    since: float


@dataclass(frozen=True, slots=True)
class CameraFaultState:
    """What is wrong with one camera now."""

    drops: tuple[int, ...] = ()
    """The faults that keep its images back, by number."""
    moved: Pose = field(default_factory=Pose)
    """Its optical frame in the frame as it was."""
    noise: float = 1.0
    """How many times as noisy it is."""
    shown: Mapping[str, str] = field(default_factory=dict[str, str])
    """Colours that are shown as others."""


class DeviceFaults:
    """The faults of devices that last now, by their number in the fault file, and what they come to. Held by
    a backend; its devices ask."""

    def __init__(self, cameras: Iterable[str]) -> None:
        self._names = tuple(cameras)
        self._active: dict[int, Ailing] = {}
        self._held: dict[int, tuple[float, ...]] = {}
        self._sum_up()

    def begin(self, number: int, fault: Ailing, held: tuple[float, ...]) -> None:
        """`held`: what the device was doing then: of a jam the opening, m, and force, N, that the drives
        keep; of a silent sensor its last reading (6,) and its time, s; of what is counted the count."""
        self._active[number] = fault
        self._held[number] = held
        self._sum_up()

    def end(self, number: int) -> None:
        del self._active[number], self._held[number]
        self._sum_up()

    @property
    def any(self) -> bool:
        """Whether anything is wrong."""
        return bool(self._active)

    def held(self, number: int) -> tuple[float, ...]:
        """As it was given to `begin`, counted up to now; of what does not last, nothing."""
        return self._held.get(number, ())

    def spent(self, number: int) -> bool:
        """Whether as many images or requests as the fault was to last for are over."""
        fault = self._active.get(number)
        match fault:
            case CameraDrop(images=int(most)) | NoPlan(requests=int(most)):
                return self._held[number][0] >= most
            case _:
                return False

    def dropped(self, camera: str) -> bool:
        """Asked for each image: whether it does not come."""
        trouble = self.cameras.get(camera)
        return trouble is not None and self._counted(trouble.drops)

    def no_plan(self) -> bool:
        """Asked for each request to the planner: whether it finds nothing."""
        return self._counted(self._planless)

    def off(self, turn: Quaternion) -> tuple[float, ...]:
        """What the wrist's sensor is off by, (6,) N and Nm in the world's axes, it being turned like that."""
        force, torque = self.bias
        return (*rotated(turn, force), *rotated(turn, torque))

    def _counted(self, numbers: Iterable[int]) -> bool:
        """Whether any of them still has something to keep back; each of those has kept back one more."""
        lasting = [number for number in numbers if not self.spent(number)]
        for number in lasting:
            self._held[number] = (self._held[number][0] + 1.0,)
        return bool(lasting)

    def _sum_up(self) -> None:
        """What all of them come to."""
        faults = self._active
        self.stalled = any(isinstance(f, Stall) for f in faults.values())
        jams = [n for n, f in faults.items() if isinstance(f, GripperJam)]
        self.jam: GripperCommand | None = GripperCommand(*self._held[jams[0]]) if jams else None
        """What the fingers' drives do instead of what they are told."""
        self.grip_share = math.prod(f.share for f in faults.values() if isinstance(f, GripperWeak))
        self.torque_shares: dict[str, float] = {}
        for fault in faults.values():
            if isinstance(fault, JointWeak):
                self.torque_shares[fault.joint] = self.torque_shares.get(fault.joint, 1.0) * fault.share
        silent = [self._held[n] for n, f in faults.items() if isinstance(f, WrenchDead)]
        self.silence = _silence(silent[0]) if silent else None
        biases = [f for f in faults.values() if isinstance(f, WrenchBias)]
        self.biased = bool(biases)
        self.bias = (_total(f.force for f in biases), _total(f.torque for f in biases))
        self._planless = [n for n, f in faults.items() if isinstance(f, NoPlan)]
        self.cameras: dict[str, CameraFaultState] = {}
        for name in self._names:
            of = {
                n: f
                for n, f in faults.items()
                if isinstance(f, CameraDrop | CameraShift | CameraNoise | CameraMislabel)
                and f.camera in (None, name)
            }
            if of:
                self.cameras[name] = _trouble(of)


def jammed(told: GripperCommand, width: float, most: float) -> tuple[float, float]:
    """What the drives of fingers go on doing that jam at that opening, m: opening and force; `most`: the
    greatest force, N."""
    if told.width < width - SQUEEZE:
        return max(width - SQUEEZE, 0.0), told.force
    return width, most


def clipped(torque: Array, limits: Array) -> Array:
    """Torques (n,) as far as joints with these limits (n,) give them, Nm."""
    return torque.clip(-limits, limits)


def _silence(held: tuple[float, ...]) -> FrozenReading:
    fx, fy, fz, tx, ty, tz, since = held
    return FrozenReading(Wrench((fx, fy, fz), (tx, ty, tz)), since)


def _total(vectors: Iterable[Vector3]) -> Vector3:
    x, y, z = 0.0, 0.0, 0.0
    for a, b, c in vectors:
        x, y, z = x + a, y + b, z + c
    return x, y, z


def _trouble(faults: Mapping[int, CameraFault]) -> CameraFaultState:
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
    """A simulated robot and its surroundings."""

    @property
    def clock(self) -> Clock: ...
    @property
    def gripper(self) -> Gripper: ...
    @property
    def ailments(self) -> DeviceFaults:
        """What is wrong with its devices now."""
        ...

    def truth(self) -> tuple[TrueBody, ...]: ...
    def true_tcp(self) -> Pose: ...
    def in_hand(self) -> ObjectId | None:
        """The item that the fingers really hold."""
        ...

    def remove(self, item: str) -> None: ...
    def change_dynamics(
        self, item: str, friction: float | None = None, mass: float | None = None
    ) -> None: ...
    def bump(self, item: str, velocity: Vector3, spin: Vector3 = (0.0, 0.0, 0.0)) -> None: ...
    def lubricate(self, item: str, friction: float | None, *, again: bool = False) -> None:
        """The item has that friction until it is given its own back, None. `again`: it had it when the
        checkpoint was taken."""
        ...

    def enlarge(self, item: str, factor: float) -> bool:
        """The item becomes so many times as large; False: there is no room for that now."""
        ...

    def appear(self, kind: str, colour: str, place: tuple[float, float], yaw: float) -> ObjectId | None:
        """A further item comes to lie there; None: something is there now. Raises PicktreeError where nothing
        is below."""
        ...

    def obstacles(self) -> tuple[TrueObstacle, ...]: ...
    def room_for(self, body: Fixture) -> bool: ...
    def put_obstacle(self, body: Fixture) -> ObjectId: ...
    def take_obstacle(self, name: ObjectId) -> None: ...
    def afflict(self, number: int, fault: Ailing, held: tuple[float, ...] | None = None) -> None:
        """A device begins to fail. `held`: it did when the checkpoint was taken, and that was what the device
        was doing when it began."""
        ...

    def relieve(self, number: int) -> None:
        """It works again."""
        ...
