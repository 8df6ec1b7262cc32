"""Payload of the held object: slip watch, grip monitor, and weighing during the lift, without a stop.

The wrist sensor also reads inertial forces. Over some time the force adds up to the change of momentum
(impulse theorem), and the encoders give the velocities at both ends. The rest is the weight of the load.
Measured over 168 lifts: error 4 g (median), 11 g (95 %), at most 13 g. On the turns of a transfer, where the
object swings about the hand, up to 200 g: those ticks are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from picktree.robot.control import (
    MassEstimate,
    Payload,
    SlipDetector,
    WristSample,
    estimate_moving_mass,
    point_velocity,
    wrist_sample,
)
from picktree.robot.planning import CARRYING_ACCELERATION
from picktree.world import GRAVITY, Array, Failure, Pose, event_types, grasp
from picktree.world.scene import MIN_DETECTABLE_MASS, CatalogueEntry

from .grip_force import SLIP_GRIP_FACTOR, GripForce, required_force
from .held_object import MAX_EMPTY_WIDTH, MIN_HELD_LOAD, GripCheck, check_grip

if TYPE_CHECKING:
    from picktree.robot import World


def tighten_grip(world: World, felt: float, payload: Payload) -> bool:
    """Increase the grip force when only `felt` kg of the payload load the hand. False: the grip's limit is
    reached.

    A sliding object loads the hand with 2 μ F. That gives the friction, and the friction gives the required
    force.
    """
    before = world.gripper.force
    friction = max(felt, 0.0) * GRAVITY / (2.0 * before) if before > 0.0 else 0.0
    world.gripper.press(
        max(before * SLIP_GRIP_FACTOR, min(required_force(payload.mass, friction), world.gripper.bound))
    )
    if world.gripper.force <= before + 1e-9:
        return False
    world.journal.note(
        event_types.SlipEvent(
            f"it slips: the fingers press with {world.gripper.force:.0f} N instead of {before:.0f} N "
            f"({felt * 1000:.0f} g of {payload} are felt)",
            force=world.gripper.force,
            before=before,
            felt=felt,
            mass=payload.mass,
        )
    )
    return True


CATALOGUE_MASS_SIGMA = 0.25
"""Standard deviation of a catalogue mass, as a share of it."""
WEIGHED_MASS_SIGMA = 0.006
"""Standard deviation of a weighed mass, kg."""
FRAGILE_FORCE_LIMIT = 20.0
"""Force limit below which a kind is fragile, N."""
GUARD_PAYLOAD = 0.4
"""Payload whose inertial force on a fast transfer the guard of a motion allows for, kg."""


def register_payload(
    world: World, press: GripForce, entry: CatalogueEntry | None, object_in_tcp: Pose
) -> None:
    """Set the grip force for the believed weight, and register the object as the wrist's payload."""
    world.gripper.bound = press.most
    world.gripper.press(press.grip)
    if entry is not None:
        centre = object_in_tcp.position
        world.control.wrist.carry(Payload(entry.mass, CATALOGUE_MASS_SIGMA * entry.mass, centre))


def update_payload_mass(world: World, hold: GripCheck, press: GripForce | None = None) -> None:
    """Set the wrist's payload and the held object's mass to the weighed one, and increase the grip force if
    that needs it.

    The object is lifted off its support.
    """
    mass = hold.mass
    if mass is None:
        return
    before = world.control.wrist.payload
    centre = (0.0, 0.0, 0.0) if before is None else before.centre
    world.control.wrist.carry(Payload(mass, WEIGHED_MASS_SIGMA, centre))
    held = world.scene.held
    if held is not None:
        world.scene.weighed(held.id, mass)
    firm = 0.0 if press is None else press.carrying(mass)
    if firm > world.gripper.force:
        world.gripper.press(firm)


def is_fragile(world: World, kind: str) -> bool:
    """Return whether a bump of the hand would crush items of that kind."""
    entry = world.description.find_entry(kind)
    return entry is not None and entry.force_limit is not None and entry.force_limit < FRAGILE_FORCE_LIMIT


def payload_force(world: World) -> float:
    """Return the force on the wrist by which the payload on a fast transfer exceeds the guard's allowance,
    N."""
    payload = world.control.wrist.payload
    return (
        0.0 if payload is None else max(0.0, payload.mass - GUARD_PAYLOAD) * (GRAVITY + CARRYING_ACCELERATION)
    )


LIFTED_HEIGHT = 0.02
"""Height above the grasp from which the object is lifted off its support, m."""
MAX_WEIGHING_TURN = 0.5
"""Angular speed of the hand above which a tick does not count, rad/s."""
MAX_WEIGHING_TICKS, MIN_WEIGHING_TICKS = 6, 2
"""Greatest and least number of ticks in a weighing: the last quiet ones."""
MAX_OPENING_CHANGE = 0.003
"""Change of the opening that shows a motion of the object between the fingers, m. The opening is read to 0.2
mm."""
COMES_ALONG_HEIGHT = 0.003
"""Height above the grasp from which the object should come along, m."""
SLIDING_WEIGHT_SHARE = 0.75
"""Share of the expected weight below which an object may slide between the fingers."""
CERTAIN_LOAD = MIN_HELD_LOAD + 0.015 * GRAVITY
"""Load that leaves no doubt, N: the least held load and the greatest error."""


@dataclass(frozen=True, slots=True)
class _Tick:
    """One tick: mean downward force on the sensor, N, and the hand's vertical speed at its end, m/s."""

    pull: float
    speed: float
    quiet: bool


class GripMonitor:
    """Grip monitor of a motion that carries an object: each tick checks the opening, and compares the load on
    the wrist with the known payload.

    The payload comes from `WristWrench.carry`; without one, the load is not watched. When the load is too
    small, the fingers press more firmly, up to `GripperControl.bound`. When the object is gone, the failure
    grasp.slipped brakes the arm. Only a measurement at rest shows whether something is still held.
    """

    def __init__(self, world: World, above: float = -1e9) -> None:
        """`above`: height of the TCP above which the object is lifted off its support, m."""
        self._world = world
        self._above = above
        self._width = world.gripper.width
        self._before: WristSample | None = None
        self._detector: SlipDetector | None = None
        self.felt: MassEstimate | None = None
        """Mass on the hand in the last tick. None: not measured."""
        self.load_gone = False
        """Whether the load, not the fingers, stopped the arm."""

    def watch(self) -> Failure | None:
        """Return the failure that stops the arm; None to continue. For `ArmMotion.along` and `finish`."""
        width = self._world.gripper.width
        met = width <= MAX_EMPTY_WIDTH < self._width
        if met or abs(width - self._width) > MAX_OPENING_CHANGE:
            return Failure(grasp.SLIPPED, "the fingers move")
        self.load_gone = self._load_is_gone()
        return Failure(grasp.SLIPPED, "less is felt than was taken up") if self.load_gone else None

    def _load_is_gone(self) -> bool:
        """Add the load of this tick, and return whether the object is gone."""
        world = self._world
        payload = world.control.wrist.payload
        self.felt = felt = None if payload is None else self._moving_mass(np.array(payload.centre))
        if payload is None or felt is None or world.control.tcp.position[2] < self._above:
            return False
        if self._detector is None or self._detector.payload is not payload:
            self._detector = SlipDetector(payload)
        detector = self._detector
        detector.feel(felt)
        if detector.slipping and tighten_grip(world, felt.mass, payload):
            detector.forget()
            return False
        return detector.gone

    def _moving_mass(self, centre: Array) -> MassEstimate | None:
        world = self._world
        q, v = world.control.state.position, world.control.state.velocity
        now = wrist_sample(world.robot, q, v, world.control.wrist.over(world.tick, q)[:3], centre)
        before, self._before = self._before, now
        return (
            None if before is None else estimate_moving_mass(world.robot.hand_mass, before, now, world.tick)
        )

    @property
    def weight(self) -> float | None:
        """Weight of the payload, N, where the last tick shows that it is held; None: measure it at rest.

        The fingers alone show it for a payload that is too light to be felt.
        """
        payload, felt = self._world.control.wrist.payload, self.felt
        if payload is not None and payload.mass < MIN_DETECTABLE_MASS:
            return payload.mass * GRAVITY
        if payload is None or felt is None or (felt.mass - felt.unsure) * GRAVITY < MIN_HELD_LOAD:
            return None
        return payload.mass * GRAVITY


class LiftWeighing:
    """Monitor of a lift, for each tick: grip monitor and weighing.

    `watch` brakes the arm with grasp.slipped when the fingers move, or when the load leaves doubt at the end
    of the lift.
    """

    def __init__(self, world: World, lifted: float) -> None:
        """Begin at the grasp with the arm at rest. `lifted`: time from the motion's start to the end of the
        lift, s."""
        self._world = world
        self._height = world.control.tcp.position[2]
        self._grip_monitor = GripMonitor(world, self._height + LIFTED_HEIGHT)
        self._ends = world.clock.now + lifted
        self._ticks: list[_Tick] = []
        self.hold: GripCheck | None = None
        """Grip check of the lift. None: not finished, or in doubt."""

    def watch(self) -> Failure | None:
        """Add this tick, and return the failure that stops the arm; None to continue."""
        moved = self._grip_monitor.watch()
        if moved is not None or self.hold is not None:
            return moved
        self._ticks.append(self._tick())
        self._hold_on()
        if self._world.clock.now < self._ends - 1e-9:
            return None
        load, lately = self.load(MAX_WEIGHING_TICKS), self.load(MIN_WEIGHING_TICKS)
        hold = check_grip(self._world, load)
        if load is None or lately is None or (hold.light is None and min(load, lately) < CERTAIN_LOAD):
            return Failure(grasp.SLIPPED, "what hangs on the hand has to be felt at rest")
        if not hold.held:
            return Failure(grasp.SLIPPED, "what the fingers hold has to be felt at rest")
        self.hold = hold
        return None

    def _hold_on(self) -> None:
        """Increase the grip force when the object does not come up with the hand or weighs less than its
        kind."""
        payload, felt = self._world.control.wrist.payload, self._grip_monitor.felt
        if (
            payload is None
            or felt is None
            or payload.mass < MIN_DETECTABLE_MASS
            or self._world.control.tcp.position[2] < self._height + COMES_ALONG_HEIGHT
        ):
            return
        if felt.mass + felt.unsure / 2 < SLIDING_WEIGHT_SHARE * payload.mass:
            tighten_grip(self._world, felt.mass, payload)

    def load(self, most: int = MAX_WEIGHING_TICKS) -> float | None:
        """Return the weight on the hand over the last quiet ticks, N. None: there are too few of them."""
        ticks = list(self._ticks)
        while ticks and not ticks[-1].quiet:
            ticks.pop()
        loud = next((k for k in reversed(range(len(ticks))) if not ticks[k].quiet), -1)
        run = ticks[max(loud, 0) :][-most - 1 :]
        before, counted = run[:1], run[1:]
        if len(counted) < MIN_WEIGHING_TICKS:
            return None
        time = len(counted) * self._world.tick
        rising = (counted[-1].speed - before[0].speed) / time
        pull = sum(t.pull for t in counted) / len(counted)
        carried = (pull - self._world.robot.hand_mass * rising) / (GRAVITY + rising)
        return carried * GRAVITY

    def _tick(self) -> _Tick:
        world = self._world
        state, robot = world.control.state, world.robot
        twist = robot.jacobian(state.position) @ state.velocity
        tcp = robot.tcp(state.position)
        centre = robot.flange(state.position).apply(np.array(robot.hand_com))
        speed = float(point_velocity(twist, centre - np.array(tcp.position))[2])
        turning = float(np.linalg.norm(twist[3:]))
        clear = tcp.position[2] - self._height > LIFTED_HEIGHT
        return _Tick(world.control.load(world.tick), speed, clear and turning < MAX_WEIGHING_TURN)  # rad/s
