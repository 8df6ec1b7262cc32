"""What slips is gripped more firmly, at once and without a stop; what is gone stops the arm."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...control.wrist.payload_estimate import Payload
from ...control.wrist.slip_detection import FeltMass, Moving, SlipDetector, carried, moving
from ...world.journal import Happened
from ...world.values import GRAVITY
from ..grasp.grip_force import FIRMER, needed

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
        self._before: Moving | None = None
        self._detector: SlipDetector | None = None
        self.felt: FeltMass | None = None
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
        if detector.slipping and firmer(world, felt.mass, payload):
            detector.forget()
            return False
        return detector.gone

    def _felt(self, centre: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> FeltMass | None:
        world = self._world
        q, v = world.control.state.position, world.control.state.velocity
        now = moving(world.robot, q, v, world.control.wrist.over(world.tick, q)[:3], centre)
        before, self._before = self._before, now
        return None if before is None else carried(world.robot.hand_mass, before, now, world.tick)


def firmer(world: World, felt: float, payload: Payload) -> bool:
    """Of an object only `felt` kg hang on the hand: press more firmly, as far as the grip allows; False when
    it does not.

    What slides is pulled by 2 μ F, which tells the friction, and that the force that is needed.
    """
    before = world.grip.force
    friction = max(felt, 0.0) * GRAVITY / (2.0 * before) if before > 0.0 else 0.0
    world.grip.press(max(before * FIRMER, min(needed(payload.mass, friction), world.grip.bound)))
    if world.grip.force <= before + 1e-9:
        return False
    world.journal.note(
        Happened(
            "slip",
            f"it slips: the fingers press with {world.grip.force:.0f} N instead of {before:.0f} N "
            f"({felt * 1000:.0f} g of {payload} are felt)",
            data={"force": world.grip.force, "before": before, "felt": felt, "mass": payload.mass},
        )
    )
    return True
