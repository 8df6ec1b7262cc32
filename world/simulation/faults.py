"""Carrying out a fault file: at its time, or when a node starts, something is done to an item or the way."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from ..errors import PicktreeError
from ..faults.description import AtTime, Bump, FaultFile, FaultSpec, Friction, Obstacle, Remove, Target
from ..files.node_pattern import node_matches
from ..journal import Happened, Plain
from ..protocols import Clock
from ..scene.description import Fixture
from ..values import ObjectId, Pose, Vector3
from .truth import TrueBody, TrueObstacle


class Faulty(Protocol):
    """What a backend lets faults do."""

    @property
    def clock(self) -> Clock: ...
    def truth(self) -> tuple[TrueBody, ...]: ...
    def true_tcp(self) -> Pose: ...
    def remove(self, item: str) -> None: ...
    def change_dynamics(
        self, item: str, friction: float | None = None, mass: float | None = None
    ) -> None: ...
    def bump(self, item: str, velocity: Vector3, spin: Vector3 = (0.0, 0.0, 0.0)) -> None: ...
    def obstacles(self) -> tuple[TrueObstacle, ...]: ...
    def room_for(self, body: Fixture) -> bool: ...
    def put_obstacle(self, body: Fixture) -> ObjectId: ...
    def take_obstacle(self, name: ObjectId) -> None: ...


@dataclass(frozen=True, slots=True)
class FaultState:
    """How far one fault has come."""

    starts: int = 0
    """How often the node that it waits for has started."""
    due: float | None = None
    """Simulated time, s; None while it waits for a node."""
    node: str = ""
    """Path of the node whose start made it due."""
    done: bool = False
    standing: str = ""
    """Name of the obstacle that it has put into the way and has yet to take away."""
    until: float = 0.0
    """When it takes that away, s."""
    waits: bool = False
    """It is due, but something is in its place."""


class Injector:
    """Carries out faults once each, between two ticks.

    `object_place` tells where the belief has the object of a node, by the node's path.
    """

    def __init__(
        self,
        faults: FaultFile | None,
        hardware: Faulty,
        object_place: Callable[[str], Vector3 | None] = lambda _: None,
    ) -> None:
        self._faults: tuple[FaultSpec, ...] = faults.faults if faults else ()
        for fault in self._faults:
            if not isinstance(fault, Remove | Friction | Bump | Obstacle):
                kind = type(fault).__name__
                raise PicktreeError(f"{faults.source if faults else ''}: {kind} cannot be carried out yet")
        self._hardware = hardware
        self._object_place = object_place
        self._states = [
            FaultState(due=f.when.time if isinstance(f.when, AtTime) else None) for f in self._faults
        ]

    def node_started(self, path: str) -> None:
        """Called by the tree whenever a node starts."""
        for n, (fault, state) in enumerate(zip(self._faults, self._states, strict=True)):
            when = fault.when
            if isinstance(when, AtTime) or state.due is not None or not node_matches(when.pattern, path):
                continue
            state = replace(state, starts=state.starts + 1)
            if state.starts == when.start:
                state = replace(state, due=self._hardware.clock.now + when.delay, node=path)
            self._states[n] = state

    def tick(self) -> tuple[Happened, ...]:
        """Carry out what is due now. Called after each tick of the tree."""
        now = self._hardware.clock.now
        happened: list[Happened] = []
        for n, (fault, state) in enumerate(zip(self._faults, self._states, strict=True)):
            if state.standing and now >= state.until - 1e-9:
                happened.append(self._clear(state))
                self._states[n] = replace(state, standing="")
            elif not state.done and state.due is not None and now >= state.due - 1e-9:
                if isinstance(fault, Obstacle):
                    self._states[n], told = self._obstruct(fault, state, now)
                    happened += told
                else:
                    self._states[n] = replace(state, done=True)
                    happened.append(self._carry_out(fault, state.node))
        return tuple(happened)

    def state(self) -> tuple[FaultState, ...]:
        """For a checkpoint; what faults have done to items is in the hardware's own."""
        return tuple(self._states)

    def restore(self, states: Sequence[FaultState]) -> None:
        """Raises PicktreeError when they are of another fault file."""
        if len(states) != len(self._faults):
            raise PicktreeError(f"the checkpoint knows {len(states)} faults, the file {len(self._faults)}")
        self._states = list(states)

    def _obstruct(self, fault: Obstacle, state: FaultState, now: float) -> tuple[FaultState, list[Happened]]:
        """Put the obstacle where it belongs, or wait until nothing is there."""
        body = fault.body
        data: dict[str, Plain] = {"fault": "obstacle", "obstacle": body.id, "at": list(body.pose.position)}
        if not self._hardware.room_for(body):
            if state.waits:
                return state, []
            message = f"{body.id} waits until nothing is in its place"
            return replace(state, waits=True), [
                Happened("fault", message, state.node, data | {"waits": True})
            ]
        name = self._hardware.put_obstacle(body)
        state = replace(state, done=True, waits=False)
        if fault.stays is not None:
            state = replace(state, standing=str(name), until=now + fault.stays)
        message = f"{name} is put into the way"
        return state, [Happened("fault", message, state.node, data | {"obstacle": name})]

    def _clear(self, state: FaultState) -> Happened:
        self._hardware.take_obstacle(ObjectId(state.standing))
        data: dict[str, Plain] = {"fault": "obstacle", "obstacle": state.standing, "gone": True}
        return Happened("fault", f"{state.standing} is taken away", state.node, data)

    def _carry_out(self, fault: FaultSpec, node: str) -> Happened:
        assert isinstance(fault, Remove | Friction | Bump)
        name = type(fault).__name__.lower()
        body = self._choose(fault.target, node)
        if body is None:
            return Happened("fault", f"{name}: no item fits", node, {"fault": name, "item": None})
        data: dict[str, Plain] = {"fault": name, "item": body.id, "kind": body.kind, "colour": body.colour}
        match fault:
            case Remove():
                self._hardware.remove(body.id)
                message = f"{body.id} is snatched away"
            case Friction(friction=friction, mass=mass):
                self._hardware.change_dynamics(body.id, friction, mass)
                data |= {"friction": friction, "mass": mass}
                message = f"{body.id} has friction {friction:g} now"
                message += f" and weighs {mass:g} kg" if mass is not None else ""
            case Bump(velocity=velocity, spin=spin):
                self._hardware.bump(body.id, velocity, spin)
                data |= {"velocity": list(velocity), "spin": list(spin)}
                message = f"{body.id} is bumped to {math.hypot(*velocity):.2f} m/s"
        return Happened("fault", message, node, data)

    def _choose(self, target: Target, node: str) -> TrueBody | None:
        fitting = [
            body
            for number, body in enumerate(self._hardware.truth())
            if body.present
            and target.index in (None, number)
            and target.kind in (None, body.kind)
            and target.form in (None, body.form)
            and target.colour in (None, body.colour)
        ]
        match target.nearest_to:
            case "tool":
                near = self._hardware.true_tcp().position
            case "object":
                near = self._object_place(node)
            case None:
                near = None
        if near is None:
            return fitting[0] if fitting else None
        return min(fitting, key=lambda body: math.dist(body.pose.position, near), default=None)
