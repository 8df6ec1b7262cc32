"""Nominal parts of a simulation: devices, properties of items, bodies and skills that no fault affects.

A what-if holds a part nominal to find out what happens without its fault. It needs no knowledge of the
faults: a gripper has its force and moves, a camera is at its place, an item has the catalogue's mass.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, TypeAlias, cast, get_args

from picktree.files import PicktreeError, node_matches, suggest_name
from picktree.world import Pose, greatest_length
from picktree.world.scene import SceneDescription

from .device_faults import InjectableRobot
from .fault_entries import (
    Appear,
    Bump,
    CameraFault,
    FaultSpec,
    Friction,
    GripperJam,
    GripperWeak,
    Hang,
    Heavier,
    JointWeak,
    Larger,
    NoPlan,
    Obstacle,
    Raise,
    Remove,
    Slip,
    Stall,
    WrenchBias,
    WrenchDead,
)

Part: TypeAlias = Literal[
    "gripper", "arm", "joint", "wrist", "camera", "planner",
    "mass", "friction", "size", "place", "arrivals", "body", "skill",
]  # fmt: skip
"""Kind of a part. `mass`, `friction`, `size`, `place`: of an item; `arrivals`: items that nothing announces;
`body`: a body that the robot does not know; `skill`: the code of a node."""
OF_ITEM: Final = frozenset({"mass", "friction", "size", "place"})
"""Parts that are properties of an item."""
NAMED: Final = OF_ITEM | {"joint", "body", "skill"}
"""Parts that need a name; a camera without a name means all cameras."""
MIN_SCALE_CHANGE = 1e-6
"""Relative difference of an item's size from the catalogue's above which it counts as scaled."""


@dataclass(frozen=True, slots=True)
class NominalPart:
    """Part that is nominal for the whole run, or from its checkpoint on."""

    part: Part
    name: str = ""
    """Joint, camera, item, body or node path; empty for a part that exists once."""

    def words(self) -> str:
        return f"{self.part} {self.name}".rstrip()

    @classmethod
    def from_words(cls, words: str) -> NominalPart:
        """Parse `gripper` or `joint panda_joint4`. Raises PicktreeError for an unknown part."""
        part, _, name = words.strip().partition(" ")
        known = cast("tuple[Part, ...]", get_args(Part))
        if part not in known:
            raise PicktreeError(f"{words!r} is no part that can be nominal ({suggest_name(part, known)})")
        if (part in NAMED) != bool(name) and part != "camera":
            example = f"'{part} NAME'" if part in NAMED else f"'{part}' alone"
            raise PicktreeError(f"the nominal part {words!r} is to be written as {example}")
        return cls(part, name.strip())


def require_known(parts: Iterable[NominalPart], scene: SceneDescription, joints: Sequence[str]) -> None:
    """Raise PicktreeError for a joint or camera that the cell does not have, and for a name of no item.

    Items and bodies may come later.
    """
    known = {"joint": tuple(joints), "camera": tuple(camera.name for camera in scene.cameras)}
    for each in parts:
        names = known.get(each.part, ())
        if names and each.name and each.name not in names:
            hint = suggest_name(each.name, names)
            raise PicktreeError(f"the nominal part {each.words()!r}: there is no {each.name!r} ({hint})")
        if each.part in OF_ITEM and not each.name.removeprefix("item_").isdecimal():
            raise PicktreeError(f"the nominal part {each.words()!r}: items are named as item_03")


def nominal_scene(scene: SceneDescription, parts: Sequence[NominalPart]) -> SceneDescription:
    """Return the scene for the simulation: nominal cameras are at their believed poses, and bodies that are
    taken away are missing."""
    cameras = {each.name for each in parts if each.part == "camera"}
    bodies = {each.name for each in parts if each.part == "body"}
    if not cameras | bodies:
        return scene
    right = (
        replace(camera, error=Pose()) if cameras & {"", camera.name} else camera for camera in scene.cameras
    )
    unknown = tuple(body for body in scene.unknown if body.id not in bodies)
    return replace(scene, cameras=tuple(right), unknown=unknown)


def make_nominal(hardware: InjectableRobot, scene: SceneDescription, parts: Iterable[NominalPart]) -> None:
    """Give items the mass, friction and size of the catalogue, and take bodies away."""
    for each in parts:
        if each.part == "body":
            if each.name in {body.id for body in hardware.obstacles()}:
                hardware.take_obstacle(next(b.id for b in hardware.obstacles() if b.id == each.name))
            continue
        body = next((b for b in hardware.recent_truth() if b.id == each.name and b.present), None)
        entry = None if body is None else scene.find_entry(body.kind)
        if body is None or entry is None:
            continue
        if each.part == "size":
            factor = greatest_length(entry.shape) / greatest_length(body.shape)
            if abs(factor - 1.0) > MIN_SCALE_CHANGE:
                hardware.enlarge(each.name, factor)
        elif each.part == "mass" and body.mass != entry.mass:
            hardware.change_dynamics(each.name, None, entry.mass)
        elif each.part == "friction" and hardware.friction_of(each.name) != entry.friction:
            hardware.change_dynamics(each.name, entry.friction, None)


def without_nominal(fault: FaultSpec, target: str, parts: Sequence[NominalPart]) -> FaultSpec | None:
    """Return what is left of a fault beside nominal parts; None: nothing.

    `target`: item, obstacle or node path that the fault is about to affect; empty for a device.
    """
    nominal = {each.part for each in parts if _concerns(each, fault, target)}
    match fault:
        case Friction(mass=None) | Slip():
            return None if "friction" in nominal else fault
        case Friction(mass=float(mass)):
            if "friction" in nominal:
                rest = Heavier(fault.when, fault.target, mass, probability=fault.probability)
                return None if "mass" in nominal else rest
            return replace(fault, mass=None) if "mass" in nominal else fault
        case Heavier():
            return None if "mass" in nominal else fault
        case Larger():
            return None if "size" in nominal else fault
        case Remove() | Bump():
            return None if "place" in nominal else fault
        case _:
            return None if nominal else fault


def _concerns(each: NominalPart, fault: FaultSpec, target: str) -> bool:
    match fault:
        case GripperJam() | GripperWeak():
            return each.part == "gripper"
        case JointWeak(joint=joint):
            return each == NominalPart("joint", joint)
        case Stall():
            return each.part == "arm"
        case WrenchBias() | WrenchDead():
            return each.part == "wrist"
        case CameraFault(camera=camera):
            # A fault of all cameras is one device: with a nominal camera it is gone.
            return each.part == "camera" and (camera is None or each.name in ("", camera))
        case NoPlan():
            return each.part == "planner"
        case Appear():
            return each.part == "arrivals"
        case Obstacle():
            return each.part == "body" and target == each.name
        case Hang() | Raise():
            return each.part == "skill" and node_matches(f"/{each.name}", target)
        case Friction() | Heavier() | Larger() | Remove() | Bump() | Slip():
            return each.part in OF_ITEM and target == each.name
        case _:
            return False
