"""Walking through a mission: from state to state, node by node, each node and state once."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial

from ..declaration import PRECONDITIONS
from ..mission import Mission, NodeSpec, TreeSpec, bottom_up
from ..node import Node
from ..values.references import Reference
from .default_flow import LeafFlow, any_order_outcomes
from .failure_reasons import NO_REPORT, UNREPORTED, FailureReasons, joined
from .flow_state import (
    EMPTY,
    FIRST_FILLER,
    KEPT,
    NOTHING,
    OUTER,
    SHARED,
    ConcurrentEffect,
    FlowState,
    States,
    tidy,
)
from .key_bits import KeyBits, lay_out
from .key_reading import KeyReader, WiredTree
from .outcomes import NEVER, NodeOutcomes, OutcomeCollector, tidy_failures


def conditioned(
    spec: NodeSpec, state: FlowState, walk: FlowAnalysis, run: Callable[[FlowState], NodeOutcomes]
) -> NodeOutcomes:
    """The ends of a node whose preconditions are asked, which then runs, and whose postconditions follow."""
    ends = OutcomeCollector()
    states: States = frozenset((state,))
    for name in PRECONDITIONS:
        condition = spec.preconditions.get(name)
        if condition is None:
            continue
        asked = walk.ask(spec, name, condition, states)
        ends.fail(asked.failed)
        settled, states = (asked.no, asked.yes) if name == "_while" else (asked.yes, asked.no)
        match name:
            case "_failureIf":
                ends.fail(dict.fromkeys(settled, NO_REPORT))
            case "_successIf":
                ends.succeed(settled)
            case _:
                ends.skip(settled)
        if not states:
            walk.unreached(spec, f"its {name} {'never' if name == '_while' else 'always'} holds")
            break
    for start in states:
        flow = run(start)
        ends.take(flow)
        if "_while" in spec.preconditions:
            # Where it no longer holds, the node is halted first.
            halted = _assigned_keys(spec, ("_onHalted",), walk)
            running = frozenset(state.perhaps(halted) for state in flow.running)
            asked = walk.ask(spec, "_while", spec.preconditions["_while"], running)
            ends.fail(asked.failed)
            ends.skip(asked.no)
    return _concluded(spec, ends.flow(), walk) if spec.postconditions else ends.flow()


def _concluded(spec: NodeSpec, flow: NodeOutcomes, walk: FlowAnalysis) -> NodeOutcomes:
    """After the assignments of the postconditions; one that has no value makes a success a failure."""
    ends = OutcomeCollector()
    ends.succeed(_assigned(spec, ("_onSuccess", "_post"), flow.success, walk, ends))
    ends.skip(flow.skipped)
    for state, reasons in flow.failure.items():
        problems = OutcomeCollector()
        for after in _assigned(spec, ("_onFailure", "_post"), frozenset((state,)), walk, problems):
            ends.fail_at(after, reasons)
        for after, missing in problems.flow().failure.items():
            ends.fail_at(after, joined((reasons.only(~UNREPORTED), missing)))
    halted = _assigned_keys(spec, ("_onHalted",), walk)
    ends.run(state.perhaps(halted) for state in flow.running)
    for state in flow.running:  # no end comes of them, but the names are read
        _assigned(spec, ("_onHalted",), frozenset((state,)), walk, OutcomeCollector())
    return ends.flow()


def _assigned(
    spec: NodeSpec, places: tuple[str, ...], states: States, walk: FlowAnalysis, ends: OutcomeCollector
) -> States:
    """The states after all could be carried out; the others are failures of `ends`."""
    written = _assigned_keys(spec, places, walk)
    for place in places:
        for assignment in spec.postconditions.get(place, ()):
            bits = walk.bits(assignment.key)
            asked = walk.ask(spec, place, assignment.value, states)
            for state, reasons in asked.failed.items():
                ends.fail_at(state.perhaps(written), reasons)
            after: list[FlowState] = []
            for state in (*asked.yes, *asked.no):
                if not assignment.new:
                    _, missing = walk.read(spec, place, assignment.key, bits, state)
                    if missing:
                        ends.fail_at(state.perhaps(written), walk.fails(spec, missing))
                after.append(state.written(bits))
            states = tidy(after)
    return states


def _assigned_keys(spec: NodeSpec, places: tuple[str, ...], walk: FlowAnalysis) -> int:
    bits = 0
    for place in places:
        for assignment in spec.postconditions.get(place, ()):
            bits |= walk.bits(assignment.key)
    return bits


class FlowAnalysis(KeyReader):
    """What a node's `flow` may ask, and what was found on the way."""

    def __init__(self, mission: Mission) -> None:
        super().__init__()
        self.ends: dict[str, NodeOutcomes] = {}
        """Of the trees that were entered from outside."""
        self.reached: dict[int, NodeSpec] = {}
        self.started: set[int] = set()
        self.entered: set[str] = set()
        self.blocked: dict[int, str] = {}
        """Why a node was not reached, by `id` of its spec; it may have been from elsewhere."""
        self.handled: set[tuple[int, str]] = set()
        """Handlers that were used, by `id` of the spec and label."""
        self.fillers: list[NodeSpec] = []
        self.leaves: dict[int, LeafFlow] = {}
        """By `id` of the spec."""
        self.unhidable = self.causes.matching("safety.*")
        """What no node may turn into a success; faults of the program are not walked through."""
        self._trees = mission.trees
        self._layouts = lay_out(mission.trees, bottom_up(mission.trees))
        self._frames: dict[tuple[str, tuple[tuple[int, int], ...], int], WiredTree] = {}
        self._hands: dict[str, int] = {}
        self._remembered: dict[int, FailureReasons] = {}
        self._recalled: set[int] = set()
        self._outdated = False

    # What whoever analyses a mission calls.

    def enter(self, tree: TreeSpec, hand: int = EMPTY) -> None:
        """Walk through a tree that starts with its inputs written; how it ends is then in `ends`."""
        self._hands[tree.name] = hand
        self._enter(tree.name)
        while self._outdated:
            # Something was recalled before all of it was known: all that was entered, once more.
            self._outdated = False
            for frame in self._frames.values():
                frame.memo.clear()
            for name in self._hands:
                self._enter(name)

    def layout_of(self, tree: str) -> KeyBits:
        """Which bits of a state stand for what in that tree."""
        return self._layouts[tree]

    def frames_of(self, tree: str) -> tuple[WiredTree, ...]:
        """The ways in which the tree is wired, with all that was found of its nodes."""
        return tuple(frame for (name, _, _), frame in self._frames.items() if name == tree)

    # What a node's flow may ask.

    def child(
        self, spec: NodeSpec, states: Iterable[FlowState], meanwhile: ConcurrentEffect = NOTHING
    ) -> NodeOutcomes:
        """The ends of a child that starts in any of these states; `meanwhile`: what others may do between
        its ticks."""
        if meanwhile != NOTHING and any(self._node(spec, state).running for state in states):
            flow = self.child(spec, tidy(meanwhile.on(state) for state in states))
            shared = any(state.hand & SHARED for state in states)
            return flow if shared or not meanwhile.hand else flow.alone()
        flows = [self._node(spec, state) for state in states]
        if len(flows) < 2:
            return flows[0] if flows else NEVER
        ends = OutcomeCollector()
        for flow in flows:
            ends.take(flow)
        return ends.flow()

    def effect(self, spec: NodeSpec, states: Iterable[FlowState]) -> ConcurrentEffect:
        """What a child that starts in any of these states may do to them."""
        found = NOTHING
        for state in states:
            found = found.with_(self._node(spec, state).effect(state))
        return found

    def remember(self, spec: NodeSpec, reasons: FailureReasons) -> None:
        """That the node may have failed so in an earlier activation."""
        known = self._remembered.get(id(spec))
        together = reasons if known is None else joined((known, reasons))
        if known is None or together.any & ~known.any or together.loud & ~known.loud:
            self._remembered[id(spec)] = together
            self._outdated = self._outdated or id(spec) in self._recalled

    def recall(self, spec: NodeSpec) -> FailureReasons:
        """What it may have failed with in an earlier activation."""
        self._recalled.add(id(spec))
        return self._remembered.get(id(spec), FailureReasons(0, 0))

    def filler(self, spec: NodeSpec) -> int:
        """The bit of `FlowState.hand` that says that this node took what is held."""
        if not any(spec is known for known in self.fillers):
            self.fillers.append(spec)
        index = next(i for i, known in enumerate(self.fillers) if known is spec)
        return FIRST_FILLER << index

    def unreached(self, spec: NodeSpec, why: str) -> None:
        """The child is not ticked this time; `why` completes `it is never reached: …`."""
        self.blocked[id(spec)] = why

    def handles(self, spec: NodeSpec, label: str) -> None:
        """The node has used the handler of that label."""
        self.handled.add((id(spec), label))

    # Private.

    def _enter(self, tree: str) -> None:
        inputs = self._layouts[tree].inputs
        state = FlowState(inputs, inputs, self._hands[tree])
        self.ends[tree] = self._in_frame(self._trees[tree], (), 0, state)

    def _node(self, spec: NodeSpec, state: FlowState) -> NodeOutcomes:
        memo, key = self._frame.memo, (id(spec), state)
        flow = memo.get(key)
        if flow is None:
            outer, self._missing = self._missing, 0
            self.reached.setdefault(id(spec), spec)
            if spec.preconditions or spec.postconditions:
                flow = conditioned(spec, state, self, partial(self._run, spec))
            else:
                flow = self._run(spec, state)
            if self._missing:
                flow = NodeOutcomes(flow.success, flow.failure, flow.skipped, flow.running, self._missing)
            memo[key] = flow
            self._missing = outer
        self._missing |= flow.missing
        return flow

    def _run(self, spec: NodeSpec, state: FlowState) -> NodeOutcomes:
        self.started.add(id(spec))
        if spec.node is None:
            return self._call(spec, state)
        after, reasons = self.inputs(spec, state)
        flow = _flow_of(spec.node)(spec, after, self)
        if reasons is None:
            return flow
        if not reasons.loud:
            state = state.in_doubt()
        known = flow.failure.get(state)
        failure = {**flow.failure, state: reasons if known is None else joined((known, reasons))}
        return NodeOutcomes(flow.success, tidy_failures(failure), flow.skipped, flow.running)

    def _call(self, spec: NodeSpec, state: FlowState) -> NodeOutcomes:
        shift, layout = self._frame.layout.calls[id(spec)]
        everything = (1 << layout.size) - 1
        sure, maybe = (state.sure >> shift) & everything, (state.maybe >> shift) & everything
        wired: dict[int, int] = {}
        constant = owned = 0
        for port in layout.tree.ports:
            bit, bound = layout.keys[port.key], spec.ports.get(port.key)
            if isinstance(bound, Reference):
                outer = self.bits(bound.key)
                wired[bit] = outer
                owned |= bit if bound.attributes or outer & self._frame.owned else 0
                sure = sure | bit if state.sure & outer else sure & ~bit
                maybe = maybe | bit if state.maybe & outer else maybe & ~bit
            elif bound is not None or port.direction == "in":
                sure, maybe, constant = sure | bit, maybe | bit, constant | bit
        twice = tuple(pair for pair in wired.items() if list(wired.values()).count(pair[1]) > 1)
        # Who took what is held is the same to a sub-tree: else each use of it would be another.
        held = state.hand & ~(EMPTY | KEPT | SHARED)
        hand = state.hand & ~held | (OUTER if held else 0)
        inside = FlowState(sure, maybe, hand, state.doubtful)
        flow = self._in_frame(layout.tree, twice, owned, inside)
        for port in layout.tree.ports:
            bound = spec.ports.get(port.key)
            if isinstance(bound, Reference) and port.direction == "in":
                unwritten = bool(flow.missing & layout.keys[port.key])
                self.note_read(spec, port.key, bound.key, state, missing=unwritten)
        # What is written at each start need not be kept from one to the next.
        kept = everything & ~(sum(wired) | constant)
        ways = tuple(wired.items())

        def outside(inner: FlowState) -> FlowState:
            sure, maybe = (inner.sure & kept) << shift, (inner.maybe & kept) << shift
            for bit, outer in ways:
                sure |= outer if inner.sure & bit else 0
                maybe |= outer if inner.maybe & bit else 0
            after = inner.hand & ~OUTER | held if inner.hand & OUTER else inner.hand
            return FlowState(state.sure | sure, state.maybe | maybe, after, inner.doubtful)

        ends = OutcomeCollector()
        ends.succeed(map(outside, flow.success))
        ends.skip(map(outside, flow.skipped))
        ends.run(map(outside, flow.running))
        for inner, reasons in flow.failure.items():
            ends.fail_at(outside(inner), reasons.through(spec))
        return ends.flow()

    def _in_frame(
        self, tree: TreeSpec, twice: tuple[tuple[int, int], ...], owned: int, state: FlowState
    ) -> NodeOutcomes:
        key = (tree.name, twice, owned)
        frame = self._frames.get(key)
        if frame is None:
            same = {bit: sum(other for other, to in twice if to == outer) for bit, outer in twice}
            frame = self._frames[key] = WiredTree(self._layouts[tree.name], same, owned)
        self.entered.add(tree.name)
        above, self._here = self._here, frame
        outer, self._missing = self._missing, 0
        flow = self._node(tree.root, state)
        self._here, self._missing = above, outer
        return flow


def _flow_of(node: type[Node]) -> Callable[[NodeSpec, FlowState, FlowAnalysis], NodeOutcomes]:
    """The class's own account; the most cautious one where its behaviour was rewritten below that."""
    for base in node.__mro__:
        if "flow" in vars(base):
            return node.flow
        if "on_tick" in vars(base):
            return partial(any_order_outcomes, node)
    return node.flow
