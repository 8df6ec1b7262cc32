"""Motions of a held peg at a hole: peg and hole as values, forces at the foot of the peg, extraction.

The patterns of a search over a surface are here, too.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ...world.values import Array
from .compliant_motion import CompliantMotion, ContactState


def rotation_about(axis: Array, angle: float) -> Array:
    """Return the rotation matrix (3, 3) about a unit vector (3,) by an angle, rad (Rodrigues)."""
    x, y, z = axis.tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)


def perpendicular_axes(up: Array) -> tuple[Array, Array]:
    """Return two unit vectors (3,) that span the plane perpendicular to `up`."""
    x = np.cross(np.array([0.0, 1.0, 0.0]) if abs(up[1]) < 0.9 else np.array([1.0, 0.0, 0.0]), up)
    x = x / float(np.linalg.norm(x))
    return x, np.cross(up, x)


def rotation_axis(rotation: Array) -> Array:
    """Return the unit axis (3,) of a rotation by less than half a turn; z for the identity."""
    r = rotation
    axis = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    size = float(np.linalg.norm(axis))
    return np.array([0.0, 0.0, 1.0]) if size < 1e-9 else axis / size


def rotated_towards(rotation: Array, towards: Array, share: float, about: Array, most: float) -> Array:
    """Return `rotation` (3, 3) turned by a share of the way to `towards`, at most `most` rad from `about`."""
    between = towards @ rotation.T
    angle = math.asin(min(1.0, float(np.linalg.norm(skew(between)))))
    moved = rotation_about(rotation_axis(between), share * angle) @ rotation
    away = moved @ about.T
    far = math.asin(min(1.0, float(np.linalg.norm(skew(away)))))
    return moved if far <= most else rotation_about(rotation_axis(away), most) @ about


def skew(r: Array) -> Array:
    """Return the rotation vector (3,) whose length is the sine of the angle; less than a quarter turn."""
    return 0.5 * np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])


class SettlingDetector:
    """Detector of standstill: a value that has changed little for a given time."""

    def __init__(self, time: float, little: float) -> None:
        self._time, self._little = time, little
        self._recent: deque[tuple[float, float]] = deque()

    def since(self, now: float, value: float) -> bool:
        """Add `value` at time `now`, s, and return whether all values of the last `time` s lie within
        `little`."""
        recent = self._recent
        recent.append((now, value))
        while now - recent[0][0] > self._time:
            recent.popleft()
        if now - recent[0][0] < 0.9 * self._time:
            return False
        values = [v for _, v in recent]
        return max(values) - min(values) < self._little


def spiral(pitch: float, radius: float, step: float) -> Iterator[tuple[float, float]]:
    """Yield points (x, y) of an Archimedean spiral out to `radius`, m, spaced by `step` m along it."""
    rise, angle = pitch / (2 * math.pi), 0.0
    while rise * angle <= radius:
        r = rise * angle
        yield r * math.cos(angle), r * math.sin(angle)
        angle += step / math.hypot(r, rise)


def grid(spacing: float, radius: float) -> Iterator[tuple[float, float]]:
    """Yield the middle and rings of points around it within the radius, m.

    No point of the disc is further than about 0.6 of the spacing from one of them.
    """
    yield 0.0, 0.0
    beyond = radius - 0.5 * spacing
    rings = math.ceil(max(0.0, beyond) / spacing)
    for ring in range(1, rings + 1):
        at = ring * (beyond + 0.15 * spacing) / rings
        for k in range(6 * ring):
            angle = math.pi * k / (3 * ring)
            yield at * math.cos(angle), at * math.sin(angle)


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
