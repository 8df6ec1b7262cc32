"""Trying one child after another, as Fallback, ReactiveFallback and RoundRobin do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .failure_reasons import UNREPORTED, Reasons, joined
from .flow_state import NOTHING, Effect, States, tidy
from .outcomes import Ends, Failures

if TYPE_CHECKING:
    from ..mission import NodeSpec
    from .flow_walk import Walk


@dataclass(frozen=True, slots=True)
class Trial:
    """After one more child: `skipped`: all so far were; `failed`: for which reasons those so far failed."""

    success: States
    running: States
    skipped: States
    failed: Failures


def try_next(
    part: NodeSpec, skipped: States, failed: Failures, walk: Walk, meanwhile: Effect = NOTHING
) -> Trial:
    """Try the child where all before it were skipped, and where one failed."""
    first = walk.child(part, skipped, meanwhile)
    success, running, after = set(first.success), set(first.running), Ends()
    after.fail(first.failure)
    for state, before in failed.items():
        flow = walk.child(part, (state,), meanwhile)
        success |= flow.success
        running |= flow.running
        for passed in flow.skipped:
            after.fail_at(passed, before)
        for end, now in flow.failure.items():
            after.fail_at(end, decisive(before, now))
    return Trial(tidy(success), tidy(running), first.skipped, after.flow().failure)


def decisive(before: Reasons, now: Reasons) -> Reasons:
    """The reasons of the last child that gives any. What follows a reported failure is an attempt to cure it,
    and what comes out of that attempt was not left without one."""
    cured = before.loud != 0 and before.loud & UNREPORTED == 0
    reported = now.only(~UNREPORTED)
    parts = [reported.tried() if cured else reported] if reported.any else []
    if now.loud & UNREPORTED:
        parts.append(before.tried() if cured else before)
    return joined(parts)
