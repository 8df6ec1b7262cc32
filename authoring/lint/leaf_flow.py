"""Outcomes of leaves, and of control nodes of which nothing is known."""

from __future__ import annotations

from ...files.expressions.expression import Expression
from ...trees.declaration import NodeDeclaration
from ...trees.flow import FAILURE, RUNNING, SKIPPED, SUCCESS, Hand, LeafFlow
from ...trees.mission import NodeSpec
from .failure_reasons import NO_REPORT, FailureReasons, joined
from .flow_walk import FlowWalk
from .outcomes import EMPTY, KEPT, SHARED, FlowState, Outcomes, tidy, uncovered


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
    outputs = walk.keys_of(spec, (port.key for port in node.outputs))
    held = _hand_after(success, entry.hand, filler)
    hand = 0
    for how in otherwise:
        hand |= _hand_after(how, entry.hand, filler)
    halfway = entry.perhaps(outputs).holding(hand)
    if flow is None or SUCCESS in flow.ends:
        ends.add(SUCCESS, (entry.written(outputs).holding(held),))
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


def _hand_after(how: Hand, hand: int, filler: int) -> int:
    """Return the possible contents of the hand after a node, from those before it."""
    before = hand if hand & SHARED else 0
    match how:
        case "unchanged":
            return hand
        case "full":
            return before | filler
        case "empty":
            return before | EMPTY
        case "kept":
            return before | hand & EMPTY | (KEPT if hand & ~(EMPTY | SHARED) else 0)


def any_order_outcomes(node: NodeDeclaration, spec: NodeSpec, entry: FlowState, walk: FlowWalk) -> Outcomes:
    """Return the most cautious outcomes: children in any order, as often as one likes, and any end."""
    outputs = walk.keys_of(spec, (port.key for port in node.outputs))
    own = walk.fails(spec, walk.causes.of(node.causes_with(spec.ports)), walk.undeclared)
    reasons: list[FailureReasons] = [own, NO_REPORT]
    reached = frozenset((entry.perhaps(outputs),))
    while True:
        after = set(reached)
        for part in spec.children:
            flow = walk.child(part, reached)
            after |= flow.everywhere
            reasons += flow.failure.values()
        states = uncovered(tidy(state.perhaps(outputs) for state in after))
        if states == reached:
            break
        reached = states
    ends = Outcomes()
    for status in (SUCCESS, SKIPPED, RUNNING):
        ends.add(status, reached)
    ends.add(FAILURE, reached, joined(reasons))
    return ends.tidied()
