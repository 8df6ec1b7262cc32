"""Fault injector: carries out a fault file on items, devices and the program, at set times or when nodes
start."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, cast

from ...files.errors import PicktreeError
from ...world.journal import JournalEvent
from ...world.run_events import FaultEvent
from ...world.values import ObjectId, Vector3
from .device_entries import (
    Ailing,
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
    Raise,
    Stall,
    WrenchBias,
    WrenchDead,
)  # fmt: skip
from .device_faults import InjectableRobot
from .fault_entries import (
    Appear,
    Bump,
    FaultFile,
    FaultSpec,
    Friction,
    Heavier,
    ItemFault,
    Larger,
    Obstacle,
    Remove,
    Slip,
)
from .fault_states import (
    NO_ITEM,
    FaultSchedule,
    FaultState,
    apply_item_fault,
    choose_target,
    end_sentence,
    item_fault_details,
    record_details,
    start_sentence,
)

__all__ = ["FaultInjector", "FaultState", "InjectableProgram", "InjectableRobot", "new_states"]

_DEVICE_FAULTS: tuple[type, ...] = (
    GripperJam, GripperWeak, JointWeak, Stall, WrenchBias, WrenchDead, CameraDrop, CameraShift, CameraNoise,
    CameraMislabel, NoPlan,
)  # fmt: skip
_RAISED_MESSAGE = "the skill's code cannot go on"


@dataclass(frozen=True, slots=True)
class InjectionResult:
    """Result of carrying out a fault at one occasion."""

    event: FaultEvent
    """Event without the node. One of a fault that waits is recorded once, and without a message never."""
    standing: str = ""
    """Effect that has to be ended later; empty: none."""


class InjectableProgram(Protocol):
    """Running tree, as far as faults interfere with it."""

    def acting(self, path: str = "") -> str | None:
        """Return the path of the skill that runs at or below a node; empty: no skill runs; None: the node
        does not run."""
        ...

    def stand_in(self, path: str, body: Callable[[], Generator[None, None, None]]) -> bool:
        """Replace a skill's generator by `body` from its next tick on. Returns False when the node is no
        skill."""
        ...


class FaultInjector:
    """Fault injector of one run; works between two ticks.

    `object_place` returns the believed place of a node's object, by the node's path; `program` returns the
    running tree. `kill` ends the process; without it a repeated run continues past the kill.
    """

    def __init__(
        self,
        faults: FaultFile | None,
        hardware: InjectableRobot,
        object_place: Callable[[str], Vector3 | None] = lambda _: None,
        *,
        seed: int = 0,
        program: Callable[[], InjectableProgram] | None = None,
        kill: Callable[[], None] | None = None,
    ) -> None:
        self._faults: tuple[FaultSpec, ...] = faults.faults if faults else ()
        self._hardware = hardware
        self._object_place = object_place
        self._program = program
        self._kill = kill
        self._occasions = FaultSchedule(seed)
        self._states = list(new_states(faults, seed))
        self._told: list[FaultEvent] = []

    @property
    def no_plan(self) -> Callable[[], bool] | None:
        """Callback that tells for each planning request whether the planner finds nothing; None: no fault of
        the file does that."""
        return self._hardware.ailments.no_plan if any(isinstance(f, NoPlan) for f in self._faults) else None

    def node_started(self, path: str) -> None:
        """Note the start of a node. The tree calls this whenever a node starts."""
        now = self._hardware.clock.now
        for n, fault in enumerate(self._faults):
            before = self._states[n]
            state = self._occasions.node_started(n, fault.when, before, path, now)
            if state is before:
                continue
            self._states[n] = state
            if isinstance(fault, Hang | Raise) and len(state.dues) > len(before.dues):
                self._strike_at_once(n, fault, path, now)

    def tick(self) -> tuple[JournalEvent, ...]:
        """Carry out the due faults and return their events. Called after each tick of the tree."""
        now = self._hardware.clock.now
        happened, self._told = self._told, []
        for n, fault in enumerate(self._faults):
            state = self._states[n]
            if state.standing and self._over(n, state, now):
                happened += self._end(n, fault)
            while dues := self._states[n].dues:
                if dues[0].time > now + 1e-9:
                    break
                happened += self._strike(n, fault, now)
                if self._states[n].waits:
                    break
        return tuple(happened)

    def state(self) -> tuple[FaultState, ...]:
        """Return the faults' states for a checkpoint. The hardware's own state holds permanent changes of
        items."""
        held = self._hardware.ailments.held
        return tuple(replace(state, held=held(n)) for n, state in enumerate(self._states))

    def restore(self, states: Sequence[FaultState]) -> None:
        """Take over the states of a checkpoint and resume active faults. A process that had been killed is
        not killed by the same fault again. Raises PicktreeError when the states are of another fault file."""
        if len(states) != len(self._faults):
            raise PicktreeError(f"the checkpoint knows {len(states)} faults, the file {len(self._faults)}")
        self._states = list(states)
        for n, (fault, state) in enumerate(zip(self._faults, states, strict=True)):
            if not state.standing:
                continue
            match fault:
                case Slip(friction=friction):
                    self._hardware.lubricate(state.standing, friction, again=True)
                case Kill():
                    self._states[n] = replace(state, standing="")
                case _ if isinstance(fault, _DEVICE_FAULTS):
                    self._hardware.afflict(n, cast(Ailing, fault), state.held)
                case _:
                    pass

    def _over(self, n: int, state: FaultState, now: float) -> bool:
        if self._hardware.ailments.spent(n):
            return True
        return state.until is not None and now >= state.until - 1e-9

    def _end(self, n: int, fault: FaultSpec) -> list[FaultEvent]:
        """End a fault that lasted."""
        state = self._states[n]
        name, self._states[n] = state.standing, replace(state, standing="")
        event = FaultEvent("", state.node, fault=fault.name, gone=True)
        match fault:
            case Obstacle():
                self._hardware.take_obstacle(ObjectId(name))
                event = replace(event, message=f"{name} is taken away", obstacle=name)
            case Slip():
                self._hardware.lubricate(name, None)
                event = replace(event, message=f"{name} has its own friction again", item=name)
            case Kill():
                if self._kill is not None:
                    self._kill()
                return []
            case _:
                self._hardware.relieve(n)
                event = replace(event, message=end_sentence(cast(Ailing, fault)))
        return [event]

    def _strike(self, n: int, fault: FaultSpec, now: float) -> list[FaultEvent]:
        """Carry out the first due occasion of a fault."""
        state = self._states[n]
        if state.standing and not isinstance(fault, Obstacle):
            self._end(n, fault)
        outcome = self._outcome(n, fault, state)
        told = replace(outcome.event, node=state.node)
        if told.waits:
            self._states[n] = replace(self._states[n], waits=True)
            return [] if state.waits or not told.message else [told]
        lasts = fault.stays if isinstance(fault, Obstacle) else getattr(fault, "lasts", None)
        until = now if isinstance(fault, Kill) else None if lasts is None else now + lasts
        after = self._occasions.taken(n, fault.when, self._states[n], now)
        if outcome.standing:
            after = replace(after, standing=outcome.standing, until=until)
        self._states[n] = after
        return [told]

    def _outcome(self, n: int, fault: FaultSpec, state: FaultState) -> InjectionResult:
        match fault:
            case Obstacle():
                return self._obstruct(fault, state)
            case Appear():
                return self._appear(fault)
            case Slip():
                return self._slip(fault)
            case Hang() | Raise():
                return self._meddle(fault, state)
            case Kill():
                return InjectionResult(FaultEvent("the process is killed", fault="kill"), standing="kill")
            case Remove() | Friction() | Bump() | Heavier() | Larger():
                return self._befall(fault, state)
            case _:
                width = self._hardware.gripper.read().width
                self._hardware.afflict(n, fault)
                said = start_sentence(fault, width)
                event = FaultEvent(said, fault=fault.name, extra=record_details(fault))
                return InjectionResult(event, standing=fault.name)

    def _befall(self, fault: ItemFault, state: FaultState) -> InjectionResult:
        name = fault.name
        body = choose_target(self._hardware, fault.target, state.node, self._object_place)
        if body is None:
            return InjectionResult(FaultEvent(f"{name}: no item fits", fault=name, extra=NO_ITEM))
        message = apply_item_fault(fault, body, self._hardware)
        event = FaultEvent(message or "", fault=name, item=body.id, extra=item_fault_details(fault, body))
        if message is None:
            event = replace(event, message=f"{body.id} waits for room to be larger", waits=True)
        return InjectionResult(event)

    def _obstruct(self, fault: Obstacle, state: FaultState) -> InjectionResult:
        """Add the obstacle, or wait until its place is free."""
        body = fault.body
        event = FaultEvent("", fault="obstacle", obstacle=body.id, extra={"at": body.pose.position})
        if state.standing:  # what it put there before
            return InjectionResult(replace(event, waits=True))
        if not self._hardware.room_for(body):
            message = f"{body.id} waits until nothing is in its place"
            return InjectionResult(replace(event, message=message, waits=True))
        name = self._hardware.put_obstacle(body)
        standing = "" if fault.stays is None else str(name)
        event = replace(event, message=f"{name} is put into the way", obstacle=name)
        return InjectionResult(event, standing=standing)

    def _appear(self, fault: Appear) -> InjectionResult:
        what = f"a {fault.colour} {fault.kind}"
        event = FaultEvent("", fault="appear", extra={"kind": fault.kind, "colour": fault.colour})
        x, y = fault.place
        try:
            name = self._hardware.appear(fault.kind, fault.colour, fault.place, fault.yaw)
        except PicktreeError as error:
            message = f"{what} does not appear: {error}"
            return InjectionResult(replace(event, message=message, extra={**event.extra, **NO_ITEM}))
        if name is None:
            message = f"{what} waits until nothing is in its place"
            return InjectionResult(replace(event, message=message, waits=True))
        message = f"{name}, {what}, appears at ({x:.3f}, {y:.3f})"
        return InjectionResult(replace(event, message=message, item=name))

    def _slip(self, fault: Slip) -> InjectionResult:
        event = FaultEvent("", fault="slip", extra={"friction": fault.friction, "lasts": fault.lasts})
        item = self._hardware.in_hand()
        if item is None:  # it waits for something to be held
            return InjectionResult(replace(event, waits=True))
        self._hardware.lubricate(item, fault.friction)
        lasting = "" if fault.lasts is None else f" for {fault.lasts:g} s"
        message = f"{item} slips: its friction is {fault.friction:g}{lasting}"
        return InjectionResult(replace(event, message=message, item=item), standing=item)

    def _meddle(self, fault: Hang | Raise, state: FaultState) -> InjectionResult:
        """Replace the generator of the running skill."""
        name = fault.name
        tree = None if self._program is None else self._program()
        path = None if tree is None else tree.acting(state.node)
        if tree is None or path is None:
            message = f"{name}: the node had ended before"
            return InjectionResult(FaultEvent(message, fault=name, extra={"skill": None}))
        if not path:
            return InjectionResult(FaultEvent("", fault=name, waits=True))
        tree.stand_in(path, _fault_generator(fault))
        return _program_fault_result(fault, path)

    def _strike_at_once(self, n: int, fault: Hang | Raise, path: str, now: float) -> None:
        """Replace the generator of a skill that has just started, which may end in the same tick."""
        state = self._states[n]
        if state.dues[0].time > now or self._program is None:
            return
        if self._program().stand_in(path, _fault_generator(fault)):
            outcome = _program_fault_result(fault, path)
            self._told.append(replace(outcome.event, node=path))
            self._states[n] = self._occasions.taken(n, fault.when, state, now)


def new_states(
    faults: FaultFile | None,
    seed: int,
    since: float | None = None,
    before: tuple[FaultFile | None, Sequence[FaultState]] = (None, ()),
) -> tuple[FaultState, ...]:
    """Return the states of the faults of a file, at the time `since`, s, or at the start of the run.
    Occasions before `since` are skipped.

    A fault at the same position in the file `before` keeps its state.
    """
    occasions, known = FaultSchedule(seed), dict(enumerate(before[0].faults if before[0] else ()))
    return tuple(
        before[1][n] if known.get(n) == fault else occasions.begun(n, fault.when, since)
        for n, fault in enumerate(faults.faults if faults else ())
    )


def _program_fault_result(fault: Hang | Raise, path: str) -> InjectionResult:
    name = path.rsplit("/", 1)[-1]
    does = "hangs" if isinstance(fault, Hang) else "raises an exception"
    return InjectionResult(FaultEvent(f"the code of {name} {does}", fault=fault.name, skill=path))


def _fault_generator(fault: Hang | Raise) -> Callable[[], Generator[None, None, None]]:
    return _for_ever if isinstance(fault, Hang) else _raising


def _for_ever() -> Generator[None, None, None]:
    while True:
        yield


def _raising() -> Generator[None, None, None]:
    yield from ()
    raise RuntimeError(_RAISED_MESSAGE)
