"""Recover, RecoveryNode, ForAttempt, Budget and PlanWith: a branch is repeated after its failures are
handled by cause, within limits, and with planner overrides.
"""

from __future__ import annotations

from abc import abstractmethod
from contextlib import nullcontext
from typing import TYPE_CHECKING, cast

from picktree.robot.planning import PlannerOverrides
from picktree.trees import (
    ControlNode,
    Decorator,
    In,
    Node,
    NodeStatus,
    Out,
    PortProblem,
    PortValues,
    child,
    children,
    control_flow,
    optional_child,
    port,
    table,
    with_attached,
)
from picktree.world import FailureReport, ObjectId, event_types, internal, matches, tree, world

if TYPE_CHECKING:
    from picktree.robot.planning import PlanService


class Budget(Decorator):
    """Bounds the cost of recovery below: how many handlers may run, and how much time they may take.

    Each handler that a `Recover` or `RecoveryNode` below starts counts. The time from a first
    failure until it is cured or given up counts, too. A handler that runs when the
    time is used up may end; no further handler starts. The nodes below then give up, with their `give_up`.
    The budget fails with tree.budget and attaches the failure that was not handled. Without recovery the
    child may run without limit.

    With `of` each object has an account, which is kept until the child succeeds with that object. Without
    `of` each start of the node opens a new account. Budgets may be nested: a recovery is charged to all of
    them.
    """

    flow = control_flow.ChildFlow(
        own={control_flow.RUNNING: control_flow.FAILURE, control_flow.FAILURE: control_flow.FAILURE}
    )
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
        "the object of the account, which is kept between two runs; without it, each run has its own account",
        default=ObjectId(""),
    )
    tries: In[int] = port("maximum number of handlers; -1 for any number", default=-1, least=-1)
    time: In[float] = port(
        "maximum simulated time for recovery; 0 for no limit", unit="s", default=0.0, least=0
    )
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
            event_types.BudgetEvent(
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

    def store_refusal(self, report: FailureReport) -> None:
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
    """Plans motions of its child with another seed, budget, clearance or planner.

    The overrides apply only to plans of the child, in the child's ticks. They end with the child, whatever
    its result. For one `PlanWith` inside another, budgets multiply, clearances add up, and the inner seed and
    planner count.
    """

    flow = control_flow.ChildFlow()
    example = """
    Recover:
      attempts: 3
      attempt: "{attempt}"
      do:
        PlanWith: {seed: "{attempt}", budget: 3, do: {GoTo: {pose: home}}}
      when:
        planning.*: {SafeRetreat: {pose: rest}}
    """

    seed: In[int] = port("seed of the random trees; 0 for the usual one", default=0, least=0)
    budget: In[float] = port(
        "multiple of the usual number of collision checks of a plan", default=1.0, above=0, most=100
    )
    clearance: In[float] = port(
        "clearance of free motions beyond the usual margins",
        unit="m",
        default=0.0,
        least=0,
        most=0.1,
    )
    planner: In[str] = port(
        "planner of free motions, such as `bit_star`; by default the usual one", default="", names="planner"
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


class RecoveryControl(ControlNode, abstract=True):
    """Runs `tried`; after a failure runs a handler, then `tried` again, a tick apart.

    The outputs `attempt`, `cause`, `message` and `failed` describe the recovery to the nodes below. Handlers
    are charged to every `Budget` above; one that is used up refuses the next.
    """

    causes = (tree.ATTEMPTS,)
    remembers = ("_runs", "_reports", "_handler", "_giving_up", "_refused")
    positions = ("_handler",)
    _runs: int = 0
    _reports: tuple[FailureReport, ...] = ()
    _handler: str = ""
    """Label of the running handler; empty while `tried` runs."""
    _giving_up: bool = False
    _refused: bool = False
    """Whether a budget above has refused the next handler."""

    # Written by sub-classes.

    @abstractmethod
    def tried(self) -> Node:
        """Child that must succeed."""
        ...

    @abstractmethod
    def most_runs(self) -> int:
        """Maximum number of runs of `tried`."""
        ...

    @abstractmethod
    def cure_of(self, report: FailureReport) -> str:
        """Return the label of the handler for a failure, as in `cure`; empty without a handler."""
        ...

    @abstractmethod
    def cure(self, label: str) -> Node: ...

    def resort(self) -> Node | None:
        """Node that runs before the final failure; None: none."""
        return None

    def ends_with(self, label: str) -> bool:
        """Return whether the handler takes the place of `tried`: with its success the node succeeds."""
        return False

    @classmethod
    def goes_on_after(cls, cure: NodeStatus) -> bool:
        """Return whether `tried` runs again after a handler with this end."""
        return cure is not NodeStatus.FAILURE

    # Shared by sub-classes.

    def on_start(self) -> None:
        self._runs, self._reports, self._handler, self._giving_up = 0, (), "", False
        self._refused = False
        self._write_outputs(None)

    def on_tick(self) -> NodeStatus:
        if self._reports:
            for budget in budgets_above(self):
                budget.is_recovering()
        if self._giving_up:
            return self._give_up()
        if self._handler:
            return self._handle()
        state = self.tried().step()
        if state is NodeStatus.FAILURE:
            return self._failed(self.tried())
        return state

    def _failed(self, body: Node) -> NodeStatus:
        self._runs += 1
        report = body.failure
        if report is None:
            report = FailureReport(tree.ATTEMPTS, "a condition does not hold", {}, body.path)
        self._reports = (*self._reports, report)
        self._write_outputs(report)
        label = self.cure_of(report)
        if not label and matches(str(internal.ANY), report.cause):
            return self.fail_with(report)
        ends = self.ends_with(label)
        if not label or (not ends and (self._runs >= self.most_runs() or self._is_stuck(label))):
            return self._give_up()
        refusal = self._charge_budgets()
        if refusal is not None:
            self._refused = True
            self._reports = (*self._reports[:-1], refusal)
            return self._give_up()
        self._handler = label
        progress = f"tried (attempt {self._runs} of {self.most_runs()})" if not ends else "done instead"
        self.world.journal.note(
            event_types.RecoveryEvent(
                f"{report.cause} in {report.node}: {label} is {progress}",
                self.path,
                cause=report.cause.name,
                failed=report.node,
                reason=report.message,
                handler=label,
                attempt=self._runs,
                ends=ends,
            )
        )
        return NodeStatus.RUNNING

    def _is_stuck(self, label: str) -> bool:
        """Return whether nothing has changed since the body failed, in this run or in an earlier one.

        After its own first failure a second handler is tried, which may do more than the first.
        """
        if all(report.evidence.get("unchanged") is True for report in self._reports[-2:]):
            return True
        reports = self._reports
        return len(reports) > 1 and self._is_still_unknown(reports[-2], reports[-1], label)

    def _is_still_unknown(self, before: FailureReport, last: FailureReport, label: str) -> bool:
        """Return whether the object is still unknown after its handler has just run.

        It was unknown before, or the same handler has looked for it, and it was given up.
        """
        if last.cause is not world.UNKNOWN_OBJECT or before.evidence.get("object") != last.evidence.get(
            "object"
        ):
            return False
        return before.cause is last.cause or self.cure_of(before) == label

    def _write_outputs(self, report: FailureReport | None) -> None:
        """Write the outputs: the running attempt, or the failed one with its report."""
        if report is None:
            self.output("attempt", self._runs + 1)
            if self._reports:
                return  # the failure that was cured stays known while it is tried again
        self.output("cause", report.cause.name if report else "")
        self.output("message", report.message if report else "")
        self.output("failed", report.node if report else "")

    def _charge_budgets(self) -> FailureReport | None:
        """Charge one handler to all budgets above; return the refusal when one of them allows no more."""
        budgets = budgets_above(self)
        last = self._reports[-1]
        for budget in budgets:
            refusal = budget.refusal(last)
            if refusal is not None:
                return refusal
        for budget in budgets:
            budget.charge()
        return None

    def _handle(self) -> NodeStatus:
        handler, ends = self.cure(self._handler), self.ends_with(self._handler)
        state = handler.step()
        if state is NodeStatus.RUNNING:
            return state
        self._handler = ""
        if ends and state is NodeStatus.SUCCESS:
            return state
        if not ends and self.goes_on_after(state):
            self._write_outputs(None)
            return NodeStatus.RUNNING
        failed = (handler.failure,) if handler.failure is not None else ()
        return self.fail_with(with_attached(self._reports[-1], failed))

    def _give_up(self) -> NodeStatus:
        *earlier, last = self._reports
        report = with_attached(last, earlier)
        resort = self.resort()
        if resort is not None:
            self._giving_up = True
            match resort.step():
                case NodeStatus.RUNNING:
                    return NodeStatus.RUNNING
                case NodeStatus.FAILURE if resort.failure is not None:
                    report = with_attached(report, (resort.failure,))
                case _:
                    pass
        if self._refused:
            for budget in budgets_above(self):
                if budget.path == report.node:
                    budget.store_refusal(report)
        return self.fail_with(report)


class RecoveryNode(RecoveryControl):
    """Runs its first child; when it fails, runs the second, then the first again, as in Nav2.

    The first child runs at most `number_of_retries` + 1 times. When the second child fails or is skipped, the
    node fails with the first child's cause and attaches the second child's. When all retries are used up, it
    fails with the last cause and attaches the earlier ones. SKIPPED when the first child is. The tick ends
    between the two children. `Recover` chooses the handler by the cause.
    """

    flow = control_flow.Recovery(
        runs="number_of_retries", first_is_free=True, skipped_handler=control_flow.FAILURE
    )
    example = """
    RecoveryNode:
      number_of_retries: 2
      do:
        - Grasp: {object: "{item}"}
        - Observe: {camera: overhead}
    """

    parts = children(
        "the child that must succeed, and the child that may cure its failure",
        least=2,
        most=2,
        labels=("", "recovery"),
    )
    number_of_retries: In[int] = port("maximum number of runs of the second child", default=1, least=0)
    attempt: Out[int] = port("number of the present or last attempt: 1, 2, …")
    cause: Out[str] = port("cause of the failure that is being handled; empty before the first")
    message: Out[str] = port("message of that failure")
    failed: Out[str] = port("path of the node with that failure")

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
    """Take the value of a list for this attempt; attempts beyond the end of the list take the last value.

    So an attempt can use more force, less speed or another camera than the attempt before. Numbers are in SI
    units, without unit.
    """

    flow = control_flow.LeafFlow(steady=True)
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
    attempt: In[int] = port("number of the attempt: 1, 2, …; output `attempt` of the Recover", least=1)
    values: In[list[object]] = port("values, one for each attempt")
    value: Out[object] = port("value for this attempt", each_of="values")

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

    The first pattern of `when` that matches the cause is used, in the order of the file, else `otherwise`. A
    cause without a handler fails immediately. A failing handler ends the node with the original cause; the
    handler's cause is attached. When all attempts are used up, `give_up` is run: it leaves the arm in a state
    from which other nodes can continue. The node then fails with the last cause and attaches the earlier
    ones. Attempts also end early in two cases. The first: the last two failures, or the first one of this
    run, report an unchanged situation (evidence `unchanged`). The second: an object is still unknown after
    its handler. A fault of the program is handled only where a pattern names it: `internal.error`.

    A handler of `instead` replaces `do`. It takes precedence over those of `when`, also after the last
    attempt, and the node succeeds with it. So a defective item is done when it is in quarantine. The outputs
    give `do`, the handlers and `give_up` the number of the attempt and the handled failure. The tick ends
    between a handler and the next attempt.
    """

    flow = control_flow.Recovery(runs="attempts", resort="give_up", instead="instead")
    example = """
    Recover:
      attempts: 3
      do: [{Grasp: {object: "{item}"}}, {Place: {object: "{item}", into: red_bin}}]
      when:
        grasp.missed: [SafeRetreat, {Observe: {camera: overhead}}]
        control.*: SafeRetreat
      otherwise: SafeRetreat
      instead:
        place.full: {Place: {object: "{item}", into: blue_bin}}
      give_up: {SafeRetreat: {hand: open}}
    """

    attempts: In[int] = port(
        "maximum number of runs of `do`; second tries within a skill, as of `Grasp`, do not count",
        default=3,
        least=1,
    )
    attempt: Out[int] = port("number of the present or last attempt: 1, 2, …")
    cause: Out[str] = port("cause of the failure that is being handled; empty before the first")
    message: Out[str] = port("message of that failure")
    failed: Out[str] = port("path of the node with that failure")
    body = child("the child that must succeed")
    handlers = table(
        "cause, or family of causes, and its handler, which may cure the failure", key="when", of="cause"
    )
    otherwise = optional_child("handler of all other causes", key="otherwise")
    endings = table(
        "cause, or family of causes, and the child that runs instead of `do`, which is not tried again",
        key="instead",
        of="cause",
    )
    last_resort = optional_child("child that runs before the node finally fails", key="give_up")

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str, ...]:
        if not given.any_of("when", "otherwise", "instead"):
            lacking = "without `when`, `otherwise` or `instead` nothing is recovered"
            return (f"{lacking}; use RetryUntilSuccessful to retry",)
        return ()

    def tried(self) -> Node:
        return self.body

    def most_runs(self) -> int:
        return self.attempts

    def cure_of(self, report: FailureReport) -> str:
        for pattern in (*self.endings, *self.handlers):
            if matches(pattern, report.cause):
                return pattern
        # A program fault must not be handled by accident.
        if self.otherwise is None or matches(str(internal.ANY), report.cause):
            return ""
        return _OTHERWISE

    def cure(self, label: str) -> Node:
        if label == _OTHERWISE and self.otherwise is not None:
            return self.otherwise
        return self.endings[label] if label in self.endings else self.handlers[label]

    def ends_with(self, label: str) -> bool:
        return label in self.endings

    def resort(self) -> Node | None:
        return self.last_resort


_OTHERWISE = "otherwise"
