"""Latch of the safety monitor: a stop stays until it is acknowledged.

Persisting violations are then tolerated for the retreat alone.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...world.causes import Cause, FailureReport
from ...world.journal import Journal
from ...world.skill_events import SafetyStopEvent


@dataclass(frozen=True, slots=True)
class LatchState:
    """State of the latch between two control periods."""

    stopped: FailureReport | None
    stops: int
    tolerated: tuple[tuple[str, float], ...]
    """Violations that were acknowledged and persist: name and level."""
    levels: tuple[tuple[str, float], ...]
    """Violations that persist: name and level."""
    retreats: str = ""
    """Node path of the retreat that acknowledged. Violations are tolerated for its motions alone."""
    standing: tuple[tuple[str, FailureReport], ...] = ()
    """Failure report of each persisting violation."""
    latched: str = ""
    """Name of the violation that latched the stop."""


class Latch:
    """Latch of safety stops. Each violation has a name and a level: the excess over its limit.

    `violated` reports a violation, `within` its end. The first one latches the stop. After acknowledgement a
    persisting violation is tolerated as long as it does not grow; otherwise the way out would trip the same
    stop. It is tolerated only while the acknowledging retreat moves the arm (`moves`).
    """

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self.stopped: FailureReport | None = None
        self.stops = 0
        """Number of stops since the run began."""
        self._tolerated: dict[str, float] = {}
        self._levels: dict[str, float] = {}
        self._standing: dict[str, FailureReport] = {}
        self._retreats = ""
        self._latched = ""
        self._fresh = False

    @property
    def busy(self) -> bool:
        """Whether a violation persists or is tolerated."""
        return bool(self._levels or self._tolerated)

    def stands(self, name: str) -> bool:
        """Return whether `name` is violated now, tolerated or not."""
        return name in self._levels

    def tolerates(self, name: str) -> bool:
        return name in self._tolerated

    def acknowledge(self, by: str) -> None:
        """Allow motion again: for the node path `by` in spite of persisting violations."""
        if self.stopped is not None:
            # The violation may be just within its limit by now, and must not stop the retreat by flickering.
            self._tolerated = {self._latched or self.stopped.cause.name: 0.0, **self._levels}
            self._retreats = by
            self.stopped = None

    def moves(self, owner: str) -> None:
        """Register that `owner` begins to move the arm. Violations tolerated for another owner stop it."""
        if not self._tolerated or owner == self._retreats:
            return
        self._tolerated.clear()
        for name, report in self._standing.items():
            self._latch(name, report)

    def take_fresh(self) -> bool:
        """Return whether a stop was latched since the last call."""
        fresh, self._fresh = self._fresh, False
        return fresh

    def within(self, name: str, room: float, slack: float) -> None:
        """Report no violation, with a margin of `room`. Tolerance ends when the margin exceeds `slack`."""
        if self._levels.pop(name, None) is not None:
            self._standing.pop(name, None)
        if room > slack:
            self._tolerated.pop(name, None)

    def violated(
        self,
        name: str,
        cause: Cause,
        level: float,
        slack: float,
        message: str,
        **evidence: str | float | list[float],
    ) -> None:
        self._levels[name] = level
        report = self._standing[name] = FailureReport(cause, message, evidence)
        tolerated = self._tolerated.get(name)
        if tolerated is not None and level <= tolerated + slack:
            self._tolerated[name] = min(tolerated, level)
            return
        self._latch(name, report)

    def _latch(self, name: str, report: FailureReport) -> None:
        if self.stopped is not None:
            return
        self.stopped, self._latched = report, name
        self._tolerated.clear()
        self.stops += 1
        self._fresh = True
        cause, evidence = report.cause.name, dict(report.evidence)
        self._journal.note(SafetyStopEvent(report.message, cause=cause, extra=evidence))

    def state(self) -> LatchState:
        return LatchState(
            self.stopped,
            self.stops,
            tuple(self._tolerated.items()),
            tuple(self._levels.items()),
            self._retreats,
            tuple(self._standing.items()),
            self._latched,
        )

    def restore(self, saved: LatchState) -> None:
        self.stopped, self.stops = saved.stopped, saved.stops
        self._tolerated, self._levels = dict(saved.tolerated), dict(saved.levels)
        self._standing, self._retreats = dict(saved.standing), saved.retreats
        self._latched = saved.latched
        self._fresh = False
