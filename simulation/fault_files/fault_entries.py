"""Values of fault file entries, made from entries that passed the checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from ...world.scene.loading.scene_entries import hidden_body
from ...world.values import Pose
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
from .item_entries import (
    Appear,
    Bump,
    FaultTarget,
    Friction,
    Heavier,
    ItemFault,
    Larger,
    Obstacle,
    Remove,
    Slip,
)

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
