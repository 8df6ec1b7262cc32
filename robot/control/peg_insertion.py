"""Peg insertion: touch, search of the hole by contact, pressing to the bottom, and extraction of the peg.

One motion does all of the insertion, so that the wrist reading before the first contact stays the zero. The
patterns of a search over a surface are here, too.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from picktree.world import Array

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


Search: TypeAlias = Literal["tilt", "spiral", "none"]
Outcome: TypeAlias = Literal["under way", "in", "not found", "jammed", "no bottom"]


@dataclass(frozen=True, slots=True)
class InsertionParameters:
    """Forces, lengths, speeds and angles of an insertion: N, m, m/s, rad."""

    contact: float = 4.0
    """Force above which the peg touches the surface, N."""
    press: float = 8.0
    """Force on the surface during the search, N."""
    push: float = 15.0
    """Force into the hole, N."""
    drop: float = 0.003
    """Depth below the surface at which the hole counts as found, m."""
    pitch: float = 0.001
    """Distance between two turns of the spiral, m."""
    speed: float = 0.012
    """Speed along the spiral, m/s."""
    lean: float = math.radians(8.0)
    aside: float = 6.0
    """Sideways force of a leaning peg towards the wall of the hole, N."""
    wiggle: float = math.radians(1.2)
    yaw: float = math.radians(3.0)
    """Amplitude of the rotation about the peg's axis, rad. Only for pegs that do not fit at every angle."""
    pulls: int = 2
    """Maximum number of pulls back from a jam before the peg counts as jammed."""
    attempts: int = 3
    """Maximum number of searches."""


SURFACE_DESCENT_SPEED = 0.03
"""Speed of the descent to the surface, m/s."""
MAX_SURFACE_ERROR = 0.006
"""Greatest error of the surface's believed height, m: tilt of the fixture and height of the peg in the
hand."""
RAISING_ANGULAR_SPEED = 0.2
"""Angular speed at which the leaning peg is raised, rad/s."""
UPRIGHT_LEAN = math.radians(2.5)
"""Lean below which the peg counts as upright, rad. Its angle in the hand is not known more precisely."""
WALL_SPIRAL_RADIUS = 0.0025
"""Radius of the spiral when the peg was raised against the wall and has not dropped, m."""
SLIDING_SPEED = 0.02
"""Speed of the leaning peg along the surface, m/s."""
SLIDING_PRESS_SHARE = 0.75
"""Force on the surface while the leaning peg slides, as a share of `press`."""
MIN_WALL_RESISTANCE = 0.5
"""Least resistance that shows a wall, N. A shorter slide gives no evidence of walls."""
MAX_SLIDES = 3
"""Maximum number of slides of a leaning peg around one grid point; each begins at the wall found before."""
SPIRAL_FORCE_SHARE = 0.35
"""Force along the spiral, as a share of the force on the surface. Friction takes about as much."""
SPIRAL_STIFFNESS = 1500.0
"""Stiffness that holds the foot on the spiral, in addition to the spring's, N/m."""
BLOCKED_TIME, BLOCKED_TRAVEL = 0.15, 0.0006
"""Time, s, and travel, m: a tool that moves less than this in that time is blocked."""
AXIS_TOLERANCE = 0.003
"""Distance of the peg from the hole's axis within its clearance, m. A recess further from the believed axis
than its uncertainty and this tolerance is another hole, or the edge of the fixture."""
STALL_TIME, STALL_DEPTH = 0.5, 0.0003
"""Time, s, and depth, m: a peg that sinks less than this in that time has stalled."""
BOTTOM_TIME = 0.12
"""Time without motion after which a peg is at the bottom, s. A longer one would only press it against the
walls."""
MAX_MISSING_DEPTH = 0.0025
"""Depth that may be missing at the bottom, m."""
WIGGLE_FREQUENCY, YAW_FREQUENCY = 1.2, 0.8
"""Frequencies of the wiggle and of the yaw sweep, Hz."""
ALIGNMENT_TIME = 0.4
"""Time constant with which the walls may turn the peg in its hole, s."""
MAX_ALIGNMENT = math.radians(2.5)
"""Greatest rotation of the peg away from its initial orientation, rad."""


class InsertionMotion(PegMotion):
    """Insertion from the air above a hole's mouth: touch, search, press.

    It begins with the peg upright over the believed middle. It ends with the peg at rest at the bottom, or
    out of the hole and above it; `outcome` gives the case.
    """

    def __init__(
        self, peg: HeldPeg, mouth: BelievedHole, touch: InsertionParameters, search: Search, linear: float
    ) -> None:
        """`linear`: stiffness of the spring that the motion runs with, N/m."""
        super().__init__(peg, mouth, linear)
        self._touch = touch
        self._search: Search = search
        self._steps: Generator[None, ContactState, None] | None = None
        self.outcome: Outcome = "under way"
        self.stage: Literal["touch", "search", "press", "withdraw"] = "touch"
        """Present part of the motion."""
        self.searched = 0.0
        """Greatest distance of a searched point from the believed middle, m."""
        self.tried: list[str] = []
        """Search methods so far, in order; the last one was in use at the end."""
        self._side = 1.0
        self.pulled = 0
        """Number of pulls back from a jam."""

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
                felt = yield from self._restart_search(felt)
            felt = yield from self._run_search(way, felt)
            if self.depth < self._touch.drop or self._excess_distance(self._foot(felt)) > AXIS_TOLERANCE:
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

    def _leave(self, felt: ContactState) -> Part:
        self.stage = "withdraw"
        return (yield from super()._leave(felt))

    def _way(self, number: int) -> str:
        """Return the next search method. A spiral follows a tilt that found nothing; after a jam the peg
        leans the other way."""
        if self._search == "none":
            return "straight down"
        if self._search == "spiral" or self.outcome == "not found":
            return "spiral"
        return "tilt back" if number % 2 else "tilt"

    def _run_search(self, way: str, felt: ContactState) -> Part:
        """Run one search; skip it when the peg is in the hole already."""
        if self.depth >= self._touch.drop:
            return felt
        self.stage = "search"
        self._side = -1.0 if way == "tilt back" else 1.0
        if way == "spiral":
            return (yield from self._spiral(felt))
        if way == "straight down":
            return (yield from self._straight(felt))
        return (yield from self._tilt(felt))

    def _restart_search(self, felt: ContactState) -> Part:
        """Lift the peg, move it over the believed middle, and descend until the surface is touched again."""
        up = self._mouth.up
        felt = yield from self._leave(felt)
        away = self._foot(felt) - self._mouth.middle
        back = felt.position - (away - up * float(up @ away))
        felt = yield from self._go(felt, back, self.turn)
        return (yield from self._descend(felt))

    def _descend(self, felt: ContactState) -> Part:
        """Move straight down until the surface is touched, or the peg is in the hole at once."""
        self.stage = "touch"
        up, most = self._mouth.up, self._touch.contact
        self.velocity = -SURFACE_DESCENT_SPEED * up
        while True:
            self.position = self.position + self.velocity * felt.period
            felt = yield
            height = -self._note(felt)
            if height < -MAX_SURFACE_ERROR - self._touch.drop:
                break
            if float(felt.force @ up) > most:
                self.surface = height if height > -MAX_SURFACE_ERROR else 0.0
                break
        self._note(felt)
        return felt

    def _straight(self, felt: ContactState) -> Part:
        """Press straight down without a search, until the peg drops or `STALL_TIME` is over."""
        begun = felt.elapsed
        while felt.elapsed - begun < STALL_TIME:
            self._act(felt, -self._touch.press * self._mouth.up)
            felt = yield
            if self._note(felt) >= self._touch.drop:
                break
        return felt

    def _spiral(self, felt: ContactState, radius: float | None = None) -> Part:
        """Press and follow an Archimedean spiral over the surface until the peg drops."""
        touch, up, upright = self._touch, self._mouth.up, self.turn
        x, y = perpendicular_axes(up)
        begin = self._foot(felt)
        begun = felt.elapsed
        rubbing, before = SPIRAL_FORCE_SHARE * touch.press, begin
        for a, b in spiral(touch.pitch, radius or self._mouth.slack, touch.speed * felt.period):
            target = begin + a * x + b * y
            off = target - self._foot(felt)
            off = off - up * float(up @ off)
            ahead, before = target - before, target
            along = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
            self._act(felt, SPIRAL_STIFFNESS * off + rubbing * along - touch.press * up, off)
            if not self._peg.round:
                sweep = math.sin(2 * math.pi * YAW_FREQUENCY * (felt.elapsed - begun))
                self.rotation = rotation_about(up, touch.yaw * sweep) @ upright
            self.searched = max(self.searched, math.hypot(a, b))
            felt = yield
            if self._note(felt) >= touch.drop:
                break
        self.rotation = upright
        return felt

    def _tilt(self, felt: ContactState) -> Part:
        """Search with the leaning peg: its lowest point enters the hole, meets the wall, then the peg is
        raised."""
        x, y = perpendicular_axes(self._mouth.up)
        for a, b in grid(0.7 * self._mouth.across, self._mouth.slack):
            self.searched = max(self.searched, math.hypot(a, b))
            aim = self._mouth.middle + a * x + b * y
            for _ in range(MAX_SLIDES):
                felt = yield from self._lean(felt, aim)
                felt, blocked, wall = yield from self._against_wall(felt)
                if blocked or wall is None:
                    break
                # The peg has slid past the middle of a wall: the hole is there.
                aim = wall - self._towards * (self._mouth.across / 2)
                if self._excess_distance(aim) > AXIS_TOLERANCE:
                    break
            else:
                continue
            if not blocked:
                continue
            felt = yield from self._upright(felt)
            if self.depth < self._touch.drop:
                felt = yield from self._spiral(felt, WALL_SPIRAL_RADIUS)
            if self.depth >= self._touch.drop:
                break
        return felt

    def _lean(self, felt: ContactState, aim: Array) -> Part:
        """Lift the peg, lean it, and descend with its lowest point over `aim` (3,) until it touches."""
        up, touch, tip = self._mouth.up, self._touch, self._tip
        leaning = rotation_about(np.cross(up, self._towards), touch.lean) @ self.turn
        above = aim + up * (self.surface + CLEAR_FOOT_HEIGHT / 2) - leaning @ tip
        felt = yield from self._go(
            felt, felt.position + up * (max(0.0, self.depth) + CLEAR_FOOT_HEIGHT), self.rotation
        )
        felt = yield from self._go(felt, above, leaning)
        deepest = 2 * self._reach * math.sin(touch.lean) + 0.002
        self.velocity = -SURFACE_DESCENT_SPEED * up
        while True:
            self.position = self.position + self.velocity * felt.period
            felt = yield
            low = float(up @ (felt.position + felt.rotation @ tip - self._mouth.middle)) - self.surface
            if float(felt.force @ up) > touch.contact or low < -deepest:
                return felt

    def _against_wall(
        self, felt: ContactState
    ) -> Generator[None, ContactState, tuple[ContactState, bool, Array | None]]:
        """Push the leaning peg sideways until something blocks it, as the wall of the hole does.

        It ends beyond all walls that the hole may have, too.

        Returns the last state, whether it is blocked, and the place (3,) of the lowest point at the greatest
        resistance. None: there was no resistance.
        """
        touch, towards, begin = self._touch, self._towards, felt.position
        stand = SettlingDetector(BLOCKED_TIME, BLOCKED_TRAVEL)
        press, most, lead = (
            -SLIDING_PRESS_SHARE * touch.press * self._mouth.up,
            touch.aside / self._linear,
            0.0,
        )
        greatest, wall = -math.inf, begin + felt.rotation @ self._tip
        while True:
            lead = min(most, lead + SLIDING_SPEED * felt.period)
            self._act(felt, press, lead * towards)
            self.velocity = SLIDING_SPEED * towards
            before = felt.position
            felt = yield
            lead = max(0.0, lead - float(towards @ (felt.position - before)))
            way = float(towards @ (felt.position - begin))
            against = -float(towards @ felt.force)
            if against > greatest:
                greatest, wall = against, felt.position + felt.rotation @ self._tip
            if stand.since(felt.elapsed, way) and lead > 0.8 * most:
                return felt, True, wall
            low = felt.position + felt.rotation @ self._tip - self._mouth.middle
            if float(towards @ low) > self._reach + self._mouth.slack + AXIS_TOLERANCE:
                return felt, False, wall if greatest > MIN_WALL_RESISTANCE else None

    def _upright(self, felt: ContactState) -> Part:
        """Raise the leaning peg against the wall, and let it drop."""
        touch, up = self._touch, self._mouth.up
        axis, towards = np.cross(up, self._towards), self._towards
        begun, rising = felt.elapsed, touch.lean / RAISING_ANGULAR_SPEED
        while True:
            time = felt.elapsed - begun
            angle = touch.lean * max(0.0, 1.0 - time / rising)
            sweep = 0.0
            if time > rising and not self._peg.round:
                sweep = touch.yaw * math.sin(2 * math.pi * YAW_FREQUENCY * (time - rising))
            self.rotation = rotation_about(up, sweep) @ rotation_about(axis, angle) @ self.turn
            leaning = float(np.linalg.norm(skew(self.turn @ felt.rotation.T)))
            press = touch.press * (0.5 if leaning > UPRIGHT_LEAN else 1.0)
            self._act(felt, touch.aside * towards - press * up)
            felt = yield
            if (leaning < UPRIGHT_LEAN and self.depth >= touch.drop) or time > rising + 1.5:
                return felt

    def _press(self, felt: ContactState) -> Part:
        """Press the peg to the bottom with a wiggle. When it stalls before, pull it back and press harder."""
        self.stage = "press"
        touch, mouth = self._touch, self._mouth
        x, y = perpendicular_axes(mouth.up)
        base, begun = self.rotation, felt.elapsed
        stand, bottom = SettlingDetector(STALL_TIME, STALL_DEPTH), SettlingDetector(BOTTOM_TIME, STALL_DEPTH)
        push, wiggle, pulls = touch.push, touch.wiggle, 0
        while True:
            phase = 2 * math.pi * WIGGLE_FREQUENCY * (felt.elapsed - begun)
            axis = math.cos(phase) * x + math.sin(phase) * y
            base = rotated_towards(
                base, felt.rotation, felt.period / ALIGNMENT_TIME, self.turn, MAX_ALIGNMENT
            )
            sweep = 0.0
            if pulls and not self._peg.round:
                sweep = 0.5 * touch.yaw * math.sin(2 * math.pi * YAW_FREQUENCY * (felt.elapsed - begun))
            self.rotation = rotation_about(mouth.up, sweep) @ rotation_about(axis, wiggle) @ base
            self._act(felt, -push * mouth.up)
            felt = yield
            depth = self._note(felt)
            if depth > mouth.depth + MAX_SURFACE_ERROR + MAX_MISSING_DEPTH:
                self.outcome = "no bottom"
                return felt
            deep = depth >= mouth.depth - MAX_MISSING_DEPTH
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
            stand = SettlingDetector(STALL_TIME, STALL_DEPTH)

    def _pull_back(self, felt: ContactState, depth: float) -> Part:
        begun = felt.elapsed
        self.spin = np.zeros(3)
        while felt.elapsed - begun < 0.3 and self._note(felt) > max(0.001, depth - 0.004):
            self._act(felt, self._touch.push * self._mouth.up)
            felt = yield
        return felt

    def _excess_distance(self, point: Array) -> float:
        """Return how much further a point (3,) is from the believed axis than the real one can be, m."""
        away = point - self._mouth.middle
        away = away - self._mouth.up * float(self._mouth.up @ away)
        return float(np.linalg.norm(away)) - self._mouth.slack

    @property
    def _tip(self) -> Array:
        return self._peg.foot + self._side * self._peg.tip

    @property
    def _reach(self) -> float:
        """Distance from the middle of the underside to the leading point of the rim, m."""
        return float(np.linalg.norm(self._peg.tip))

    @property
    def _towards(self) -> Array:
        """Unit vector (3,) along the surface, in the direction of the lean."""
        up = self._mouth.up
        along = self._side * (self.turn @ self._peg.lean)
        along = along - up * float(up @ along)
        return along / float(np.linalg.norm(along))
