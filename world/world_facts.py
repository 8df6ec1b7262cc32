"""Facts of the world: names that every expression of a mission may use, besides the blackboard's keys."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

from picktree.world.scene import destinations

from .planning_scene import BeliefObject, PlanningScene
from .protocols import FeedSignals
from .values import ObjectId, Pose


class NamedCandidate(Protocol):
    @property
    def name(self) -> str: ...


C = TypeVar("C", bound=NamedCandidate)
UNCHANGED_DISTANCE, UNCHANGED_TURN = 0.003, math.radians(3.0)
"""Displacement, m, and rotation, rad, of a believed object up to which it counts as unchanged: a camera's
noise."""
SURROUNDINGS_RADIUS = 0.35
"""Distance of objects from another one up to which they may be in the way of a hand at it, m."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Failure that geometry alone decides, with the belief that decided it."""

    message: str
    around: Mapping[ObjectId, Pose]
    """The object and all others near it, as believed."""
    in_bins: int
    """Number of objects believed in bins."""

    @classmethod
    def of(cls, message: str, subject: BeliefObject, scene: PlanningScene) -> Refusal:
        around = {o.id: o.pose for o in scene.objects if o.pose.distance(subject.pose) <= SURROUNDINGS_RADIUS}
        return cls(message, around, sum(o.place in scene.bins for o in scene.objects))

    def is_valid(self, subject: BeliefObject, scene: PlanningScene) -> bool:
        """Return whether nothing has changed around the object since."""
        now = Refusal.of("", subject, scene)
        return (
            now.in_bins == self.in_bins
            and now.around.keys() == self.around.keys()
            and all(
                pose.distance(self.around[name]) <= UNCHANGED_DISTANCE
                and pose.angle(self.around[name]) <= UNCHANGED_TURN
                for name, pose in now.around.items()
            )
        )


class AttemptMemory:
    """Memory of attempts: names of failed candidates for each (node path, object), and refusals. A refusal is
    valid until something changes around its object."""

    def __init__(self) -> None:
        self._tried: dict[str, list[str]] = {}
        self.refusals: dict[str, Refusal] = {}
        """Refusals by `skill|object`."""

    def refuse(self, skill: str, subject: BeliefObject, scene: PlanningScene, message: str) -> None:
        """Record that a skill cannot handle an object in the present scene."""
        self.refusals[f"{skill}|{subject.id}"] = Refusal.of(message, subject, scene)

    def refusal(self, skill: str, subject: BeliefObject, scene: PlanningScene) -> str | None:
        """Return the message of a refusal that is still valid; None without one."""
        found = self.refusals.get(f"{skill}|{subject.id}")
        return found.message if found is not None and found.is_valid(subject, scene) else None

    def remaining(self, node: str, subject: str, candidates: Iterable[C]) -> list[C]:
        """Return the candidates that this node has not tried on this subject, in their order.

        When all were tried the memory is cleared and all are offered again: the scene may have changed.
        """
        ranked = list(candidates)
        tried = self._tried.get(f"{node}|{subject}", [])
        fresh = [c for c in ranked if c.name not in tried]
        if not fresh and ranked:
            self._tried.pop(f"{node}|{subject}", None)
            return ranked
        return fresh

    def count(self, node: str, subject: str) -> int:
        """Return the number of candidates that were tried since the memory was last cleared."""
        return len(self._tried.get(f"{node}|{subject}", ()))

    def failed(self, node: str, subject: str, candidate: str) -> None:
        self._tried.setdefault(f"{node}|{subject}", []).append(candidate)

    def clear(self, node: str, subject: str) -> None:
        self._tried.pop(f"{node}|{subject}", None)

    def forget(self, subject: str) -> None:
        """Discard all attempts and refusals of an object that is gone for good."""
        for memory in (self._tried, self.refusals):
            for key in [key for key in memory if key.rpartition("|")[2] == subject]:
                del memory[key]

    @property
    def objects(self) -> frozenset[str]:
        """Objects with failed candidates or refusals."""
        return frozenset(key.rpartition("|")[2] for key in (*self._tried, *self.refusals))

    def state(self) -> dict[str, list[str]]:
        return {key: list(names) for key, names in self._tried.items()}

    def restore(self, state: Mapping[str, Iterable[str]]) -> None:
        self._tried = {key: list(names) for key, names in state.items()}


@dataclass(frozen=True, slots=True)
class FeedProgressState:
    """See `FeedProgress`."""

    deliveries: int = 0
    exchanges: Mapping[ObjectId, int] = field(default_factory=dict[ObjectId, int])


class FeedProgress:
    """Counts of deliveries and exchanges that the belief contains; later ones are new."""

    def __init__(self) -> None:
        self.deliveries = 0
        """Number of deliveries that were looked at or are no longer waited for."""
        self._exchanges: dict[ObjectId, int] = {}

    def exchanged(self, signals: FeedSignals) -> tuple[ObjectId, ...]:
        """Return the bins that were exchanged since the last call."""
        counts = signals.exchanges
        found = tuple(bin_id for bin_id, n in counts.items() if n > self._exchanges.get(bin_id, 0))
        self._exchanges.update((bin_id, counts[bin_id]) for bin_id in found)
        return found

    def state(self) -> FeedProgressState:
        return FeedProgressState(self.deliveries, dict(self._exchanges))

    def restore(self, state: FeedProgressState) -> None:
        self.deliveries = state.deliveries
        self._exchanges = dict(state.exchanges)


ASIDE = "aside"
"""The place of an item that the mission has given up."""
TAKEN_AWAY = "taken away with its bin"
"""Reason to remove an object from the belief when its bin is exchanged for an empty one."""
RODE_ON = "the belt carries it on"
"""Reason to remove an object from the belief when the belt below it may run."""
FACTS: Mapping[str, type[bool] | type[int] | type[float] | type[str]] = {
    "items_left": bool,
    "items_to_do": int,
    "holding": bool,
    "held_object": str,
    "stopped": bool,
    "feed_exhausted": bool,
    "items_done": int,
    "time": float,
}
"""Their names and types."""
GRASP, PUSH = "grasp", "push"
"""Skills whose refusals are remembered."""


def items_to_do(scene: PlanningScene) -> tuple[BeliefObject, ...]:
    """Return the items that are believed to be outside their destination and are not set aside."""
    return tuple(
        o
        for o in scene.objects
        if o.role == "item"
        and o.place != ASIDE
        and (to := scene.destination(o.id)) is not None
        and not destinations.is_at(o.place, to)
    )


def facts(
    scene: PlanningScene, *, looked: bool, stopped: bool, exhausted: bool, done: int, now: float
) -> Mapping[str, bool | int | float | str]:
    """Return the values of the facts. `items_left` is true also before the first look, when the table is
    unknown, and while a heap is left.

    `exhausted`: the feed signals that nothing more will come; `done`: items placed so far.
    """
    held = scene.held
    left = len(items_to_do(scene))
    heaped = any(o.role == "heap" and o.place != ASIDE for o in scene.objects)
    return {
        "items_left": left > 0 or heaped or not looked,
        "items_to_do": left,
        "holding": held is not None,
        "held_object": held.id if held else "",
        "stopped": stopped,
        "feed_exhausted": exhausted,
        "items_done": done,
        "time": now,
    }
