"""Walking through a mission: from state to state, node by node, each node and state once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial

from ...world.causes import tree as tree_causes
from ...world.causes import world as world_causes
from ...world.facts import FACTS
from ...world.files.expressions import Expression
from ..calls import bottom_up
from ..declaration import PRECONDITIONS
from ..mission import Mission, NodeSpec, TreeSpec
from ..node import Node
from ..ports import Required
from ..references import Constant, Reference
from .ends import NEVER, Ends, Failures, Flow, tidy_failures
from .layout import Layout, lay_out
from .plainly import Leaf, any_way
from .reasons import NO_REPORT, UNREPORTED, CauseBits, Reasons, joined
from .shape import Shape, shape
from .state import EMPTY, FIRST_FILLER, NOTHING, Effect, State, States, tidy


@dataclass(frozen=True, slots=True)
class Asked:
    """What an expression may answer: where it holds, where not, and where it has no value."""

    yes: States
    no: States
    failed: Failures


@dataclass(slots=True)
class Read:
    """A key that is read at one place. It may be unwritten there (`missing`), or written (`ever`)."""

    spec: NodeSpec
    place: str
    key: str
    tree: str
    missing: bool = False
    ever: bool = False


@dataclass(slots=True)
class Frame:
    """A tree in one way of being wired; `same`: bits that stand for one key; `owned`: inputs that are
    attributes of an object."""

    layout: Layout
    same: Mapping[int, int]
    owned: int
    memo: dict[tuple[int, State], Flow] = field(default_factory=dict[tuple[int, State], Flow])


class Walk:
    """What a node's `flow` may ask, and what was found on the way."""

    def __init__(self, mission: Mission) -> None:
        self.causes = CauseBits()
        self.reached: dict[int, NodeSpec] = {}
        self.started: set[int] = set()
        self.entered: set[str] = set()
        self.blocked: dict[int, str] = {}
        """Why a node was not reached, by `id` of its spec; it may have been from elsewhere."""
        self.reads: dict[tuple[int, str, str], Read] = {}
        self.handled: set[tuple[int, str]] = set()
        """Handlers that were used, by `id` of the spec and label."""
        self.raised: dict[int, int] = {}
        self.fillers: list[NodeSpec] = []
        self.leaves: dict[int, Leaf] = {}
        """By `id` of the spec."""
        self._trees = mission.trees
        self._layouts = lay_out(mission.trees, bottom_up(mission.trees))
        self._frames: dict[tuple[str, tuple[tuple[int, int], ...], int], Frame] = {}
        self._frame: Frame | None = None
        self._missing = 0
        self._missing_input = self.causes.of((tree_causes.MISSING_INPUT,))
        self._unknown_object = self.causes.of((world_causes.UNKNOWN_OBJECT,))
        self.undeclared = self._missing_input | self._unknown_object
        """What a node may fail with although it does not declare it."""
        self.unhidable = self.causes.matching("safety.*")
        """What no node may turn into a success; faults of the program are not walked through."""
        self._shapes: dict[int, Shape] = {}
        self._remembered: dict[int, Reasons] = {}
        self._recalled: set[int] = set()
        self._outdated = False
        self._made: dict[tuple[int, int, int], Reasons] = {}

    # What whoever analyses a mission calls.

    def enter(self, tree: TreeSpec, hand: int = EMPTY) -> Flow:
        """The ends of a tree that starts with its inputs written."""
        layout = self._layouts[tree.name]
        while True:
            self._outdated = False
            flow = self._in_frame(tree, (), 0, State(layout.inputs, layout.inputs, hand))
            if not self._outdated:
                return flow
            # Something was recalled before all of it was known.
            for frame in self._frames.values():
                frame.memo.clear()

    def layout_of(self, tree: str) -> Layout:
        """Which bits of a state stand for what in that tree."""
        return self._layouts[tree]

    def frames_of(self, tree: str) -> tuple[Frame, ...]:
        """The ways in which the tree is wired, with all that was found of its nodes."""
        return tuple(frame for (name, _, _), frame in self._frames.items() if name == tree)

    # What a node's flow may ask.

    def child(self, spec: NodeSpec, states: Iterable[State], meanwhile: Effect = NOTHING) -> Flow:
        """The ends of a child that starts in any of these states; `meanwhile`: what others may do between
        its ticks."""
        if meanwhile != NOTHING and any(self._node(spec, state).running for state in states):
            states = tidy(meanwhile.on(state) for state in states)
        flows = [self._node(spec, state) for state in states]
        if len(flows) < 2:
            return flows[0] if flows else NEVER
        ends = Ends()
        for flow in flows:
            ends.take(flow)
        return ends.flow()

    def effect(self, spec: NodeSpec, states: Iterable[State]) -> Effect:
        """What a child that starts in any of these states may do to them."""
        found = NOTHING
        for state in states:
            found = found.with_(self._node(spec, state).effect(state))
        return found

    def fails(self, spec: NodeSpec, loud: int, quiet: int = 0) -> Reasons:
        """Failures of the node's own making."""
        key = (id(spec), loud, quiet & ~loud)
        if key not in self._made:
            self._made[key] = Reasons(loud, quiet & ~loud, origin=spec)
            self.raised[id(spec)] = self.raised.get(id(spec), 0) | loud
        return self._made[key]

    def literal(self, spec: NodeSpec, key: str) -> object:
        """The value of an input where the text says it, or its default; None where a reference does."""
        bound = spec.ports.get(key)
        if isinstance(bound, Constant):
            return bound.value
        port = spec.node.declaration.port(key) if spec.node is not None and bound is None else None
        return None if port is None or isinstance(port.default, Required) else port.default

    def number(self, spec: NodeSpec, key: str) -> float | None:
        """As `literal`, of a number."""
        value = self.literal(spec, key)
        return value if isinstance(value, int | float) else None

    def key_of(self, spec: NodeSpec, port: str) -> int:
        """The bits of the key that a port is wired to; 0 when it is wired to none."""
        bound = spec.ports.get(port)
        return self._bits(bound.key) if isinstance(bound, Reference) else 0

    def keys_of(self, spec: NodeSpec, ports: Iterable[str]) -> int:
        """As `key_of`, of several."""
        bits = 0
        for port in ports:
            bits |= self.key_of(spec, port)
        return bits

    def flags(self, spec: NodeSpec) -> tuple[int, ...]:
        """The bits of a node that is `lasting`."""
        assert self._frame is not None
        return self._frame.layout.flags[id(spec)]

    def remember(self, spec: NodeSpec, reasons: Reasons) -> None:
        """That the node may have failed so in an earlier activation."""
        known = self._remembered.get(id(spec))
        together = reasons if known is None else joined((known, reasons))
        if known is None or together.any & ~known.any or together.loud & ~known.loud:
            self._remembered[id(spec)] = together
            self._outdated = self._outdated or id(spec) in self._recalled

    def recall(self, spec: NodeSpec) -> Reasons:
        """What it may have failed with in an earlier activation."""
        self._recalled.add(id(spec))
        return self._remembered.get(id(spec), Reasons(0, 0))

    def filler(self, spec: NodeSpec) -> int:
        """The bit of `State.hand` that says that this node took what is held."""
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

    def shape(self, expression: Expression) -> Shape:
        found = self._shapes.get(id(expression))
        if found is None:
            found = self._shapes[id(expression)] = shape(expression)
        return found

    def ask(self, spec: NodeSpec, place: str, expression: Expression, states: Iterable[State]) -> Asked:
        """What the expression that stands under the key `place` of a node answers."""
        found = self.shape(expression)
        yes: list[State] = []
        no: list[State] = []
        failed = Ends()
        for state in states:
            after, reasons = self._names(spec, place, found, state)
            if reasons is not None:
                failed.fail_at(state, reasons)
            if found.fails:
                continue
            if found.constant is not False:
                yes.append(self._told(after, holding=found.if_yes))
            if found.constant is not True:
                no.append(self._told(after, holding=found.if_no))
        return Asked(tidy(yes), tidy(no), failed.flow().failure)

    # Private.

    def _told(self, state: State, *, holding: bool | None) -> State:
        """After the fact `holding` was heard, unless a key hides it."""
        assert self._frame is not None
        if holding is None or state.maybe & self._frame.layout.keys.get("holding", 0):
            return state
        # What a node holds that does not say so of itself is not known here.
        held = state.hand & ~EMPTY
        return state.holding((held or state.hand) if holding else EMPTY)

    def _node(self, spec: NodeSpec, state: State) -> Flow:
        assert self._frame is not None
        memo, key = self._frame.memo, (id(spec), state)
        flow = memo.get(key)
        if flow is None:
            outer, self._missing = self._missing, 0
            self.reached.setdefault(id(spec), spec)
            if spec.preconditions or spec.postconditions:
                flow = self._conditioned(spec, state)
            else:
                flow = self._run(spec, state)
            if self._missing:
                flow = Flow(flow.success, flow.failure, flow.skipped, flow.running, self._missing)
            memo[key] = flow
            self._missing = outer
        self._missing |= flow.missing
        return flow

    def _conditioned(self, spec: NodeSpec, state: State) -> Flow:
        ends = Ends()
        states: States = frozenset((state,))
        for name in PRECONDITIONS:
            condition = spec.preconditions.get(name)
            if condition is None:
                continue
            asked = self.ask(spec, name, condition, states)
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
                self.unreached(spec, f"its {name} {'never' if name == '_while' else 'always'} holds")
                break
        for start in states:
            flow = self._run(spec, start)
            ends.take(flow)
            if "_while" in spec.preconditions:
                asked = self.ask(spec, "_while", spec.preconditions["_while"], flow.running)
                ends.fail(asked.failed)
                ends.skip(asked.no)
        return self._concluded(spec, ends.flow()) if spec.postconditions else ends.flow()

    def _concluded(self, spec: NodeSpec, flow: Flow) -> Flow:
        """After the assignments of the postconditions; one that has no value makes a success a failure."""
        ends = Ends()
        ends.succeed(self._assigned(spec, ("_onSuccess", "_post"), flow.success, ends))
        ends.skip(flow.skipped)
        for state, reasons in flow.failure.items():
            problems = Ends()
            for after in self._assigned(spec, ("_onFailure", "_post"), frozenset((state,)), problems):
                ends.fail_at(after, reasons)
            for after, missing in problems.flow().failure.items():
                ends.fail_at(after, joined((reasons.only(~UNREPORTED), missing)))
        halted = self._assigned_keys(spec, ("_onHalted",))
        ends.run(state.perhaps(halted) for state in flow.running)
        for state in flow.running:  # no end comes of them, but the names are read
            self._assigned(spec, ("_onHalted",), frozenset((state,)), Ends())
        return ends.flow()

    def _assigned(self, spec: NodeSpec, places: tuple[str, ...], states: States, ends: Ends) -> States:
        """The states after all could be carried out; the others are failures of `ends`."""
        written = self._assigned_keys(spec, places)
        for place in places:
            for assignment in spec.postconditions.get(place, ()):
                bits = self._bits(assignment.key)
                asked = self.ask(spec, place, assignment.value, states)
                for state, reasons in asked.failed.items():
                    ends.fail_at(state.perhaps(written), reasons)
                after: list[State] = []
                for state in (*asked.yes, *asked.no):
                    if not assignment.new:
                        _, missing = self._read(spec, place, assignment.key, bits, state)
                        if missing:
                            ends.fail_at(state.perhaps(written), self.fails(spec, missing))
                    after.append(state.written(bits))
                states = tidy(after)
        return states

    def _assigned_keys(self, spec: NodeSpec, places: tuple[str, ...]) -> int:
        bits = 0
        for place in places:
            for assignment in spec.postconditions.get(place, ()):
                bits |= self._bits(assignment.key)
        return bits

    def _run(self, spec: NodeSpec, state: State) -> Flow:
        self.started.add(id(spec))
        if spec.node is None:
            return self._call(spec, state)
        after, reasons = self._inputs(spec, state)
        flow = _flow_of(spec.node)(spec, after, self)
        if reasons is None:
            return flow
        if not reasons.loud:
            state = state.in_doubt()
        known = flow.failure.get(state)
        failure = {**flow.failure, state: reasons if known is None else joined((known, reasons))}
        return Flow(flow.success, tidy_failures(failure), flow.skipped, flow.running)

    def _call(self, spec: NodeSpec, state: State) -> Flow:
        assert self._frame is not None
        shift, layout = self._frame.layout.calls[id(spec)]
        everything = (1 << layout.size) - 1
        sure, maybe = (state.sure >> shift) & everything, (state.maybe >> shift) & everything
        wired: dict[int, int] = {}
        constant = owned = 0
        for port in layout.tree.ports:
            bit, bound = layout.keys[port.key], spec.ports.get(port.key)
            if isinstance(bound, Reference):
                outer = self._bits(bound.key)
                wired[bit] = outer
                owned |= bit if bound.attributes or outer & self._frame.owned else 0
                sure = sure | bit if state.sure & outer else sure & ~bit
                maybe = maybe | bit if state.maybe & outer else maybe & ~bit
            elif bound is not None or port.direction == "in":
                sure, maybe, constant = sure | bit, maybe | bit, constant | bit
        twice = tuple(pair for pair in wired.items() if list(wired.values()).count(pair[1]) > 1)
        inside = State(sure, maybe, state.hand, state.doubtful)
        flow = self._in_frame(layout.tree, twice, owned, inside)
        for port in layout.tree.ports:
            bound = spec.ports.get(port.key)
            if isinstance(bound, Reference) and port.direction == "in":
                unwritten = bool(flow.missing & layout.keys[port.key])
                self._note_read(spec, port.key, bound.key, state, missing=unwritten)
        # What is written at each start need not be kept from one to the next.
        kept = everything & ~(sum(wired) | constant)
        ways = tuple(wired.items())

        def outside(inner: State) -> State:
            sure, maybe = (inner.sure & kept) << shift, (inner.maybe & kept) << shift
            for bit, outer in ways:
                sure |= outer if inner.sure & bit else 0
                maybe |= outer if inner.maybe & bit else 0
            return State(state.sure | sure, state.maybe | maybe, inner.hand, inner.doubtful)

        ends = Ends()
        ends.succeed(map(outside, flow.success))
        ends.skip(map(outside, flow.skipped))
        ends.run(map(outside, flow.running))
        for inner, reasons in flow.failure.items():
            ends.fail_at(outside(inner), reasons.through(spec))
        return ends.flow()

    def _in_frame(self, tree: TreeSpec, twice: tuple[tuple[int, int], ...], owned: int, state: State) -> Flow:
        key = (tree.name, twice, owned)
        frame = self._frames.get(key)
        if frame is None:
            same = {bit: sum(other for other, to in twice if to == outer) for bit, outer in twice}
            frame = self._frames[key] = Frame(self._layouts[tree.name], same, owned)
        self.entered.add(tree.name)
        above, self._frame = self._frame, frame
        outer, self._missing = self._missing, 0
        flow = self._node(tree.root, state)
        self._frame, self._missing = above, outer
        return flow

    def _bits(self, key: str) -> int:
        assert self._frame is not None
        bit = self._frame.layout.keys[key]
        return self._frame.same.get(bit, bit)

    def _inputs(self, spec: NodeSpec, state: State) -> tuple[State, Reasons | None]:
        """After the inputs were read as the node starts; and why that may fail."""
        assert self._frame is not None and spec.node is not None
        loud = quiet = 0
        for key, bound in spec.ports.items():
            if not isinstance(bound, Reference):
                continue
            port = spec.node.declaration.port(key)
            if port is None or port.direction != "in":
                continue
            bits = self._bits(bound.key)
            state, missing = self._read(spec, key, bound.key, bits, state)
            loud |= missing
            if bound.attributes or bits & self._frame.owned:
                loud, quiet = loud | self._unknown_object, quiet | self._missing_input
            if port.type.name != "any" or port.type.many:
                quiet |= self._missing_input
        return state, self.fails(spec, loud, quiet) if loud or quiet else None

    def _names(self, spec: NodeSpec, place: str, found: Shape, state: State) -> tuple[State, Reasons | None]:
        """After the names of an expression were read; and why it may have no value."""
        assert self._frame is not None
        loud = quiet = 0
        for name in found.names:
            bits = self._bits(name)
            if name in FACTS and not state.sure & bits:
                continue
            after, missing = self._read(spec, place, name, bits, state)
            loud |= missing
            state = after if name in found.certain else state
            if bits & self._frame.owned:
                loud, quiet = loud | self._unknown_object, quiet | self._missing_input
        if found.attributes:
            loud, quiet = loud | self._unknown_object, quiet | self._missing_input
        if found.fails:
            loud |= self._missing_input
        elif not found.total:
            quiet |= self._missing_input
        return state, self.fails(spec, loud, quiet) if loud or quiet else None

    def _read(self, spec: NodeSpec, place: str, key: str, bits: int, state: State) -> tuple[State, int]:
        """After a key was read: then it was written. Also the cause if it may not have been."""
        unwritten = not state.sure & bits
        self._note_read(spec, place, key, state, missing=unwritten)
        if not unwritten:
            return state, 0
        after = state.written(bits)
        # Of what comes behind a read that cannot succeed nothing is told; a loop does not make it succeed.
        inputs = self._frame.layout.inputs if self._frame is not None else 0
        return after if state.maybe & bits or inputs & bits else after.in_doubt(), self._missing_input

    def _note_read(self, spec: NodeSpec, place: str, key: str, state: State, *, missing: bool) -> None:
        assert self._frame is not None
        layout, bits = self._frame.layout, self._bits(key)
        if bits & layout.inputs:
            # Whether an input is written is for the user of the sub-tree to see to.
            self._missing |= bits & layout.inputs if missing and not state.doubtful else 0
            return
        where = (id(spec), place, key)
        read = self.reads.get(where)
        if read is None:
            read = self.reads[where] = Read(spec, place, key, layout.tree.name)
        read.missing = read.missing or (missing and not state.doubtful)
        read.ever = read.ever or (bool(state.maybe & bits) and not state.doubtful)


def _flow_of(node: type[Node]) -> Callable[[NodeSpec, State, Walk], Flow]:
    """The class's own account; the most cautious one where its behaviour was rewritten below that."""
    for base in node.__mro__:
        if "flow" in vars(base):
            return node.flow
        if "on_tick" in vars(base):
            return partial(any_way, node)
    return node.flow
