"""Sequence, Fallback, their reactive forms, and Nav2's RoundRobin: children one after the other."""

from __future__ import annotations

from typing import cast

from ...world.causes import tree
from ..failure_reports import decisive_report
from ..flow import NEXT, ChildFlow, Pipeline, Resumed, Turns
from ..node import ControlNode
from ..ports import In, children, port
from ..status import NodeStatus


class OrderedNode(ControlNode, abstract=True):
    """Node that ticks its children in order, as its `flow` says; goes on with the child that was RUNNING."""

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
    """Node that ticks its children anew at each tick, from the first."""

    remembers = positions = ()
    counted = ()

    def on_tick(self) -> NodeStatus:
        self.on_start()
        state = super().on_tick()
        for later in self.parts[self._index + 1 :]:
            later.halt()
        return state


class Sequence(OrderedNode):
    """Ticks its children in order until one fails; goes on with the child that was RUNNING.

    SUCCESS when all succeeded (skipped ones do not count), SKIPPED when all were skipped. It fails with the
    failure of its failing child.
    """

    flow = ChildFlow(success=NEXT, skipped=NEXT)
    example = """
    Sequence:
      - Grasp: {object: "{item}"}
      - Place: {object: "{item}", into: "{item.destination}"}
    """

    parts = children("what is done, in this order")


class SequenceWithMemory(OrderedNode):
    """A Sequence that goes on with the child that failed or was halted, also when it is started again.

    Children before that one are not ticked again until all have succeeded. SKIPPED when all were skipped in
    one go.
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

    parts = children("what is done, in this order")

    def on_start(self) -> None:
        self._skipped = 0

    def on_tick(self) -> NodeStatus:
        state = super().on_tick()
        if self._index == len(self.parts):
            self._index = 0
        return state


class PipelineSequence(OrderedNode):
    """Ticks its children again at each tick, from the first to the furthest that has run, as Nav2's.

    A child that runs again does not hold up those behind it that have begun. It ends when a child fails, or
    when the last has succeeded; what still runs is then halted. SKIPPED when all were skipped.
    """

    flow = Pipeline(success=NEXT, skipped=NEXT, reactive=True)
    example = """
    PipelineSequence:
      - RateController:
          hz: 0.5
          do: {Observe: {camera: overhead, objects: "{items}"}}
      - GoTo: {pose: home}
    """

    parts = children("what is done, in this order, each again while the later ones run")

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
    """Asks every child anew at each tick, from the first: conditions first, then what they guard.

    When an earlier child runs or fails, a later one that was RUNNING is halted, after the earlier was ticked.
    """

    flow = ChildFlow(success=NEXT, skipped=NEXT, reactive=True)
    example = """
    ReactiveSequence:
      - Condition: {if: not stopped}
      - GoTo: {pose: home}
    """

    parts = children("the conditions, then what they guard")


class Fallback(OrderedNode):
    """Ticks its children in order until one succeeds; goes on with the child that was RUNNING.

    When none succeeds it fails with the last child's failure, the others' attached. A child without a report
    (a false condition) does not hide one that has. SKIPPED when all were skipped.
    """

    flow = ChildFlow(failure=NEXT, skipped=NEXT)
    example = """
    Fallback:
      - Place: {object: "{item}", into: red_bin}
      - SafeRetreat: {hand: open}
    """

    parts = children("what is tried, in this order")


class ReactiveFallback(ReactiveNode):
    """Tries every child anew at each tick, from the first.

    When an earlier child runs or succeeds, a later one that was RUNNING is halted, after the earlier was
    ticked. Both hold the arm for a moment, and the one that acquired it last keeps it.
    """

    flow = ChildFlow(failure=NEXT, skipped=NEXT, reactive=True)
    example = """
    ReactiveFallback:
      - Condition: {if: not holding}
      - SafeRetreat: {hand: open}
    """

    parts = children("what is tried, the most wanted first")


class RoundRobin(ControlNode):
    """Ticks its children in turn, and begins each time after the child that succeeded last, as Nav2's.

    A child that fails or is skipped passes the turn on, in the same tick. It fails when all have failed, and,
    unless it may `wrap_around`, when the last child has had its turn and did not succeed. Whose turn it is
    outlasts success; failure and being halted give it back to the first child. As handler of a `Recover` it
    tries another cure at each failure.
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

    parts = children("what takes turns")
    wrap_around: In[bool] = port("after the last child it is the first one's turn again", default=False)
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
