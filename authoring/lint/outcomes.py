"""States of a mission at one point, and the outcomes of a node: the states in which it may end, and why it
may fail.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from picktree.trees import NodeStatus, control_flow
from picktree.world import Cause, Family, all_causes, matches

if TYPE_CHECKING:
    from picktree.trees import NodeSpec

UNREPORTED = 1
"""Bit of a failure without a report: a condition that does not hold."""
ALL = -1


class CauseBits:
    """Bits of the causes that are registered at the creation of this object; bit 0 is `UNREPORTED`."""

    def __init__(self) -> None:
        self._causes = all_causes()
        self._bits = {cause.name: 2 << index for index, cause in enumerate(self._causes)}
        self._matching: dict[str, int] = {}

    def of(self, declared: Iterable[Cause | Family]) -> int:
        """Return the bits of the causes that a node declares."""
        mask = 0
        for one in declared:
            mask |= self.matching(str(one))
        return mask

    def matching(self, pattern: str) -> int:
        """Return the bits of the causes that a pattern of `when:` covers."""
        if pattern not in self._matching:
            bits = (self._bits[cause.name] for cause in self._causes if matches(pattern, cause))
            self._matching[pattern] = sum(bits)
        return self._matching[pattern]

    def names(self, mask: int) -> tuple[str, ...]:
        """Return the names of a set, in the order of their registration."""
        return tuple(name for name, bit in self._bits.items() if mask & bit)

    def words(self, mask: int) -> str:
        """Return the set in the syntax of a mission: whole families as `family.*`."""
        families: dict[str, list[str]] = {}
        for name in self._bits:
            families.setdefault(name.rpartition(".")[0], []).append(name)
        parts: list[str] = []
        for family, names in families.items():
            contained = [name for name in names if mask & self._bits[name]]
            if len(contained) == len(names) > 1:
                parts.append(f"{family}.*")
            else:
                parts += contained
        return ", ".join(parts)


@dataclass(frozen=True, slots=True, eq=False)
class FailureReasons:
    """Causes that a failure may have. `quiet` ones are possible although no node declares them.

    Their origins are a graph that only reports read. `origin`: the node that raised them itself. Otherwise
    they are the causes of `inner` in the mask `keep`. `met`: a node has tried a cure against them. `call`:
    the node that runs the sub-tree which they leave.
    """

    loud: int
    quiet: int
    origin: NodeSpec | None = None
    inner: tuple[FailureReasons, ...] = ()
    keep: int = ALL
    met: bool = False
    call: NodeSpec | None = None

    @property
    def any(self) -> int:
        return self.loud | self.quiet

    def only(self, mask: int) -> FailureReasons:
        if self.any & ~mask == 0:
            return self
        return FailureReasons(self.loud & mask, self.quiet & mask, inner=(self,), keep=mask)

    def tried(self) -> FailureReasons:
        """Return the same reasons after a node has tried a cure against them."""
        return FailureReasons(self.loud, self.quiet, inner=(self,), met=True)

    def through(self, call: NodeSpec) -> FailureReasons:
        """Return the same reasons outside of the sub-tree, at its call."""
        return FailureReasons(self.loud, self.quiet, inner=(self,), call=call)

    def sources(self, own: str) -> Iterator[CauseOrigin]:
        """Yield the nodes that raise the causes; for a node in another file than `own`, its use in `own`."""
        seen: set[tuple[int, int, bool, int]] = set()
        todo: list[tuple[FailureReasons, int, bool, NodeSpec | None]] = [(self, ALL, False, None)]
        while todo:
            reasons, mask, met, call = todo.pop()
            mask &= reasons.keep
            key = (id(reasons), mask, met, id(call))
            if key in seen or not reasons.any & mask:
                continue
            seen.add(key)
            met = met or reasons.met
            if reasons.origin is not None:
                there = None if reasons.origin.mark.file == own else call
                yield CauseOrigin(reasons.origin, there or reasons.origin, reasons.loud & mask, met)
            if reasons.call is not None and reasons.call.mark.file == own:
                call = reasons.call
            todo.extend((inner, mask, met, call) for inner in reversed(reasons.inner))


@dataclass(frozen=True, slots=True)
class CauseOrigin:
    """Node that raises causes; `at` is its place, or its use, in the mission's own file."""

    node: NodeSpec
    at: NodeSpec
    causes: int
    met: bool


NO_REPORT = FailureReasons(UNREPORTED, 0)
"""Reasons of a condition that does not hold."""


def joined(parts: Iterable[FailureReasons]) -> FailureReasons:
    distinct = tuple({id(part): part for part in parts}.values())
    if len(distinct) == 1:
        return distinct[0]
    loud = quiet = 0
    for part in distinct:
        loud |= part.loud
        quiet |= part.quiet
    return FailureReasons(loud, quiet & ~loud, inner=distinct)


HAND_EMPTY = 1
"""Bit of `FlowState.hand`: nothing is held."""
HAND_SECURED = 2
"""Bit of `FlowState.hand`: a retreat secured the held object, or it was held before the analysis began."""
HELD_OUTSIDE = 4
"""Bit of `FlowState.hand`, in a sub-tree: an object taken by any node of its users is still held."""
HAND_SHARED = 8
"""Bit of `FlowState.hand`: a concurrent node may change the held object, so that no change is final."""
FIRST_FILLER = 16
"""First bit of `FlowState.hand` for single nodes: the object that the node took is still held."""
MAX_STATES = 6
"""Maximum number of distinct states at one point; more are merged."""
MAX_STATES_BETWEEN_TICKS = 4
"""Maximum number of distinct states between two ticks, where less depends on it."""


class FlowState(NamedTuple):
    """State of a mission at one point. Bits in neither `sure` nor `maybe`: keys and flags that no path wrote.

    `hand` is a set of possibilities, as bits. `doubtful`: only an undeclared outcome of some node leads to
    this point. Such a state causes no finding, but it counts as reached.
    """

    sure: int
    maybe: int
    hand: int
    doubtful: bool = False

    def written(self, bits: int) -> FlowState:
        """Return the state after writes of these keys."""
        done = self.sure & bits == bits
        return self if done else FlowState(self.sure | bits, self.maybe | bits, self.hand, self.doubtful)

    def perhaps(self, bits: int) -> FlowState:
        """Return the state after possible writes of these keys."""
        done = self.maybe & bits == bits
        return self if done else FlowState(self.sure, self.maybe | bits, self.hand, self.doubtful)

    def holding(self, hand: int) -> FlowState:
        return self if hand == self.hand else FlowState(self.sure, self.maybe, hand, self.doubtful)

    def alone(self) -> FlowState:
        """Return the state after the end of all concurrent nodes."""
        return self.holding(self.hand & ~HAND_SHARED)

    def in_doubt(self) -> FlowState:
        return self if self.doubtful else FlowState(self.sure, self.maybe, self.hand, True)


class ConcurrentEffect(NamedTuple):
    """Possible effect of concurrent nodes: keys that they write, changes of the hand."""

    maybe: int = 0
    hand: int = 0

    def on(self, state: FlowState) -> FlowState:
        """Return the state with everything that the effect may add."""
        hand = state.hand | self.hand | (HAND_SHARED if self.hand else 0)
        return FlowState(state.sure, state.maybe | self.maybe, hand, state.doubtful)

    def with_(self, other: ConcurrentEffect) -> ConcurrentEffect:
        return ConcurrentEffect(self.maybe | other.maybe, self.hand | other.hand)


NO_CONCURRENT_EFFECT = ConcurrentEffect()
States: TypeAlias = frozenset[FlowState]
NO_STATES: States = frozenset()


def merged(states: Iterable[FlowState]) -> FlowState:
    """Return one state that covers all of the states, of which there is at least one."""
    sure, maybe, hand, doubtful = -1, 0, 0, True
    for state in states:
        sure &= state.sure
        maybe |= state.maybe
        hand |= state.hand
        doubtful = doubtful and state.doubtful
    return FlowState(sure, maybe, hand, doubtful)


def tidy(states: Iterable[FlowState], limit: int = MAX_STATES) -> States:
    """Return the states without covered ones; too many are merged, first those with the same hand."""
    found = states if isinstance(states, frozenset) else frozenset(states)
    if 1 < len(found) <= 3 * limit:  # to compare more, each with each, would cost too much
        found = uncovered(found)
    for with_hand in (True, False):
        if len(found) > limit:
            found = uncovered(frozenset(map(merged, _alike(found, with_hand=with_hand))))
    return found


def _alike(states: Iterable[FlowState], *, with_hand: bool) -> Iterable[list[FlowState]]:
    groups: dict[tuple[int, bool], list[FlowState]] = {}
    for state in states:
        groups.setdefault((state.hand if with_hand else 0, state.doubtful), []).append(state)
    return groups.values()


def uncovered(states: States) -> States:
    """Return the states that no other state covers."""
    left: list[FlowState] = []
    for state in states:
        sure, maybe, hand, doubtful = state
        for other in states:
            # As `covers` of another state; this is the most frequent test.
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


Failures: TypeAlias = Mapping[FlowState, FailureReasons]
"""States after a failure of a node, with the reasons."""


class Outcomes:
    """Ends of a node that started in one state. `running`: possible states between two ticks.

    They are collected, and no longer changed once they are `tidied`.
    """

    __slots__ = ("failure", "missing", "running", "skipped", "success")

    def __init__(self, failure: Failures | None = None, skipped: States = NO_STATES) -> None:
        self.success: States = NO_STATES
        self.skipped = skipped
        self.running: States = NO_STATES
        self.failure: dict[FlowState, FailureReasons] = dict(failure or {})
        self.missing = 0
        """Inputs of the sub-tree that were read although nothing had surely written them, as bits of keys."""

    def __iter__(self) -> Iterator[tuple[NodeStatus, FlowState, FailureReasons | None]]:
        for status, states in (
            (control_flow.SUCCESS, self.success),
            (control_flow.SKIPPED, self.skipped),
            (control_flow.RUNNING, self.running),
        ):
            for state in states:
                yield status, state, None
        for state, reasons in self.failure.items():
            yield control_flow.FAILURE, state, reasons

    def groups(self) -> Iterator[tuple[NodeStatus, States, FailureReasons | None]]:
        """Return the states of each outcome except RUNNING, those of failures one by one."""
        if self.skipped:
            yield control_flow.SKIPPED, self.skipped, None
        if self.success:
            yield control_flow.SUCCESS, self.success, None
        for state, reasons in self.failure.items():
            yield control_flow.FAILURE, frozenset((state,)), reasons

    def add(
        self, status: NodeStatus, states: Iterable[FlowState], reasons: FailureReasons | None = None
    ) -> None:
        """Add outcomes. A failure without reasons is ignored; with quiet reasons only it is doubtful."""
        match status:
            case NodeStatus.SUCCESS:
                self.success = self.success.union(states)
            case NodeStatus.SKIPPED:
                self.skipped = self.skipped.union(states)
            case NodeStatus.FAILURE if reasons is not None and reasons.any:
                self.fail(dict.fromkeys(states, reasons))
            case NodeStatus.FAILURE:
                pass
            case _:
                self.running = self.running.union(states)

    def fail(self, failures: Failures) -> None:
        for state, reasons in failures.items():
            at = state if reasons.loud else state.in_doubt()
            known = self.failure.get(at)
            self.failure[at] = reasons if known is None else joined((known, reasons))

    def take(self, other: Outcomes) -> None:
        """Add all outcomes of a child."""
        self.success, self.skipped = self.success | other.success, self.skipped | other.skipped
        self.running |= other.running
        if other.failure:
            self.fail(other.failure)

    def tidied(self) -> Outcomes:
        """Leave out covered states, and merge too many states; return self."""
        self.success, self.skipped = tidy(self.success), tidy(self.skipped)
        self.running, self.failure = (
            tidy(self.running, MAX_STATES_BETWEEN_TICKS),
            _tidy_failures(self.failure),
        )
        return self

    def mapped(
        self,
        change: Callable[[FlowState], FlowState],
        reason: Callable[[FailureReasons], FailureReasons] = lambda reasons: reasons,
    ) -> Outcomes:
        """Return the outcomes with other states and reasons."""
        ends = Outcomes()
        for status, state, reasons in self:
            ends.add(status, (change(state),), None if reasons is None else reason(reasons))
        return ends.tidied()

    @property
    def fails_surely(self) -> bool:
        """Whether it may fail with a declared cause."""
        return any(not state.doubtful and why.loud for state, why in self.failure.items())

    @property
    def everywhere(self) -> States:
        """Return every possible state after its end or halt."""
        return self.success | self.skipped | self.running | self.failure.keys()

    def effect(self, entry: FlowState) -> ConcurrentEffect:
        """Return the possible effect on the state in which it started."""
        maybe = hand = 0
        for state in self.everywhere:
            maybe |= state.maybe
            hand |= state.hand
        return ConcurrentEffect(maybe & ~entry.maybe, hand & ~entry.hand & ~HAND_SHARED)


def _tidy_failures(failures: dict[FlowState, FailureReasons]) -> dict[FlowState, FailureReasons]:
    """Return the failures with too many states merged, as by `tidy`."""
    for with_hand in (True, False):
        if len(failures) > MAX_STATES:
            groups = _alike(failures, with_hand=with_hand)
            failures = {merged(group): joined(failures[state] for state in group) for group in groups}
    return failures


def decisive(before: FailureReasons, now: FailureReasons) -> FailureReasons:
    """Return the reasons of the last child that has any. A child after a reported failure is an attempt to
    cure it, so its own failures count as tried."""
    cured = before.loud != 0 and before.loud & UNREPORTED == 0
    reported = now.only(~UNREPORTED)
    parts = [reported.tried() if cured else reported] if reported.any else []
    if now.loud & UNREPORTED:
        parts.append(before.tried() if cured else before)
    return joined(parts)


def narrowed(failures: Failures, mask: int) -> Failures:
    """Return the failures with a cause in the mask, reduced to these causes."""
    return {s: reasons.only(mask) for s, reasons in failures.items() if reasons.any & mask}


def together(failures: Failures) -> Failures:
    return dict.fromkeys(tidy(failures), joined(failures.values())) if failures else failures
