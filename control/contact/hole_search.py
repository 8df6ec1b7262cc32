"""Courses that find a hole by feeling and put a peg into it, from the air above it to its bottom.

One course does all of it, so that what the wrist felt before it touched anything stays the zero. Forces act
at the foot of the peg, not at the TCP: with its centre of compliance there a peg that rubs over a surface
stays upright (Whitney 1982).
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from ...world.values import Array
from ..cartesian.compliant_motion import ContactState
from .peg_motion import LIFTED, BelievedHole, HeldPeg, Part, PegMotion
from .search_patterns import (
    SettlingDetector,
    grid,
    perpendicular_axes,
    rotated_towards,
    rotation_about,
    skew,
    spiral,
)

Search: TypeAlias = Literal["tilt", "spiral", "none"]
Outcome: TypeAlias = Literal["under way", "in", "not found", "jammed", "no bottom"]


@dataclass(frozen=True, slots=True)
class InsertionParameters:
    """How firmly and how patiently: N, m, s, rad."""

    contact: float = 4.0
    """Force that tells a contact."""
    press: float = 8.0
    """While searching."""
    push: float = 15.0
    """Into the hole."""
    drop: float = 0.003
    """Depth below the surface at which the hole counts as found."""
    pitch: float = 0.001
    """Between two turns of the spiral."""
    speed: float = 0.012
    """Along the spiral, m/s."""
    lean: float = math.radians(8.0)
    aside: float = 6.0
    """Force to the side of a leaning peg, towards the wall of the hole."""
    wiggle: float = math.radians(1.2)
    yaw: float = math.radians(3.0)
    """Turned so far either way, where it fits at some turns about its axis only."""
    pulls: int = 2
    """How often it is pulled back from a jam to be pressed again."""
    attempts: int = 3
    """How often the search may begin anew."""


DESCENT = 0.03
"""Speed of the way down to the surface, m/s."""
ROUGH = 0.006
"""How far off its believed height the surface may be: tilt of the fixture, height in the hand, m."""
RISING = 0.2
"""Of the leaning peg, rad/s."""
UPRIGHT = math.radians(2.5)
"""A peg that leans less counts as upright: no more is known of how it is held."""
AROUND = 0.0025
"""Radius searched where the peg was raised against the wall and has not dropped, m."""
SLIDING = 0.02
"""Of the leaning peg to the side, m/s."""
SLIDING_PRESS = 0.75
"""Of the force on the surface while searching, pressed meanwhile."""
LEAST_RUBBING = 0.5
"""A slide that is held back by no more than this at any place tells nothing of walls, N."""
AIMS = 3
"""How often a leaning peg slides over about the same place, each time beginning from what was felt before."""
RUBBING = 0.35
"""Share of the force on the surface that is pushed along a spiral: rubbing takes about as much."""
FIRMER = 1500.0
"""Stiffness with which the foot is held on the spiral beyond that of the spring, N/m."""
BLOCKED_TIME, BLOCKED = 0.15, 0.0006
"""A tool that comes no further than this in that time is blocked, s, m."""
STALL_TIME, STALL = 0.5, 0.0003
"""A peg that goes no deeper than this in that time stands, s, m."""
BOTTOM_TIME = 0.12
"""At the bottom it need not stand longer than this, s: it would only be pressed against the walls."""
SHORT = 0.0025
"""So much less deep than it should be it may stand at the bottom, m."""
WIGGLES, YAWS = 1.2, 0.8
"""Turns of the wiggle, and sweeps of the yaw, a second."""
ALIGNING = 0.4
"""Time constant with which a peg in its hole may turn as the walls want it, s."""
ALIGNED = math.radians(2.5)
"""Greatest turn away from where it began, rad."""


class InsertionMotion(PegMotion):
    """Down from the air above a hole's mouth into it: touch, search, press.

    It begins with the peg upright over the believed middle. It ends with the peg at the bottom, at rest in
    the hand, or out of the hole and above it again; `outcome` says which.
    """

    def __init__(
        self, peg: HeldPeg, mouth: BelievedHole, touch: InsertionParameters, search: Search, linear: float
    ) -> None:
        """`linear`: stiffness of the spring that the course is run with, N/m."""
        super().__init__(peg, mouth, linear)
        self._touch = touch
        self._search: Search = search
        self._steps: Generator[None, ContactState, None] | None = None
        self.outcome: Outcome = "under way"
        self.searched = 0.0
        """How far from the believed middle the foot was while it searched, m."""
        self.tried: list[str] = []
        """The ways in which it has searched, the last one that of the end."""
        self._side = 1.0
        self.pulled = 0
        """How often it was pulled back from a jam."""

    def step(self, felt: ContactState) -> None:
        if self._steps is None:
            self._steps = self._run()
            next(self._steps)
        self._note(felt)
        try:
            self._steps.send(felt)
        except StopIteration:
            self.finished = True

    def _run(self) -> Generator[None, ContactState, None]:
        felt = yield
        felt = yield from self._descend(felt)
        for number in range(self._touch.attempts):
            way = self._way(number)
            self.tried.append(way)
            if number and not way.startswith("tilt"):
                felt = yield from self._again(felt)
            felt = yield from self._by(way, felt)
            if self.depth < self._touch.drop:
                self.outcome = "not found"
                continue
            felt = yield from self._press(felt)
            if self.outcome in ("in", "no bottom"):
                break
            felt = yield from self._leave(felt)
        if self.outcome == "in":
            self._relax(felt)
        else:
            yield from self._leave(felt)

    def _way(self, number: int) -> str:
        """How to search next. A spiral after a tilt that has found nothing; one that jams leans the other way
        next time."""
        if self._search == "none":
            return "straight down"
        if self._search == "spiral" or self.outcome == "not found":
            return "spiral"
        return "tilt back" if number % 2 else "tilt"

    def _by(self, way: str, felt: ContactState) -> Part:
        """One search; none is needed where the peg is in the hole already."""
        if self.depth >= self._touch.drop:
            return felt
        self._side = -1.0 if way == "tilt back" else 1.0
        if way == "spiral":
            return (yield from self._spiral(felt))
        if way == "straight down":
            return (yield from self._straight(felt))
        return (yield from self._tilt(felt))

    def _again(self, felt: ContactState) -> Part:
        """Up, over the believed middle, and down until the surface is felt again."""
        up = self._mouth.up
        felt = yield from self._leave(felt)
        away = self._foot(felt) - self._mouth.middle
        back = felt.position - (away - up * float(up @ away))
        felt = yield from self._go(felt, back, self.turn)
        return (yield from self._descend(felt))

    def _descend(self, felt: ContactState) -> Part:
        """Straight down until the surface is felt, or the peg is in the hole at once."""
        up, most = self._mouth.up, self._touch.contact
        self.velocity = -DESCENT * up
        while True:
            self.position = self.position + self.velocity * felt.period
            felt = yield
            height = -self._note(felt)
            if height < -ROUGH - self._touch.drop:
                break
            if float(felt.force @ up) > most:
                self.surface = height if height > -ROUGH else 0.0
                break
        self._note(felt)
        return felt

    def _straight(self, felt: ContactState) -> Part:
        """No search: it goes in here or not at all."""
        begun = felt.elapsed
        while felt.elapsed - begun < STALL_TIME:
            self._act(felt, -self._touch.press * self._mouth.up)
            felt = yield
            if self._note(felt) >= self._touch.drop:
                break
        return felt

    def _spiral(self, felt: ContactState, radius: float | None = None) -> Part:
        """Over the surface along an Archimedean spiral, pressing, until the peg drops."""
        touch, up, upright = self._touch, self._mouth.up, self.turn
        x, y = perpendicular_axes(up)
        begin = self._foot(felt)
        begun = felt.elapsed
        rubbing, before = RUBBING * touch.press, begin
        for a, b in spiral(touch.pitch, radius or self._mouth.slack, touch.speed * felt.period):
            target = begin + a * x + b * y
            off = target - self._foot(felt)
            off = off - up * float(up @ off)
            ahead, before = target - before, target
            along = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
            self._act(felt, FIRMER * off + rubbing * along - touch.press * up, off)
            if not self._peg.round:
                sweep = math.sin(2 * math.pi * YAWS * (felt.elapsed - begun))
                self.rotation = rotation_about(up, touch.yaw * sweep) @ upright
            self.searched = max(self.searched, math.hypot(a, b))
            felt = yield
            if self._note(felt) >= touch.drop:
                break
        self.rotation = upright
        return felt

    def _tilt(self, felt: ContactState) -> Part:
        """With the peg leaning, its lowest point in the hole first: against the wall, then upright."""
        x, y = perpendicular_axes(self._mouth.up)
        for a, b in grid(0.7 * self._mouth.across, self._mouth.slack):
            self.searched = max(self.searched, math.hypot(a, b))
            aim = self._mouth.middle + a * x + b * y
            for _ in range(AIMS):
                felt = yield from self._lean(felt, aim)
                felt, blocked, wall = yield from self._against_wall(felt)
                if blocked or wall is None:
                    break
                # It has passed a wall that it was beside the middle of: there the hole is.
                aim = wall - self._towards * (self._mouth.across / 2)
            else:
                continue
            if not blocked:
                continue
            felt = yield from self._upright(felt)
            if self.depth < self._touch.drop:
                felt = yield from self._spiral(felt, AROUND)
            if self.depth >= self._touch.drop:
                break
        return felt

    def _lean(self, felt: ContactState, aim: Array) -> Part:
        """Up, and down again leaning, the lowest point at `aim` (3,), until it touches."""
        up, touch, tip = self._mouth.up, self._touch, self._tip
        leaning = rotation_about(np.cross(up, self._towards), touch.lean) @ self.turn
        above = aim + up * (self.surface + LIFTED / 2) - leaning @ tip
        felt = yield from self._go(felt, felt.position + up * (max(0.0, self.depth) + LIFTED), self.rotation)
        felt = yield from self._go(felt, above, leaning)
        deepest = 2 * self._reach * math.sin(touch.lean) + 0.002
        self.velocity = -DESCENT * up
        while True:
            self.position = self.position + self.velocity * felt.period
            felt = yield
            low = float(up @ (felt.position + felt.rotation @ tip - self._mouth.middle)) - self.surface
            if float(felt.force @ up) > touch.contact or low < -deepest:
                return felt

    def _against_wall(
        self, felt: ContactState
    ) -> Generator[None, ContactState, tuple[ContactState, bool, Array | None]]:
        """Push to the side; whether something blocks the way, as the wall of the hole does, and where (3,)
        the lowest point was when most was felt of one; None: nothing was felt."""
        touch, towards, begin = self._touch, self._towards, felt.position
        stand = SettlingDetector(BLOCKED_TIME, BLOCKED)
        press, most, lead = -SLIDING_PRESS * touch.press * self._mouth.up, touch.aside / self._linear, 0.0
        greatest, wall = -math.inf, begin + felt.rotation @ self._tip
        while True:
            lead = min(most, lead + SLIDING * felt.period)
            self._act(felt, press, lead * towards)
            self.velocity = SLIDING * towards
            before = felt.position
            felt = yield
            lead = max(0.0, lead - float(towards @ (felt.position - before)))
            way = float(towards @ (felt.position - begin))
            against = -float(towards @ felt.force)
            if against > greatest:
                greatest, wall = against, felt.position + felt.rotation @ self._tip
            if stand.since(felt.elapsed, way) and lead > 0.8 * most:
                return felt, True, wall
            if way > 2 * self._reach + self._mouth.slack:
                return felt, False, wall if greatest > LEAST_RUBBING else None

    def _upright(self, felt: ContactState) -> Part:
        """Raise the leaning peg against the wall, and let it drop."""
        touch, up = self._touch, self._mouth.up
        axis, towards = np.cross(up, self._towards), self._towards
        begun, rising = felt.elapsed, touch.lean / RISING
        while True:
            time = felt.elapsed - begun
            angle = touch.lean * max(0.0, 1.0 - time / rising)
            sweep = 0.0
            if time > rising and not self._peg.round:
                sweep = touch.yaw * math.sin(2 * math.pi * YAWS * (time - rising))
            self.rotation = rotation_about(up, sweep) @ rotation_about(axis, angle) @ self.turn
            leaning = float(np.linalg.norm(skew(self.turn @ felt.rotation.T)))
            press = touch.press * (0.5 if leaning > UPRIGHT else 1.0)
            self._act(felt, touch.aside * towards - press * up)
            felt = yield
            if (leaning < UPRIGHT and self.depth >= touch.drop) or time > rising + 1.5:
                return felt

    def _press(self, felt: ContactState) -> Part:
        """Down to the bottom, wiggling; pulled back a bit and pressed again, more strongly, where it stands
        before."""
        touch, mouth = self._touch, self._mouth
        x, y = perpendicular_axes(mouth.up)
        base, begun = self.rotation, felt.elapsed
        stand, bottom = SettlingDetector(STALL_TIME, STALL), SettlingDetector(BOTTOM_TIME, STALL)
        push, wiggle, pulls = touch.push, touch.wiggle, 0
        while True:
            phase = 2 * math.pi * WIGGLES * (felt.elapsed - begun)
            axis = math.cos(phase) * x + math.sin(phase) * y
            base = rotated_towards(base, felt.rotation, felt.period / ALIGNING, self.turn, ALIGNED)
            sweep = 0.0
            if pulls and not self._peg.round:
                sweep = 0.5 * touch.yaw * math.sin(2 * math.pi * YAWS * (felt.elapsed - begun))
            self.rotation = rotation_about(mouth.up, sweep) @ rotation_about(axis, wiggle) @ base
            self._act(felt, -push * mouth.up)
            felt = yield
            depth = self._note(felt)
            if depth > mouth.depth + ROUGH + SHORT:
                self.outcome = "no bottom"
                return felt
            deep = depth >= mouth.depth - SHORT
            if deep:
                wiggle = 0.0
                if bottom.since(felt.elapsed, depth):
                    self.outcome = "in"
                    return felt
            if deep or not stand.since(felt.elapsed, depth):
                continue
            if pulls >= touch.pulls:
                self.outcome = "jammed"
                return felt
            pulls, self.pulled = pulls + 1, self.pulled + 1
            felt = yield from self._pull_back(felt, depth)
            push, wiggle = push + 2.0, 1.4 * wiggle
            stand = SettlingDetector(STALL_TIME, STALL)

    def _pull_back(self, felt: ContactState, depth: float) -> Part:
        begun = felt.elapsed
        self.spin = np.zeros(3)
        while felt.elapsed - begun < 0.3 and self._note(felt) > max(0.001, depth - 0.004):
            self._act(felt, self._touch.push * self._mouth.up)
            felt = yield
        return felt

    @property
    def _tip(self) -> Array:
        return self._peg.foot + self._side * self._peg.tip

    @property
    def _reach(self) -> float:
        """From the middle of the underside to the point that goes first, m."""
        return float(np.linalg.norm(self._peg.tip))

    @property
    def _towards(self) -> Array:
        """(3,) unit vector along the surface to which the peg leans."""
        up = self._mouth.up
        along = self._side * (self.turn @ self._peg.lean)
        along = along - up * float(up @ along)
        return along / float(np.linalg.norm(along))
