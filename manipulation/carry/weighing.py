"""Weighing what the hand holds while it lifts it, without a stop.

The sensor at the wrist feels what is beyond it accelerate, too. Over some time, though, the force adds up to
the change of momentum (the impulse theorem), and the velocities at both ends are known from the encoders:
what is left is the weight of what hangs on the hand. Measured over lifts: 4 g off (root mean square), 10 g at
worst; on the turns of a transfer, where the object swings about the hand, up to 200 g: those are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...control.wrist.slip_detection import FeltMass
from ...world.causes import Failure, grasp
from ...world.values import GRAVITY, Array
from .hold_check import EMPTY_WIDTH, LEAST_LOAD, Hold
from .slip_reaction import SlipWatch, firmer

if TYPE_CHECKING:
    from ...cell.world import World

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


class Kept:
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
    def felt(self) -> FeltMass | None:
        """What hung on the hand in the last tick, as far as it is known."""
        return self._slip.felt

    def watch(self) -> Failure | None:
        """For `Motions.along` and `finish`."""
        width = self._grip.width
        if width <= EMPTY_WIDTH or abs(width - self._width) > STEADY:
            return self.stop("the fingers move")
        return self.stop("less is felt than was taken up") if self._slip.watch() else None

    def stop(self, why: str) -> Failure:
        self.doubt = Failure(grasp.SLIPPED, why)
        return self.doubt


class Weighing:
    """Asked each tick while the arm lifts an object: does it stay in the hand, and what does it weigh?

    `watch` brakes the arm when the fingers move, or when the lift is over and the load leaves doubt.
    """

    def __init__(self, world: World, lifted: float) -> None:
        """Begin at the grasp, the arm at rest. `lifted`: seconds from the motion's start to the end of the
        lift."""
        self._world = world
        self._height = world.control.tcp.position[2]
        self._kept = Kept(world, self._height + CLEAR)
        self._ends = world.clock.now + lifted
        self._ticks: list[_Tick] = []
        self.hold: Hold | None = None
        """What was felt, when it leaves no doubt."""

    @property
    def doubt(self) -> Failure | None:
        """What stopped the arm, see `Kept`."""
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
        self.hold = Hold(self._world.grip.width, load)
        return None

    def _hold_on(self) -> None:
        """What does not come up with the hand, or weighs less than its kind, slides: press more firmly."""
        payload, felt = self._world.control.wrist.payload, self._kept.felt
        if payload is None or felt is None or self._world.control.tcp.position[2] < self._height + BEGUN:
            return
        if felt.mass + felt.unsure / 2 < SLIDING * payload.mass:
            firmer(self._world, felt.mass, payload)

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
