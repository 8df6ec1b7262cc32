"""Planner overrides: another seed, more collision checks, or more clearance for a part of a mission."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..requests import LineGoal, OffsetGoal, Request


@dataclass(frozen=True, slots=True)
class PlannerOverrides:
    """Overrides of requests to the planner; the defaults change nothing."""

    seed: int = 0
    """Seed of other random numbers; 0: the usual ones."""
    budget: float = 1.0
    """Factor on the collision checks that a request may spend."""
    clearance: float = 0.0
    """Addition to the clearance of free motions, m. A straight line goes close to bodies on purpose."""

    def __and__(self, inner: PlannerOverrides) -> PlannerOverrides:
        """Combine two overrides, the other within this one."""
        seed = inner.seed or self.seed
        return PlannerOverrides(seed, self.budget * inner.budget, self.clearance + inner.clearance)

    def of(self, request: Request) -> Request:
        """Return the request with the overrides applied."""
        if self.budget == 1.0 and not self.clearance:
            return request
        budget = max(1, round(request.budget * self.budget))
        straight = isinstance(request.target, LineGoal | OffsetGoal)
        clearance = request.clearance + (0.0 if straight else self.clearance)
        return replace(request, budget=budget, clearance=clearance)

    def stream(self, name: str) -> str:
        """Return the stream of random numbers that replaces the one of that name."""
        return f"{name} seed {self.seed}" if self.seed else name
