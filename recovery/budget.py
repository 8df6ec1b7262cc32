"""Budget: what recovery may cost, for one item or for a whole branch."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from ..trees.controls.decorator import Decorator
from ..trees.flow import FlowState, NodeOutcomes, OutcomeCollector
from ..trees.node import Node
from ..trees.ports import In, port
from ..trees.status import NodeStatus
from ..trees.values.port_types import PortValues
from ..world.causes import FailureReport, tree
from ..world.values import ObjectId

if TYPE_CHECKING:
    from ..trees.flow.flow_walk import FlowAnalysis
    from ..trees.mission import NodeSpec


class Budget(Decorator):
    """Bounds what recovery below may cost: how many handlers may run, and how much time that may take.

    Each handler that a `Recover` or `RecoveryNode` below starts counts, and the time from a first failure
    until it is cured or given up. What is going on when the time is over is finished; the next handler is
    refused: those below give up, with their `give_up`, and the budget fails with tree.budget, the failure
    that nobody paid for attached, whatever stands between. Without recovery the child may run as long as it
    likes.

    With `of` there is an account for each object, kept from one time to the next until the child succeeds
    with it; without it, each start of the node begins a new one. Budgets may stand in one another: a recovery
    is charged to all of them.
    """

    example = """
    Budget:
      of: "{item}"
      tries: 6
      time: 90 s
      do:
        Recover:
          attempts: 10
          do: {Grasp: {object: "{item}"}}
          otherwise: [SafeRetreat, Observe]
    """

    of: In[ObjectId] = port(
        "the object whose account this is, kept between two runs; without it, an account for each run",
        default=ObjectId(""),
    )
    tries: In[int] = port("how many handlers may run; -1 for any number", default=-1, least=-1)
    time: In[float] = port("how long recovery may take; 0 for any time", unit="s", default=0.0, least=0)
    causes = (tree.BUDGET,)
    by_turns = True
    remembers = ("_accounts", "_before", "_given_up")
    _accounts: dict[str, list[float]] = {}  # noqa: RUF012 - replaced, never changed
    """By object: handlers run, seconds spent. Of those that did not succeed last."""
    _before: float = 0.0
    """When it was ticked last."""
    _given_up: FailureReport | None = None
    _recovering: bool = False
    """Whether somebody below is recovering in this tick."""

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str, ...]:
        no_count = "tries" not in given.keys or given.number("tries") == -1
        no_time = "time" not in given.keys or given.number("time") == 0
        if no_count and no_time:
            return ("without `tries` or `time` nothing is bounded",)
        return ()

    # What those below say, who recover.

    def refusal(self, last: FailureReport) -> FailureReport | None:
        """Why one more handler is not paid for after that failure; None: it is."""
        self._given_up = None  # somebody further up is about to give up; it ends when they have
        count, seconds = self._account()
        if (self.tries < 0 or count < self.tries) and (not self.time or seconds < self.time):
            return None
        if (last.cause, last.node) == (tree.BUDGET, self.path):
            return last  # this one has refused it further down already
        whose = f"of {self.of} " if self.of else ""
        spent = [f"{count:g} of {self.tries} handlers"] if self.tries >= 0 else [f"{count:g} handlers"]
        spent += [f"{seconds:.1f} of {self.time:g} s"] if self.time else [f"{seconds:.1f} s"]
        message = f"the budget {whose}is used up ({', '.join(spent)}): {last.message}"
        self.note(
            "budget",
            message,
            cause=last.cause.name,
            failed=last.node,
            object=self.of,
            tries=int(count),
            seconds=seconds,
        )
        evidence = {"object": str(self.of), "tries": int(count), "seconds": seconds, "cause": last.cause.name}
        return FailureReport(tree.BUDGET, message, evidence, self.path, (last,))

    def charge(self) -> None:
        """One more handler starts."""
        count, seconds = self._account()
        self._set_account(count + 1, seconds)

    def is_recovering(self) -> None:
        """The time of this tick goes into recovery."""
        self._recovering = True

    def has_given_up(self, report: FailureReport) -> None:
        """What was refused a handler has ended."""
        self._given_up = report

    # As a node.

    def on_start(self) -> None:
        self._given_up = None
        if not self.of:
            self._accounts = {}

    def on_tick(self) -> NodeStatus:
        now, self._recovering = self.world.clock.now, False
        state = self.relay()
        if self._recovering:
            count, seconds = self._account()
            self._set_account(count, seconds + now - self._before)
        self._before = now
        if self._given_up is not None and state is not NodeStatus.FAILURE:
            # Somebody between has passed it over.
            self.body.halt()
            return self.fail_with(self._given_up)
        if state is NodeStatus.SUCCESS:
            self._accounts = {key: value for key, value in self._accounts.items() if key != self.of}
        return state

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        flow, ends = walk.child(spec.children[0], (entry,)), OutcomeCollector()
        ends.take(flow)
        used_up = walk.fails(spec, walk.causes.of(cls.causes))
        for state in (*flow.failure, *flow.running):
            ends.fail_at(state, used_up)
        return ends.flow()

    # Private.

    def _account(self) -> tuple[float, float]:
        count, seconds = self._accounts.get(self.of, (0.0, 0.0))
        return count, seconds

    def _set_account(self, count: float, seconds: float) -> None:
        others = {key: value for key, value in self._accounts.items() if key != self.of}
        kept = list(others.items())[-_KEPT:]
        self._accounts = {**dict(kept), self.of: [count, seconds]}


_KEPT = 200
"""Accounts of other objects, so that hours of items that were given up do not grow the state."""


def budgets_above(node: Node) -> tuple[Budget, ...]:
    """Those that pay for recovery at that node, the nearest first."""
    found: list[Budget] = []
    above = cast("Node | None", node.parent)
    while above is not None:
        if isinstance(above, Budget):
            found.append(above)
        above = cast("Node | None", above.parent)
    return tuple(found)
