"""Budget and PlanWith: limits on the cost of recovery, and planner overrides while a branch runs."""

from __future__ import annotations

from contextlib import nullcontext
from typing import TYPE_CHECKING, cast

from ..robot.planning.requests import PlannerOverrides
from ..trees.controls.decorator import Decorator
from ..trees.flow import FAILURE, RUNNING, ChildFlow
from ..trees.node import Node
from ..trees.port_types import PortValues
from ..trees.ports import In, port
from ..trees.status import NodeStatus
from ..world.causes import FailureReport, tree
from ..world.run_events import BudgetEvent
from ..world.values import ObjectId

if TYPE_CHECKING:
    from ..robot.planning.plan_service import PlanService


class Budget(Decorator):
    """Bounds the cost of recovery below: how many handlers may run, and how much time they may take.

    Each handler that a `Recover` or `RecoveryNode` below starts counts. The time from a first
    failure until it is cured or given up counts, too. A handler that runs when the
    time is over is finished; the next is refused. The nodes below then give up, with their `give_up`. The
    budget fails with tree.budget, with the failure that was not handled attached. Without recovery the child
    may run without limit.

    With `of` each object has an account, which is kept until the child succeeds with that object. Without
    `of` each start of the node opens a new account. Budgets may be nested: a recovery is charged to all of
    them.
    """

    flow = ChildFlow(own={RUNNING: FAILURE, FAILURE: FAILURE})
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
    remembers = ("_accounts", "_before", "_given_up")
    _accounts: dict[str, list[float]] = {}  # noqa: RUF012 - replaced, never changed
    """Handlers run and seconds spent by object, without objects whose last run succeeded."""
    _before: float = 0.0
    """Simulated time of the last tick, s."""
    _given_up: FailureReport | None = None
    _recovering: bool = False
    """Whether a node below is recovering in this tick."""

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str, ...]:
        no_count = "tries" not in given.keys or given.number("tries") == -1
        no_time = "time" not in given.keys or given.number("time") == 0
        if no_count and no_time:
            return ("without `tries` or `time` nothing is bounded",)
        return ()

    # Called by the recovering nodes below.

    def refusal(self, last: FailureReport) -> FailureReport | None:
        """Return why no further handler is allowed after this failure; None: one is allowed."""
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
        cause, failed = last.cause.name, last.node
        self.world.journal.note(
            BudgetEvent(
                message,
                self.path,
                cause=cause,
                failed=failed,
                object=self.of,
                tries=int(count),
                seconds=seconds,
            )
        )
        evidence = {"object": str(self.of), "tries": int(count), "seconds": seconds, "cause": last.cause.name}
        return FailureReport(tree.BUDGET, message, evidence, self.path, (last,))

    def charge(self) -> None:
        """Count one more handler."""
        count, seconds = self._account()
        self._set_account(count + 1, seconds)

    def is_recovering(self) -> None:
        """Charge the time of this tick to recovery."""
        self._recovering = True

    def has_given_up(self, report: FailureReport) -> None:
        """Store the report of a node below that gave up after a refusal."""
        self._given_up = report

    # Called as for every node.

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
            # A node in between has ignored the failure.
            self.body.halt()
            return self.fail_with(self._given_up)
        if state is NodeStatus.SUCCESS:
            self._accounts = {key: value for key, value in self._accounts.items() if key != self.of}
        return state

    # Private.

    def _account(self) -> tuple[float, float]:
        count, seconds = self._accounts.get(self.of, (0.0, 0.0))
        return count, seconds

    def _set_account(self, count: float, seconds: float) -> None:
        others = {key: value for key, value in self._accounts.items() if key != self.of}
        kept = list(others.items())[-_MAX_ACCOUNTS:]
        self._accounts = {**dict(kept), self.of: [count, seconds]}


_MAX_ACCOUNTS = 200
"""Maximum number of accounts of other objects: items given up over hours must not enlarge the state."""


def budgets_above(node: Node) -> tuple[Budget, ...]:
    """Return the budgets that are charged for recovery at this node, the nearest first."""
    found: list[Budget] = []
    above = cast("Node | None", node.parent)
    while above is not None:
        if isinstance(above, Budget):
            found.append(above)
        above = cast("Node | None", above.parent)
    return tuple(found)


class PlanWith(Decorator):
    """While its child runs, motions are planned with other seed, budget, clearance or planner.

    It holds for what the child itself plans, and only in its own ticks: however the child ends, everything is
    planned as before afterwards. Where one stands in the other, budgets multiply, clearances add up, and the
    inner seed and planner count.
    """

    flow = ChildFlow()
    example = """
    Recover:
      attempts: 3
      attempt: "{attempt}"
      do:
        PlanWith: {seed: "{attempt}", budget: 3, do: {GoTo: {pose: home}}}
      when:
        planning.*: {SafeRetreat: {pose: rest}}
    """

    seed: In[int] = port("another number, other random trees; 0 for the usual ones", default=0, least=0)
    budget: In[float] = port(
        "how many times the collision checks that a plan may take otherwise", default=1.0, above=0, most=100
    )
    clearance: In[float] = port(
        "how much more room free motions keep than the usual margins",
        unit="m",
        default=0.0,
        least=0,
        most=0.1,
    )
    planner: In[str] = port(
        "the planner of free motions, as `bit_star`; the usual one unless given", default="", names="planner"
    )

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str, ...]:
        if not given.any_of("seed", "budget", "clearance", "planner"):
            return ("without `seed`, `budget`, `clearance` or `planner` it changes nothing",)
        return ()

    def on_tick(self) -> NodeStatus:
        # A rehearsal has no planner.
        plan = cast("PlanService | None", getattr(self.world, "plan", None))
        manner = PlannerOverrides(self.seed, self.budget, self.clearance, self.planner)
        with plan.in_manner(manner) if plan is not None else nullcontext():
            return self.relay()
