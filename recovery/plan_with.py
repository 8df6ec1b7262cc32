"""PlanWith: planner overrides while a branch runs."""

from __future__ import annotations

from contextlib import nullcontext
from typing import TYPE_CHECKING, cast

from ..planning.requests import PlannerOverrides
from ..trees.controls.decorator import Decorator
from ..trees.flow import FlowState, NodeOutcomes, OutcomeCollector
from ..trees.ports import In, port
from ..trees.status import NodeStatus
from ..trees.values.port_types import PortValues

if TYPE_CHECKING:
    from ..planning.service.plan_service import PlanService
    from ..trees.flow.flow_walk import FlowAnalysis
    from ..trees.mission import NodeSpec


class PlanWith(Decorator):
    """While its child runs, motions are planned with another seed, more collision checks, or more room.

    It holds for what the child itself plans, and only in its own ticks: however the child ends, everything is
    planned as before afterwards. Where one stands in the other, budgets multiply and clearances add up.
    """

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
    by_turns = True
    steady = True

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str, ...]:
        if not given.any_of("seed", "budget", "clearance"):
            return ("without `seed`, `budget` or `clearance` it changes nothing",)
        return ()

    def on_tick(self) -> NodeStatus:
        # A rehearsal has no planner.
        plan = cast("PlanService | None", getattr(self.world, "plan", None))
        manner = PlannerOverrides(self.seed, self.budget, self.clearance)
        with plan.in_manner(manner) if plan is not None else nullcontext():
            return self.relay()

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        ends = OutcomeCollector()
        ends.take(walk.child(spec.children[0], (entry,)))
        return ends.flow()
