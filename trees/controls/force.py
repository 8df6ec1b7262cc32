"""Inverter, ForceSuccess, ForceFailure: decorators that change the child's status."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..flow import NO_REPORT, FlowState, NodeOutcomes, OutcomeCollector
from ..status import NodeStatus
from ..values.failure_reports import cannot_be_hidden
from .decorator import Decorator

if TYPE_CHECKING:
    from ..flow.flow_walk import FlowAnalysis
    from ..mission import NodeSpec


class Inverter(Decorator):
    """SUCCESS becomes FAILURE without a report, and FAILURE becomes SUCCESS, unless it is a safety stop."""

    by_turns = True
    steady = True

    example = """
    Inverter:
      Condition: {if: holding}
    """

    def on_tick(self) -> NodeStatus:
        match self.body.step():
            case NodeStatus.SUCCESS:
                return NodeStatus.FAILURE
            case NodeStatus.FAILURE if cannot_be_hidden(self.body.failure):
                return self.fail_with(self.body.failure)
            case NodeStatus.FAILURE:
                return NodeStatus.SUCCESS
            case other:
                return other

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        flow, ends = walk.child(spec.children[0], (entry,)), OutcomeCollector()
        _hide_failures(flow, walk, ends)
        ends.fail(dict.fromkeys(flow.success, NO_REPORT))
        return ends.flow()


class ForceSuccess(Decorator):
    """SUCCESS however the child ends. It cannot hide a safety stop (safety.*) or a fault of the program."""

    by_turns = True
    steady = True

    example = """
    ForceSuccess:
      GoTo: {pose: observe}
    """

    def on_tick(self) -> NodeStatus:
        state = self.relay()
        if state is NodeStatus.FAILURE and not cannot_be_hidden(self.body.failure):
            return NodeStatus.SUCCESS
        return state

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        flow, ends = walk.child(spec.children[0], (entry,)), OutcomeCollector()
        _hide_failures(flow, walk, ends)
        ends.succeed(flow.success)
        return ends.flow()


class ForceFailure(Decorator):
    """FAILURE however the child ends, with the child's failure when it has one."""

    by_turns = True
    steady = True

    example = """
    Fallback:
      - Grasp: {object: "{item}"}
      - ForceFailure:
          Log: {message: could not be grasped, value: "{item}"}
    """

    def on_tick(self) -> NodeStatus:
        state = self.relay()
        return NodeStatus.FAILURE if state is NodeStatus.SUCCESS else state

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        flow, ends = walk.child(spec.children[0], (entry,)), OutcomeCollector()
        ends.fail(flow.failure)
        ends.fail(dict.fromkeys(flow.success, NO_REPORT))
        ends.skip(flow.skipped)
        ends.run(flow.running)
        return ends.flow()


def _hide_failures(flow: NodeOutcomes, walk: FlowAnalysis, ends: OutcomeCollector) -> None:
    """Collect the outcomes of a child other than success, with failures turned into successes where
    allowed."""
    for state, reasons in flow.failure.items():
        ends.fail_at(state, reasons.only(walk.unhidable))
        if hidden := reasons.only(~walk.unhidable).any:
            ends.succeed((state if reasons.loud & hidden else state.in_doubt(),))
    ends.skip(flow.skipped)
    ends.run(flow.running)
