"""Motion of a held peg at a hole: peg and hole, forces at the peg's foot, and the way out again."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ...world.values import Array
from ..cartesian.compliant_motion import CompliantMotion, ContactState
from .search_patterns import rotation_about, rotation_axis

Part: TypeAlias = Generator[None, ContactState, ContactState]
"""A part of a course: sent what is felt in each control period, it ends with the last of it."""

LIFTED = 0.008
"""Of the foot above the surface, where the peg is out of the way, m."""
TURNING = 0.4
"""Of the tool when it leans, rad/s."""
LEAVING = 0.02
"""Out of the hole, m/s."""
MOVING = 0.05
"""Of the tool in the air, m/s."""
SINKING = 0.04
"""Speed of the peg into the hole at which nothing presses any more, m/s."""


@dataclass(frozen=True, slots=True, eq=False)
class HeldPeg:
    """What of a held peg a search has to know. It may really sit a little beside, and lean, in the hand."""

    foot: Array
    """(3,) the middle of its underside in the TCP's frame, m."""
    lean: Array
    """(3,) unit vector in the TCP's frame, across the peg: to where it leans."""
    tip: Array
    """(3,) from the foot to the point of its rim that goes first then, in the TCP's frame, m."""
    round: bool
    """Whether it fits at any turn about its axis."""


@dataclass(frozen=True, slots=True, eq=False)
class BelievedHole:
    """What is believed of the hole."""

    middle: Array
    """(3,) of its mouth in the world, m."""
    up: Array
    """(3,) unit vector out of it, in the world."""
    across: float
    """Least width of the opening, m."""
    depth: float
    """How deep the peg is to go, m."""
    slack: float
    """How far beside the middle it may really be, m."""


class PegMotion(CompliantMotion):
    """Motion of a held peg at a hole: forces act at its foot, and the depth of the foot is measured.

    With the centre of compliance at the foot a peg that rubs over a surface stays upright (Whitney 1982).
    """

    def __init__(self, peg: HeldPeg, mouth: BelievedHole, linear: float) -> None:
        """`linear`: stiffness of the spring that the motion runs with, N/m."""
        super().__init__()
        self._peg, self._mouth = peg, mouth
        self._linear = linear
        self._depths: deque[tuple[float, float]] = deque(maxlen=10)
        self._sinking = 0.0
        self.surface = 0.0
        """Height of the felt surface over the believed mouth, m."""
        self.depth = 0.0
        """Of the foot below that surface now, m."""
        self.deepest = 0.0

    @property
    def up(self) -> Array:
        """(3,) unit vector out of the hole."""
        return self._mouth.up

    def _foot(self, felt: ContactState) -> Array:
        return felt.position + felt.rotation @ self._peg.foot

    def _note(self, felt: ContactState) -> float:
        """The depth of the foot below the surface, kept."""
        away = self._foot(felt) - self._mouth.middle
        self.depth = self.surface - float(self._mouth.up @ away)
        self.deepest = max(self.deepest, self.depth)
        self._depths.append((felt.elapsed, self.depth))
        (before, then), (now, last) = self._depths[0], self._depths[-1]
        self._sinking = (last - then) / (now - before) if now > before else 0.0
        return self.depth

    def _act(self, felt: ContactState, force: Array, aside: Array | None = None) -> None:
        """Exert a force (3,) at the foot, and pull it by `aside` (3,) m with the spring."""
        lever = felt.rotation @ self._peg.foot
        up = self._mouth.up
        force = force + up * min(0.0, float(up @ force)) * -min(1.0, max(0.0, self._sinking / SINKING))
        self.velocity = np.zeros(3)
        self.position = felt.position if aside is None else felt.position + aside
        whole = force if aside is None else force + self._linear * aside
        self.wrench = np.concatenate([force, np.cross(lever, whole)])

    def _relax(self, felt: ContactState) -> None:
        """Nothing is exerted where the tool is."""
        self.position, self.rotation = felt.position, felt.rotation
        self.velocity, self.wrench = np.zeros(3), np.zeros(6)
        self.spin = np.zeros(3)

    def _go(self, felt: ContactState, position: Array, rotation: Array, speed: float = MOVING) -> Part:
        """The anchor straight to a pose of the TCP."""
        start, turn = felt.position, self.rotation
        between = rotation @ turn.T
        angle = math.acos(min(1.0, max(-1.0, (float(np.trace(between)) - 1.0) / 2.0)))
        axis = rotation_axis(between)
        way = position - start
        time = max(float(np.linalg.norm(way)) / speed, angle / TURNING, 1e-3)
        begun = felt.elapsed
        self.wrench = np.zeros(6)
        while felt.elapsed - begun < time:
            share = (felt.elapsed - begun) / time
            smooth = share * share * (3.0 - 2.0 * share)
            self.position = start + smooth * way
            rate = 6.0 * share * (1.0 - share) / time
            self.velocity, self.spin = way * rate, axis * (angle * rate)
            self.rotation = rotation_about(axis, smooth * angle) @ turn
            felt = yield
        self.position, self.rotation = position, rotation
        self.velocity = self.spin = np.zeros(3)
        return felt

    def _leave(self, felt: ContactState) -> Part:
        """Out of the hole and above it, upright."""
        up = self._mouth.up
        rise = up * (max(0.0, self._note(felt)) + LIFTED)
        return (yield from self._go(felt, felt.position + rise, self.turn, speed=LEAVING))


class ExtractionMotion(CompliantMotion):
    """Straight out of a hole, for as long as it is deep, and a bit further."""

    def __init__(self, up: Array, depth: float) -> None:
        super().__init__()
        self._up, self._way = up, max(0.0, depth) + LIFTED
        self._done = 0.0

    def step(self, felt: ContactState) -> None:
        self._done = min(self._way, self._done + LEAVING * felt.period)
        self.position = self.origin + self._up * self._done
        self.finished = self._done >= self._way
        self.velocity = np.zeros(3) if self.finished else LEAVING * self._up
