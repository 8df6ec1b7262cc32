"""In which manner motions are planned for a while: another seed, more checks, more room."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..requests import LineGoal, OffsetGoal, Request


@dataclass(frozen=True, slots=True)
class PlannerOverrides:
    """Changes what is asked of the planner; as it stands it changes nothing."""

    seed: int = 0
    """Another one draws other random numbers."""
    budget: float = 1.0
    """How many times the collision checks that a request would get."""
    clearance: float = 0.0
    """Added to the room that free motions keep, m. A straight line goes close to things on purpose."""

    def __and__(self, inner: PlannerOverrides) -> PlannerOverrides:
        """Both at once, the other within this one."""
        seed = inner.seed or self.seed
        return PlannerOverrides(seed, self.budget * inner.budget, self.clearance + inner.clearance)

    def of(self, request: Request) -> Request:
        """The request as it is asked in this manner."""
        if self.budget == 1.0 and not self.clearance:
            return request
        budget = max(1, round(request.budget * self.budget))
        straight = isinstance(request.target, LineGoal | OffsetGoal)
        clearance = request.clearance + (0.0 if straight else self.clearance)
        return replace(request, budget=budget, clearance=clearance)

    def stream(self, name: str) -> str:
        """The stream of random numbers that takes the place of the one of that name."""
        return f"{name} seed {self.seed}" if self.seed else name
