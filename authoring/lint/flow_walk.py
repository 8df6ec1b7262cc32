"""Walk through a mission from state to state: the interface for the flow of one node, and the findings."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import reduce
from math import inf
from typing import cast

from picktree.files import Expression
from picktree.trees import NodeSpec, Required, control_flow, references
from picktree.world import perception, world_facts
from picktree.world import tree as tree_causes
from picktree.world import world as world_causes

from .keys import ExpressionShape, KeyBits, shape
from .outcomes import (
    FIRST_FILLER,
    HAND_EMPTY,
    HAND_SHARED,
    NO_CONCURRENT_EFFECT,
    CauseBits,
    ConcurrentEffect,
    FailureReasons,
    Failures,
    FlowState,
    Outcomes,
    States,
    joined,
    tidy,
)


@dataclass(frozen=True, slots=True)
class ExpressionAnswers:
    """Possible values of an expression: states where it holds, where not, and where it has no value."""

    yes: States
    no: States
    failed: Failures


@dataclass(slots=True)
class KeyRead:
    """Read of a key at one place. The key may be unwritten there (`missing`), or written (`ever`)."""

    spec: NodeSpec
    place: str
    key: str
    tree: str
    missing: bool = False
    ever: bool = False


@dataclass(slots=True)
class WiredTree:
    """Tree with one wiring of its ports.

    `same`: bits of the same key; `owned`: inputs that are attributes of an object; `rooted`: own keys and
    ports that other trees write, too.
    """

    layout: KeyBits
    same: Mapping[int, int]
    owned: int
    rooted: int
    memo: dict[tuple[int, FlowState], Outcomes] = field(default_factory=dict[tuple[int, FlowState], Outcomes])


class FlowWalk(ABC):
    """Interface of the walk through a mission for the flow of one node."""

    def __init__(self) -> None:
        self.causes = CauseBits()
        self.reads: dict[tuple[int, str, str], KeyRead] = {}
        """Reads by `id` of the spec, its port or condition with the name, and the name."""
        self.raised: dict[int, int] = {}
        """Causes that each node has raised itself, by `id` of its spec."""
        self._missing_input = self.causes.of((tree_causes.MISSING_INPUT,))
        self._unknown_object = self.causes.of((world_causes.UNKNOWN_OBJECT,))
        self.undeclared = self._missing_input | self._unknown_object | self.causes.of((tree_causes.TIMEOUT,))
        """Causes with which a node may fail without a declaration."""
        self.no_image = self.causes.of((perception.NO_IMAGE,))
        """Cause with which any look may fail. Without another declared cause of a look, the linter does not
        demand a handler for it: any device may fail."""
        self._here: WiredTree | None = None
        self._missing = 0
        self._shapes: dict[int, ExpressionShape] = {}
        self._made: dict[tuple[int, int, int], FailureReasons] = {}
        self.reached: dict[int, NodeSpec] = {}
        self.started: set[int] = set()
        self.entered: set[str] = set()
        self.blocked: dict[int, str] = {}
        """Reason why a node was not reached, by `id` of its spec; another path may still reach it."""
        self.handled: set[tuple[int, str]] = set()
        """Handlers that were used, by `id` of the spec and label."""
        self.fillers: dict[int, tuple[int, NodeSpec]] = {}
        """Bits of `FlowState.hand` with the node that took the held object, by `id` of its spec."""
        self.kept: set[int] = set()
        """Children, by `id` of the spec, that their parent ticks again after their end without a reset."""
        self.unhidable = self.causes.matching("safety.*")
        """Causes that no node may turn into a success; faults of the program are left out."""
        self._remembered: dict[int, FailureReasons] = {}
        self._recalled: set[int] = set()
        self._outdated = False

    @property
    def _frame(self) -> WiredTree:
        assert self._here is not None, "no tree was entered"
        return self._here

    def fails(self, spec: NodeSpec, loud: int, quiet: int = 0) -> FailureReasons:
        """Return the failures that the node itself raises."""
        key = (id(spec), loud, quiet & ~loud)
        if key not in self._made:
            self._made[key] = FailureReasons(loud, quiet & ~loud, origin=spec)
            self.raised[id(spec)] = self.raised.get(id(spec), 0) | loud
        return self._made[key]

    def literal(self, spec: NodeSpec, key: str) -> object:
        """Return the constant value of an input, or its default; None for a read or computed one."""
        bound = spec.ports.get(key)
        if isinstance(bound, references.Constant):
            return bound.value
        port = spec.node.declaration.port(key) if spec.node is not None and bound is None else None
        return None if port is None or isinstance(port.default, Required) else port.default

    def number(self, spec: NodeSpec, key: str) -> float | None:
        value = self.literal(spec, key)
        return value if isinstance(value, int | float) else None

    def runs(self, spec: NodeSpec, flow: control_flow.ChildFlow) -> tuple[float, float]:
        """Return the least and the greatest number of runs that are allowed."""
        least = most = inf if isinstance(flow, control_flow.Loop | control_flow.Recovery) else 1
        if isinstance(flow, control_flow.Loop | control_flow.Recovery) and flow.runs:
            number = self.number(spec, flow.runs)
            least, most = (0, inf) if number is None else (inf, inf) if number < 0 else (number, number)
        if isinstance(flow, control_flow.Recovery):
            return least + flow.first_is_free, most + flow.first_is_free
        if isinstance(flow, control_flow.Loop) and flow.each_of:
            items = self.literal(spec, flow.each_of)
            length = len(cast("list[object]", items)) if isinstance(items, list) else None
            least, most = min(least, length or 0), min(most, inf if length is None else length)
        return least, most

    def outputs(self, spec: NodeSpec) -> int:
        """Return the bits of the keys to which the node's outputs are wired."""
        ports = spec.node.declaration.outputs if spec.node is not None else ()
        wired = (spec.ports.get(port.key) for port in ports)
        return self.all_bits(bound.key for bound in wired if isinstance(bound, references.Reference))

    def all_bits(self, keys: Iterable[str]) -> int:
        return reduce(int.__or__, map(self.bits, keys), 0)

    def flags(self, spec: NodeSpec) -> tuple[int, ...]:
        """Return the bits of a node that is `lasting`."""
        return self._frame.layout.flags[id(spec)]

    def shape(self, expression: Expression) -> ExpressionShape:
        if id(expression) not in self._shapes:
            self._shapes[id(expression)] = shape(expression)
        return self._shapes[id(expression)]

    def ask(
        self, spec: NodeSpec, place: str, expression: Expression, states: Iterable[FlowState]
    ) -> ExpressionAnswers:
        """Return the possible values of the expression under the key `place` of a node."""
        found = self.shape(expression)
        yes: list[FlowState] = []
        no: list[FlowState] = []
        failed = Outcomes()
        for state in states:
            after, reasons = self._names(spec, place, found, state)
            failed.add(control_flow.FAILURE, (state,), reasons)
            if found.fails:
                continue
            if found.constant is not False:
                yes.append(self._with_holding(after, holding=found.if_yes))
            if found.constant is not True:
                no.append(self._with_holding(after, holding=found.if_no))
        return ExpressionAnswers(tidy(yes), tidy(no), failed.tidied().failure)

    # For the walk.

    def _with_holding(self, state: FlowState, *, holding: bool | None) -> FlowState:
        """Return the state after a test of the fact `holding`; unchanged when a key hides the fact."""
        hidden = state.maybe & self._frame.layout.keys.get("holding", 0)
        if holding is None or hidden or state.hand & HAND_SHARED:
            return state
        # What a node holds that does not say so of itself is not known here.
        held = state.hand & ~HAND_EMPTY
        return state.holding((held or state.hand) if holding else HAND_EMPTY)

    def bits(self, key: str) -> int:
        """Return the bits of a key: several when ports of the tree are wired to the same key."""
        bit = self._frame.layout.keys[key]
        return self._frame.same.get(bit, bit)

    def inputs(self, spec: NodeSpec, state: FlowState) -> tuple[FlowState, FailureReasons]:
        """Return the state after the read of the inputs at the start, and the reasons of a failure."""
        assert spec.node is not None
        state, reasons = self.computed_inputs(spec, state)
        loud = quiet = 0
        for key, bound in spec.ports.items():
            if not isinstance(bound, references.Reference):
                continue
            port = spec.node.declaration.port(key)
            if port is None or port.direction != "in" or port.takes == "key":
                continue
            bits = self.bits(bound.key)
            state, missing, perhaps = self.read(spec, key, bound.key, bits, state)
            loud, quiet = loud | missing, quiet | perhaps
            if bound.attributes or bits & self._frame.owned:
                loud, quiet = loud | self._unknown_object, quiet | self._missing_input
            if port.type.name != "any" or port.type.many:
                quiet |= self._missing_input
        return state, joined((self.fails(spec, loud, quiet), *reasons))

    def computed_inputs(self, spec: NodeSpec, state: FlowState) -> tuple[FlowState, list[FailureReasons]]:
        """Return the state after the evaluation of the ports' expressions at the start, and the reasons of a
        failure."""
        found: list[FailureReasons] = []
        for key, bound in spec.ports.items():
            if isinstance(bound, references.PortExpression):
                state, reasons = self._names(spec, key, self.shape(bound.value), state)
                found += (reasons, self.fails(spec, 0, self._missing_input))
        return state, found

    def _names(
        self, spec: NodeSpec, place: str, found: ExpressionShape, state: FlowState
    ) -> tuple[FlowState, FailureReasons]:
        """Return the state after the read of an expression's names, and the reasons why it may have no
        value."""
        loud, quiet, owned = 0, 0, found.attributes
        for name in found.names:
            bits = self.bits(name)
            if name in world_facts.FACTS and not state.sure & bits:
                continue
            after, missing, perhaps = self.read(spec, place, name, bits, state)
            loud, quiet = loud | missing, quiet | perhaps
            state = after if name in found.certain else state
            owned = owned or bits & self._frame.owned != 0
        if owned:
            loud, quiet = loud | self._unknown_object, quiet | self._missing_input
        if found.fails:
            loud |= self._missing_input
        elif not found.total:
            quiet |= self._missing_input
        return state, self.fails(spec, loud, quiet)

    def read(
        self, spec: NodeSpec, place: str, key: str, bits: int, state: FlowState
    ) -> tuple[FlowState, int, int]:
        """Return the state after the read of a key, in which it is written, and the causes of an unwritten
        key: loud, quiet."""
        if bits & self._frame.rooted:
            return state.perhaps(bits), 0, self._missing_input
        unwritten = not state.sure & bits
        self.note_read(spec, place, key, state, missing=unwritten)
        if not unwritten:
            return state, 0, 0
        # Of what comes behind a read that cannot succeed nothing is told; a loop does not make it succeed.
        reportable = state.maybe & bits or self._frame.layout.inputs & bits
        return state.written(bits) if reportable else state.in_doubt(), self._missing_input, 0

    def note_read(self, spec: NodeSpec, place: str, key: str, state: FlowState, *, missing: bool) -> None:
        layout, bits = self._frame.layout, self.bits(key)
        if bits & layout.inputs:
            # Whether an input is written is for the user of the sub-tree to see to.
            self._missing |= bits & layout.inputs if missing and not state.doubtful else 0
            return
        where = (id(spec), place, key)
        read = self.reads.get(where)
        if read is None:
            read = self.reads[where] = KeyRead(spec, place, key, layout.tree.name)
        read.missing = read.missing or (missing and not state.doubtful)
        read.ever = read.ever or bool(state.maybe & bits)

    # What a node's flow may ask.

    def child(
        self, spec: NodeSpec, states: Iterable[FlowState], meanwhile: ConcurrentEffect = NO_CONCURRENT_EFFECT
    ) -> Outcomes:
        """Return the outcomes of a child that starts in any of the states; `meanwhile`: changes between its
        ticks."""
        if meanwhile != NO_CONCURRENT_EFFECT and any(
            self.node_outcomes(spec, state).running for state in states
        ):
            flow = self.child(spec, tidy(meanwhile.on(state) for state in states))
            shared = any(state.hand & HAND_SHARED for state in states)
            return flow if shared or not meanwhile.hand else flow.mapped(FlowState.alone)
        flows = [self.node_outcomes(spec, state) for state in states]
        if len(flows) == 1:
            return flows[0]
        ends = Outcomes()
        for flow in flows:
            ends.take(flow)
        return ends.tidied()

    def effect(self, spec: NodeSpec, states: Iterable[FlowState]) -> ConcurrentEffect:
        """Return the possible effect of a child that starts in any of these states."""
        effects = (self.node_outcomes(spec, state).effect(state) for state in states)
        return reduce(ConcurrentEffect.with_, effects, NO_CONCURRENT_EFFECT)

    def remember(self, spec: NodeSpec, reasons: FailureReasons) -> None:
        """Remember the reasons of failures of the node in an earlier activation."""
        known = self._remembered.get(id(spec))
        together = reasons if known is None else joined((known, reasons))
        if known is None or together.any & ~known.any or together.loud & ~known.loud:
            self._remembered[id(spec)] = together
            self._outdated = self._outdated or id(spec) in self._recalled

    def recall(self, spec: NodeSpec) -> FailureReasons:
        """Return the reasons of failures of the node in an earlier activation."""
        self._recalled.add(id(spec))
        return self._remembered.get(id(spec), FailureReasons(0, 0))

    def filler(self, spec: NodeSpec) -> int:
        """Return the bit of `FlowState.hand` for an object that this node took."""
        self.fillers.setdefault(id(spec), (FIRST_FILLER << len(self.fillers), spec))
        return self.fillers[id(spec)][0]

    def unreached(self, spec: NodeSpec, why: str) -> None:
        """Note that the child is not ticked here; `why` completes `it is never reached: …`."""
        self.blocked[id(spec)] = why

    def handles(self, spec: NodeSpec, label: str) -> None:
        """Note that the node has used the handler of that label."""
        self.handled.add((id(spec), label))

    @abstractmethod
    def node_outcomes(self, spec: NodeSpec, state: FlowState) -> Outcomes:
        """Return the outcomes of a node that starts in that state."""
        ...
