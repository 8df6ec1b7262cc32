"""Which plan the arm follows when: one that was made ahead waits until the motion before it has ended."""

from __future__ import annotations

import bisect
from collections.abc import Iterable
from dataclasses import dataclass

from ...logs.run_log import At
from ...logs.schema.records import Plan

SAME = 0.02
"""Joints that differ by less are at the same place, rad."""
LATE = 0.1
"""How long after its end a plan counts as followed, s: the arm has to arrive."""


@dataclass(frozen=True, slots=True)
class _Span:
    """A plan and the time in which it is followed, simulated s."""

    start: float
    end: float
    plan: Plan


class Followed:
    """Plans that were found, as they are followed: inferred, for the log does not say which were executed.

    A plan that begins where the one before ends comes after it; any other takes its place.
    """

    def __init__(self, plans: Iterable[At[Plan]]) -> None:
        self._all: list[_Span] = []
        for at in plans:
            plan = at.record
            if plan.outcome != "found":
                continue
            start = at.time + plan.thinking
            if self._all and _goes_on(self._all[-1].plan, plan):
                start = max(start, self._all[-1].end)
            self._all.append(_Span(start, start + plan.duration, plan))
        self._starts = [following.start for following in self._all]

    def at(self, time: float) -> Plan | None:
        """What is followed at that time, s."""
        number = bisect.bisect_right(self._starts, time) - 1
        if number < 0 or time > self._all[number].end + LATE:
            return None
        return self._all[number].plan


def _goes_on(before: Plan, plan: Plan) -> bool:
    return bool(before.path and plan.path) and all(
        abs(a - b) < SAME for a, b in zip(before.path[-1], plan.path[0], strict=True)
    )
