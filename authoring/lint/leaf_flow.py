"""Outcomes of leaves, and of control nodes of which nothing is known."""

from __future__ import annotations

from functools import reduce

from ...files.expressions.expression import Expression
from ...trees.declaration import NodeDeclaration
from ...trees.flow import FAILURE, RUNNING, SKIPPED, SUCCESS, Hand, LeafFlow
from ...trees.mission import NodeSpec
from .failure_reasons import NO_REPORT, FailureReasons, joined
from .flow_walk import FlowWalk
from .outcomes import EMPTY, KEPT, NONE, SHARED, FlowState, Outcomes, tidy, uncovered


def leaf_outcomes(
    node: NodeDeclaration, spec: NodeSpec, flow: LeafFlow | None, entry: FlowState, walk: FlowWalk
) -> Outcomes:
    """Return the outcomes of a leaf; without a flow it may end in any way."""
    ends = Outcomes()
    if flow is not None and flow.asks:
        expression = walk.literal(spec, flow.asks)
        assert isinstance(expression, Expression)
        asked = walk.ask(spec, flow.asks, expression, (entry,))
        ends.add(SUCCESS, asked.yes)
        ends.add(FAILURE, asked.no, NO_REPORT)
        ends.fail(asked.failed)
        return ends.tidied()
    success, otherwise = node.hand_with(spec.ports)
    filler = walk.filler(spec) if "full" in (success, *otherwise) else 0
    before = entry.hand if entry.hand & SHARED else 0
    kept = KEPT if entry.hand & ~(EMPTY | SHARED) else 0
    hands: dict[Hand, int] = {
        "unchanged": entry.hand,
        "full": before | filler,
        "empty": before | EMPTY,
        "kept": before | entry.hand & EMPTY | kept,
    }
    outputs = walk.outputs(spec)
    halfway = entry.perhaps(outputs).holding(reduce(int.__or__, (hands[how] for how in otherwise)))
    if flow is None or SUCCESS in flow.ends:
        ends.add(SUCCESS, (entry.written(outputs).holding(hands[success]),))
    if flow is None or FAILURE in flow.ends:
        ends.add(FAILURE, (halfway,), _reasons(node, spec, flow, walk))
    if flow is None or not (flow.instant or flow.steady):
        ends.add(RUNNING, (halfway,))
    if flow is None:
        ends.add(SKIPPED, (entry,))
    return ends


def _reasons(node: NodeDeclaration, spec: NodeSpec, flow: LeafFlow | None, walk: FlowWalk) -> FailureReasons:
    if flow is not None and len(flow.ends) == 1:
        return NO_REPORT
    looks = walk.causes.of(node.causes) & walk.no_image
    reasons = walk.fails(spec, walk.causes.of(node.causes_with(spec.ports)), walk.undeclared | looks)
    return joined((reasons, NO_REPORT)) if flow is None or node.kind == "condition" else reasons


def any_order_outcomes(node: NodeDeclaration, spec: NodeSpec, entry: FlowState, walk: FlowWalk) -> Outcomes:
    """Return the most cautious outcomes: children in any order, as often as one likes, and any end."""
    outputs = walk.outputs(spec)
    reasons = [walk.fails(spec, walk.causes.of(node.causes_with(spec.ports)), walk.undeclared), NO_REPORT]
    before, reached = NONE, frozenset((entry.perhaps(outputs),))
    while before != reached:
        before, flows = reached, [walk.child(part, reached) for part in spec.children]
        reasons += (why for flow in flows for why in flow.failure.values())
        after = (state.perhaps(outputs) for flow in flows for state in flow.everywhere)
        reached = uncovered(tidy((*reached, *after)))
    ends = Outcomes(dict.fromkeys(reached, joined(reasons)), skipped=reached)
    ends.success = ends.running = reached
    return ends.tidied()
