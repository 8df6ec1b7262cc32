"""Jog of the tool: twists in, joint set-points out, from the first command to rest."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

from picktree.files import PicktreeError
from picktree.world import (
    Array,
    Cause,
    Failure,
    Pose,
    control,
    planning,
    safety,
    world,
)
from picktree.world.robot_model import RobotModel

from .commands import MAX_TWIST_ANGULAR_SPEED, MAX_TWIST_SPEED, Doing, Twist
from .control_loop import ControlLoop
from .force_guard import ForceGuard, above_limit
from .motion_lease import Lease
from .velocity_controller import JogController, SpeedRestriction

StoppedBy: TypeAlias = Literal["done", "contact", "collision", "joint_limit", "singularity", "workspace"]


Lookout: TypeAlias = Callable[[Array], tuple[str, ...]]
"""Collision query of the look-ahead: pairs that touch on configurations (k, n), rad, as `panda_hand at
table`. Empty: free."""


TWIST_SHARES = (1.0, 0.7, 0.5, 0.35, 0.2, 0.1, 0.05)
"""Shares of the commanded twist, tried in this order until the path to a stop is free."""


LOOKAHEAD_STEP = 1 / 60
"""Time between two configurations of the look-ahead, s."""


REST_SPEED_SHARE = 0.02
"""Share of the commanded speed below which the jogged arm counts as at rest."""


MIN_REMAINING_TRAVEL = 1e-4
"""Remaining travel of the TCP below which a jog has gone its distance, m."""


REST_TICKS = 4
"""Ticks at a standstill before a jog counts as stopped: it needs time to get going."""


@dataclass(frozen=True, slots=True)
class JogFeedback:
    """Feedback to the source of the twists, given before each twist."""

    elapsed: float
    """Time since the start of the jog, s."""
    tcp: Pose
    travelled: float
    """Path length of the TCP so far, m."""
    force: float
    """External force on the hand beyond the reading at the start, N."""
    share: float
    """Share of the last twist that the arm follows, 0 … 1."""
    held_by: str
    """Reason for a slower motion: `collision hand at table`, `joint_limit NAME`, `singularity`, `workspace`,
    or empty."""


Twists: TypeAlias = "Twist | Callable[[JogFeedback], Twist | None]"
"""One constant twist, or a callable that returns the twist of each tick. None ends the jog."""


@dataclass(frozen=True, slots=True)
class JogResult:
    """Result of a jog, at rest."""

    stopped_by: StoppedBy
    detail: str
    """Pairs that would touch, or the joint, that stopped the jog."""
    travelled: float
    """Path length of the TCP, m."""
    elapsed: float
    """Duration of the jog, s."""
    force: float
    """Contact force that ended the jog, N; 0 without a contact."""
    pose: Pose
    """TCP pose in the world."""
    limit: float
    """Force limit of the scene, N."""

    def failure(self) -> Failure | None:
        """Return the failure that describes why the jog stopped. None: it ended by itself."""
        if self.stopped_by == "done":
            return None
        cause, what = _STOP_SENTENCES[self.stopped_by]
        after = f"after {self.travelled * 1000:.0f} mm"
        text = what.format(detail=self.detail, force=self.force, above=above_limit(self.force, self.limit))
        evidence: dict[str, str | float] = {"stopped_by": self.stopped_by, "travelled": self.travelled}
        return Failure(cause, f"{text} {after} of a jog", detail=self.detail, **evidence)


_STOP_SENTENCES: dict[str, tuple[Cause, str]] = {
    "contact": (world.DISTURBED, "touched something at {force:.0f} N{above}"),
    "collision": (planning.BLOCKED, "stopped before a collision ({detail})"),
    "joint_limit": (safety.JOINT_LIMIT, "{detail} came to its limit"),
    "singularity": (safety.SINGULARITY, "the arm came to a singular configuration"),
    "workspace": (safety.WORKSPACE, "the tool came to the edge of the workspace"),
}


class JogMotion:
    """Jogging of a loop's arm. `lookout` checks the path to a stop in each tick."""

    def __init__(self, loop: ControlLoop, model: RobotModel, lookout: Lookout | None, tick: float) -> None:
        self._loop = loop
        self._model = model
        self._lookout = lookout
        self._tick = tick

    def run(
        self,
        lease: Lease,
        twists: Twists,
        guard: ForceGuard,
        duration: float,
        distance: float,
        check: Callable[[Lease], None],
        until_rest: Callable[[Lease], Doing[None]],
    ) -> Doing[JogResult]:
        """Jog the arm from rest to rest.

        A constant twist ends where something stops it. A callable receives the reason as feedback and decides
        itself.
        """
        loop = self._loop
        jog = JogController(self._model, loop.period, loop.monitor.limits.workspace, distance)
        lease.run(jog, guard)
        begun, tcp, travelled = loop.now, loop.tcp, 0.0
        share, ticks_at_rest, blocked = 1.0, 0, tuple[str, ...]()
        stopped_by: StoppedBy = "done"
        detail = ""
        while True:
            elapsed = loop.now - begun
            if elapsed >= duration - 1e-9:
                break
            if isinstance(twists, Twist):
                twist: Twist | None = twists
            else:
                held_by = str(_restriction(jog, blocked) or "")
                force = guard.size(loop.wrist.force)
                twist = twists(JogFeedback(elapsed, loop.tcp, travelled, force, share, held_by))
            if twist is None or jog.state.left < MIN_REMAINING_TRAVEL:
                break
            twist = _checked_twist(twist)
            share, blocked = self._share(jog, twist, share)
            jog.command(twist.scaled(share))
            yield
            check(lease)
            travelled += loop.tcp.distance(tcp)
            tcp = loop.tcp
            if guard.contact is not None:
                break
            if jog.is_late:
                yield from until_rest(lease)
                raise Failure(control.TIMEOUT, "a jog has had no command in time, and has stopped")
            ticks_at_rest = ticks_at_rest + 1 if _is_at_rest(jog, twist) else 0
            restriction = _restriction(jog, blocked)
            if isinstance(twists, Twist) and ticks_at_rest >= REST_TICKS and restriction is not None:
                stopped_by, detail = restriction.kind, restriction.detail
                break
        jog.brake()
        yield from until_rest(lease)
        check(lease)
        travelled += loop.tcp.distance(tcp)
        force = 0.0
        if guard.contact is not None:
            stopped_by, force = "contact", math.hypot(*guard.contact)
        limit = loop.monitor.limits.force
        return JogResult(stopped_by, detail, travelled, loop.now - begun, force, loop.tcp, limit)

    def _share(self, jog: JogController, wanted: Twist, before: float) -> tuple[float, tuple[str, ...]]:
        """Return the largest share of a twist from which the arm stops before a collision, and the bodies it
        would touch.

        The look-ahead covers the tick until the next call, and one more for the reaction.
        """
        if self._lookout is None:
            return 1.0, ()
        blocked: tuple[str, ...] = ()
        nearest = max(k for k, share in enumerate((*TWIST_SHARES, 0.0)) if share >= before)
        for share in TWIST_SHARES[max(0, nearest - 1) :]:
            hit = self._lookout(jog.ahead(wanted.scaled(share), 2 * self._tick, LOOKAHEAD_STEP))
            if not hit:
                return share, blocked
            blocked = hit
        return 0.0, blocked


def _restriction(jog: JogController, blocked: tuple[str, ...]) -> SpeedRestriction | None:
    """Return the reason why the jog is slower than commanded; `blocked`: pairs that would touch."""
    return SpeedRestriction("collision", ", ".join(blocked)) if blocked else jog.law.restriction


def _is_at_rest(jog: JogController, wanted: Twist) -> bool:
    linear, angular = jog.law.tool_speed(jog.state)
    return (
        linear <= REST_SPEED_SHARE * wanted.speed + 1e-6
        and angular <= REST_SPEED_SHARE * math.hypot(*wanted.angular) + 1e-4
    )


def _checked_twist(wanted: Twist) -> Twist:
    numbers = (*wanted.linear, *wanted.angular)
    if len(numbers) != 6 or not all(math.isfinite(number) for number in numbers):
        raise PicktreeError(f"a twist needs three m/s and three rad/s, not {numbers}")
    speed, turn = wanted.speed, math.hypot(*wanted.angular)
    if speed > MAX_TWIST_SPEED * (1.0 + 1e-9) or turn > MAX_TWIST_ANGULAR_SPEED * (1.0 + 1e-9):
        raise PicktreeError(
            f"a jog goes at most {MAX_TWIST_SPEED:g} m/s and turns at most {MAX_TWIST_ANGULAR_SPEED:g} "
            "rad/s, "
            f"not {speed:.3g} m/s and {turn:.3g} rad/s"
        )
    return wanted
