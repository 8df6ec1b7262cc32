"""Values of fault file entries, made from entries that passed the checks: faults of items, obstacles, devices
and program."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

from ...world.scene.description import Fixture, Form
from ...world.scene.scene_entries import hidden_body
from ...world.values import Pose, Vector3
from .device_entries import (
    Ailing,
    AtNode,
    AtTime,
    CameraDrop,
    CameraMislabel,
    CameraNoise,
    CameraShift,
    GripperJam,
    GripperWeak,
    Hang,
    JointWeak,
    Kill,
    NoPlan,
    ProgramFault,
    Raise,
    Stall,
    When,
    WrenchBias,
    WrenchDead,
)
from .fault_schema import FaultEntryFile, TargetFile


@dataclass(frozen=True, slots=True)
class FaultTarget:
    """Target of a fault: a true item. Among the items that fit all given criteria it is the nearest to
    `nearest_to`, else the first.

    `tool` is the TCP; `object` is the believed place of the object that the node's port `object` names.
    """

    index: int | None = None
    """Number in the order of spawning, from 0."""
    kind: str | None = None
    form: Form | None = None
    colour: str | None = None
    nearest_to: Literal["tool", "object"] | None = None


@dataclass(frozen=True, slots=True)
class Remove:
    """The item is snatched away, out of the robot's world."""

    name: ClassVar[str] = "remove"
    when: When
    target: FaultTarget


@dataclass(frozen=True, slots=True)
class Friction:
    """The item gets another friction, and mass (kg) where one is given."""

    name: ClassVar[str] = "friction"
    when: When
    target: FaultTarget
    friction: float
    mass: float | None = None


@dataclass(frozen=True, slots=True)
class Bump:
    """The item gets a velocity (m/s, world) and a spin (rad/s, world) all at once."""

    name: ClassVar[str] = "bump"
    when: When
    target: FaultTarget
    velocity: Vector3
    spin: Vector3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Slip:
    """The item that the fingers hold, or hold next, has another friction for `lasts` s, or for good; then its
    own again."""

    name: ClassVar[str] = "slip"
    when: When
    friction: float = 0.0
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class Heavier:
    """The item has another mass, kg, than the catalogue says."""

    name: ClassVar[str] = "heavier"
    when: When
    target: FaultTarget
    mass: float


@dataclass(frozen=True, slots=True)
class Larger:
    """The item is `factor` times as large, along each of its axes, as the catalogue says; its mass stays."""

    name: ClassVar[str] = "larger"
    when: When
    target: FaultTarget
    factor: float


@dataclass(frozen=True, slots=True)
class Appear:
    """A further item of the catalogue appears at `place` (x, y) in the world, m. It waits until nothing is
    there. `yaw`, rad, about the world's z."""

    name: ClassVar[str] = "appear"
    when: When
    kind: str
    colour: str
    place: tuple[float, float]
    yaw: float = 0.0


@dataclass(frozen=True, slots=True)
class Obstacle:
    """An obstacle that the robot does not know is put into its way. It waits until nothing is there, never
    moves, and is removed after `stays` s; None: never."""

    name: ClassVar[str] = "obstacle"
    when: When
    body: Fixture
    stays: float | None = None


ItemFault: TypeAlias = Remove | Friction | Bump | Heavier | Larger
"""Faults that change one named item for good."""


__all__ = [
    "Appear",
    "AtNode",
    "AtTime",
    "Bump",
    "FaultExpectation",
    "FaultFile",
    "FaultSpec",
    "FaultTarget",
    "Friction",
    "Heavier",
    "Larger",
    "Obstacle",
    "Remove",
    "Slip",
    "When",
]


FaultSpec: TypeAlias = ItemFault | Slip | Appear | Obstacle | Ailing | ProgramFault
"""One injected fault. Its `name` is the word of fault files and records; a renamed class keeps it."""


@dataclass(frozen=True, slots=True)
class FaultExpectation:
    """Expected outcome of a run with these faults, for its evaluation. Neither robot nor simulation reads
    it."""

    causes: tuple[str, ...] = ()
    """Causes, or patterns of causes, that name the failure correctly; empty: the fault should do no harm."""
    lost: int = 0
    """Number of items that physically cannot be sorted any more."""
    roots: tuple[str, ...] = ()
    """Root causes, or patterns of them, by which an explanation names it correctly."""


@dataclass(frozen=True, slots=True)
class FaultFile:
    """A fault file, read: its faults in the order of the file."""

    faults: tuple[FaultSpec, ...]
    source: str = ""
    text: str = ""
    """Text of the file as read, for the log."""
    expect: FaultExpectation | None = None


_ZERO_VECTOR = (0.0, 0.0, 0.0)


def fault_of_entry(entry: FaultEntryFile) -> FaultSpec:
    """Return the fault of a checked entry, which has all that its kind needs."""
    return _MAKERS[entry.fault](entry, _when(entry))


def _when(entry: FaultEntryFile) -> When:
    when = entry.when
    probability = 1.0 if entry.probability is None else entry.probability
    if when.node is None:
        return AtTime(when.at or 0.0, when.every, probability)
    return AtNode(when.node, when.start or 1, when.delay or 0.0, bool(when.each), probability)


def _target(entry: FaultEntryFile) -> FaultTarget:
    chosen = entry.target or TargetFile()
    return FaultTarget(chosen.index, chosen.kind, chosen.form, chosen.colour, chosen.nearest_to)


def _obstacle(entry: FaultEntryFile, when: When) -> Obstacle:
    assert entry.body is not None
    return Obstacle(when, hidden_body(entry.name or "obstacle", entry.body), entry.stays)


def _appear(entry: FaultEntryFile, when: When) -> Appear:
    assert entry.kind is not None
    assert entry.colour is not None
    return Appear(when, entry.kind, entry.colour, entry.place or (0.0, 0.0), entry.yaw or 0.0)


def _bump(entry: FaultEntryFile, when: When) -> Bump:
    return Bump(when, _target(entry), entry.velocity or _ZERO_VECTOR, entry.spin or _ZERO_VECTOR)


def _shift(entry: FaultEntryFile, when: When) -> CameraShift:
    moved = Pose.from_rpy(entry.shift or _ZERO_VECTOR, entry.turn or _ZERO_VECTOR)
    return CameraShift(when, moved, entry.camera, entry.lasts)


def _mislabel(entry: FaultEntryFile, when: When) -> CameraMislabel:
    return CameraMislabel(
        when, entry.colour or "", entry.shown_as or "", bool(entry.swapped), entry.camera, entry.lasts
    )


_MAKERS: Mapping[str, Callable[[FaultEntryFile, When], FaultSpec]] = {
    "remove": lambda entry, when: Remove(when, _target(entry)),
    "friction": lambda entry, when: Friction(when, _target(entry), entry.friction or 0.0, entry.mass),
    "bump": _bump,
    "obstacle": _obstacle,
    "slip": lambda entry, when: Slip(when, entry.friction or 0.0, entry.lasts),
    "appear": _appear,
    "heavier": lambda entry, when: Heavier(when, _target(entry), entry.mass or 0.0),
    "larger": lambda entry, when: Larger(when, _target(entry), entry.factor or 1.0),
    "gripper_jam": lambda entry, when: GripperJam(when, entry.lasts),
    "gripper_weak": lambda entry, when: GripperWeak(when, entry.share or 0.0, entry.lasts),
    "camera_drop": lambda entry, when: CameraDrop(when, entry.camera, entry.lasts, entry.images),
    "camera_shift": _shift,
    "camera_noise": lambda entry, when: CameraNoise(when, entry.factor or 1.0, entry.camera, entry.lasts),
    "camera_mislabel": _mislabel,
    "wrench_bias": lambda entry, when: WrenchBias(
        when, entry.force or _ZERO_VECTOR, entry.torque or _ZERO_VECTOR, entry.lasts
    ),
    "wrench_dead": lambda entry, when: WrenchDead(when, entry.lasts),
    "joint_weak": lambda entry, when: JointWeak(when, entry.joint or "", entry.share or 0.0, entry.lasts),
    "stall": lambda entry, when: Stall(when, entry.lasts),
    "no_plan": lambda entry, when: NoPlan(when, entry.lasts, entry.requests),
    "hang": lambda _, when: Hang(when),
    "raise": lambda _, when: Raise(when),
    "kill": lambda _, when: Kill(when),
}
