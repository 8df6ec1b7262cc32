"""Inverter, ForceSuccess, ForceFailure: what a child's answer means."""

from __future__ import annotations

from ..reports import cannot_be_hidden
from ..status import NodeStatus
from .decorator import Decorator


class Inverter(Decorator):
    """SUCCESS becomes FAILURE without a report, and FAILURE becomes SUCCESS, unless it is a safety stop."""

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

    def on_tick(self) -> NodeStatus:
        state = self.relay()
        if state is NodeStatus.FAILURE and not cannot_be_hidden(self.body.failure):
            return NodeStatus.SUCCESS
        return state


class ForceFailure(Decorator):
    """FAILURE however the child ends, with the child's failure when it has one."""

    def on_tick(self) -> NodeStatus:
        state = self.relay()
        return NodeStatus.FAILURE if state is NodeStatus.SUCCESS else state
