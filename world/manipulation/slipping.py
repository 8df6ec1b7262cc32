"""What slips is gripped more firmly, at once and without a stop; what is gone stops the arm."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..control.slip import FeltMass, Moving, SlipDetector, carried, moving
from ..journal import Happened
from .pressing import FIRMER

if TYPE_CHECKING:
    from ..world import World


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

    def watch(self) -> bool:
        """Take this tick into account; True when the object is gone."""
        world = self._world
        payload = world.control.wrist.payload
        state = world.control.state
        if payload is None or world.robot.tcp(state.position).position[2] < self._above:
            self._before = None
            return False
        if self._detector is None or self._detector.payload is not payload:
            self._detector = SlipDetector(payload)
        felt = self._felt(np.array(payload.centre))
        if felt is None:
            return False
        detector = self._detector
        detector.feel(felt)
        if detector.slipping and firmer(world, f"{felt.mass * 1000:.0f} g of {payload} are felt"):
            detector.forget()
            return False
        return detector.gone

    def _felt(self, centre: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> FeltMass | None:
        world = self._world
        q, v = world.control.state.position, world.control.state.velocity
        now = moving(world.robot, q, v, world.control.wrist.over(world.tick, q)[:3], centre)
        before, self._before = self._before, now
        return None if before is None else carried(world.robot.hand_mass, before, now, world.tick)


def firmer(world: World, why: str) -> bool:
    """Press more firmly, as far as the grip allows; False when it does not."""
    before = world.grip.force
    world.grip.press(min(before * FIRMER, world.grip.bound))
    if world.grip.force <= before + 1e-9:
        return False
    world.journal.note(
        Happened(
            "slip",
            f"it slips: the fingers press with {world.grip.force:.0f} N instead of {before:.0f} N ({why})",
            data={"force": world.grip.force, "before": before},
        )
    )
    return True
