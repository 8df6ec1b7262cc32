"""Outcomes of children in order, the last of which cleans up when another one fails or is halted."""

from __future__ import annotations

from ...trees.flow import FAILURE, RUNNING, CleanUp
from ...trees.mission import NodeSpec
from .failure_reasons import UNREPORTED, joined
from .flow_walk import FlowWalk
from .outcomes import NONE, Failures, FlowState, Outcomes, States, tidy


def clean_up_outcomes(spec: NodeSpec, flow: CleanUp, entry: FlowState, walk: FlowWalk) -> Outcomes:
    """Return the outcomes of the node that starts in one state."""
    *tried, last = spec.children
    ends, failed, before = Outcomes(), Outcomes(), ""
    halted: States = NONE
    arriving = Outcomes(skipped=frozenset((entry,)))
    for part in tried:
        if not (arriving.success or arriving.skipped):
            walk.unreached(part, f"{before} before it never succeeds")
            continue
        begun, skipped = (walk.child(part, states) for states in (arriving.success, arriving.skipped))
        arriving = Outcomes(skipped=skipped.skipped)
        arriving.success = begun.success | begun.skipped | skipped.success
        arriving.tidied()
        halted |= begun.running | skipped.running
        failed.fail(begun.failure)
        failed.fail(skipped.failure)
        before = part.name
    ends.success, ends.skipped, ends.running = arriving.success, arriving.skipped, halted
    _clean(last, failed.tidied().failure, ends, walk)
    if walk.literal(spec, flow.on_halt) is not False and halted:
        ends.running |= walk.child(last, tidy(halted)).everywhere
    elif not failed.failure:
        walk.unreached(last, "no child before it fails")
    return ends.tidied()


def _clean(last: NodeSpec, failures: Failures, ends: Outcomes, walk: FlowWalk) -> None:
    """Add the failures after the last child. Its own counts only where the one before it has no report."""
    for state, reasons in failures.items():
        cleaned, reported = walk.child(last, (state,)), reasons.only(~UNREPORTED)
        ends.add(RUNNING, cleaned.running)
        ends.add(FAILURE, cleaned.success | cleaned.skipped, reasons)
        for after, why in cleaned.failure.items():
            silent = (reported, why) if reported.any else (why,)
            ends.add(FAILURE, (after,), joined(silent) if reasons.any & UNREPORTED else reasons)
