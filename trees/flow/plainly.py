"""The flows of nodes of which only the declaration is known: leaves, and control nodes of plug-ins."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .ends import Ends, Flow
from .reasons import NO_REPORT, Reasons, joined
from .state import EMPTY, KEPT, State, tidy, uncovered

if TYPE_CHECKING:
    from ..declaration import Hand
    from ..mission import NodeSpec
    from ..node import Node
    from .walk import Walk


def leaf(
    node: type[Node],
    spec: NodeSpec,
    entry: State,
    walk: Walk,
    *,
    takes_time: bool,
    says_no: bool = False,
    skips: bool = False,
) -> Flow:
    """A leaf that may fail with what it declares. `says_no`: also without a report, as a condition."""
    outputs = sum({walk.key_of(spec, port.key) for port in node.declaration.outputs})
    success, failure = node.hand_with(spec.ports)
    ends = Ends()
    ends.succeed((entry.written(outputs).holding(hand_after(success, entry.hand, spec, walk)),))
    hand = 0
    for how in failure:
        hand |= hand_after(how, entry.hand, spec, walk)
    halfway = entry.perhaps(outputs).holding(hand)
    reasons = walk.fails(spec, walk.causes.of(node.causes_with(spec.ports)), walk.undeclared)
    ends.fail_at(halfway, joined((reasons, NO_REPORT)) if says_no else reasons)
    if takes_time:
        ends.run((halfway,))
    if skips:
        ends.skip((entry,))
    return ends.flow()


def hand_after(how: Hand, hand: int, spec: NodeSpec, walk: Walk) -> int:
    """What may be in the hand after a node that held these possibilities before."""
    match how:
        case "unchanged":
            return hand
        case "full":
            return walk.filler(spec)
        case "empty":
            return EMPTY
        case "kept":
            return hand & EMPTY | (KEPT if hand & ~EMPTY else 0)


def any_way(node: type[Node], spec: NodeSpec, entry: State, walk: Walk) -> Flow:
    """The most cautious account: children in any order, as often as one likes, and any end."""
    if not spec.children:
        return leaf(node, spec, entry, walk, takes_time=True, says_no=True, skips=True)
    outputs = sum({walk.key_of(spec, port.key) for port in node.declaration.outputs})
    own = walk.fails(spec, walk.causes.of(node.causes_with(spec.ports)), walk.undeclared)
    reasons: list[Reasons] = [own, NO_REPORT]
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
    ends = Ends()
    ends.succeed(reached)
    ends.skip(reached)
    ends.run(reached)
    for state in reached:
        ends.fail_at(state, joined(reasons))
    return ends.flow()
