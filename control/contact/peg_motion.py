"""Motions of a held peg at a hole: peg and hole as values, forces at the foot of the peg, extraction."""

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
"""Part of a motion: a generator that receives the contact state of each control period and returns the last
one."""

CLEAR_FOOT_HEIGHT = 0.008
"""Height of the foot above the surface where the peg is clear of it, m."""
LEAN_ANGULAR_SPEED = 0.4
"""Angular speed of the tool when it leans, rad/s."""
EXTRACTION_SPEED = 0.02
"""Speed out of the hole, m/s."""
AIR_SPEED = 0.05
"""Speed of the tool in the air, m/s."""
MAX_SINKING_SPEED = 0.04
"""Speed of the peg into the hole at which the pressing force has faded to zero, m/s."""


@dataclass(frozen=True, slots=True, eq=False)
class HeldPeg:
    """Geometry of a held peg. Its real position and lean in the hand may differ a little."""

    foot: Array
    """Middle (3,) of the underside in the TCP frame, m."""
    lean: Array
    """Unit vector (3,) across the peg in the TCP frame: the direction of its lean."""
    tip: Array
    """Vector (3,) in the TCP frame, m: from the foot to the point of the rim that leads when the peg
    leans."""
    round: bool
    """Whether the peg fits at every angle about its axis."""


@dataclass(frozen=True, slots=True, eq=False)
class BelievedHole:
    """Believed geometry of a hole."""

    middle: Array
    """Middle (3,) of the hole's mouth in the world, m."""
    up: Array
    """Unit vector (3,) out of the hole, in the world."""
    across: float
    """Least width of the opening, m."""
    depth: float
    """Depth to which the peg is inserted, m."""
    slack: float
    """Greatest distance of the real middle from the believed one, m."""


class PegMotion(CompliantMotion):
    """Motion of a held peg at a hole: it exerts forces at the foot and measures the foot's depth.

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
        """Height of the touched surface above the believed mouth, m."""
        self.depth = 0.0
        """Depth of the foot below the touched surface, m."""
        self.deepest = 0.0

    @property
    def up(self) -> Array:
        """Unit vector (3,) out of the hole, in the world."""
        return self._mouth.up

    def _foot(self, felt: ContactState) -> Array:
        return felt.position + felt.rotation @ self._peg.foot

    def _note(self, felt: ContactState) -> float:
        """Update and return the depth of the foot below the surface, m."""
        away = self._foot(felt) - self._mouth.middle
        self.depth = self.surface - float(self._mouth.up @ away)
        self.deepest = max(self.deepest, self.depth)
        self._depths.append((felt.elapsed, self.depth))
        (before, then), (now, last) = self._depths[0], self._depths[-1]
        self._sinking = (last - then) / (now - before) if now > before else 0.0
        return self.depth

    def _act(self, felt: ContactState, force: Array, aside: Array | None = None) -> None:
        """Exert a force (3,) at the foot, N, and pull the foot by `aside` (3,) m with the spring."""
        lever = felt.rotation @ self._peg.foot
        up = self._mouth.up
        force = force + up * min(0.0, float(up @ force)) * -min(
            1.0, max(0.0, self._sinking / MAX_SINKING_SPEED)
        )
        self.velocity = np.zeros(3)
        self.position = felt.position if aside is None else felt.position + aside
        whole = force if aside is None else force + self._linear * aside
        self.wrench = np.concatenate([force, np.cross(lever, whole)])

    def _relax(self, felt: ContactState) -> None:
        """Exert no force at the present pose."""
        self.position, self.rotation = felt.position, felt.rotation
        self.velocity, self.wrench = np.zeros(3), np.zeros(6)
        self.spin = np.zeros(3)

    def _go(self, felt: ContactState, position: Array, rotation: Array, speed: float = AIR_SPEED) -> Part:
        """Move the anchor straight to a pose of the TCP."""
        start, turn = felt.position, self.rotation
        between = rotation @ turn.T
        angle = math.acos(min(1.0, max(-1.0, (float(np.trace(between)) - 1.0) / 2.0)))
        axis = rotation_axis(between)
        way = position - start
        time = max(float(np.linalg.norm(way)) / speed, angle / LEAN_ANGULAR_SPEED, 1e-3)
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
        """Move the peg out of the hole and above it, upright."""
        up = self._mouth.up
        rise = up * (max(0.0, self._note(felt)) + CLEAR_FOOT_HEIGHT)
        return (yield from self._go(felt, felt.position + rise, self.turn, speed=EXTRACTION_SPEED))


class ExtractionMotion(CompliantMotion):
    """Straight motion out of a hole: by the peg's depth and `CLEAR_FOOT_HEIGHT` more."""

    def __init__(self, up: Array, depth: float) -> None:
        super().__init__()
        self._up, self._way = up, max(0.0, depth) + CLEAR_FOOT_HEIGHT
        self._done = 0.0

    def step(self, felt: ContactState) -> None:
        self._done = min(self._way, self._done + EXTRACTION_SPEED * felt.period)
        self.position = self.origin + self._up * self._done
        self.finished = self._done >= self._way
        self.velocity = np.zeros(3) if self.finished else EXTRACTION_SPEED * self._up
