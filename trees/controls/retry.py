"""RetryUntilSuccessful: repeats a branch after a failure."""

from __future__ import annotations

from ...world.causes import FailureReport, internal, matches, tree
from ..flow import AGAIN, Loop
from ..ports import In, port
from ..status import NodeStatus
from ..values.failure_reports import with_attached
from ..values.port_types import PortProblem, PortValues
from .decorator import Decorator


class RetryUntilSuccessful(Decorator):
    """Runs its child until it succeeds, at most `num_attempts` times, one tick apart.

    When all attempts are used up it fails with the last failure, the earlier ones attached; with
    tree.attempts when the child gave no reason. A fault of the program is not tried again.
    """

    flow = Loop(failure=AGAIN, runs="num_attempts")
    example = """
    RetryUntilSuccessful:
      num_attempts: 3
      do: {Grasp: {object: "{item}"}}
    """

    num_attempts: In[int] = port("how often the child may run; -1 for without end", least=-1)
    causes = (tree.ATTEMPTS,)
    remembers = ("_attempts", "_reports")
    _attempts: int = 0
    _reports: tuple[FailureReport, ...] = ()

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        if given.number("num_attempts") != 0:
            return ()
        return (PortProblem("num_attempts", "with 0 attempts the child never runs", "at least 1, or -1"),)

    def on_start(self) -> None:
        self._attempts, self._reports = 0, ()

    def on_tick(self) -> NodeStatus:
        if self.num_attempts == 0:
            return self.fail(tree.ATTEMPTS, "no attempt is allowed")
        state = self.body.step()
        if state is not NodeStatus.FAILURE:
            return state
        self._attempts += 1
        report = self.body.failure
        fault = report is not None and matches(str(internal.ANY), report.cause)
        # The count can exceed the limit when an edit during the run lowers the limit.
        if fault or 0 < self.num_attempts <= self._attempts:
            return self._give_up(report)
        # Reports are limited, so that the state does not grow over hours of attempts.
        self._reports = (*self._reports, *((report,) if report else ()))[-_MAX_REPORTS:]
        return NodeStatus.RUNNING

    def _give_up(self, last: FailureReport | None) -> NodeStatus:
        if last is None:
            message = f"{self._attempts} attempts are used up"
            return self.fail(tree.ATTEMPTS, message, attached=self._reports)
        return self.fail_with(with_attached(last, self._reports))


_MAX_REPORTS = 20
