"""Inverter, ForceSuccess, ForceFailure: decorators that change the child's status."""

from __future__ import annotations

from ..flow import FAILURE, SUCCESS, ChildFlow
from ..status import NodeStatus
from ..values.failure_reports import cannot_be_hidden
from .decorator import Decorator


class Inverter(Decorator):
    """SUCCESS becomes FAILURE without a report, and FAILURE becomes SUCCESS, unless it is a safety stop."""

    flow = ChildFlow(success=FAILURE, failure=SUCCESS)
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


class ForceSuccess(Decorator):
    """SUCCESS however the child ends. It cannot hide a safety stop (safety.*) or a fault of the program."""

    flow = ChildFlow(failure=SUCCESS)
    example = """
    ForceSuccess:
      GoTo: {pose: observe}
    """

    def on_tick(self) -> NodeStatus:
        state = self.relay()
        if state is NodeStatus.FAILURE and not cannot_be_hidden(self.body.failure):
            return NodeStatus.SUCCESS
        return state


class ForceFailure(Decorator):
    """FAILURE however the child ends, with the child's failure when it has one."""

    flow = ChildFlow(success=FAILURE)
    example = """
    Fallback:
      - Grasp: {object: "{item}"}
      - ForceFailure:
          Log: {message: could not be grasped, value: "{item}"}
    """

    def on_tick(self) -> NodeStatus:
        state = self.relay()
        return NodeStatus.FAILURE if state is NodeStatus.SUCCESS else state
