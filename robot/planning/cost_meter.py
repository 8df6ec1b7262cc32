"""Cost meter: collision checks and descents of a block, in simulated time."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass

from ...world.computing_time import ComputeTimeAccount
from .collision_checker import CollisionChecker
from .inverse_kinematics import InverseKinematics


@dataclass(slots=True)
class MeasuredCost:
    """Cost of a measured block, filled in when it ends: collision checks and simulated s."""

    checks: int = 0
    seconds: float = 0.0


class CostMeter:
    """Meter that charges the use of `collision` and `ik` within `measure` to the thinking account."""

    def __init__(
        self, collision: CollisionChecker, ik: InverseKinematics, thinking: ComputeTimeAccount, cost: float
    ) -> None:
        self._collision = collision
        self._ik = ik
        self._thinking = thinking
        self._cost = cost

    @contextmanager
    def measure(self) -> Generator[MeasuredCost]:
        spent = MeasuredCost()
        checks, solves = self._collision.checks, self._ik.solves
        try:
            yield spent
        finally:
            spent.checks = self._collision.checks - checks
            spent.seconds = (spent.checks + self._ik.solves - solves) * self._cost
            self._thinking.spend(spent.seconds)
