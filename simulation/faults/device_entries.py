"""Faults of the robot's devices (arm, gripper, wrist sensor, cameras), the planner and the program. `lasts`
in s; None: for good."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

from ...world.values import Pose, Vector3


@dataclass(frozen=True, slots=True)
class AtTime:
    """Occasions at the simulated time `time`, s; with `every`, repeated at that interval, s."""

    time: float
    every: float | None = None
    probability: float = 1.0
    """Probability that the fault happens at one of its occasions, drawn from a stream of its own."""


@dataclass(frozen=True, slots=True)
class AtNode:
    """Occasion `delay` s after the node that fits `pattern` has started for the `start`-th time (from 1).
    With `each` at every start from that one on."""

    pattern: str
    start: int = 1
    delay: float = 0.0
    each: bool = False
    probability: float = 1.0
    """Probability that the fault happens at one of its occasions, drawn from a stream of its own."""


When: TypeAlias = AtTime | AtNode


@dataclass(frozen=True, slots=True)
class Hang:
    """The running skill yields for ever: it never ends until it is halted."""

    name: ClassVar[str] = "hang"
    when: When


@dataclass(frozen=True, slots=True)
class Raise:
    """The code of the running skill raises an exception."""

    name: ClassVar[str] = "raise"
    when: When


@dataclass(frozen=True, slots=True)
class Kill:
    """The process is killed (SIGKILL)."""

    name: ClassVar[str] = "kill"
    when: When


ProgramFault: TypeAlias = Hang | Raise | Kill


@dataclass(frozen=True, slots=True)
class GripperJam:
    """The fingers stay in place, ignore commands, and keep pressing on the item that they hold."""

    name: ClassVar[str] = "gripper_jam"
    when: When
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class GripperWeak:
    """The fingers press with a share of the commanded force."""

    name: ClassVar[str] = "gripper_weak"
    when: When
    share: float
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class JointWeak:
    """The joint's torque is at most a share of what it could give."""

    name: ClassVar[str] = "joint_weak"
    when: When
    joint: str
    share: float
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class Stall:
    """The arm ignores commands: its drives hold it in place."""

    name: ClassVar[str] = "stall"
    when: When
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class WrenchBias:
    """The wrist's sensor has a bias: force, N, and torque, Nm, in its own axes."""

    name: ClassVar[str] = "wrench_bias"
    when: When
    force: Vector3
    torque: Vector3 = (0.0, 0.0, 0.0)
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class WrenchDead:
    """The wrist's sensor is silent: its reading and its time stamp do not change."""

    name: ClassVar[str] = "wrench_dead"
    when: When
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class CameraDrop:
    """A camera (None: any) gives no image, for a time or for a number of images."""

    name: ClassVar[str] = "camera_drop"
    when: When
    camera: str | None = None
    lasts: float | None = None
    images: int | None = None


@dataclass(frozen=True, slots=True)
class CameraShift:
    """A camera's true optical frame is moved, given in the frame as it was: x right, y down, z forward."""

    name: ClassVar[str] = "camera_shift"
    when: When
    moved: Pose
    camera: str | None = None
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class CameraNoise:
    """The noise of a camera's depth and colour is `factor` times as large."""

    name: ClassVar[str] = "camera_noise"
    when: When
    factor: float
    camera: str | None = None
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class CameraMislabel:
    """A camera shows one colour of items as another; `swapped`: and the other as the one."""

    name: ClassVar[str] = "camera_mislabel"
    when: When
    colour: str
    shown_as: str
    swapped: bool = False
    camera: str | None = None
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class NoPlan:
    """The planner finds no path, for a time or for a number of requests."""

    name: ClassVar[str] = "no_plan"
    when: When
    lasts: float | None = None
    requests: int | None = None


def counted(fault: object) -> bool:
    """Return whether the fault can end after a number of images or requests."""
    return isinstance(fault, CameraDrop | NoPlan)


CameraFault: TypeAlias = CameraDrop | CameraShift | CameraNoise | CameraMislabel
Ailing: TypeAlias = (
    GripperJam | GripperWeak | JointWeak | Stall | WrenchBias | WrenchDead | CameraFault | NoPlan
)
"""Faults that last: each begins and ends, unless it is for good."""
