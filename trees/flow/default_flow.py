"""The flows of nodes of which only the declaration is known: leaves, and control nodes of plug-ins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .failure_reasons import NO_REPORT, FailureReasons, joined
from .flow_state import EMPTY, KEPT, NONE, SHARED, FlowState, tidy, uncovered
from .outcomes import NodeOutcomes, OutcomeCollector

if TYPE_CHECKING:
    from ..declaration import Hand
    from ..mission import NodeSpec
    from ..node import Node
    from .flow_walk import FlowAnalysis


def leaf(
    node: type[Node],
    spec: NodeSpec,
    entry: FlowState,
    walk: FlowAnalysis,
    *,
    takes_time: bool,
    says_no: bool = False,
    skips: bool = False,
) -> NodeOutcomes:
    """A leaf that may fail with what it declares. `says_no`: also without a report, as a condition."""
    found = walk.leaves.get(id(spec))
    if found is None:
        found = walk.leaves[id(spec)] = _leaf(node, spec, walk, says_no=says_no)
    outputs = walk.keys_of(spec, found.outputs) if found.outputs else 0
    held = hand_after(found.success, entry.hand, found.filler)
    hand = 0
    for how in found.otherwise:
        hand |= hand_after(how, entry.hand, found.filler)
    halfway = entry.perhaps(outputs).holding(hand)
    failed = halfway if found.reasons.loud else halfway.in_doubt()
    return NodeOutcomes(
        frozenset((entry.written(outputs).holding(held),)),
        {failed: found.reasons},
        frozenset((entry,)) if skips else NONE,
        frozenset((halfway,)) if takes_time else NONE,
    )


@dataclass(frozen=True, slots=True)
class LeafFlow:
    """What does not depend on the state in which a leaf starts."""

    outputs: tuple[str, ...]
    success: Hand
    otherwise: tuple[Hand, ...]
    filler: int
    reasons: FailureReasons


def _leaf(node: type[Node], spec: NodeSpec, walk: FlowAnalysis, *, says_no: bool) -> LeafFlow:
    success, otherwise = node.hand_with(spec.ports)
    outputs = tuple(port.key for port in node.declaration.outputs if port.key in spec.ports)
    filler = walk.filler(spec) if "full" in (success, *otherwise) else 0
    looks = walk.causes.of(node.declaration.causes) & walk.no_image
    reasons = walk.fails(spec, walk.causes.of(node.causes_with(spec.ports)), walk.undeclared | looks)
    return LeafFlow(outputs, success, otherwise, filler, joined((reasons, NO_REPORT)) if says_no else reasons)


def hand_after(how: Hand, hand: int, filler: int) -> int:
    """What may be in the hand after a node that held these possibilities before."""
    before = hand if hand & SHARED else 0
    return before | _hand_after(how, hand, filler)


def _hand_after(how: Hand, hand: int, filler: int) -> int:
    match how:
        case "unchanged":
            return hand
        case "full":
            return filler
        case "empty":
            return EMPTY
        case "kept":
            return hand & EMPTY | (KEPT if hand & ~(EMPTY | SHARED) else 0)


def any_order_outcomes(
    node: type[Node], spec: NodeSpec, entry: FlowState, walk: FlowAnalysis
) -> NodeOutcomes:
    """The most cautious account: children in any order, as often as one likes, and any end."""
    if not spec.children:
        return leaf(node, spec, entry, walk, takes_time=True, says_no=True, skips=True)
    outputs = walk.keys_of(spec, tuple(port.key for port in node.declaration.outputs))
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
    ends = OutcomeCollector()
    ends.succeed(reached)
    ends.skip(reached)
    ends.run(reached)
    for state in reached:
        ends.fail_at(state, joined(reasons))
    return ends.flow()
