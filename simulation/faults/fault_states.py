"""Progress of the faults of a file: occasions so far, occasions used, and due faults; targets of item
faults.

The sentences and data of the record for device faults are here, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

from ...files.node_patterns import node_matches
from ...world.journal import Plain
from ...world.random_streams import RandomStreams
from ...world.values import Vector3
from ..feed.spawn import item_number
from ..truth import TrueBody
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
    JointWeak,
    NoPlan,
    Stall,
    When,
    WrenchBias,
    WrenchDead,
)
from .device_faults import InjectableRobot
from .fault_entries import Bump, FaultTarget, Friction, Heavier, ItemFault, Larger, Remove


def choose_target(
    hardware: InjectableRobot, target: FaultTarget, node: str, object_place: Callable[[str], Vector3 | None]
) -> TrueBody | None:
    """Choose the item that a target means; None: no item fits. `object_place` returns the believed place of a
    node's object."""
    fitting = [
        body
        for body in hardware.recent_truth()
        if body.present
        and target.index in (None, item_number(body.id))
        and target.kind in (None, body.kind)
        and target.form in (None, body.form)
        and target.colour in (None, body.colour)
    ]
    match target.nearest_to:
        case "tool":
            near = hardware.true_tcp().position
        case "object":
            near = object_place(node)
        case None:
            near = None
    if near is None:
        return fitting[0] if fitting else None
    return min(fitting, key=lambda body: math.dist(body.pose.position, near), default=None)


NO_ITEM: Final[Mapping[str, Plain]] = {"item": None}
"""Recorded value of a fault that found no item to act on."""


def item_fault_details(fault: ItemFault, body: TrueBody) -> dict[str, Plain]:
    """Return the recorded parameters of the fault, with the look of its item."""
    data: dict[str, Plain] = {"kind": body.kind, "colour": body.colour}
    match fault:
        case Remove():
            pass
        case Friction(friction=friction, mass=mass):
            data |= {"friction": friction, "mass": mass}
        case Bump(velocity=velocity, spin=spin):
            data |= {"velocity": list(velocity), "spin": list(spin)}
        case Heavier(mass=mass):
            data["mass"] = mass
        case Larger(factor=factor):
            data["factor"] = factor
    return data


def apply_item_fault(fault: ItemFault, body: TrueBody, hardware: InjectableRobot) -> str | None:
    """Carry out a fault of an item. Returns a sentence about it; None: there is no room for it now."""
    match fault:
        case Remove():
            hardware.remove(body.id)
            return f"{body.id} is snatched away"
        case Friction(friction=friction, mass=mass):
            hardware.change_dynamics(body.id, friction, mass)
            message = f"{body.id} has friction {friction:g} now"
            return message + (f" and weighs {mass:g} kg" if mass is not None else "")
        case Bump(velocity=velocity, spin=spin):
            hardware.bump(body.id, velocity, spin)
            return f"{body.id} is bumped to {math.hypot(*velocity):.2f} m/s"
        case Heavier(mass=mass):
            hardware.change_dynamics(body.id, None, mass)
            return f"{body.id} weighs {mass:g} kg now"
        case Larger(factor=factor):
            return (
                f"{body.id} is {factor:g} times as large now" if hardware.enlarge(body.id, factor) else None
            )


@dataclass(frozen=True, slots=True)
class DueFault:
    """Occasion at which a fault is due."""

    time: float
    """Simulated time, s."""
    node: str
    """Path of the node whose start made the fault due; empty for a fault at a time."""


@dataclass(frozen=True, slots=True)
class FaultState:
    """Progress of one fault."""

    starts: int = 0
    """Number of starts of the node for which the fault waits."""
    due: float | None = None
    """Simulated time at which the fault is due, s; None while it waits for a node."""
    node: str = ""
    """Path of the node whose start made the fault due."""
    done: bool = False
    """Whether the fault is over for good."""
    standing: str = ""
    """Effect that the fault has still to end: the obstacle that it added, the item that slips, or the fault
    itself; empty: none."""
    until: float | None = 0.0
    """Simulated time at which it ends that effect, s; None: never."""
    waits: bool = False
    """Whether the fault is due but has to wait, because something is in its place."""
    chances: int = 0
    """Number of occasions so far at which the fault might have happened."""
    then: tuple[DueFault, ...] = ()
    """Further occasions that are due, in order."""
    held: tuple[float, ...] = ()
    """State of the device when the fault began, as `DeviceFaults` keeps it."""

    @property
    def dues(self) -> tuple[DueFault, ...]:
        return () if self.due is None or self.done else (DueFault(self.due, self.node), *self.then)


class FaultSchedule:
    """Schedule of the faults of a run.

    Whether a fault takes an occasion depends on the run's seed, the fault's number in the file and the number
    of the occasion. Nothing else that happens changes it.
    """

    def __init__(self, seed: int) -> None:
        self._streams = RandomStreams(seed)

    def begun(self, number: int, when: When, since: float | None = None) -> FaultState:
        """Return the state of a new fault. Occasions until the time `since`, s, are skipped."""
        if not isinstance(when, AtTime):
            return FaultState()
        state = self._at_time(number, when, FaultState(), when.time)
        while since is not None and not state.done and state.due is not None and state.due <= since:
            state = self.taken(number, when, state, state.due)
        return state

    def node_started(self, number: int, when: When, state: FaultState, path: str, now: float) -> FaultState:
        """Return the state of a fault after the node at `path` has started."""
        if isinstance(when, AtTime) or state.done or not node_matches(when.pattern, path):
            return state
        if state.due is not None and not when.each:
            return state
        state = replace(state, starts=state.starts + 1)
        if state.starts < when.start or (state.starts > when.start and not when.each):
            return state
        happens = self._happens(number, when, state)
        state = replace(state, chances=state.chances + 1)
        if not happens:
            return state if when.each else replace(state, done=True)
        # A fault that waits for room, or for an item in the hand, is due once only.
        before = () if state.waits else state.dues
        return _with(state, (*before, DueFault(now + when.delay, path)))

    def taken(self, number: int, when: When, state: FaultState, now: float) -> FaultState:
        """Return the state of a fault after a due occasion, whether or not there was anything to affect."""
        state = replace(state, waits=False)
        match when:
            case AtNode(each=True):
                return _with(state, state.dues[1:])
            case AtTime(every=float()) if state.due is not None:
                return self._at_time(number, when, state, state.due, now)
            case _:
                return replace(state, done=True)

    def _at_time(
        self, number: int, when: AtTime, state: FaultState, begin: float, after: float | None = None
    ) -> FaultState:
        """Return the state with the next occasion that is taken: `begin`, or the first of its repetitions
        later than `after`."""
        time = begin
        for _ in range(10_000):  # with a small probability it may never be
            if after is None or time > after + 1e-9:
                happens = self._happens(number, when, state)
                state = replace(state, chances=state.chances + 1)
                if happens:
                    return replace(state, due=time, node="", then=())
            if when.every is None:
                break
            time += when.every
        return replace(state, due=time, done=True)

    def _happens(self, number: int, when: When, state: FaultState) -> bool:
        if when.probability >= 1.0:
            return True
        rng = self._streams.at(f"fault/{number}", state.chances)
        return float(rng.random()) < when.probability


def _with(state: FaultState, dues: tuple[DueFault, ...]) -> FaultState:
    if not dues:
        return replace(state, due=None, node="", then=())
    return replace(state, due=dues[0].time, node=dues[0].node, then=dues[1:])


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
