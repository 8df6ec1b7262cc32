"""Motions of the gripper as generators."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from picktree.world import Clock, Failure, Gripper, GripperCommand, GripperState, control
from picktree.world.robot_model import GripperDescription

from .commands import Doing

REST_OPENING_CHANGE = 3e-4
"""Change of the opening in a tick below which the fingers are at rest, m."""
OPENING_TOLERANCE = 1.5e-3
"""Distance to the commanded opening at which it counts as reached, m."""
MAX_OPENING_SHORTFALL = 5e-3
"""Distance to the commanded opening from which an incomplete motion is an error, m."""
OPENING_FORCE = 20.0
"""Opening force of each finger, N. It must not press a neighbour against a wall."""
MIN_RELEASE_SHARE = 0.25
"""Least share of a release's opening that lets go of the object."""
MIN_FORCE_SHARE = 0.75
"""Least force of fingers at rest, as a share of the commanded force. Measured over sorts with hand and
linkage: 0.97 and more."""
FORCE_RISE_TICKS = 4
"""Ticks in which the force of fingers that have just stopped may still rise."""
MAX_MET_OPENING = 2e-3
"""Opening up to which the fingers touch each other, m. Their force then does not show an object."""
MIN_FINGER_TRAVEL = 1e-3
"""Travel up to which fingers have not moved, m, when the commanded opening is farther off."""
OPENING_SPARE_TIME = 0.5
"""Time beyond the travel time in which free fingers are open, s."""
FINGER_START_TIME = 0.3
"""Time in which free fingers have begun to move, s."""
BACK_OFF_OPENING = 3e-3
"""Change of the opening that relieves fingers which press against a neighbour, m."""
MOVE_SPARE_TIME = 1.0
"""Longest wait beyond the travel time at the fingers' speed, s."""


@dataclass(frozen=True, slots=True)
class GripperProgress:
    """Last command to the gripper, which stays in force when its skill ends, and where it began."""

    command: GripperCommand
    begun: float
    """Opening when it was given, m."""
    time: float
    """Time of the command, simulated s."""
    bound: float
    """Greatest force of `GripperControl.press`, N."""


class GripperControl:
    """Control of the gripper: open, close, release. A command stays in force when its skill is halted."""

    def __init__(
        self, gripper: Gripper, clock: Clock, description: GripperDescription, opening: float = OPENING_FORCE
    ) -> None:
        """`opening`: opening force of each finger, N."""
        self._gripper = gripper
        self._clock = clock
        self._description = description
        self._command = GripperCommand(description.max_width, 0.0)
        self._from = description.max_width
        self._command_time = 0.0
        self._opening = min(opening, description.max_force)
        self.bound = description.max_force
        """Greatest force of `press`, N: the limit of the held object. It is reset when the fingers open."""

    def save(self) -> GripperProgress:
        """Return the active command: fingers that still open continue after a restart."""
        return GripperProgress(self._command, self._from, self._command_time, self.bound)

    def restore(self, progress: GripperProgress) -> None:
        """Take over a command that the gripper has already got."""
        self._command, self._from = progress.command, progress.begun
        self._command_time, self.bound = progress.time, progress.bound

    @property
    def width(self) -> float:
        """Measured opening, m."""
        return self._gripper.read().width

    def widest(self, opening: float = 0.0) -> float:
        """Return the widest opening of a motion that starts now, m: present, commanded, or `opening`.

        The command counts while the fingers may still open; later something holds them.
        """
        way, width = self._command.width - self._from, self.width
        since = self._clock.now - self._command_time
        opens = way > 0.0 and since < way / (2 * self._description.speed) + FINGER_START_TIME
        return max(opening, width, self._command.width if opens else 0.0)

    def span(self, opening: float) -> tuple[float, float]:
        """Return the widest and the narrowest opening on the way from now to `opening`, m.

        Fingers that close come between bodies that they straddled, and those on a linkage reach further.
        """
        return self.widest(opening), min(self.width, opening)

    @property
    def state(self) -> GripperState:
        """Measured opening and its speed, and the drive force on each finger."""
        return self._gripper.read()

    @property
    def force(self) -> float:
        """Last commanded force of each finger, N."""
        return self._command.force

    def start(
        self, width: float | None = None, force: float | None = None, speed: float | None = None
    ) -> None:
        """Begin to move towards an opening, m, and do not wait. Default: fully open.

        Each finger moves with at most `speed` m/s.
        """
        limits = self._description
        self._command = GripperCommand(
            limits.max_width if width is None else width, self._opening if force is None else force, speed
        ).within(limits.max_width, limits.max_force, limits.speed)
        self._from, self._command_time = self.width, self._clock.now
        self._gripper.command(self._command)

    def overdue_failure(self) -> Failure | None:
        """Return Failure(control.gripper) when fingers that open during a motion are overdue to move or to be
        open.

        None: they are in time, or they close. The final opening of closing fingers is unknown.
        """
        way, width = self._command.width - self._from, self.width
        if way <= MAX_OPENING_SHORTFALL or width > self._command.width - MAX_OPENING_SHORTFALL:
            return None
        since = self._clock.now - self._command_time
        moves = since < FINGER_START_TIME or width > self._from + MIN_FINGER_TRAVEL
        if moves and since < way / (2 * self._description.speed) + OPENING_SPARE_TIME:
            return None
        return self._not_open(width, self._command.width)

    def check_grip_force(self, begun: float) -> Doing[None]:
        """Check the fingers at rest after they have closed from an opening of `begun` m.

        Raises Failure(control.gripper) when they have not moved, or press with less than the commanded force.
        """
        ticks, limit = 0, self._clock.now + MOVE_SPARE_TIME
        while ticks < FORCE_RISE_TICKS:
            if self._unsound(begun) is None:
                return
            # A gripper that still executes the command has not got its force yet.
            busy = self._gripper.read().busy and self._clock.now < limit
            ticks = ticks if busy else ticks + 1
            yield
        unsound = self._unsound(begun)
        if unsound is not None:
            raise unsound

    def _unsound(self, begun: float) -> Failure | None:
        state, commanded = self._gripper.read(), self.force
        moved, presses = begun - state.width, abs(state.force)
        met = state.width <= self._description.min_width + MAX_MET_OPENING
        if presses >= MIN_FORCE_SHARE * commanded or met:
            return None
        evidence = {"width": state.width, "moved": moved, "force": presses, "told": commanded}
        if moved <= MIN_FINGER_TRAVEL:
            message = (
                f"the fingers stand at {state.width * 1000:.1f} mm and have not moved, though told to close "
                f"with {commanded:.0f} N"
            )
        else:
            message = f"the fingers press with {presses:.1f} N each, though told {commanded:.0f} N"
        return Failure(control.GRIPPER, message, **evidence)

    def press(self, force: float) -> None:
        """Continue to close with another force of each finger, N, at most `bound`."""
        self.start(0.0, min(force, self.bound))

    def open(self, width: float | None = None) -> Doing[None]:
        """Open to `width` m with at most `bound` N; default: fully. Raises Failure(control.gripper) when
        something holds the fingers."""
        yield from self._open(self._description.max_width if width is None else width, MAX_OPENING_SHORTFALL)

    def release(
        self, by: float, share: float = 1.0, pressed: Callable[[], bool] = lambda: False
    ) -> Doing[None]:
        """Open by `by` m to release the held object; neighbours may stop the fingers after a quarter of it.

        Returns after that `share` of the opening, while the fingers still open. They back off as soon as
        `pressed` returns True. Raises Failure(control.gripper) when something holds the fingers.
        """
        begun = self.width
        short = max(MAX_OPENING_SHORTFALL, (1.0 - MIN_RELEASE_SHARE) * by)
        yield from self._open(begun + by, short, begun + max(share, MIN_RELEASE_SHARE) * by, pressed)

    def _open(
        self,
        width: float,
        short: float,
        enough: float = math.inf,
        pressed: Callable[[], bool] = lambda: False,
    ) -> Doing[None]:
        target = min(width, self._description.max_width)
        # A finger that alone pushes at something exerts the force of both drives.
        force, self.bound = min(self._opening, self.bound / 2), self._description.max_force
        reached = yield from self.move(target, force, enough=enough, pressed=pressed)
        if reached < target - short:
            raise self._not_open(reached, target)

    @staticmethod
    def _not_open(width: float, target: float) -> Failure:
        return Failure(
            control.GRIPPER,
            f"the fingers opened {width * 1000:.0f} mm of {target * 1000:.0f} mm",
            width=width,
            wanted=target,
        )

    def close(self, force: float, speed: float | None = None) -> Doing[float]:
        """Close with `force` N on each finger until the fingers are at rest, and return the opening, m.

        Raises Failure(control.gripper) when they do not move or press as commanded.
        """
        begun = self.width
        yield from self.move(0.0, force, speed)
        yield from self.check_grip_force(begun)
        return self.width

    def move(
        self,
        width: float,
        force: float,
        speed: float | None = None,
        *,
        enough: float = math.inf,
        pressed: Callable[[], bool] = lambda: False,
    ) -> Doing[float]:
        """Move towards an opening until it is reached or the fingers are at rest, and return the opening, m.

        Each finger moves with at most `speed` m/s. The wait ends at an opening of `enough` m. When `pressed`
        returns True they move back by `BACK_OFF_OPENING`.
        """
        self.start(width, force, speed)
        way = abs(self.width - width)
        limit = self._clock.now + way / (2 * (speed or self._description.speed)) + MOVE_SPARE_TIME
        before = self.width
        yield
        still = 0
        while self._clock.now < limit:
            now = self.width
            if pressed():
                self.start(now - BACK_OFF_OPENING, force, speed)
                return now
            stands = abs(now - before) < REST_OPENING_CHANGE and not self._gripper.read().busy
            still = still + 1 if stands else 0
            if abs(now - width) < OPENING_TOLERANCE or now >= enough or still >= 2:
                break
            before = now
            yield
        return self.width
