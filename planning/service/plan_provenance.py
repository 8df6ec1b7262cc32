"""What trajectories were planned for: who checks one again must suppose what its planner supposed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

from ...world.belief.planning_scene import PlanningScene
from ...world.trajectory import Trajectory
from ..requests import JointGoal, Plan, Request

SAME_WIDTH = 0.002
"""Change of the fingers' opening that makes no difference, m."""


@dataclass(frozen=True, slots=True)
class Seen:
    """The belief and the hand for which a trajectory was found free."""

    version: int
    allowed: frozenset[frozenset[str]]
    """Pairs that the scene allowed to touch, beside those of the requests."""
    width: float
    """Opening of the fingers, m."""

    def covers(self, now: Seen, *, width_matters: bool) -> bool:
        """Whether what was free then is free now: nothing new is believed, and nothing allowed then is
        forbidden now."""
        same_hand = not width_matters or abs(self.width - now.width) <= SAME_WIDTH
        return self.version == now.version and self.allowed <= now.allowed and same_hand


@dataclass(frozen=True, slots=True, eq=False)
class Made:
    """What a trajectory was planned for, and the belief in which it was found free last."""

    requests: tuple[Request, ...]
    """One motion's, or those of a chain's legs."""
    passes: tuple[float, ...]
    """When each of them ends, s."""
    seen: Seen


class MadePlans:
    """Remembers plans for as long as somebody keeps their trajectory. Nothing of it outlives a checkpoint,
    because no plan does."""

    def __init__(self, scene: PlanningScene, width: Callable[[], float]) -> None:
        self._scene = scene
        self._width = width
        self._made: WeakKeyDictionary[Trajectory, Made] = WeakKeyDictionary()

    def note(self, plan: Plan) -> None:
        """The plan's trajectory was just found free."""
        requests = [leg.request for leg in plan.legs or (plan,)]
        passes = plan.passes or (plan.trajectory.duration,)
        known = tuple(request for request in requests if request is not None)
        if len(known) == len(passes):
            self._made[plan.trajectory] = Made(known, passes, self.now())

    def renew(self, trajectory: Trajectory) -> None:
        """The trajectory, which need be no plan of ours, was found free in the belief as it is now."""
        made = self._made.get(trajectory)
        if made is None:
            request = Request(JointGoal(trajectory.end), trajectory.start)
            made = Made((request,), (trajectory.duration,), self.now())
        self._made[trajectory] = replace(made, seen=self.now())

    def of(self, trajectory: Trajectory) -> Made | None:
        """None: no plan of ours, and never found free."""
        return self._made.get(trajectory)

    def now(self) -> Seen:
        snapshot = self._scene.snapshot()
        return Seen(snapshot.version, snapshot.allowed, self._width())
