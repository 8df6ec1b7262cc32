"""Loops that never end, and attempts that cannot turn out otherwise."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from picktree.files import Diagnostic, Expression
from picktree.trees import (
    MAIN,
    ForEach,
    KeepRunningUntilFailure,
    Node,
    NodeSpec,
    Parallel,
    ParallelAll,
    ReactiveFallback,
    ReactiveSequence,
    Repeat,
    RetryUntilSuccessful,
    Timeout,
    TreeSpec,
    control_flow,
    data_flow,
)
from picktree.world import world_facts

from .mission_survey import LintModel

_CHANGING_FACT = "time"
"""Fact that changes without an action of the robot."""


@dataclass(frozen=True, slots=True)
class BranchEffects:
    """Effects of a branch. `acts`: a node may move the robot, look, or have unknown effects. `keys`: written
    keys."""

    acts: bool
    keys: frozenset[str]

    def decides(self, expression: Expression) -> bool:
        """Whether the branch may change the value of the expression."""
        facts = {name for name in expression.names if name in world_facts.FACTS}
        by_world = self.acts and bool(facts or expression.paths)
        return by_world or _CHANGING_FACT in facts or bool(self.keys & expression.names)


NO_EFFECT = BranchEffects(acts=False, keys=frozenset())


def changes_of(branches: Iterable[NodeSpec], trees: Mapping[str, TreeSpec]) -> BranchEffects:
    """Return the possible changes by the branches, with the keys of the tree that contains them."""
    acts, keys = False, set[str]()
    for spec in (spec for branch in branches for spec in branch.iterate()):
        keys.update(use.key for use in data_flow.uses_of(spec, trees) if use.writes)
        if spec.node is None:
            acts = acts or changes_of((trees[spec.id].root,), trees).acts
        elif not (spec.children or is_steady(spec.node) or spec.node.kind == "condition"):
            acts = True
    return BranchEffects(acts, frozenset(keys))


def is_constant(branch: NodeSpec, trees: Mapping[str, TreeSpec], between: BranchEffects = NO_EFFECT) -> bool:
    """Whether it takes no time and always has the same outcome, with these changes between two
    activations."""
    written, read = set(between.keys), set[str]()
    for spec in branch.iterate():
        if not (is_constant(trees[spec.id].root, trees) if spec.node is None else is_steady(spec.node)):
            return False
        for use in data_flow.uses_of(spec, trees):
            (written if use.writes else read).add(use.key)
    return not between.acts and _CHANGING_FACT not in read and not written & read


@dataclass(frozen=True, slots=True)
class NodeContext:
    """Context of a node. `stopped`: a node above may halt it. `beside`: other nodes are ticked at the same
    time."""

    stopped: bool = False
    beside: bool = False

    def below(self, spec: NodeSpec, child: NodeSpec, survey: LintModel) -> NodeContext:
        stopped = self.stopped or "_while" in spec.preconditions
        if spec.node is None:
            return NodeContext(stopped, self.beside)
        if issubclass(spec.node, Timeout):
            stopped = stopped or survey.walk.number(spec, "msec") != 0
        flow = spec.node.declaration.flow
        if isinstance(flow, control_flow.ChildFlow) and flow.by_turns:
            return NodeContext(stopped, self.beside)
        if issubclass(spec.node, Parallel):
            return NodeContext(stopped or _may_end_early(spec, child, survey), beside=True)
        if issubclass(spec.node, ParallelAll):
            return NodeContext(stopped, beside=True)
        if issubclass(spec.node, ReactiveSequence | ReactiveFallback):
            stopped = stopped or child is not spec.children[0]
            return NodeContext(stopped, self.beside or len(spec.children) > 1)
        # Switch and WhileDoElse leave a branch for another, and of a plug-in's node nothing is known.
        return NodeContext(stopped=True, beside=True)


def _may_end_early(spec: NodeSpec, child: NodeSpec, survey: LintModel) -> bool:
    """Whether a Parallel may end because of its other children."""
    others = [survey.ends(part) for part in spec.children if part is not child]
    wanted = survey.walk.number(spec, "success_count")
    return any(other.failure for other in others) or wanted not in (-1, len(spec.children))


def contexts(survey: LintModel) -> Iterator[tuple[NodeSpec, NodeContext]]:
    """Return the started nodes of the mission's own file, in each of their contexts.

    Empty for a library, because the contexts of its trees are unknown.
    """
    seen: set[tuple[str, NodeContext]] = set()
    main = survey.mission.trees[MAIN].root if survey.main is not None else None
    todo = [(main, NodeContext())] if main is not None else []
    while todo:
        spec, around = todo.pop()
        if survey.own(spec.mark) and survey.started(spec):
            yield spec, around
        if spec.node is None and (spec.id, inside := around.below(spec, spec, survey)) not in seen:
            seen.add((spec.id, inside))
            todo.append((survey.mission.trees[spec.id].root, inside))
        todo += [(child, around.below(spec, child, survey)) for child in spec.children]


def _unhalted_nodes(survey: LintModel, *kinds: type[Node]) -> Iterator[tuple[NodeSpec, NodeContext]]:
    """Yield the nodes of these classes that no other node halts."""
    for spec, context in contexts(survey):
        stopped = context.stopped or "_while" in spec.preconditions
        if not stopped and spec.node is not None and issubclass(spec.node, kinds):
            yield spec, context


def endless(survey: LintModel) -> Iterator[Diagnostic]:
    """P321, P322: a loop that never ends."""
    for spec, context in _unhalted_nodes(survey, Repeat, RetryUntilSuccessful, KeepRunningUntilFailure):
        name, child = spec.children[0].name, survey.ends(spec.children[0])
        if spec.node is not None and issubclass(spec.node, Repeat):
            yield from _repeat(survey, spec, context)
        elif survey.walk.number(spec, "num_attempts") == -1:
            message = f"the loop never ends: num_attempts is -1, and {name} never succeeds"
            if child.success or child.skipped:
                message = "num_attempts is -1: the loop ends only when its child succeeds"
            hint = "give a number of attempts, or add a Timeout"
            yield survey.fault(spec, message, hint, code="P321", at="num_attempts")
        elif spec.id == KeepRunningUntilFailure.__name__ and not child.fails_surely:
            message, hint = (
                f"the loop never ends: {name} cannot fail",
                "use a Repeat with 'num_cycles' or 'while'",
            )
            yield survey.fault(spec, message, hint, code="P321")


def only_failing(survey: LintModel) -> Iterator[Diagnostic]:
    """P327: a mission that cannot succeed."""
    main = survey.main
    if main is None or main.success or main.skipped or not main.failure:
        return
    root = survey.mission.main.root
    if not survey.own(root.mark) or next(endless(survey), None) is not None:
        return
    message = "the mission can only end by failing: no way through it succeeds"
    hint = "put a ForceSuccess or an Inverter around the part that fails in the end"
    if any(spec.id == KeepRunningUntilFailure.__name__ for spec in survey.nodes(KeepRunningUntilFailure)):
        hint = (
            "KeepRunningUntilFailure fails in the end: use a Repeat with 'while', or put a "
            "ForceSuccess around it"
        )
    yield survey.fault(root, message, hint, code="P327")


def _repeat(survey: LintModel, spec: NodeSpec, context: NodeContext) -> Iterator[Diagnostic]:
    if survey.walk.number(spec, "num_cycles") != -1:
        return
    part, child = spec.children[0], survey.ends(spec.children[0])
    condition = survey.walk.literal(spec, "while")
    constant = isinstance(condition, Expression) and survey.walk.shape(condition).constant
    if condition is None or constant:
        at = "while" if constant else "num_cycles"
        reason = "'while' always holds" if constant else "num_cycles is -1 and there is no 'while'"
        if child.fails_surely or child.skipped:
            message = f"the loop ends only when {part.name} fails: {reason}"
        else:
            message = f"the loop never ends: {reason}, and {part.name} cannot fail"
        yield survey.fault(
            spec, message, "give a number of cycles or a 'while', or add a Timeout", code="P321", at=at
        )
        return
    if not isinstance(condition, Expression) or constant is not None or context.beside:
        return
    if not changes_of((part,), survey.mission.trees).decides(condition):
        message = f"nothing in {part.name} changes '{condition}': once begun, the loop never ends"
        yield survey.fault(spec, message, "give a number of cycles, too", code="P322", at="while")


def unbounded_recovery(survey: LintModel) -> Iterator[Diagnostic]:
    """P325: a loop repeats while items are left, and passes over their failures."""
    for spec, _ in _unhalted_nodes(survey, Repeat):
        condition = survey.walk.literal(spec, "while")
        if survey.walk.number(spec, "num_cycles") != -1 or not isinstance(condition, Expression):
            continue
        below = tuple(_with_descendants(spec.children[0], survey))
        loops = (s for s in below if s.node is not None and issubclass(s.node, ForEach))
        passing = next((s for s in loops if survey.walk.literal(s, "on_failure") == "continue"), None)
        if passing is None or not _ITEM_FACTS & condition.names:
            continue
        flows = (s.node.declaration.flow for s in below if s.node is not None)
        if not any(isinstance(flow, control_flow.LeafFlow) and flow.gives_up for flow in flows):
            message = f"{passing.name} passes over failed items, and '{condition}' still holds: an item that "
            message += "cannot be taken keeps the loop running for ever"
            yield survey.fault(
                spec, message, "give a number of cycles, or use SetAside", code="P325", at="while"
            )


_ITEM_FACTS = frozenset(("items_left", "items_to_do"))


def is_steady(node: type[Node]) -> bool:
    """Whether it takes no time of its own, and depends on keys and facts alone."""
    return node.declaration.flow is not None and node.declaration.flow.steady


def _with_descendants(spec: NodeSpec, survey: LintModel) -> Iterator[NodeSpec]:
    """Yield the node and all its descendants, in sub-trees, too."""
    seen: set[str] = set()
    todo = [spec]
    while todo:
        for each in todo.pop().iterate():
            yield each
            if each.node is None and each.id not in seen:
                seen.add(each.id)
                todo.append(survey.mission.trees[each.id].root)


def vain_attempts(survey: LintModel) -> Iterator[Diagnostic]:
    """P323: a retry of a node that fails every time."""
    trees, found = survey.mission.trees, set[int]()
    for spec, context in contexts(survey):
        if context.beside or id(spec) in found:
            continue
        tried, cures = _attempts(survey, spec)
        if tried is None or not survey.ends(tried).fails_surely:
            continue
        if is_constant(tried, trees, changes_of(cures, trees)):
            found.add(id(spec))
            message = f"another attempt changes nothing: {tried.name} gives the same result each time"
            hint = "put a node that acts, or a Delay, between two attempts"
            yield survey.fault(spec, message, hint, code="P323")


def _attempts(survey: LintModel, spec: NodeSpec) -> tuple[NodeSpec | None, tuple[NodeSpec, ...]]:
    """Return the child that a node tries several times, and the children that it runs in between."""
    flow = spec.node.declaration.flow if spec.node is not None else None
    if not isinstance(flow, control_flow.Loop | control_flow.Recovery) or (
        isinstance(flow, control_flow.Loop) and flow.failure is not control_flow.AGAIN
    ):
        return None, ()
    runs = survey.walk.number(spec, flow.runs)
    once = (
        runs is not None and 0 <= runs + (isinstance(flow, control_flow.Recovery) and flow.first_is_free) <= 1
    )
    return (None, ()) if once else (spec.children[0], spec.children[1:])
