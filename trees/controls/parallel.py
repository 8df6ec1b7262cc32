"""Parallel and ParallelAll: all children in the same tick."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from ...world.causes import Failure, FailureReport, tree
from ..failure_reports import with_attached
from ..flow import AtOnce
from ..node import ControlNode
from ..port_types import PortProblem, PortValues
from ..ports import In, children, port
from ..status import NodeStatus


class ParallelNode(ControlNode, abstract=True):
    """Node that ticks all children that have not ended, in order, in each tick."""

    parts = children("what is done at the same time")
    counts: ClassVar[tuple[str, ...]] = ()
    """Inputs with a number of children."""
    remembers = ("_ended", "_succeeded", "_failed", "_reports")
    positions = ("_ended",)
    _ended: tuple[int, ...] = ()
    _succeeded: int = 0
    _failed: int = 0
    _reports: tuple[FailureReport, ...] = ()

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        total = len(given.labels.get("do", ()))
        wrong = [
            PortProblem(
                key, f"{count:g} of {total} children cannot be counted", f"1 to {total}, or -1 to -{total}"
            )
            for key in cls.counts
            if (count := given.number(key)) is not None and not 1 <= abs(count) <= total
        ]
        return tuple(wrong) if total else ()

    def on_start(self) -> None:
        self._ended, self._reports = (), ()
        self._succeeded = self._failed = 0

    def tick_parts(self) -> Iterator[int]:
        """Tick the children that have not ended; yield the number of skipped ones after each."""
        skipped = 0
        for index, part in enumerate(self.parts):
            if index in self._ended:
                continue
            match part.step():
                case NodeStatus.SUCCESS:
                    self._ended += (index,)
                    self._succeeded += 1
                case NodeStatus.FAILURE:
                    self._ended += (index,)
                    self._failed += 1
                    self._reports += (part.failure,) if part.failure else ()
                case NodeStatus.SKIPPED:
                    skipped += 1
                case _:
                    pass
            yield skipped

    def children_meant(self, *numbers: int) -> tuple[int, ...]:
        """Return numbers of children; one below zero counts from the end. Raises Failure for too many."""
        total = len(self.parts)
        meant = tuple(counted(number, total) for number in numbers)
        if max(meant) > total:
            message = f"{max(meant)} of {total} children are wanted"
            raise Failure(
                tree.MISSING_INPUT, message, **dict(zip(self.counts, meant, strict=True)), children=total
            )
        return meant

    def fail_with_reports(self) -> NodeStatus:
        """Fail with the first failure, the others' attached."""
        first = self._reports[0] if self._reports else None
        return self.fail_with(with_attached(first, self._reports[1:]) if first else None)


class Parallel(ParallelNode):
    """Ticks all children that have not ended, in order, in each tick.

    A number below zero counts from the end: -1 is all children, -2 all but one. It fails with the first
    failure, the others' attached. What still runs when it ends is halted. SKIPPED when all were skipped.
    """

    flow = AtOnce(wanted="success_count", tolerated="failure_count")
    example = """
    Parallel:
      - GoTo: {pose: observe}
      - OpenGripper
    """

    success_count: In[int] = port(
        "how many children must succeed; -1 for all, -2 for all but one", default=-1
    )
    failure_count: In[int] = port("how many failures are too many; -1 when all failed", default=1)
    counts = ("success_count", "failure_count")

    def on_tick(self) -> NodeStatus:
        total = len(self.parts)
        wanted, tolerated = self.children_meant(self.success_count, self.failure_count)
        skipped = 0
        for skipped in self.tick_parts():
            # As in BT.CPP: with a number that counts from the end, skipped children need not succeed.
            spared = skipped if self.success_count < 0 and skipped < total else 0
            if self._succeeded + spared >= wanted:
                return NodeStatus.SUCCESS
            if total - self._failed < wanted or self._failed >= tolerated:
                return self.fail_with_reports()
        return NodeStatus.SKIPPED if skipped == total else NodeStatus.RUNNING


class ParallelAll(ParallelNode):
    """Ticks all children in each tick until every one has ended, whatever the others do.

    It then fails when `max_failures` children or more have failed: with the first failure, the others'
    attached. A skipped child needs no end; SKIPPED when all were skipped.
    """

    flow = AtOnce(tolerated="max_failures", waits=True)
    example = """
    ParallelAll:
      max_failures: 2
      do:
        - GoTo: {pose: observe}
        - Observe: {camera: overhead, objects: "{items}"}
    """

    max_failures: In[int] = port(
        "how many failures are too many; -1 when all failed, -2 when all but one", default=1
    )
    counts = ("max_failures",)

    def on_tick(self) -> NodeStatus:
        total = len(self.parts)
        (tolerated,) = self.children_meant(self.max_failures)
        *_, skipped = (0, *self.tick_parts())
        if skipped == total:
            return NodeStatus.SKIPPED
        if skipped + len(self._ended) < total:
            return NodeStatus.RUNNING
        return self.fail_with_reports() if self._failed >= tolerated else NodeStatus.SUCCESS


def counted(number: int, total: int) -> int:
    """Return the number of children meant: a number below zero counts from the end."""
    return max(0, total + number + 1) if number < 0 else number
