"""RecoveryNode: Nav2's, a Recover with one cure for every cause."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..trees.node import Node
from ..trees.ports import In, Out, port
from ..trees.slots import children
from ..trees.status import NodeStatus
from ..world.causes import FailureReport, internal, matches
from .recovery_base import Recovering
from .recovery_flow import Cure, Recovery

if TYPE_CHECKING:
    from ..trees.flow.flow_walk import Walk
    from ..trees.mission import NodeSpec


class RecoveryNode(Recovering):
    """Runs its first child; when it fails, runs the second, then the first again, as Nav2's.

    The first child runs once more than `number_of_retries`. The node fails when the second child fails or is
    skipped, with the first one's cause, the cure's attached; and when all retries are used up, with the last
    cause, the earlier ones attached. SKIPPED when the first child is. The tick ends between the two.
    `Recover` chooses the cure by the cause.
    """

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
        # A fault of the program is cured only where somebody names it, which this node cannot.
        return "" if matches(str(internal.ANY), report.cause) else self.parts[1].name

    def cure(self, label: str) -> Node:
        return self.parts[1]

    @classmethod
    def goes_on_after(cls, cure: NodeStatus) -> bool:
        return cure is NodeStatus.SUCCESS

    @classmethod
    def recovery(cls, spec: NodeSpec, walk: Walk) -> Recovery:
        tried, cure = spec.children
        retries = walk.number(spec, "number_of_retries")
        runs = None if retries is None else retries + 1
        return Recovery(tried, (Cure(cure.name, "*", cure),), None, runs, skipped_cure_fails=True)
