"""Recover: a branch, and for each cause in which it can end what may cure it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..trees.node import Node
from ..trees.ports import In, Out, port
from ..trees.slots import child, optional_child, table
from ..trees.values.port_values import Given
from ..world.causes import FailureReport, internal, matches
from .recovery_base import Recovering
from .recovery_flow import Cure, Recovery

if TYPE_CHECKING:
    from ..trees.flow.flow_walk import Walk
    from ..trees.mission import NodeSpec


class Recover(Recovering):
    """Runs `do`; when it fails, runs the handler of the cause, then `do` again, at most `attempts` times.

    The first pattern of `when` that matches the cause is used, in the order of the file, else `otherwise`;
    a cause without a handler fails at once. A handler that fails ends the node with the original cause, the
    handler's attached. When all attempts are used up, `give_up` is run, so that the arm is left in a state
    from which others can go on, and the node fails with the last cause, the earlier ones attached.
    A fault of the program is handled only where `when` names it: `internal.error`. `do`, the handlers and
    `give_up` read from the outputs which attempt it is and what is being handled. The tick ends between a
    handler and the next attempt.
    """

    example = """
    Recover:
      attempts: 3
      do: {Grasp: {object: "{item}"}}
      when:
        grasp.missed: [SafeRetreat, {Observe: {camera: overhead}}]
        control.*: SafeRetreat
      otherwise: SafeRetreat
      give_up: {SafeRetreat: {hand: open}}
    """

    attempts: In[int] = port("how often `do` may run", default=3, least=1)
    attempt: Out[int] = port("number of the attempt that runs, or failed last: 1, 2, …")
    cause: Out[str] = port("cause of the failure that is being handled; empty before the first")
    message: Out[str] = port("its sentence")
    failed: Out[str] = port("path of the node that it comes from")
    body = child("what is to succeed")
    handlers = table("cause, or family of causes, and what may cure it", key="when", of="cause")
    otherwise = optional_child("what may cure all other causes", key="otherwise")
    last_resort = optional_child("what is done before failing for good", key="give_up")

    @classmethod
    def check_ports(cls, given: Given) -> tuple[str, ...]:
        if not given.any_of("when", "otherwise"):
            return ("without `when` or `otherwise` nothing is recovered; use RetryUntilSuccessful to retry",)
        return ()

    def tried(self) -> Node:
        return self.body

    def most_runs(self) -> int:
        return self.attempts

    def cure_of(self, report: FailureReport) -> str:
        for pattern in self.handlers:
            if matches(pattern, report.cause):
                return pattern
        # A fault of the program is not to be handled by accident.
        if self.otherwise is None or matches(str(internal.ANY), report.cause):
            return ""
        return _OTHERWISE

    def cure(self, label: str) -> Node:
        if label == _OTHERWISE and self.otherwise is not None:
            return self.otherwise
        return self.handlers[label]

    def resort(self) -> Node | None:
        return self.last_resort

    @classmethod
    def recovery(cls, spec: NodeSpec, walk: Walk) -> Recovery:
        cures = [Cure(label, label, part) for label, part in spec.slots.get("when", ())]
        cures += (Cure(_OTHERWISE, "*", part) for _, part in spec.slots.get("otherwise", ()))
        resort = next((part for _, part in spec.slots.get("give_up", ())), None)
        tried = spec.slots["do"][0][1]
        return Recovery(tried, tuple(cures), resort, walk.number(spec, "attempts"))


_OTHERWISE = "otherwise"
