"""Motion plans: the answers to requests."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from picktree.world import (
    Array,
    Cause,
    Evidence,
    Failure,
    Trajectory,
    Vector3,
)

from .requests import Request

if TYPE_CHECKING:
    pass


@dataclass(frozen=True, slots=True, eq=False)
class PlannedPath:
    """Path of one motion, without time: (m, n) rad, its corners not yet rounded."""

    path: Array
    planner: str
    """Planner that found it: the chosen one's name; of `auto`: `direct`, `RRTConnect` or `CBiRRT`; `line`,
    `chain`."""
    checks: int
    """Number of spent collision checks of configurations."""
    goal_index: int = 0
    """Index of the goal's pose that was reached."""
    fraction: float = 1.0
    """Share of a straight line that is free and reachable, 0 … 1."""
    request: Request | None = None
    """Request that was planned for, with its start filled in. The legs of a chain have one each."""
    version: int = 0
    """Belief version that was planned in."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MotionPlan(PlannedPath):
    """Executable motion plan: a path with its trajectory."""

    trajectory: Trajectory
    passes: tuple[float, ...] = ()
    """Times at which a chain's trajectory passes the end of each leg, s; () without a chain."""
    legs: tuple[PlannedPath, ...] = ()
    """Paths of a chain's legs; () without a chain."""


@dataclass(frozen=True, slots=True)
class ContactPair:
    """Pair of bodies that touch or come closer than the margin: names and distance (negative: depth), m."""

    a: str
    b: str
    distance: float
    point: Vector3 = field(default=(0.0, 0.0, 0.0))
    margin: float = 0.0
    """Margin between the two, m; 0 where it is not known."""


class LegFailure(Failure):
    """Planning failure of one leg of a motion chain."""

    def __init__(self, cause: Cause, message: str, leg: int, evidence: Evidence) -> None:
        """`leg`: index of the leg, from 0. It is part of the evidence, too."""
        super().__init__(cause, message, **{**evidence, "leg": leg})
        self.leg = leg
