"""Weighing what the hand holds while it lifts it, without a stop.

The sensor at the wrist feels what is beyond it accelerate, too. Over some time, though, the force adds up to
the change of momentum (the impulse theorem), and the velocities at both ends are known from the encoders:
what is left is the weight of what hangs on the hand. Measured over lifts: 4 g off (root mean square), 10 g at
worst; on the turns of a transfer, where the object swings about the hand, up to 200 g: those are left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...control.wrist.payload_estimate import SPREAD, Payload
from ...control.wrist.slip_detection import (
    MassEstimate,
    SlipDetector,
    WristSample,
    estimate_moving_mass,
    wrist_sample,
)
from ...world.causes import Failure, grasp
from ...world.journal import JournalEvent
from ...world.scene.description import CatalogueEntry
from ...world.values import GRAVITY, Array, Pose
from ..grasp.grip_force import ACCELERATION, FIRMER, GripForce, required_force
from .hold_check import EMPTY_WIDTH, LEAST_LOAD, GripCheck

if TYPE_CHECKING:
    from ...cell.world import World


class SlipWatch:
    """Asked each tick while the arm carries something: does the hand still feel all of what it took up?

    The wrist's payload says what that is (`Wrist.carry`); without one, nothing is watched. Where less is
    felt, the fingers press more firmly, up to what the grip allows (`Grip.bound`).
    """

    def __init__(self, world: World, above: float = -1e9) -> None:
        """`above`: height of the TCP above which the object no longer rests on anything, m."""
        self._world = world
        self._above = above
        self._before: WristSample | None = None
        self._detector: SlipDetector | None = None
        self.felt: MassEstimate | None = None
        """What hung on the hand in the last tick, as far as it is known."""

    def watch(self) -> bool:
        """Take this tick into account; True when the object is gone."""
        world = self._world
        payload = world.control.wrist.payload
        self.felt = felt = None if payload is None else self._felt(np.array(payload.centre))
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

    def _felt(self, centre: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> MassEstimate | None:
        world = self._world
        q, v = world.control.state.position, world.control.state.velocity
        now = wrist_sample(world.robot, q, v, world.control.wrist.over(world.tick, q)[:3], centre)
        before, self._before = self._before, now
        return (
            None if before is None else estimate_moving_mass(world.robot.hand_mass, before, now, world.tick)
        )


def tighten_grip(world: World, felt: float, payload: Payload) -> bool:
    """Of an object only `felt` kg hang on the hand: press more firmly, as far as the grip allows; False when
    it does not.

    What slides is pulled by 2 μ F, which tells the friction, and that the force that is needed.
    """
    before = world.grip.force
    friction = max(felt, 0.0) * GRAVITY / (2.0 * before) if before > 0.0 else 0.0
    world.grip.press(max(before * FIRMER, min(required_force(payload.mass, friction), world.grip.bound)))
    if world.grip.force <= before + 1e-9:
        return False
    world.journal.note(
        JournalEvent(
            "slip",
            f"it slips: the fingers press with {world.grip.force:.0f} N instead of {before:.0f} N "
            f"({felt * 1000:.0f} g of {payload} are felt)",
            data={"force": world.grip.force, "before": before, "felt": felt, "mass": payload.mass},
        )
    )
    return True


NEAR = (SPREAD / 3, SPREAD / 3, SPREAD / 3)
"""Standard deviation of where its centre is believed, m."""
VAGUE = 0.25
"""Standard deviation of a mass in the catalogue, as a share of it."""
WEIGHED = 0.005
"""Of a mass that was weighed, kg."""
FRAGILE = 20.0
"""N"""
LIGHT = 0.4
"""What carrying so much does to the wrist on a fast transfer, the guard of a motion has room for, kg."""


def register_payload(
    world: World, press: GripForce, entry: CatalogueEntry | None, object_in_tcp: Pose
) -> None:
    """The fingers hold something: press for its believed weight, and know it as the wrist's payload."""
    world.grip.bound = press.most
    world.grip.press(press.grip)
    if entry is not None:
        centre = object_in_tcp.position
        world.control.wrist.carry(Payload(entry.mass, VAGUE * entry.mass, centre, NEAR))


def update_payload_mass(world: World, hold: GripCheck, press: GripForce | None = None) -> None:
    """It is off the ground and was weighed: know that, and press for what it weighs."""
    if hold.load is None:
        return
    mass = hold.load / GRAVITY
    before = world.control.wrist.payload
    centre = (0.0, 0.0, 0.0) if before is None else before.centre
    world.control.wrist.carry(Payload(mass, WEIGHED, centre, NEAR))
    firm = 0.0 if press is None else press.carrying(mass)
    if firm > world.grip.force:
        world.grip.press(firm)


def is_fragile(world: World, kind: str) -> bool:
    """Whether items of that kind are crushed by what a hand bumps them with."""
    limits = [e.force_limit for e in world.description.catalogue if e.kind == kind]
    return any(limit is not None and limit < FRAGILE for limit in limits)


def payload_force(world: World) -> float:
    """Force on the wrist that carrying adds on a fast transfer beyond what a guard leaves room for, N."""
    payload = world.control.wrist.payload
    return 0.0 if payload is None else max(0.0, payload.mass - LIGHT) * (GRAVITY + ACCELERATION)


CLEAR = 0.02
"""Height above the grasp from which the object no longer rests on what it stood on, m."""
TURNING = 0.25
"""Of the hand, above which a tick does not count, rad/s."""
TICKS, FEWEST = 6, 3
"""Ticks over which is weighed: the last ones, and at least so many."""
STEADY = 0.003
"""Change of the opening that says that the object moves between the fingers, m: they are read to 0.2 mm."""
BEGUN = 0.003
"""Height above the grasp from which the object should come along, m."""
SLIDING = 0.75
"""Share of the weight that was expected below which an object may slide between the fingers."""
SURE = LEAST_LOAD + 0.013 * GRAVITY
"""Load that leaves no doubt, N: by the greatest error more than what counts as held."""


@dataclass(frozen=True, slots=True)
class _Tick:
    """One tick: the mean pull on the sensor downwards, N, and the hand's vertical speed at its end, m/s."""

    pull: float
    speed: float
    quiet: bool


class GripMonitor:
    """Asked each tick while the arm carries an object: do the fingers stay as far apart as they were, and
    does the wrist feel what it did? What slips is gripped more firmly.

    If it is not there any more, `doubt` is what brakes the arm. It says nothing of what is held: that has to
    be felt at rest.
    """

    def __init__(self, world: World, above: float = -1e9) -> None:
        """`above`: height of the TCP above which the object no longer rests on anything, m."""
        self._grip = world.grip
        self._width = world.grip.width
        self._slip = SlipWatch(world, above)
        self.doubt: Failure | None = None

    @property
    def felt(self) -> MassEstimate | None:
        """What hung on the hand in the last tick, as far as it is known."""
        return self._slip.felt

    def watch(self) -> Failure | None:
        """For `ArmMotion.along` and `finish`."""
        width = self._grip.width
        if width <= EMPTY_WIDTH or abs(width - self._width) > STEADY:
            return self.stop("the fingers move")
        return self.stop("less is felt than was taken up") if self._slip.watch() else None

    def stop(self, why: str) -> Failure:
        self.doubt = Failure(grasp.SLIPPED, why)
        return self.doubt


class LiftWeighing:
    """Asked each tick while the arm lifts an object: does it stay in the hand, and what does it weigh?

    `watch` brakes the arm when the fingers move, or when the lift is over and the load leaves doubt.
    """

    def __init__(self, world: World, lifted: float) -> None:
        """Begin at the grasp, the arm at rest. `lifted`: seconds from the motion's start to the end of the
        lift."""
        self._world = world
        self._height = world.control.tcp.position[2]
        self._kept = GripMonitor(world, self._height + CLEAR)
        self._ends = world.clock.now + lifted
        self._ticks: list[_Tick] = []
        self.hold: GripCheck | None = None
        """What was felt, when it leaves no doubt."""

    @property
    def doubt(self) -> Failure | None:
        """What stopped the arm, see `GripMonitor`."""
        return self._kept.doubt

    def watch(self) -> Failure | None:
        """Take this tick into account; a failure when the arm should stop."""
        moved = self._kept.watch()
        if moved is not None or self.hold is not None:
            return moved
        self._ticks.append(self._tick())
        self._hold_on()
        if self._world.clock.now < self._ends - 1e-9:
            return None
        load, lately = self.load(TICKS), self.load(FEWEST)
        if load is None or lately is None or min(load, lately) < SURE:
            return self._kept.stop("what hangs on the hand has to be felt at rest")
        self.hold = GripCheck(self._world.grip.width, load)
        return None

    def _hold_on(self) -> None:
        """What does not come up with the hand, or weighs less than its kind, slides: press more firmly."""
        payload, felt = self._world.control.wrist.payload, self._kept.felt
        if payload is None or felt is None or self._world.control.tcp.position[2] < self._height + BEGUN:
            return
        if felt.mass + felt.unsure / 2 < SLIDING * payload.mass:
            tighten_grip(self._world, felt.mass, payload)

    def load(self, most: int = TICKS) -> float | None:
        """Weight on the hand over the last ticks that count, N; None when there were too few of them."""
        ticks = list(self._ticks)
        while ticks and not ticks[-1].quiet:
            ticks.pop()
        loud = next((k for k in reversed(range(len(ticks))) if not ticks[k].quiet), -1)
        run = ticks[max(loud, 0) :][-most - 1 :]
        before, counted = run[:1], run[1:]
        if len(counted) < FEWEST:
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
        speed = float(_at(twist, centre - np.array(tcp.position))[2])
        turning = float(np.linalg.norm(twist[3:]))
        clear = tcp.position[2] - self._height > CLEAR
        return _Tick(world.control.load(world.tick), speed, clear and turning < TURNING)


def _at(twist: Array, lever: Array) -> Array:
    """Velocity (3,) of a point of the hand, `lever` (3,) away from the TCP."""
    return np.asarray(twist[:3] + np.cross(twist[3:], lever), np.float64)
