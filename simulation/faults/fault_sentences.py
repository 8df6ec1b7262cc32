"""Sentences and data of the record at the start and the end of a device fault."""

from __future__ import annotations

import math

from ...world.journal import Plain
from ..fault_files.device_entries import (
    Ailing,
    CameraDrop,
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
)  # fmt: skip


def start_sentence(fault: Ailing, width: float) -> str:
    """Return the sentence for the start of a fault; `width` is the fingers' opening, m."""
    return f"{_begins(fault, width)}{_lasting(fault)}"


def end_sentence(fault: Ailing) -> str:
    match fault:
        case GripperJam():
            return "the fingers move again"
        case GripperWeak():
            return "the gripper has all its force again"
        case JointWeak(joint=joint):
            return f"{joint} has all its torque again"
        case Stall():
            return "the arm's drives take commands again"
        case WrenchBias():
            return "the wrist sensor is right again"
        case WrenchDead():
            return "the wrist sensor speaks again"
        case CameraDrop(camera=camera):
            return f"images come from {_which(camera)} again"
        case CameraShift(camera=camera):
            return f"{_which(camera)} is back in its place"
        case CameraNoise(camera=camera):
            return f"{_which(camera)} is as noisy as ever"
        case CameraMislabel(camera=camera, colour=colour):
            return f"{_which(camera)} shows {colour} as it is again"
        case NoPlan():
            return "the planner finds ways again"


def record_details(fault: Ailing) -> dict[str, Plain]:
    """Return the recorded parameters of the fault."""
    told: dict[str, Plain] = {}
    match fault:
        case GripperWeak(share=share):
            told = {"share": share}
        case JointWeak(joint=joint, share=share):
            told = {"joint": joint, "share": share}
        case WrenchBias(force=force, torque=torque):
            told = {"force": list(force), "torque": list(torque)}
        case CameraShift(moved=moved):
            told = {"position": list(moved.position), "orientation": list(moved.orientation)}
        case CameraNoise(factor=factor):
            told = {"factor": factor}
        case CameraMislabel(colour=colour, shown_as=other, swapped=swapped):
            told = {"colour": colour, "shown_as": other, "swapped": swapped}
        case GripperJam() | Stall() | WrenchDead() | CameraDrop() | NoPlan():
            pass
    if isinstance(fault, CameraDrop | CameraShift | CameraNoise | CameraMislabel):
        told["camera"] = fault.camera
    return {**told, "lasts": fault.lasts}


def _begins(fault: Ailing, width: float) -> str:
    match fault:
        case GripperJam():
            return f"the fingers jam {1000 * width:.0f} mm open"
        case GripperWeak(share=share):
            return f"the gripper has {share:.0%} of its force"
        case JointWeak(joint=joint, share=share):
            return f"{joint} has {share:.0%} of its torque"
        case Stall():
            return "the arm's drives stand and take no commands"
        case WrenchBias(force=force, torque=torque):
            twist = f" and {math.hypot(*torque):.2g} Nm" if any(torque) else ""
            return f"the wrist sensor is off by {math.hypot(*force):.3g} N{twist}"
        case WrenchDead():
            return "the wrist sensor falls silent"
        case CameraDrop(camera=camera):
            return f"no image comes from {_which(camera)}"
        case CameraShift(camera=camera, moved=moved):
            turned = 2.0 * math.degrees(math.acos(min(1.0, abs(moved.orientation[3]))))
            turn = f" and {turned:.1f} deg" if turned > 0.05 else ""
            return f"{_which(camera)} is knocked by {1000 * math.hypot(*moved.position):.0f} mm{turn}"
        case CameraNoise(camera=camera, factor=factor):
            return f"{_which(camera)} is {factor:g} times as noisy"
        case CameraMislabel(camera=camera, colour=colour, shown_as=other, swapped=swapped):
            also = f" and {other} as {colour}" if swapped else ""
            return f"{_which(camera)} shows {colour} as {other}{also}"
        case NoPlan():
            return "the planner finds nothing"


def _lasting(fault: Ailing) -> str:
    counted = ""
    match fault:
        case CameraDrop(images=int(most)):
            counted = f", {most} image{'s' if most > 1 else ''} long"
        case NoPlan(requests=int(most)):
            counted = f", {most} request{'s' if most > 1 else ''} long"
        case _:
            pass
    return f"{counted}, for {fault.lasts:g} s" if fault.lasts is not None else counted


def _which(camera: str | None) -> str:
    return camera or "every camera"
