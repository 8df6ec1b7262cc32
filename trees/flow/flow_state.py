"""What is known at one point of a mission: which keys are written, and what the hand may hold."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, TypeAlias

EMPTY = 1
"""Of `FlowState.hand`: nothing is held."""
KEPT = 2
"""Of `FlowState.hand`: what is held was seen to by a retreat, or was held before the analysis began."""
OUTER = 4
"""Of `FlowState.hand`, in a sub-tree: what its users' nodes took is held still, whichever they were."""
SHARED = 8
"""Of `FlowState.hand`: something beside this may change what is held at any time, so that no change is
final."""
FIRST_FILLER = 16
"""Of `FlowState.hand`, and each bit above: what one node of the text took is held still."""

LIMIT = 6
"""States that are told apart at one point; more are merged."""
BETWEEN = 4
"""The same between two ticks, where less depends on it."""


class FlowState(NamedTuple):
    """Keys and flags are bits of `sure` and `maybe`; what is in neither was written on no way here.

    `hand` is a set of possibilities, as bits. `doubtful`: the point is reached only if some node ends in a
    way that it does not declare; nothing is reported of such a state, but it counts as reached.
    """

    sure: int
    maybe: int
    hand: int
    doubtful: bool = False

    def written(self, bits: int) -> FlowState:
        """After these keys were written."""
        if self.sure & bits == bits:
            return self
        return FlowState(self.sure | bits, self.maybe | bits, self.hand, self.doubtful)

    def perhaps(self, bits: int) -> FlowState:
        """After these keys were written, or not."""
        if self.maybe & bits == bits:
            return self
        return FlowState(self.sure, self.maybe | bits, self.hand, self.doubtful)

    def holding(self, hand: int) -> FlowState:
        return self if hand == self.hand else FlowState(self.sure, self.maybe, hand, self.doubtful)

    def alone(self) -> FlowState:
        """After what went on beside has ended."""
        return self.holding(self.hand & ~SHARED)

    def in_doubt(self) -> FlowState:
        return self if self.doubtful else FlowState(self.sure, self.maybe, self.hand, True)

    def covers(self, other: FlowState) -> bool:
        """Whether all that may be so in the other may be so here."""
        return (
            self.sure & ~other.sure == 0
            and other.maybe & ~self.maybe == 0
            and other.hand & ~self.hand == 0
            and (other.doubtful or not self.doubtful)
        )


class ConcurrentEffect(NamedTuple):
    """What something that goes on beside a node may do meanwhile: write keys, change what the hand holds."""

    maybe: int = 0
    hand: int = 0

    def on(self, state: FlowState) -> FlowState:
        """What must be reckoned with from that state on."""
        hand = state.hand | self.hand | (SHARED if self.hand else 0)
        return FlowState(state.sure, state.maybe | self.maybe, hand, state.doubtful)

    def with_(self, other: ConcurrentEffect) -> ConcurrentEffect:
        return ConcurrentEffect(self.maybe | other.maybe, self.hand | other.hand)


NOTHING = ConcurrentEffect()
States: TypeAlias = frozenset[FlowState]
NONE: States = frozenset()


def merged(states: Iterable[FlowState]) -> FlowState:
    """One state that covers them all. There must be one at least."""
    sure, maybe, hand, doubtful = -1, 0, 0, True
    for state in states:
        sure &= state.sure
        maybe |= state.maybe
        hand |= state.hand
        doubtful = doubtful and state.doubtful
    return FlowState(sure, maybe, hand, doubtful)


def tidy(states: Iterable[FlowState], limit: int = LIMIT) -> States:
    """The same with what others cover left out, and merged where there are too many."""
    found = states if isinstance(states, frozenset) else frozenset(states)
    if len(found) < 2:
        return found
    if len(found) > 3 * limit:  # to compare each with each would cost too much
        found = _merged_by(found, with_hand=True)
    found = uncovered(found)
    if len(found) > limit:
        found = uncovered(_merged_by(found, with_hand=True))
    if len(found) > limit:
        found = uncovered(_merged_by(found, with_hand=False))
    return found


def uncovered(states: States) -> States:
    """Those that no other covers."""
    left: list[FlowState] = []
    for state in states:
        sure, maybe, hand, doubtful = state
        for other in states:
            # As `covers`, of another one; this is asked more often than anything else.
            if (
                not other[0] & ~sure
                and not maybe & ~other[1]
                and not hand & ~other[2]
                and (doubtful or not other[3])
                and other is not state
            ):
                break
        else:
            left.append(state)
    return states if len(left) == len(states) else frozenset(left)


def _merged_by(states: States, *, with_hand: bool) -> States:
    groups: dict[tuple[int, bool], list[FlowState]] = {}
    for state in states:
        groups.setdefault((state.hand if with_hand else 0, state.doubtful), []).append(state)
    return frozenset(merged(group) for group in groups.values())
