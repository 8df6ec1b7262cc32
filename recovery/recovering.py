"""The base of nodes that run a branch, cure its failure, and run it again."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING

from ..trees.flow import Flow, State
from ..trees.node import Control, Node
from ..trees.reports import with_attached
from ..trees.status import NodeStatus
from ..world.causes import FailureReport, internal, matches, tree
from .flow import Recovery

if TYPE_CHECKING:
    from ..trees.flow.walk import Walk
    from ..trees.mission import NodeSpec


class Recovering(Control, abstract=True):
    """Runs `tried`; after a failure runs its cure, then `tried` again, a tick apart."""

    by_turns = True

    causes = (tree.ATTEMPTS,)
    remembers = ("_runs", "_reports", "_handler", "_giving_up")
    positions = ("_handler",)
    _runs: int = 0
    _reports: tuple[FailureReport, ...] = ()
    _handler: str = ""
    """Label of the cure that runs; empty while `tried` runs."""
    _giving_up: bool = False

    # What a sub-class says.

    @abstractmethod
    def tried(self) -> Node:
        """What is to succeed."""
        ...

    @abstractmethod
    def most_runs(self) -> int:
        """How often it may run."""
        ...

    @abstractmethod
    def cure_of(self, report: FailureReport) -> str:
        """The label of the cure of a failure, of one that `cure` knows; empty when there is none."""
        ...

    @abstractmethod
    def cure(self, label: str) -> Node: ...

    def resort(self) -> Node | None:
        """What is run before failing for good."""
        return None

    @classmethod
    def goes_on_after(cls, cure: NodeStatus) -> bool:
        """Whether `tried` runs again after a cure that ended so."""
        return cure is not NodeStatus.FAILURE

    @classmethod
    @abstractmethod
    def recovery(cls, spec: NodeSpec, walk: Walk) -> Recovery:
        """The same of a node in the text."""
        ...

    # What they share.

    def on_start(self) -> None:
        self._runs, self._reports, self._handler, self._giving_up = 0, (), "", False

    def on_tick(self) -> NodeStatus:
        if self._giving_up:
            return self._give_up()
        if self._handler:
            return self._handle()
        state = self.tried().step()
        if state is NodeStatus.FAILURE:
            return self._failed(self.tried())
        if state is NodeStatus.SUCCESS and self._reports:
            last = self._reports[-1]
            self.note(
                "cured",
                f"cured after {len(self._reports)} failures: {last.cause}",
                cause=last.cause.name,
                failed=last.node,
                tries=len(self._reports),
            )
        return state

    def _failed(self, body: Node) -> NodeStatus:
        self._runs += 1
        report = body.failure
        if report is None:
            report = FailureReport(tree.ATTEMPTS, "a condition does not hold", {}, body.path)
        self._reports = (*self._reports, report)
        if matches(str(internal.ANY), report.cause):
            return self.fail_with(report)
        label = self.cure_of(report)
        if not label or self._runs >= self.most_runs():
            return self._give_up()
        self._handler = label
        self.note(
            "recovery",
            f"{report.cause} in {report.node}: {label} is tried (attempt {self._runs} of {self.most_runs()})",
            cause=report.cause.name,
            failed=report.node,
            reason=report.message,
            handler=label,
            attempt=self._runs,
        )
        return NodeStatus.RUNNING

    def _handle(self) -> NodeStatus:
        handler = self.cure(self._handler)
        state = handler.step()
        if state is NodeStatus.RUNNING:
            return state
        self._handler = ""
        if self.goes_on_after(state):
            return NodeStatus.RUNNING
        failed = (handler.failure,) if handler.failure is not None else ()
        return self.fail_with(with_attached(self._reports[-1], failed))

    def _give_up(self) -> NodeStatus:
        *earlier, last = self._reports
        report = with_attached(last, earlier)
        resort = self.resort()
        if resort is None:
            return self.fail_with(report)
        self._giving_up = True
        match resort.step():
            case NodeStatus.RUNNING:
                return NodeStatus.RUNNING
            case NodeStatus.FAILURE if resort.failure is not None:
                return self.fail_with(with_attached(report, (resort.failure,)))
            case _:
                return self.fail_with(report)

    @classmethod
    def flow(cls, spec: NodeSpec, entry: State, walk: Walk) -> Flow:
        return cls.recovery(spec, walk).flow(spec, entry, walk)
