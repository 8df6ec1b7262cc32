"""Fault injector: carries out a fault file on items, devices and the program, at set times or when nodes
start. It keeps the progress of each fault and makes its records.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol, cast

from picktree.files import PicktreeError, node_matches
from picktree.world import JournalEvent, ObjectId, Plain, RandomStreams, Vector3, event_types

from .device_faults import InjectableRobot
from .fault_entries import (
    Appear,
    AtNode,
    AtTime,
    Bump,
    CameraDrop,
    CameraFault,
    CameraMislabel,
    CameraNoise,
    CameraShift,
    Fault,
    FaultFile,
    FaultSpec,
    FaultTarget,
    Friction,
    GripperJam,
    GripperWeak,
    Hang,
    Heavier,
    ItemFaults,
    JointWeak,
    Kill,
    Larger,
    LastingFault,
    NoPlan,
    Obstacle,
    Raise,
    Remove,
    Slip,
    Stall,
    WrenchBias,
    WrenchDead,
)
from .nominal_parts import NominalPart, without_nominal
from .spawn import item_number
from .truth import TrueBody


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


def item_fault_details(fault: ItemFaults, body: TrueBody) -> dict[str, Plain]:
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


def apply_item_fault(fault: ItemFaults, body: TrueBody, hardware: InjectableRobot) -> str | None:
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

    def begun(self, number: int, fault: Fault, since: float | None = None) -> FaultState:
        """Return the state of a new fault. Occasions until the time `since`, s, are skipped."""
        if fault.off:
            return FaultState(done=True)
        if not isinstance(fault.when, AtTime):
            return FaultState()
        state = self._at_time(number, fault, FaultState(), fault.when.time)
        while since is not None and not state.done and state.due is not None and state.due <= since:
            state = self.taken(number, fault, state, state.due)
        return state

    def node_started(self, number: int, fault: Fault, state: FaultState, path: str, now: float) -> FaultState:
        """Return the state of a fault after the node at `path` has started."""
        when = fault.when
        if isinstance(when, AtTime) or state.done or not node_matches(when.pattern, path):
            return state
        if state.due is not None and not when.each:
            return state
        state = replace(state, starts=state.starts + 1)
        if state.starts < when.start or (state.starts > when.start and not when.each):
            return state
        happens = self._happens(number, fault, state)
        state = replace(state, chances=state.chances + 1)
        if not happens:
            return state if when.each else replace(state, done=True)
        # A fault that waits for room, or for an item in the hand, is due once only.
        before = () if state.waits else state.dues
        return _with(state, (*before, DueFault(now + when.delay, path)))

    def taken(self, number: int, fault: Fault, state: FaultState, now: float) -> FaultState:
        """Return the state of a fault after a due occasion, whether or not there was anything to affect."""
        state = replace(state, waits=False)
        match fault.when:
            case AtNode(each=True):
                return _with(state, state.dues[1:])
            case AtTime(every=float()) if state.due is not None:
                return self._at_time(number, fault, state, state.due, now)
            case _:
                return replace(state, done=True)

    def _at_time(
        self, number: int, fault: Fault, state: FaultState, begin: float, after: float | None = None
    ) -> FaultState:
        """Return the state with the next occasion that is taken: `begin`, or the first of its repetitions
        later than `after`."""
        time, every = begin, fault.when.every if isinstance(fault.when, AtTime) else None
        for _ in range(10_000):  # with a small probability it may never be
            if after is None or time > after + 1e-9:
                happens = self._happens(number, fault, state)
                state = replace(state, chances=state.chances + 1)
                if happens:
                    return replace(state, due=time, node="", then=())
            if every is None:
                break
            time += every
        return replace(state, due=time, done=True)

    def _happens(self, number: int, fault: Fault, state: FaultState) -> bool:
        if fault.probability >= 1.0:
            return True
        rng = self._streams.at(f"fault/{number}", state.chances)
        return float(rng.random()) < fault.probability


def _with(state: FaultState, dues: tuple[DueFault, ...]) -> FaultState:
    if not dues:
        return replace(state, due=None, node="", then=())
    return replace(state, due=dues[0].time, node=dues[0].node, then=dues[1:])


def end_sentence(fault: LastingFault) -> str:
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


def record_details(fault: LastingFault) -> dict[str, Plain]:
    """Return the recorded parameters of the fault."""
    details: dict[str, Plain] = {}
    match fault:
        case GripperWeak(share=share):
            details = {"share": share}
        case JointWeak(joint=joint, share=share):
            details = {"joint": joint, "share": share}
        case WrenchBias(force=force, torque=torque):
            details = {"force": list(force), "torque": list(torque)}
        case CameraShift(moved=moved):
            details = {"position": list(moved.position), "orientation": list(moved.orientation)}
        case CameraNoise(factor=factor):
            details = {"factor": factor}
        case CameraMislabel(colour=colour, shown_as=other, swapped=swapped):
            details = {"colour": colour, "shown_as": other, "swapped": swapped}
        case GripperJam() | Stall() | WrenchDead() | CameraDrop() | NoPlan():
            pass
    if isinstance(fault, CameraFault):
        details["camera"] = fault.camera
    return {**details, "lasts": fault.lasts}


def _begins(fault: LastingFault, width: float) -> str:
    """Return the beginning of a fault in words; `width` is the fingers' opening, m."""
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


def _lasting(fault: LastingFault) -> str:
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


@dataclass(frozen=True, slots=True)
class InjectionResult:
    """Result of carrying out a fault at one occasion."""

    event: event_types.FaultEvent
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
    running tree. `kill` ends the process; without it a repeated run continues past the kill. Faults do not
    affect `nominal` parts.
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
        nominal: Sequence[NominalPart] = (),
    ) -> None:
        self._nominal = tuple(nominal)
        self._faults: tuple[FaultSpec, ...] = faults.faults if faults else ()
        self._hardware = hardware
        self._object_place = object_place
        self._program = program
        self._kill = kill
        self._occasions = FaultSchedule(seed)
        self._states = list(new_states(faults, seed))
        self._pending_events: list[event_types.FaultEvent] = []

    @property
    def no_plan(self) -> Callable[[], bool] | None:
        """Callback for each planning request: whether the planner finds nothing; None without such a fault in
        the file."""
        return self._hardware.faults.no_plan if any(isinstance(f, NoPlan) for f in self._faults) else None

    @property
    def never_due(self) -> tuple[str, ...]:
        """Kinds of the faults that had no occasion so far: the time is to come, or the node did not start."""
        now, never = self._hardware.clock.now, list[str]()
        for fault, state in zip(self._faults, self._states, strict=True):
            match fault.when:
                case AtTime(time=time):
                    waits = time > now
                case AtNode(start=start):
                    waits = state.starts < start
            if waits and not fault.off:
                never.append(fault.fault)
        return tuple(never)

    def node_started(self, path: str) -> None:
        """Note the start of a node. The tree calls this whenever a node starts."""
        now = self._hardware.clock.now
        for n, fault in enumerate(self._faults):
            before = self._states[n]
            state = self._occasions.node_started(n, fault, before, path, now)
            if state is before:
                continue
            self._states[n] = state
            if isinstance(fault, Hang | Raise) and len(state.dues) > len(before.dues):
                self._strike_at_once(n, fault, path, now)

    def tick(self) -> tuple[JournalEvent, ...]:
        """Carry out the due faults and return their events. Called after each tick of the tree."""
        now = self._hardware.clock.now
        happened, self._pending_events = self._pending_events, []
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
        held = self._hardware.faults.held
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
            if self._is_nominal(fault, state.standing):
                self._states[n] = replace(state, standing="")
                continue
            match fault:
                case Slip(friction=friction):
                    self._hardware.lubricate(state.standing, friction, again=True)
                case Kill():
                    self._states[n] = replace(state, standing="")
                case _ if isinstance(fault, LastingFault):
                    self._hardware.afflict(n, fault, state.held)
                case _:
                    pass

    def _over(self, n: int, state: FaultState, now: float) -> bool:
        if self._hardware.faults.spent(n):
            return True
        return state.until is not None and now >= state.until - 1e-9

    def _end(self, n: int, fault: FaultSpec) -> list[event_types.FaultEvent]:
        """End a fault that lasted."""
        state = self._states[n]
        name, self._states[n] = state.standing, replace(state, standing="")
        event = event_types.FaultEvent("", state.node, fault=fault.fault, gone=True)
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
                event = replace(event, message=end_sentence(cast(LastingFault, fault)))
        return [event]

    def _strike(self, n: int, fault: FaultSpec, now: float) -> list[event_types.FaultEvent]:
        """Carry out the first due occasion of a fault."""
        state = self._states[n]
        if state.standing and not isinstance(fault, Obstacle):
            self._end(n, fault)
        outcome = self._outcome(n, fault, state)
        event = replace(outcome.event, node=state.node)
        if event.waits:
            self._states[n] = replace(self._states[n], waits=True)
            return [] if state.waits or not event.message else [event]
        lasts = fault.stays if isinstance(fault, Obstacle) else getattr(fault, "lasts", None)
        until = now if isinstance(fault, Kill) else None if lasts is None else now + lasts
        after = self._occasions.taken(n, fault, self._states[n], now)
        if outcome.standing:
            after = replace(after, standing=outcome.standing, until=until)
        self._states[n] = after
        return [event]

    def _is_nominal(self, fault: FaultSpec, target: str) -> bool:
        return bool(self._nominal) and without_nominal(fault, target, self._nominal) is None

    def _outcome(self, n: int, fault: FaultSpec, state: FaultState) -> InjectionResult:
        target = fault.fixture.id if isinstance(fault, Obstacle) else ""
        if self._is_nominal(fault, target):
            return _no_effect(fault)
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
                return InjectionResult(
                    event_types.FaultEvent("the process is killed", fault="kill"), standing="kill"
                )
            case Remove() | Friction() | Bump() | Heavier() | Larger():
                return self._befall(fault, state)
            case _:
                width = self._hardware.gripper.read().width
                self._hardware.afflict(n, fault)
                sentence = f"{_begins(fault, width)}{_lasting(fault)}"
                event = event_types.FaultEvent(sentence, fault=fault.fault, extra=record_details(fault))
                return InjectionResult(event, standing=fault.fault)

    def _befall(self, fault: ItemFaults, state: FaultState) -> InjectionResult:
        name = fault.fault
        body = choose_target(self._hardware, fault.target, state.node, self._object_place)
        if body is None:
            return InjectionResult(event_types.FaultEvent(f"{name}: no item fits", fault=name, extra=NO_ITEM))
        left = without_nominal(fault, body.id, self._nominal)
        if left is None:
            return _no_effect(fault)
        message = apply_item_fault(cast("ItemFaults", left), body, self._hardware)
        event = event_types.FaultEvent(
            message or "", fault=name, item=body.id, extra=item_fault_details(fault, body)
        )
        if message is None:
            event = replace(event, message=f"{body.id} waits for room to be larger", waits=True)
        return InjectionResult(event)

    def _obstruct(self, fault: Obstacle, state: FaultState) -> InjectionResult:
        """Add the obstacle, or wait until its place is free."""
        body = fault.fixture
        event = event_types.FaultEvent(
            "", fault="obstacle", obstacle=body.id, extra={"at": body.pose.position}
        )
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
        event = event_types.FaultEvent("", fault="appear", extra={"kind": fault.kind, "colour": fault.colour})
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
        event = event_types.FaultEvent(
            "", fault="slip", extra={"friction": fault.friction, "lasts": fault.lasts}
        )
        item = self._hardware.in_hand()
        if item is None:  # it waits for something to be held
            return InjectionResult(replace(event, waits=True))
        if self._is_nominal(fault, item):
            return _no_effect(fault)
        self._hardware.lubricate(item, fault.friction)
        lasting = "" if fault.lasts is None else f" for {fault.lasts:g} s"
        message = f"{item} slips: its friction is {fault.friction:g}{lasting}"
        return InjectionResult(replace(event, message=message, item=item), standing=item)

    def _meddle(self, fault: Hang | Raise, state: FaultState) -> InjectionResult:
        """Replace the generator of the running skill."""
        name = fault.fault
        tree = None if self._program is None else self._program()
        path = None if tree is None else tree.acting(state.node)
        if tree is None or path is None:
            message = f"{name}: the node had ended before"
            return InjectionResult(event_types.FaultEvent(message, fault=name, extra={"skill": None}))
        if not path:
            return InjectionResult(event_types.FaultEvent("", fault=name, waits=True))
        if self._is_nominal(fault, path):
            return _no_effect(fault)
        tree.stand_in(path, _fault_generator(fault))
        return _program_fault_result(fault, path)

    def _strike_at_once(self, n: int, fault: Hang | Raise, path: str, now: float) -> None:
        """Replace the generator of a skill that has just started, which may end in the same tick."""
        state = self._states[n]
        if state.dues[0].time > now or self._program is None or self._is_nominal(fault, path):
            return
        if self._program().stand_in(path, _fault_generator(fault)):
            outcome = _program_fault_result(fault, path)
            self._pending_events.append(replace(outcome.event, node=path))
            self._states[n] = self._occasions.taken(n, fault, state, now)


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
        before[1][n] if known.get(n) == fault else occasions.begun(n, fault, since)
        for n, fault in enumerate(faults.faults if faults else ())
    )


def _no_effect(fault: Fault) -> InjectionResult:
    """Return the result of a fault whose target is held nominal."""
    message = f"{fault.fault} has no effect: its target is held nominal"
    return InjectionResult(event_types.FaultEvent(message, fault=fault.fault, extra=NO_ITEM))


def _program_fault_result(fault: Hang | Raise, path: str) -> InjectionResult:
    name = path.rsplit("/", 1)[-1]
    does = "hangs" if isinstance(fault, Hang) else "raises an exception"
    return InjectionResult(
        event_types.FaultEvent(f"the code of {name} {does}", fault=fault.fault, skill=path)
    )


def _fault_generator(fault: Hang | Raise) -> Callable[[], Generator[None, None, None]]:
    """Return the generator that replaces a skill: it yields for ever, or raises in its first tick."""

    def body() -> Generator[None, None, None]:
        while isinstance(fault, Hang):
            yield
        raise RuntimeError("the skill's code cannot go on")

    return body
