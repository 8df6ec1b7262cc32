"""Control nodes with several children: in sequence, as fallbacks, reactive, asynchronous, parallel, or
one branch selected by a value. `NODES` lists all nodes of the language itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, cast

from picktree.world import Failure, FailureReport, tree

from .control_flow import (
    NEXT,
    AtOnce,
    Branch,
    ChildFlow,
    Choice,
    CleanUp,
    NodeStatus,
    Pipeline,
    Resumed,
    Turns,
)
from .decorators import (
    Delay,
    ForceFailure,
    ForceSuccess,
    ForEach,
    Inverter,
    KeepRunningUntilFailure,
    RateController,
    Repeat,
    RetryUntilSuccessful,
    RunOnce,
    SkipUnlessUpdated,
    Timeout,
    WaitValueUpdate,
    WasEntryUpdated,
)
from .failure_reports import decisive_report, with_attached
from .leaves import AlwaysFailure, AlwaysSuccess, Condition, Log, Script, SetBlackboard, Sleep
from .node import ControlNode, Node
from .port_types import PortProblem, PortValues, show
from .ports import In, children, optional_child, port, table


class OrderedNode(ControlNode, abstract=True):
    """Node that ticks its children in the order of its `flow` and resumes at the child that was RUNNING."""

    parts = children("the children, in this order")
    remembers = ("_index", "_skipped")
    positions = ("_index",)
    counted = (NodeStatus.SKIPPED,)
    _index: int = 0
    _skipped: int = 0

    def on_start(self) -> None:
        self._index = self._skipped = 0

    def on_tick(self) -> NodeStatus:
        flow = cast("ChildFlow", self.flow)
        while self._index < len(self.parts):
            part = self.parts[self._index]
            state = part.step()
            if flow.of(state) is not NEXT:
                return self.fail_with(part.failure) if state is NodeStatus.FAILURE else state
            self._skipped += state is NodeStatus.SKIPPED
            self._index += 1
        return self.past_the_last(flow)

    def past_the_last(self, flow: ChildFlow) -> NodeStatus:
        """Return the status of the node when all children have led on."""
        if self._skipped == len(self.parts):
            return NodeStatus.SKIPPED
        if flow.success is NEXT:
            return NodeStatus.SUCCESS
        return self.fail_with(decisive_report(part.failure for part in self.parts))


class ReactiveNode(OrderedNode, abstract=True):
    """Node that ticks its children again at each tick, from the first."""

    remembers = positions = ()
    counted = ()

    def on_tick(self) -> NodeStatus:
        self.on_start()
        state = super().on_tick()
        for later in self.parts[self._index + 1 :]:
            later.halt()
        return state


class Sequence(OrderedNode):
    """Ticks its children in order until one fails; resumes at the child that was RUNNING.

    SUCCESS when all succeeded (skipped ones do not count), SKIPPED when all were skipped. It fails with the
    failure of its failing child.
    """

    flow = ChildFlow(success=NEXT, skipped=NEXT)
    example = """
    Sequence:
      - Grasp: {object: "{item}"}
      - Place: {object: "{item}", into: "{item.destination}"}
    """

    parts = children("the steps, in this order")


class SequenceWithMemory(OrderedNode):
    """A Sequence that resumes at the child that failed or was halted, also after a new start.

    Children before that one are not ticked again until all have succeeded. SKIPPED when all were skipped in
    one activation.
    """

    flow = Resumed(success=NEXT, skipped=NEXT)
    example = """
    RetryUntilSuccessful:
      num_attempts: 3
      do:
        SequenceWithMemory:
          - Observe: {camera: overhead, objects: "{items}"}
          - Grasp: {object: "{item}"}
    """

    parts = children("the steps, in this order")

    def on_start(self) -> None:
        self._skipped = 0

    def on_tick(self) -> NodeStatus:
        state = super().on_tick()
        if self._index == len(self.parts):
            self._index = 0
        return state


class PipelineSequence(OrderedNode):
    """Ticks its children again at each tick, from the first to the furthest that has run, as in Nav2.

    A child that runs again does not delay later children that have begun. It ends when a child fails, or when
    the last child has succeeded; children that still run are then halted. SKIPPED when all were skipped.
    """

    flow = Pipeline(success=NEXT, skipped=NEXT, reactive=True)
    example = """
    PipelineSequence:
      - RateController:
          hz: 0.5
          do: {Observe: {camera: overhead, objects: "{items}"}}
      - GoTo: {pose: home}
    """

    parts = children("the steps, in this order; each is ticked again while the later ones run")

    def on_tick(self) -> NodeStatus:
        skipped = 0
        for index, part in enumerate(self.parts):
            state = part.step(kept=True)
            if state is NodeStatus.FAILURE:
                return self.fail_with(part.failure)
            if state is NodeStatus.RUNNING and index >= self._index:
                self._index = index
                return state
            skipped += state is NodeStatus.SKIPPED
        return NodeStatus.SKIPPED if skipped == len(self.parts) else NodeStatus.SUCCESS


class ReactiveSequence(ReactiveNode):
    """Ticks every child again at each tick, from the first: conditions first, then the guarded child.

    When an earlier child runs or fails, a later child that was RUNNING is halted. The earlier child is ticked
    before this halt.
    """

    flow = ChildFlow(success=NEXT, skipped=NEXT, reactive=True)
    example = """
    ReactiveSequence:
      - Condition: {if: not stopped}
      - GoTo: {pose: home}
    """

    parts = children("the conditions, then the guarded child")


class Fallback(OrderedNode):
    """Ticks its children in order until one succeeds; resumes at the child that was RUNNING.

    When none succeeds, it fails with the last child's failure and attaches the failures of the others. A
    child without a report (a false condition) does not hide the report of another. SKIPPED when all were
    skipped.
    """

    flow = ChildFlow(failure=NEXT, skipped=NEXT)
    example = """
    Fallback:
      - Place: {object: "{item}", into: red_bin}
      - SafeRetreat: {hand: open}
    """

    parts = children("the alternatives, in this order")


class ReactiveFallback(ReactiveNode):
    """Ticks every child again at each tick, from the first.

    When an earlier child runs or succeeds, a later child that was RUNNING is halted. The earlier child is
    ticked before this halt. So both hold the arm for a moment; the child that acquired it last keeps it.
    """

    flow = ChildFlow(failure=NEXT, skipped=NEXT, reactive=True)
    example = """
    ReactiveFallback:
      - Condition: {if: not holding}
      - SafeRetreat: {hand: open}
    """

    parts = children("the alternatives, the preferred one first")


class RoundRobin(ControlNode):
    """Ticks its children in turn, and starts each time after the child that succeeded last, as in Nav2.

    After a child that fails or is skipped, the next child runs in the same tick. The node fails when all have
    failed. Without `wrap_around` it also fails when the last child has failed, and once after the last child
    has succeeded. After a failure or a halt of the node the first child is next. As handler of a `Recover`
    the node tries another cure at each failure.
    """

    flow = Turns(failure=NEXT, skipped=NEXT, wraps="wrap_around")
    example = """
    Recover:
      attempts: 5
      do: {Grasp: {object: "{item}"}}
      when:
        grasp.*:
          RoundRobin:
            wrap_around: true
            do:
              - Observe: {camera: overhead}
              - SafeRetreat: {pose: observe}
    """

    parts = children("the children that take turns")
    wrap_around: In[bool] = port("whether the first child follows the last one", default=False)
    causes = (tree.ATTEMPTS,)
    remembers = ("_turn", "_failed")
    positions = ("_turn",)
    counted = (NodeStatus.FAILURE,)
    _turn: int = 0
    _failed: int = 0

    def on_tick(self) -> NodeStatus:
        skipped = 0
        while self._failed + skipped < len(self.parts):
            if self._turn == len(self.parts):
                if not self.wrap_around:
                    break
                self._turn = 0
            state = self.parts[self._turn].step()
            if state is NodeStatus.RUNNING:
                return state
            self._turn += 1
            match state:
                case NodeStatus.FAILURE:
                    self._failed += 1
                case NodeStatus.SKIPPED:
                    skipped += 1
                case _:
                    self._failed = 0
                    return state
        return self._give_up(skipped)

    def on_halt(self) -> None:
        self._turn = self._failed = 0

    def _give_up(self, skipped: int) -> NodeStatus:
        in_turn = (*self.parts[self._turn :], *self.parts[: self._turn])
        nobody_asked = self._failed + skipped == 0
        self._turn = self._failed = 0
        if nobody_asked:
            return self.fail(tree.ATTEMPTS, "every child has had its turn")
        if skipped == len(self.parts):
            return NodeStatus.SKIPPED
        return self.fail_with(decisive_report(part.failure for part in in_turn))


class _AsyncNode(OrderedNode, abstract=True):
    """Node whose tick ends after a child that ended in its first tick, so that it can be halted there."""

    def on_tick(self) -> NodeStatus:
        flow = cast("ChildFlow", self.flow)
        while self._index < len(self.parts):
            part = self.parts[self._index]
            fresh = part.state is NodeStatus.IDLE
            state = part.step()
            if flow.of(state) is not NEXT:
                return self.fail_with(part.failure) if state is NodeStatus.FAILURE else state
            self._skipped += state is NodeStatus.SKIPPED
            self._index += 1
            if fresh and state is not NodeStatus.SKIPPED and self._index < len(self.parts):
                return NodeStatus.RUNNING
        return self.past_the_last(flow)


class AsyncSequence(_AsyncNode):
    """A Sequence that ends the tick after a child that succeeds in its first tick; it can be halted there."""

    flow = ChildFlow(success=NEXT, skipped=NEXT, pauses=True)
    example = """
    AsyncSequence:
      - Log: {message: first}
      - Log: {message: in the next tick}
    """

    parts = children("the steps, in this order")


class AsyncFallback(_AsyncNode):
    """A Fallback that ends the tick after a child that fails in its first tick; it can be halted there."""

    flow = ChildFlow(failure=NEXT, skipped=NEXT, pauses=True)
    example = """
    AsyncFallback:
      - Condition: {if: holding}
      - GoTo: {pose: home}
    """

    parts = children("the alternatives, in this order")


class TryCatch(ControlNode):
    """A Sequence of all children but the last; when one fails, the last child runs, and the node then fails.

    It fails with the failure of the child that failed, however the last child ends. With `catch_on_halt` a
    halt also ticks the last child, once; that child must end in one tick and move nothing.
    """

    flow = CleanUp(success=NEXT, skipped=NEXT, on_halt="catch_on_halt")
    example = """
    TryCatch:
      catch_on_halt: true
      do:
        - GoTo: {pose: observe}
        - GoTo: {pose: home}
        - Log: {message: it has not come home}
    """

    parts = children("the children in this order; the last one cleans up", least=2)
    catch_on_halt: In[bool] = port("whether a halt ticks the last child, too", default=False)
    remembers = ("_index", "_skipped", "_catching", "_reports")
    positions = ("_index",)
    counted = (NodeStatus.SKIPPED,)
    _index: int = 0
    _skipped: int = 0
    _catching: bool = False
    _reports: tuple[FailureReport, ...] = ()

    def on_start(self) -> None:
        self._index = self._skipped = 0
        self._catching = False
        self._reports = ()

    def on_tick(self) -> NodeStatus:
        last = len(self.parts) - 1
        while not self._catching and self._index < last:
            part = self.parts[self._index]
            match part.step():
                case NodeStatus.RUNNING:
                    return NodeStatus.RUNNING
                case NodeStatus.FAILURE:
                    self._catching = True
                    self._reports = (part.failure,) if part.failure is not None else ()
                case state:
                    self._skipped += state is NodeStatus.SKIPPED
                    self._index += 1
        if not self._catching:
            return NodeStatus.SKIPPED if self._skipped == last else NodeStatus.SUCCESS
        if self.parts[last].step() is NodeStatus.RUNNING:
            return NodeStatus.RUNNING
        failed, cleaning = next(iter(self._reports), None), self.parts[last].failure
        if failed is not None and cleaning is not None:
            failed = with_attached(failed, (cleaning,))
        return self.fail_with(failed or cleaning)

    def on_halt(self) -> None:
        """Tick the last child, where the file wants it: once, as BehaviorTree.CPP does."""
        if self.catch_on_halt and not self._catching:
            for part in self.parts[:-1]:
                part.halt()
            if self.parts[-1].step() is NodeStatus.RUNNING:
                self.parts[-1].halt()


class ParallelNode(ControlNode, abstract=True):
    """Node that ticks all children that have not ended, in order, in each tick."""

    parts = children("the steps that run at the same time")
    counts: ClassVar[tuple[str, ...]] = ()
    """Inputs with a number of children."""
    remembers = ("_ended", "_succeeded", "_failed", "_reports")
    positions = ("_ended",)
    _ended: tuple[int, ...] = ()
    _succeeded: int = 0
    _failed: int = 0
    _reports: tuple[FailureReport, ...] = ()

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        total = len(given.labels.get("do", ()))
        wrong = [
            PortProblem(
                key, f"{count:g} of {total} children cannot be counted", f"1 to {total}, or -1 to -{total}"
            )
            for key in cls.counts
            if (count := given.number(key)) is not None and not 1 <= abs(count) <= total
        ]
        return tuple(wrong) if total else ()

    def on_start(self) -> None:
        self._ended, self._reports = (), ()
        self._succeeded = self._failed = 0

    def tick_parts(self) -> Iterator[int]:
        """Tick the children that have not ended; yield the number of skipped ones after each."""
        skipped = 0
        for index, part in enumerate(self.parts):
            if index in self._ended:
                continue
            match part.step():
                case NodeStatus.SUCCESS:
                    self._ended += (index,)
                    self._succeeded += 1
                case NodeStatus.FAILURE:
                    self._ended += (index,)
                    self._failed += 1
                    self._reports += (part.failure,) if part.failure else ()
                case NodeStatus.SKIPPED:
                    skipped += 1
                case _:
                    pass
            yield skipped

    def resolve_counts(self, *numbers: int) -> tuple[int, ...]:
        """Return numbers of children; one below zero counts from the end. Raises Failure for too many."""
        total = len(self.parts)
        meant = tuple(counted(number, total) for number in numbers)
        if max(meant) > total:
            message = f"{max(meant)} of {total} children are wanted"
            raise Failure(
                tree.MISSING_INPUT, message, **dict(zip(self.counts, meant, strict=True)), children=total
            )
        return meant

    def fail_with_reports(self) -> NodeStatus:
        """Fail with the first failure, the others' attached."""
        first = self._reports[0] if self._reports else None
        return self.fail_with(with_attached(first, self._reports[1:]) if first else None)


class Parallel(ParallelNode):
    """Ticks all children that have not ended, in order, in each tick.

    A number below zero counts from the end: -1 is all children, -2 all but one. The node fails with the first
    failure and attaches the others. Children that still run at its end are halted. SKIPPED when all were
    skipped.
    """

    flow = AtOnce(wanted="success_count", tolerated="failure_count")
    example = """
    Parallel:
      - GoTo: {pose: observe}
      - OpenGripper
    """

    success_count: In[int] = port(
        "number of children that must succeed; -1 for all, -2 for all but one", default=-1
    )
    failure_count: In[int] = port(
        "number of failures at which the node fails; -1 for all children", default=1
    )
    counts = ("success_count", "failure_count")

    def on_tick(self) -> NodeStatus:
        total = len(self.parts)
        wanted, tolerated = self.resolve_counts(self.success_count, self.failure_count)
        skipped = 0
        for skipped in self.tick_parts():
            # As in BT.CPP: with a number that counts from the end, skipped children need not succeed.
            spared = skipped if self.success_count < 0 and skipped < total else 0
            if self._succeeded + spared >= wanted:
                return NodeStatus.SUCCESS
            if total - self._failed < wanted or self._failed >= tolerated:
                return self.fail_with_reports()
        return NodeStatus.SKIPPED if skipped == total else NodeStatus.RUNNING


class ParallelAll(ParallelNode):
    """Ticks all children in each tick until every one has ended, independent of the results of others.

    It then fails when `max_failures` children or more have failed. It fails with the first failure and
    attaches the others. A skipped child needs no end. SKIPPED when all were skipped.
    """

    flow = AtOnce(tolerated="max_failures", waits=True)
    example = """
    ParallelAll:
      max_failures: 2
      do:
        - GoTo: {pose: observe}
        - Observe: {camera: overhead, objects: "{items}"}
    """

    max_failures: In[int] = port(
        "number of failures at which the node fails; -1 for all children, -2 for all but one", default=1
    )
    counts = ("max_failures",)

    def on_tick(self) -> NodeStatus:
        total = len(self.parts)
        (tolerated,) = self.resolve_counts(self.max_failures)
        *_, skipped = (0, *self.tick_parts())
        if skipped == total:
            return NodeStatus.SKIPPED
        if skipped + len(self._ended) < total:
            return NodeStatus.RUNNING
        return self.fail_with_reports() if self._failed >= tolerated else NodeStatus.SUCCESS


def counted(number: int, total: int) -> int:
    """Return the number of children meant: a number below zero counts from the end."""
    return max(0, total + number + 1) if number < 0 else number


class BranchNode(ControlNode, abstract=True):
    """Node whose first child selects the next one by its result; reactive: again at each tick."""

    parts = children("the condition, the child for true, the child for false", least=2, most=3)
    remembers = ("_chosen",)
    positions = ("_chosen",)
    _chosen: int = 0

    def on_start(self) -> None:
        self._chosen = 0

    def on_tick(self) -> NodeStatus:
        condition = self.parts[0]
        if self._chosen == 0 or cast("Branch", self.flow).reactive:
            answer = condition.step(kept=True)
            if answer not in (NodeStatus.SUCCESS, NodeStatus.FAILURE):
                return answer
            self._chosen = 1 if answer is NodeStatus.SUCCESS else 2
            for index, part in enumerate(self.parts):
                if index not in (0, self._chosen):
                    part.halt()
        if self._chosen == len(self.parts):
            return self.fail_with(condition.failure)
        return self.result_of(self.parts[self._chosen])


class IfThenElse(BranchNode):
    """Ticks its first child until it ends; then ticks the second after SUCCESS, the third after FAILURE.

    Without a third child, FAILURE of the first is FAILURE of the node. SKIPPED when the condition is skipped.
    """

    flow = Branch()
    example = """
    IfThenElse:
      - Condition: {if: holding}
      - SafeRetreat: {hand: open}
      - GoTo: {pose: home}
    """

    parts = children(
        "the condition, the child for true, the child for false",
        least=2,
        most=3,
        labels=("if", "then", "else"),
    )


class WhileDoElse(BranchNode):
    """Ticks its first child at every tick, then the second while the first succeeds, the third while it
    fails.

    It is not a loop: it ends when the ticked child ends. As in BT.CPP the branch that is left is halted
    before the other is ticked. Without a third child, FAILURE of the first is FAILURE of the node.
    """

    flow = Branch(reactive=True)
    example = """
    WhileDoElse:
      - Condition: {if: items_left}
      - Observe: {camera: overhead, objects: "{items}"}
      - GoTo: {pose: rest}
    """

    parts = children(
        "the condition, the child while it is true, the child while it is false",
        least=2,
        most=3,
        labels=("while", "do", "else"),
    )
    remembers = positions = ()


class Switch(ControlNode):
    """Ticks the case whose name is the value of `variable`, else `default`.

    The value is read at every tick; when it changes, the case that was RUNNING is halted before the other is
    ticked, as in BT.CPP. Without a case and a default it fails with tree.no_case.
    """

    flow = Choice(reactive=True)
    example = """
    Switch:
      variable: "{item.form}"
      cases:
        plate: {Grasp: {object: "{item}", force: 15 N}}
        sphere: {Grasp: {object: "{item}", speed: 0.5}}
      default: {Grasp: {object: "{item}"}}
    """

    variable: In[object] = port("the value to match; it is read at every tick")
    cases = table("child for each value", key="cases", required=True, matches="variable")
    default = optional_child("child for all other values", key="default")
    causes = (tree.NO_CASE,)

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        seen: dict[object, str] = {}
        wrong: list[PortProblem] = []
        for name in given.labels.get("cases", ()):
            value = _value_of(name)
            if value in seen:
                wrong.append(
                    PortProblem(f"cases/{name}", f"the cases {seen[value]!r} and {name!r} are the same value")
                )
            seen.setdefault(value, name)
        return tuple(wrong)

    def on_tick(self) -> NodeStatus:
        self.read_inputs()
        fitting = (node for name, node in self.cases.items() if is_case(self.variable, name))
        chosen = next(fitting, self.default)
        if chosen is None:
            raise Failure(
                tree.NO_CASE,
                f"no case for {show(self.variable)}, and no default",
                value=str(self.variable),
                cases=list(self.cases),
            )
        for other in self.below:
            if other is not chosen:
                other.halt()
        return self.result_of(chosen)


def _value_of(name: str) -> object:
    """Return the number in a case's name, else the name; equal results are selected by the same values."""
    try:
        return float(name)
    except ValueError:
        return name


def is_case(value: object, name: str) -> bool:
    """Whether the case of that name is the one for the value."""
    if isinstance(value, bool):
        return name == str(value).lower()
    if isinstance(value, int | float):
        try:
            return float(name) == value
        except ValueError:
            return False
    return name == ("null" if value is None else str(value))


NODES: tuple[type[Node], ...] = (
    Sequence, SequenceWithMemory, Fallback, ReactiveSequence, ReactiveFallback, PipelineSequence, RoundRobin,
    AsyncSequence, AsyncFallback, TryCatch,
    Parallel, ParallelAll,
    IfThenElse, WhileDoElse, Switch, ForEach,
    Inverter, ForceSuccess, ForceFailure, Repeat, KeepRunningUntilFailure, RetryUntilSuccessful,
    Timeout, Delay, RateController, RunOnce, SkipUnlessUpdated, WaitValueUpdate,
    AlwaysSuccess, AlwaysFailure, Condition, WasEntryUpdated, SetBlackboard, Script, Log, Sleep,
)  # fmt: skip
