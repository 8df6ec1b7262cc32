"""RetryUntilSuccessful: repeats a branch after a failure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...world.causes import FailureReport, internal, matches, tree
from ..flow import UNREPORTED, FailureReasons, FlowState, NodeOutcomes, OutcomeCollector, States, joined, tidy
from ..ports import In, port
from ..status import NodeStatus
from ..values.failure_reports import with_attached
from ..values.port_types import PortProblem, PortValues
from .decorator import Decorator

if TYPE_CHECKING:
    from ..flow.flow_walk import FlowAnalysis
    from ..mission import NodeSpec


class RetryUntilSuccessful(Decorator):
    """Runs its child until it succeeds, at most `num_attempts` times, one tick apart.

    When all attempts are used up it fails with the last failure, the earlier ones attached; with
    tree.attempts when the child gave no reason. A fault of the program is not tried again.
    """

    by_turns = True

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

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        attempts, part, ends = walk.number(spec, "num_attempts"), spec.children[0], OutcomeCollector()
        used_up = walk.fails(spec, walk.causes.of(cls.causes))
        if attempts is None or attempts == 0:
            ends.fail_at(entry, used_up)
        if attempts == 0:
            walk.unreached(part, "num_attempts is 0")
            return ends.flow()
        starts: States = frozenset((entry,))
        while True:
            flow = walk.child(part, starts)
            ends.succeed(flow.success)
            ends.skip(flow.skipped)
            ends.run(flow.running)
            for state, reasons in flow.failure.items():
                if attempts != 1:
                    ends.run((state,))
                if attempts is None or attempts > 0:
                    ends.fail_at(state, _for_good(reasons if attempts == 1 else reasons.tried(), used_up))
            after = starts if attempts == 1 else tidy(starts | flow.failure.keys())
            if after == starts:
                return ends.flow()
            starts = after


def _for_good(reasons: FailureReasons, used_up: FailureReasons) -> FailureReasons:
    reported = reasons.only(~UNREPORTED)
    return joined((reported, used_up.tried())) if reasons.any & UNREPORTED else reported


_MAX_REPORTS = 20
