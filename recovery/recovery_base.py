"""Base class of nodes that run a branch, handle its failure, and run it again."""

from __future__ import annotations

from abc import abstractmethod

from ..trees.node import ControlNode, Node
from ..trees.status import NodeStatus
from ..trees.values.failure_reports import with_attached
from ..world.causes import FailureReport, internal, matches, tree
from ..world.events.run_events import CuredEvent, RecoveryEvent
from .budget import budgets_above


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
        """Return the label of the handler for a failure, as `cure` knows it; empty when there is none."""
        ...

    @abstractmethod
    def cure(self, label: str) -> Node: ...

    def resort(self) -> Node | None:
        """Node that runs before the final failure; None: none."""
        return None

    @classmethod
    def goes_on_after(cls, cure: NodeStatus) -> bool:
        """Return whether `tried` runs again after a handler with this end."""
        return cure is not NodeStatus.FAILURE

    # Shared by sub-classes.

    def on_start(self) -> None:
        self._runs, self._reports, self._handler, self._giving_up = 0, (), "", False
        self._refused = False
        self._tell(None)

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
        if state is NodeStatus.SUCCESS and self._reports:
            last = self._reports[-1]
            message, tries = f"cured after {len(self._reports)} failures: {last.cause}", len(self._reports)
            event = CuredEvent(message, self.path, cause=last.cause.name, failed=last.node, tries=tries)
            self.world.journal.note(event)
        return state

    def _failed(self, body: Node) -> NodeStatus:
        self._runs += 1
        report = body.failure
        if report is None:
            report = FailureReport(tree.ATTEMPTS, "a condition does not hold", {}, body.path)
        self._reports = (*self._reports, report)
        self._tell(report)
        label = self.cure_of(report)
        if not label and matches(str(internal.ANY), report.cause):
            return self.fail_with(report)
        if not label or self._runs >= self.most_runs():
            return self._give_up()
        refusal = self._pay()
        if refusal is not None:
            self._refused = True
            self._reports = (*self._reports[:-1], refusal)
            return self._give_up()
        self._handler = label
        attempts = f"attempt {self._runs} of {self.most_runs()}"
        self.world.journal.note(
            RecoveryEvent(
                f"{report.cause} in {report.node}: {label} is tried ({attempts})",
                self.path,
                cause=report.cause.name,
                failed=report.node,
                reason=report.message,
                handler=label,
                attempt=self._runs,
            )
        )
        return NodeStatus.RUNNING

    def _tell(self, report: FailureReport | None) -> None:
        """Write the outputs: the running attempt, or the failed one with its report."""
        if report is None:
            self.output("attempt", self._runs + 1)
            if self._reports:
                return  # the failure that was cured stays known while it is tried again
        self.output("cause", report.cause.name if report else "")
        self.output("message", report.message if report else "")
        self.output("failed", report.node if report else "")

    def _pay(self) -> FailureReport | None:
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
        handler = self.cure(self._handler)
        state = handler.step()
        if state is NodeStatus.RUNNING:
            return state
        self._handler = ""
        if self.goes_on_after(state):
            self._tell(None)
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
                    budget.has_given_up(report)
        return self.fail_with(report)
