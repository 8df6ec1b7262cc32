"""Recover: a branch, and for each cause in which it can end what may cure it."""

from __future__ import annotations

from ..trees.node import Control, Node
from ..trees.ports import In, port
from ..trees.reports import with_attached
from ..trees.slots import child, optional_child, table
from ..trees.status import NodeStatus
from ..world.causes import FailureReport, internal, matches, tree


class Recover(Control):
    """Runs `do`; when it fails, runs the handler of the cause, then `do` again, at most `attempts` times.

    The first pattern of `when` that matches the cause is used, in the order of the file, else `otherwise`;
    a cause without a handler fails at once. A handler that fails ends the node with the original cause, the
    handler's attached. When all attempts are used up, `give_up` is run, so that the arm is left in a state
    from which others can go on, and the node fails with the last cause, the earlier ones attached.
    A fault of the program is never handled. The tick ends between a handler and the next attempt.
    """

    attempts: In[int] = port("how often `do` may run", default=3, least=1)
    body = child("what is to succeed")
    handlers = table("cause, or family of causes, and what may cure it", key="when", of="cause")
    otherwise = optional_child("what may cure all other causes", key="otherwise")
    last_resort = optional_child("what is done before failing for good", key="give_up")
    causes = (tree.ATTEMPTS,)
    remembers = ("_runs", "_reports", "_handler", "_giving_up")
    _runs: int = 0
    _reports: tuple[FailureReport, ...] = ()
    _handler: str = ""
    """Label of the handler that runs; empty while `do` runs."""
    _giving_up: bool = False

    @classmethod
    def check_ports(cls, given: frozenset[str]) -> tuple[str, ...]:
        if not given & {"when", "otherwise"}:
            return ("without `when` or `otherwise` nothing is recovered; use RetryUntilSuccessful to retry",)
        return ()

    def on_start(self) -> None:
        self._runs, self._reports, self._handler, self._giving_up = 0, (), "", False

    def on_tick(self) -> NodeStatus:
        if self._giving_up:
            return self._give_up()
        if self._handler:
            return self._handle()
        state = self.body.step()
        if state is NodeStatus.FAILURE:
            return self._failed(self.body.failure)
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

    def _failed(self, report: FailureReport | None) -> NodeStatus:
        self._runs += 1
        if report is None:
            report = FailureReport(tree.ATTEMPTS, "a condition does not hold", {}, self.body.path)
        self._reports = (*self._reports, report)
        label, handler = self._handler_of(report)
        if matches(str(internal.ANY), report.cause):
            return self.fail_with(report)
        if handler is None or self._runs >= self.attempts:
            return self._give_up()
        self._handler = label
        self.note(
            "recovery",
            f"{report.cause} in {report.node}: {label} is tried (attempt {self._runs} of {self.attempts})",
            cause=report.cause.name,
            failed=report.node,
            reason=report.message,
            handler=label,
            attempt=self._runs,
        )
        return NodeStatus.RUNNING

    def _handler_of(self, report: FailureReport) -> tuple[str, Node | None]:
        for pattern, handler in self.handlers.items():
            if matches(pattern, report.cause):
                return pattern, handler
        return "otherwise", self.otherwise

    def _handle(self) -> NodeStatus:
        handler = self.otherwise if self._handler == "otherwise" else self.handlers[self._handler]
        assert handler is not None
        state = handler.step()
        if state is NodeStatus.RUNNING:
            return state
        self._handler = ""
        if state is NodeStatus.FAILURE:
            failed = (handler.failure,) if handler.failure is not None else ()
            return self.fail_with(with_attached(self._reports[-1], failed))
        return NodeStatus.RUNNING

    def _give_up(self) -> NodeStatus:
        *earlier, last = self._reports
        report = with_attached(last, earlier)
        if self.last_resort is None:
            return self.fail_with(report)
        self._giving_up = True
        match self.last_resort.step():
            case NodeStatus.RUNNING:
                return NodeStatus.RUNNING
            case NodeStatus.FAILURE if self.last_resort.failure is not None:
                return self.fail_with(with_attached(report, (self.last_resort.failure,)))
            case _:
                return self.fail_with(report)
