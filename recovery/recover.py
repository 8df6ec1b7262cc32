"""Recover, RecoveryNode and ForAttempt: run a branch, handle its failures by cause, and repeat it."""

from __future__ import annotations

from ..trees.flow import FAILURE, LeafFlow, Recovery
from ..trees.node import Node
from ..trees.ports import In, Out, port
from ..trees.slots import child, children, optional_child, table
from ..trees.status import NodeStatus
from ..trees.values.port_types import PortProblem, PortValues
from ..world.causes import FailureReport, internal, matches
from .recovery_base import RecoveryControl


class RecoveryNode(RecoveryControl):
    """Runs its first child; when it fails, runs the second, then the first again, as Nav2's.

    The first child runs once more than `number_of_retries`. When the second child fails or is skipped, the
    node fails with the first one's cause, the second one's attached. When all retries are used up, it fails
    with the last cause, the earlier ones attached. SKIPPED when the first child is. The tick ends between the
    two. `Recover` chooses the handler by the cause.
    """

    flow = Recovery(runs="number_of_retries", first_is_free=True, skipped_handler=FAILURE)
    example = """
    RecoveryNode:
      number_of_retries: 2
      do:
        - Grasp: {object: "{item}"}
        - Observe: {camera: overhead}
    """

    parts = children(
        "what is to succeed, and what may cure its failure", least=2, most=2, labels=("", "recovery")
    )
    number_of_retries: In[int] = port("how often the second child may run", default=1, least=0)
    attempt: Out[int] = port("number of the attempt that runs, or failed last: 1, 2, …")
    cause: Out[str] = port("cause of the failure that is being handled; empty before the first")
    message: Out[str] = port("its sentence")
    failed: Out[str] = port("path of the node that it comes from")

    def tried(self) -> Node:
        return self.parts[0]

    def most_runs(self) -> int:
        return self.number_of_retries + 1

    def cure_of(self, report: FailureReport) -> str:
        # A program fault is handled only where it is named, which this node cannot do.
        return "" if matches(str(internal.ANY), report.cause) else self.parts[1].name

    def cure(self, label: str) -> Node:
        return self.parts[1]

    @classmethod
    def goes_on_after(cls, cure: NodeStatus) -> bool:
        return cure is NodeStatus.SUCCESS


class ForAttempt(Node):
    """Take the value that a list has for this attempt: the first for the first; after the last, the last.

    So an attempt is made with more force, more slowly, through another camera than the one before. Numbers
    are in SI units, without unit.
    """

    flow = LeafFlow(steady=True)
    example = """
    Recover:
      attempts: 3
      attempt: "{attempt}"
      do:
        - ForAttempt: {attempt: "{attempt}", values: [1.0, 0.5, 0.25], value: "{speed}"}
        - Grasp: {object: "{item}", speed: "{speed}"}
      otherwise: SafeRetreat
    """

    kind = "action"
    played = False
    attempt: In[int] = port("which attempt it is: 1, 2, …; output `attempt` of the Recover", least=1)
    values: In[list[object]] = port("one for each attempt")
    value: Out[object] = port("the one for this attempt", each_of="values")

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        if given.constants.get("values") == []:
            return (PortProblem("values", "there is no value", "one for each attempt"),)
        return ()

    def on_tick(self) -> NodeStatus:
        if not self.values:
            return NodeStatus.FAILURE
        self.value = self.values[min(self.attempt, len(self.values)) - 1]
        return NodeStatus.SUCCESS


class Recover(RecoveryControl):
    """Runs `do`; when it fails, runs the handler of the cause, then `do` again, at most `attempts` times.

    The first pattern of `when` that matches the cause is used, in the order of the file, else `otherwise`.
    A cause without a handler fails at once. A handler that fails ends the node with the original cause, the
    handler's attached. When all attempts are used up, `give_up` is run: it leaves the arm in a state from
    which others can go on. The node then fails with the last cause, the earlier ones attached. A fault of the
    program is handled only where `when` names it: `internal.error`. The outputs give `do`, the handlers and
    `give_up` the number of the attempt and the handled failure. The tick ends between a handler and the next
    attempt.
    """

    flow = Recovery(runs="attempts", resort="give_up")
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
    def check_ports(cls, given: PortValues) -> tuple[str, ...]:
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
        # A program fault must not be handled by accident.
        if self.otherwise is None or matches(str(internal.ANY), report.cause):
            return ""
        return _OTHERWISE

    def cure(self, label: str) -> Node:
        if label == _OTHERWISE and self.otherwise is not None:
            return self.otherwise
        return self.handlers[label]

    def resort(self) -> Node | None:
        return self.last_resort


_OTHERWISE = "otherwise"
