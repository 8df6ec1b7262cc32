"""Survey for all rules: the mission, the places of its nodes, and its flow: each node in every state in which
it may start.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property, reduce

from picktree.files import Diagnostic, Expression, Mark, short_names
from picktree.trees import (
    MAIN,
    PRECONDITIONS,
    Mission,
    Node,
    NodeDeclaration,
    NodeSpec,
    TreeSpec,
    bottom_up,
    control_flow,
    data_flow,
    reachable,
    references,
)
from picktree.trees.loading import SceneNames

from .child_flow import ChildWalk, ParallelWalk, clean_up_outcomes
from .flow_walk import FlowWalk, WiredTree
from .keys import KeyBits, lay_out
from .outcomes import (
    HAND_EMPTY,
    HAND_SECURED,
    HAND_SHARED,
    HELD_OUTSIDE,
    NO_REPORT,
    NO_STATES,
    UNREPORTED,
    FailureReasons,
    FlowState,
    Outcomes,
    States,
    joined,
    tidy,
    uncovered,
)


def leaf_outcomes(
    node: NodeDeclaration,
    spec: NodeSpec,
    flow: control_flow.LeafFlow | None,
    entry: FlowState,
    walk: FlowWalk,
) -> Outcomes:
    """Return the outcomes of a leaf; without a flow it may end in any way."""
    ends = Outcomes()
    if flow is not None and flow.asks:
        expression = walk.literal(spec, flow.asks)
        assert isinstance(expression, Expression)
        answers = walk.ask(spec, flow.asks, expression, (entry,))
        ends.add(control_flow.SUCCESS, answers.yes)
        ends.add(control_flow.FAILURE, answers.no, NO_REPORT)
        ends.fail(answers.failed)
        return ends.tidied()
    success, otherwise = node.hand_with(spec.ports)
    filler = walk.filler(spec) if "full" in (success, *otherwise) else 0
    before = entry.hand if entry.hand & HAND_SHARED else 0
    kept = HAND_SECURED if entry.hand & ~(HAND_EMPTY | HAND_SHARED) else 0
    hands: dict[control_flow.Hand, int] = {
        "unchanged": entry.hand,
        "full": before | filler if entry.hand & HAND_EMPTY else entry.hand,  # full already: taken by another
        "empty": before | HAND_EMPTY,
        "kept": before | entry.hand & HAND_EMPTY | kept,
    }
    outputs = walk.outputs(spec)
    halfway = entry.perhaps(outputs).holding(reduce(int.__or__, (hands[how] for how in otherwise)))
    if flow is None or control_flow.SUCCESS in flow.ends:
        ends.add(control_flow.SUCCESS, (entry.written(outputs).holding(hands[success]),))
    if flow is None or control_flow.FAILURE in flow.ends:
        ends.add(control_flow.FAILURE, (halfway,), _reasons(node, spec, flow, walk))
    if flow is None or not (flow.instant or flow.steady):
        ends.add(control_flow.RUNNING, (halfway,))
    if flow is None:
        ends.add(control_flow.SKIPPED, (entry,))
    return ends


def _reasons(
    node: NodeDeclaration, spec: NodeSpec, flow: control_flow.LeafFlow | None, walk: FlowWalk
) -> FailureReasons:
    if flow is not None and len(flow.ends) == 1:
        return NO_REPORT
    looks = walk.causes.of(node.causes) & walk.no_image
    reasons = walk.fails(spec, walk.causes.of(node.causes_with(spec.ports)), walk.undeclared | looks)
    return joined((reasons, NO_REPORT)) if flow is None or node.kind == "condition" else reasons


def any_order_outcomes(node: NodeDeclaration, spec: NodeSpec, entry: FlowState, walk: FlowWalk) -> Outcomes:
    """Return the most cautious outcomes: children in any order and number of activations, and any end."""
    outputs = walk.outputs(spec)
    reasons = [walk.fails(spec, walk.causes.of(node.causes_with(spec.ports)), walk.undeclared), NO_REPORT]
    before, reached = NO_STATES, frozenset((entry.perhaps(outputs),))
    while before != reached:
        before, flows = reached, [walk.child(part, reached) for part in spec.children]
        reasons += (why for flow in flows for why in flow.failure.values())
        after = (state.perhaps(outputs) for flow in flows for state in flow.everywhere)
        reached = uncovered(tidy((*reached, *after)))
    ends = Outcomes(dict.fromkeys(reached, joined(reasons)), skipped=reached)
    ends.success = ends.running = reached
    return ends.tidied()


class FlowAnalysis(FlowWalk):
    """Flow analysis of a mission, with the facts for the rules."""

    def __init__(self, mission: Mission) -> None:
        super().__init__()
        self.ends: dict[str, Outcomes] = {}
        """Outcomes of the trees that were entered from outside."""
        self._trees = mission.trees
        self._layouts = lay_out(mission.trees, bottom_up(mission.trees))
        self._frames: dict[tuple[str, tuple[tuple[int, int], ...], int, int], WiredTree] = {}
        self._hands: dict[str, int] = {}

    # For the analysis of a mission.

    def enter(self, tree: TreeSpec, hand: int = HAND_EMPTY) -> None:
        """Walk through a tree that starts with its inputs written; its outcomes are then in `ends`."""
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
        """Return the layout of a state's bits in that tree."""
        return self._layouts[tree]

    def frames_of(self, tree: str) -> tuple[WiredTree, ...]:
        """Return the wirings of the tree, with the findings about its nodes."""
        return tuple(frame for (name, *_), frame in self._frames.items() if name == tree)

    # Private.

    def _enter(self, tree: str) -> None:
        inputs = self._layouts[tree].inputs
        state = FlowState(inputs, inputs, self._hands[tree])
        self.ends[tree] = self._in_frame(self._trees[tree], (), 0, 0, state)

    def node_outcomes(self, spec: NodeSpec, state: FlowState) -> Outcomes:
        memo, key = self._frame.memo, (id(spec), state)
        flow = memo.get(key)
        if flow is None:
            outer, self._missing = self._missing, 0
            self.reached.setdefault(id(spec), spec)
            if spec.preconditions or spec.postconditions:
                flow = self._conditioned(spec, state)
            else:
                flow = self._run(spec, state)
            flow.missing = self._missing
            memo[key] = flow
            self._missing = outer
        self._missing |= flow.missing
        return flow

    def _run(self, spec: NodeSpec, state: FlowState) -> Outcomes:
        self.started.add(id(spec))
        if spec.node is None:
            after, why = self.computed_inputs(spec, state)
            flow = self._call(spec, after)
            if why:
                flow.add(control_flow.FAILURE, (state,), joined(why))
            return flow.tidied() if why else flow
        after, reasons = self.inputs(spec, state)
        flow = self._outcomes(spec, after)
        flow.add(control_flow.FAILURE, (state,), reasons)
        return flow.tidied() if reasons.any else flow

    def _outcomes(self, spec: NodeSpec, entry: FlowState) -> Outcomes:
        assert spec.node is not None
        node = spec.node.declaration
        match node.flow:
            case control_flow.AtOnce() as flow:
                return ParallelWalk(spec, flow, self, entry).outcomes()
            case control_flow.CleanUp() as flow:
                return clean_up_outcomes(spec, flow, entry, self)
            case control_flow.ChildFlow() as flow:
                return ChildWalk(spec, flow, self).outcomes(entry)
            case None if spec.children:
                return any_order_outcomes(node, spec, entry, self)
            case flow:
                return leaf_outcomes(node, spec, flow, entry, self)

    def _call(self, spec: NodeSpec, state: FlowState) -> Outcomes:
        shift, layout = self._frame.layout.calls[id(spec)]
        everything = (1 << layout.size) - 1
        sure, maybe = (state.sure >> shift) & everything, (state.maybe >> shift) & everything
        wired: dict[int, int] = {}
        constant = owned = rooted = 0
        for port in layout.tree.ports:
            bit, bound = layout.keys[port.key], spec.ports.get(port.key)
            if isinstance(bound, references.Reference):
                outer = self.bits(bound.key)
                wired[bit] = outer
                owned |= bit if bound.attributes or outer & self._frame.owned else 0
                rooted |= bit if outer & self._frame.rooted else 0
                sure = sure | bit if state.sure & outer else sure & ~bit
                maybe = maybe | bit if state.maybe & outer else maybe & ~bit
            elif bound is not None or port.direction == "in":
                sure, maybe, constant = sure | bit, maybe | bit, constant | bit
        twice = tuple(pair for pair in wired.items() if list(wired.values()).count(pair[1]) > 1)
        # Who took what is held is the same to a sub-tree: else each use of it would be another.
        held = state.hand & ~(HAND_EMPTY | HAND_SECURED | HAND_SHARED)
        hand = state.hand & ~held | (HELD_OUTSIDE if held else 0)
        inside = FlowState(sure, maybe, hand, state.doubtful)
        flow = self._in_frame(layout.tree, twice, owned, rooted, inside)
        for port in layout.tree.ports:
            bound = spec.ports.get(port.key)
            if isinstance(bound, references.Reference) and port.direction == "in":
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
            after = inner.hand & ~HELD_OUTSIDE | held if inner.hand & HELD_OUTSIDE else inner.hand
            return FlowState(state.sure | sure, state.maybe | maybe, after, inner.doubtful)

        return flow.mapped(outside, lambda reasons: reasons.through(spec))

    def _in_frame(
        self, tree: TreeSpec, twice: tuple[tuple[int, int], ...], owned: int, rooted: int, state: FlowState
    ) -> Outcomes:
        key = (tree.name, twice, owned, rooted)
        frame = self._frames.get(key)
        if frame is None:
            same = {bit: sum(other for other, to in twice if to == outer) for bit, outer in twice}
            layout = self._layouts[tree.name]
            frame = self._frames[key] = WiredTree(layout, same, owned, layout.rooted | rooted)
        self.entered.add(tree.name)
        above, self._here = self._here, frame
        outer, self._missing = self._missing, 0
        flow = self.node_outcomes(tree.root, state)
        self._here, self._missing = above, outer
        return flow

    # Preconditions and postconditions.

    def _conditioned(self, spec: NodeSpec, state: FlowState) -> Outcomes:
        """Return the ends of a node with its preconditions before it, and its postconditions after it."""
        ends = Outcomes()
        states: States = frozenset((state,))
        for name in PRECONDITIONS:
            if name not in spec.preconditions:
                continue
            answers = self.ask(spec, name, spec.preconditions[name], states)
            ends.fail(answers.failed)
            settled, states = (answers.no, answers.yes) if name == "_while" else (answers.yes, answers.no)
            ends.add(
                {"_failureIf": control_flow.FAILURE, "_successIf": control_flow.SUCCESS}.get(
                    name, control_flow.SKIPPED
                ),
                settled,
                NO_REPORT,
            )
            if not states and (id(spec) not in self.kept or not (ends.success or ends.failure)):
                self.unreached(spec, f"its {name} {'never' if name == '_while' else 'always'} holds")
                break
        if id(spec) in self.kept and (states or ends.success or ends.failure):
            states = frozenset((*states, state))
        for start in states:
            flow = self._run(spec, start)
            ends.take(flow)
            if "_while" in spec.preconditions:
                # Where it no longer holds, the node is halted first.
                halted = self._assigned_keys(spec, "_onHalted")
                running = frozenset(state.perhaps(halted) for state in flow.running)
                answers = self.ask(spec, "_while", spec.preconditions["_while"], running)
                ends.fail(answers.failed)
                ends.add(control_flow.SKIPPED, answers.no)
        return self._concluded(spec, ends.tidied()) if spec.postconditions else ends.tidied()

    def _concluded(self, spec: NodeSpec, flow: Outcomes) -> Outcomes:
        """Return the ends after the assignments; one that has no value makes a success a failure."""
        ends = Outcomes(skipped=flow.skipped)
        ends.add(
            control_flow.SUCCESS,
            self._assigned(spec, (*self._scripts(spec), "_onSuccess", "_post"), flow.success, ends),
        )
        for state, reasons in flow.failure.items():
            problems = Outcomes()
            after = self._assigned(spec, ("_onFailure", "_post"), frozenset((state,)), problems)
            ends.add(control_flow.FAILURE, after, reasons)
            for at, missing in problems.tidied().failure.items():
                ends.add(control_flow.FAILURE, (at,), joined((reasons.only(~UNREPORTED), missing)))
        halted = self._assigned_keys(spec, "_onHalted")
        ends.add(control_flow.RUNNING, (state.perhaps(halted) for state in flow.running))
        # No end comes of a halt, but the names are read.
        self._assigned(spec, ("_onHalted",), flow.running, Outcomes())
        return ends.tidied()

    @staticmethod
    def _scripts(spec: NodeSpec) -> tuple[str, ...]:
        return spec.node.declaration.scripts if spec.node is not None else ()

    def _assigned(self, spec: NodeSpec, places: tuple[str, ...], states: States, ends: Outcomes) -> States:
        """Return the states after all assignments; states without a value are failures of `ends`."""
        written = self._assigned_keys(spec, *places)
        for place in places if states else ():
            for assignment in spec.postconditions.get(place, ()):
                bits = self.bits(assignment.key)
                answers = self.ask(spec, place, assignment.value, states)
                states = answers.yes | answers.no
                ends.fail({state.perhaps(written): reasons for state, reasons in answers.failed.items()})
                for state in states if not assignment.new else ():
                    _, *missing = self.read(spec, place, assignment.key, bits, state)
                    ends.add(control_flow.FAILURE, (state.perhaps(written),), self.fails(spec, *missing))
                states = tidy(state.written(bits) for state in states)
        return states

    def _assigned_keys(self, spec: NodeSpec, *places: str) -> int:
        return self.all_bits(a.key for place in places for a in spec.postconditions.get(place, ()))


class LintModel:
    """Analysed mission; a rule queries it and yields faults."""

    def __init__(self, mission: Mission, known: SceneNames | None) -> None:
        self.mission = mission
        self.known = known
        self.file = mission.document.root.mark.file
        self.walk = FlowAnalysis(mission)
        self._ends: dict[int, Outcomes] = {}
        if MAIN in mission.trees and not mission.library:
            self.walk.enter(mission.main)
        # The remaining trees are judged by themselves, callers first: from those the others are entered.
        for name in reversed(bottom_up(mission.trees)):
            if name not in self.walk.entered and self.own(mission.trees[name].mark):
                self.walk.enter(mission.trees[name], HAND_EMPTY | HAND_SECURED)
        self._places = {
            id(p.spec): p for tree in mission.trees.values() for p in data_flow.placed_nodes(tree)
        }
        self.usage = {name: self.walk.layout_of(name).usage for name in mission.trees}

    def own(self, mark: Mark) -> bool:
        """Whether the node is in the mission's own file; other files are checked by themselves."""
        return mark.file == self.file

    @cached_property
    def used(self) -> frozenset[str]:
        """Trees that `Main` uses; for a library all trees."""
        return frozenset(self.mission.trees) if self.mission.library else reachable(self.mission.trees)

    def trees(self) -> Iterator[TreeSpec]:
        """Trees of the mission's own file, in its order."""
        return (tree for tree in self.mission.trees.values() if self.own(tree.mark))

    def places(self) -> Iterator[data_flow.PlacedNode]:
        """Nodes of the mission's own file, parents first."""
        for tree in self.trees():
            for spec in tree.root.iterate():
                yield self._places[id(spec)]

    def nodes(self, *kinds: type[Node]) -> Iterator[NodeSpec]:
        """Yield the nodes of these classes, or all except sub-trees."""
        for place in self.places():
            if place.spec.node is not None and issubclass(place.spec.node, kinds or Node):
                yield place.spec

    def fault(
        self, spec: NodeSpec, message: str, hint: str = "", *, code: str, at: str = "", error: bool = False
    ) -> Diagnostic:
        """Return a finding at a node, or at the value under its key `at`."""
        path = self._places[id(spec)].path
        return Diagnostic(spec.mark_at(at), path, message, hint, code, "error" if error else "warning")

    def around(self, spec: NodeSpec) -> tuple[NodeSpec, ...]:
        """Return the nodes above it in its tree, the outermost first."""
        return self._places[id(spec)].above

    def short_name(self, spec: NodeSpec) -> str:
        """Return the shortest end of its path that no other node of the mission's own file has."""
        return self._short_names[self._places[id(spec)].path]

    @cached_property
    def _short_names(self) -> Mapping[str, str]:
        return short_names(place.path for place in self.places())

    # How the mission and its nodes may go.

    @property
    def main(self) -> Outcomes | None:
        """Outcomes of the mission; None for a library."""
        return None if self.mission.library else self.walk.ends.get(MAIN)

    def reached(self, spec: NodeSpec) -> bool:
        """Whether the node is ticked on any path of the mission."""
        return id(spec) in self.walk.reached

    def started(self, spec: NodeSpec) -> bool:
        """Whether the node is ticked on any path, and its preconditions let it start."""
        return id(spec) in self.walk.started

    def ends(self, spec: NodeSpec) -> Outcomes:
        """Return the outcomes of the node over all states in which it was reached."""
        known = self._ends.get(id(spec))
        if known is None:
            known = self._ends[id(spec)] = Outcomes()
            for ends in self._found.get(id(spec), ()):
                known.take(ends)
        return known

    def entries(self, spec: NodeSpec) -> tuple[FlowState, ...]:
        """Return the states in which the node was reached."""
        return tuple(
            state
            for name in self.mission.trees
            for frame in self.walk.frames_of(name)
            for other, state in frame.memo
            if other == id(spec)
        )

    @cached_property
    def _found(self) -> dict[int, list[Outcomes]]:
        found: dict[int, list[Outcomes]] = {}
        for name in self.mission.trees:
            for frame in self.walk.frames_of(name):
                for (spec, _), ends in frame.memo.items():
                    found.setdefault(spec, []).append(ends)
        return found
