"""The gripper's motions as generators."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeAlias, TypeVar

from ..causes import Failure, control
from ..protocols import Clock, Gripper
from ..robot.description import GripperDescription
from ..values import GripperState

T = TypeVar("T")
Doing: TypeAlias = Generator[None, None, T]

STILL = 3e-4
"""Change of the opening in a tick below which the fingers stand, m."""
REACHED = 1.5e-3
"""m"""
BLOCKED = 5e-3
"""Fingers that stay this far short of an opening are an error, m."""
OPENING = 20.0
"""Force a finger with which they open, N: what stands beside them must not be pressed against a wall."""
LEAST_RELEASE = 0.25
"""Share of the opening of a release that lets go."""
SPARE = 1.0
"""Time beyond what the way takes at the fingers' speed, s."""


class Grip:
    """Opens and closes. A command stays in force when the skill that gave it is halted."""

    def __init__(
        self, gripper: Gripper, clock: Clock, description: GripperDescription, opening: float = OPENING
    ) -> None:
        """`opening`: force a finger with which they open, N."""
        self._gripper = gripper
        self._clock = clock
        self._description = description
        self._force = 0.0
        self._opening = min(opening, description.max_force)
        self.bound = description.max_force
        """Greatest force of `press`, N: what is held bears no more. Until the fingers open."""

    @property
    def width(self) -> float:
        """Measured opening, m."""
        return self._gripper.read().width

    @property
    def state(self) -> GripperState:
        """What the gripper measures: opening, its speed, and the force of its drive on each finger."""
        return self._gripper.read()

    @property
    def force(self) -> float:
        """With which each finger was told to press last, N."""
        return self._force

    def start(
        self, width: float | None = None, force: float | None = None, speed: float | None = None
    ) -> None:
        """Begin to move towards an opening (fully open by default) and do not wait. Each finger moves with
        at most `speed` m/s."""
        most = self._description
        target = most.max_width if width is None else min(max(width, 0.0), most.max_width)
        self._force = self._opening if force is None else min(force, most.max_force)
        self._gripper.command(target, self._force, speed)

    def press(self, force: float) -> None:
        """Go on closing with another force a finger, N: firmer or more gently about what is held, at most
        `bound`."""
        self.start(0.0, min(force, self.bound))

    def open(self, width: float | None = None) -> Doing[None]:
        """Open to `width` m, by default fully, and not with more force than `bound`. Failure(control.timeout)
        when something holds the fingers."""
        yield from self._open(self._description.max_width if width is None else width, BLOCKED)

    def release(self, by: float) -> Doing[None]:
        """Let go of what is held: open by `by` m, or as far as what stands beside the fingers leaves them,
        if that is a quarter of it. Failure(control.timeout) when something holds the fingers."""
        yield from self._open(self.width + by, max(BLOCKED, (1.0 - LEAST_RELEASE) * by))

    def _open(self, width: float, short: float) -> Doing[None]:
        target = min(width, self._description.max_width)
        # A finger that alone pushes at something has the drive of both.
        force, self.bound = min(self._opening, self.bound / 2), self._description.max_force
        reached = yield from self.move(target, force)
        if reached < target - short:
            raise Failure(
                control.TIMEOUT,
                f"the fingers opened {reached * 1000:.0f} mm of {target * 1000:.0f} mm",
                width=reached,
                wanted=target,
            )

    def close(self, force: float, speed: float | None = None) -> Doing[float]:
        """Close with `force` N a finger until the fingers stand; answers the opening, m."""
        return (yield from self.move(0.0, force, speed))

    def move(self, width: float, force: float, speed: float | None = None) -> Doing[float]:
        """Towards an opening until it is reached or the fingers stand, each moving with at most `speed`
        m/s; answers the opening, m."""
        self.start(width, force, speed)
        way = abs(self.width - width)
        limit = self._clock.now + way / (2 * (speed or self._description.speed)) + SPARE
        before = self.width
        yield
        still = 0
        while self._clock.now < limit:
            now = self.width
            still = still + 1 if abs(now - before) < STILL else 0
            if abs(now - width) < REACHED or still >= 2:
                break
            before = now
            yield
        return self.width
