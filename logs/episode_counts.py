"""Counts of episodes and injected faults, for the summary of a run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace

from picktree.world import event_types

from .item_episodes import ENDS, Decision


@dataclass(frozen=True, slots=True)
class CureCount:
    """Counts of the episodes of one cause with the same last cure, in the terms of `episode`."""

    cause: str
    cure: str
    """Last attempted cure; empty without an attempt."""
    seen: int = 0
    cured: int = 0
    given_up: int = 0
    """Number of episodes with vain cures. `seen` is the sum of the five ends."""
    unhandled: int = 0
    open: int = 0
    tries: int = 0
    """Number of attempts in all of the episodes."""
    tries_cured: int = 0
    """Number of attempts in the cured episodes."""
    seconds: float = 0.0
    """Time lost, simulated s."""
    done_instead: int = 0
    """Number of episodes that a handler of `instead` ended: neither cured nor given up."""
    failed_before: tuple[str, ...] = ()
    """Names of the other cures that ran before it in these episodes and failed, each once."""

    def with_(self, other: CureCount) -> CureCount:
        """Return the sum of both counts."""
        numbers = (each.name for each in fields(self) if each.name not in ("cause", "cure", "failed_before"))
        sums = {name: getattr(self, name) + getattr(other, name) for name in numbers}
        failed = tuple(dict.fromkeys((*self.failed_before, *other.failed_before)))
        return replace(self, **sums | {"seconds": round(sums["seconds"], 6)}, failed_before=failed)

    @property
    def to_cure(self) -> int:
        """Number of episodes that needed a cure: all except those with the end `done_instead`."""
        return self.seen - self.done_instead

    @property
    def tries_a_cure(self) -> float | None:
        """Mean number of attempts of a cured episode; None when nothing was cured."""
        return self.tries_cured / self.cured if self.cured else None


NEVER_DUE = "never_due"
"""End in the count of faults whose time did not come, or whose node did not start."""


@dataclass(frozen=True, slots=True)
class PlantedCount:
    """Count of injected faults of one kind with the same first cause after them, and the same end."""

    fault: str
    cause: str
    """Cause of the first failure after the fault; empty when nothing failed."""
    end: str
    """End of that failure's episode; empty without a cause, NEVER_DUE for a fault without any occasion."""
    count: int = 0


@dataclass(frozen=True, slots=True)
class CauseCount:
    """Counts of all episodes of one cause."""

    cause: str
    total: CureCount
    by_cure: tuple[CureCount, ...]
    """Counts by cure, the cure with the most successes first."""

    @property
    def tried(self) -> tuple[str, ...]:
        """Names of all cures that ran, each once, in the order of their runs within an episode."""
        groups = [each for each in self.by_cure if each.cure and each.to_cure]
        return tuple(dict.fromkeys(name for each in groups for name in (*each.failed_before, each.cure)))

    @property
    def failed_before(self) -> str:
        """Text for the cures that failed in cured episodes, ` (LookAgain failed before)`, or empty."""
        names = dict.fromkeys(name for each in self.by_cure if each.cured for name in each.failed_before)
        return f" ({', '.join(names)} failed before)" if names else ""

    def to_text(self) -> str:
        """Return the counts without the cause: `3 seen, 3 cured by RetreatAndLook after 1.3 tries, 12.4 s
        lost`."""
        total = self.total
        parts = [f"{total.seen} seen", self._cured(), self._done_instead()]
        parts.append(f"{total.given_up} given up" if total.cured and total.given_up else "")
        if total.unhandled:
            parts.append(
                "nobody handled it" if total.unhandled == total.seen else f"{total.unhandled} not handled"
            )
        parts.append(f"{total.open} open at the end" if total.open else "")
        parts.append(f"{total.seconds:.1f} s lost" if total.seconds >= 0.05 else "")
        return ", ".join(part for part in parts if part)

    def _cured(self) -> str:
        total = self.total
        if not total.cured:
            tried = ", ".join(self.tried)
            untried = "given up untried" if total.given_up else ""
            return f"none cured (tried: {tried})" if tried else untried
        by = [each for each in self.by_cure if each.cured]
        names = [each.cure if len(by) == 1 else f"{each.cure} ({each.cured})" for each in by]
        tries = total.tries_a_cure or 0.0
        return f"{total.cured} cured by {' or '.join(names)} after {_tries(tries)}{self.failed_before}"

    def _done_instead(self) -> str:
        names = [each.cure for each in self.by_cure if each.done_instead]
        return f"{self.total.done_instead} done instead ({', '.join(names)})" if names else ""


class EpisodeCounts:
    """Counter of episodes and injected faults."""

    def __init__(self, cures: Iterable[CureCount] = (), planted: Iterable[PlantedCount] = ()) -> None:
        self._cures: dict[tuple[str, str], CureCount] = {}
        self._planted: dict[tuple[str, str, str], PlantedCount] = {}
        for cure in cures:
            self.add_cures(cure)
        for fault in planted:
            self.add_faults(fault)

    def add(self, decision: Decision) -> None:
        """Count an episode or an injected fault; single failures are not counted."""
        match decision:
            case event_types.EpisodeEvent():
                self.add_cures(_one(decision))
            case event_types.FaultOutcomeEvent(fault=fault, cause=cause, end=end):
                self.add_faults(PlantedCount(fault, cause, end or "", 1))
            case event_types.FailureDecidedEvent():
                pass

    def add_cures(self, some: CureCount) -> None:
        key = (some.cause, some.cure)
        self._cures[key] = self._cures.get(key, CureCount(*key)).with_(some)

    def add_faults(self, some: PlantedCount) -> None:
        key = (some.fault, some.cause, some.end)
        before = self._planted.get(key, PlantedCount(*key))
        self._planted[key] = replace(before, count=before.count + some.count)

    @property
    def cures(self) -> tuple[CureCount, ...]:
        """Counts by cause; within a cause the cure with the most successes first."""
        return tuple(sorted(self._cures.values(), key=lambda c: (c.cause, -c.cured, -c.seen, c.cure)))

    @property
    def planted(self) -> tuple[PlantedCount, ...]:
        return tuple(self._planted[key] for key in sorted(self._planted))


def by_cause(cures: Iterable[CureCount]) -> tuple[CauseCount, ...]:
    """Return the counts by cause, with the most time lost first."""
    found: dict[str, list[CureCount]] = {}
    for each in cures:
        found.setdefault(each.cause, []).append(each)
    counts = [CauseCount(cause, _sum(cause, each), tuple(each)) for cause, each in found.items()]
    return tuple(sorted(counts, key=lambda c: (-c.total.seconds, -c.total.seen, c.cause)))


def counted(episodes: Iterable[event_types.EpisodeEvent]) -> tuple[CureCount, ...]:
    counts = EpisodeCounts()
    for episode in episodes:
        counts.add(episode)
    return counts.cures


def added_cures(cures: Iterable[CureCount]) -> tuple[CureCount, ...]:
    """Return the counts of several runs together."""
    return EpisodeCounts(cures).cures


def never_due(kinds: Iterable[str]) -> tuple[PlantedCount, ...]:
    """Return the counts of faults that had no occasion, by kind."""
    return added_planted(PlantedCount(kind, "", NEVER_DUE, 1) for kind in kinds)


def added_planted(planted: Iterable[PlantedCount]) -> tuple[PlantedCount, ...]:
    """Return the counts of several runs together."""
    return EpisodeCounts((), planted).planted


def cause_lines(cures: Iterable[CureCount]) -> Iterator[str]:
    """Yield a line for each cause, with the most time lost first."""
    causes: Sequence[CauseCount] = by_cause(cures)
    width = max((len(each.cause) for each in causes), default=0)
    for each in causes:
        yield f"{each.cause:<{width}}  {each.to_text()}"


def planted_lines(planted: Iterable[PlantedCount]) -> Iterator[str]:
    """Yield a line for each count: `2 slip, then grasp.slipped (cured)`."""
    for each in planted:
        if each.end == NEVER_DUE:
            yield f"{each.count} {each.fault} not injected: the time or the node's start did not come"
            continue
        seen = f"{each.cause} ({ENDS[each.end]})" if each.cause else "nothing failed"
        yield f"{each.count} {each.fault}, then {seen}"


def _one(episode: event_types.EpisodeEvent) -> CureCount:
    end = episode.end
    return CureCount(
        episode.cause,
        episode.cure,
        1,
        int(end == "cured"),
        int(end == "given_up"),
        int(end == "unhandled"),
        int(end == "open"),
        episode.tries,
        episode.tries if end == "cured" else 0,
        episode.seconds,
        int(end == "done_instead"),
        episode.failed_before,
    )


def _sum(cause: str, parts: Iterable[CureCount]) -> CureCount:
    total = CureCount(cause, "")
    for part in parts:
        total = total.with_(part)
    return replace(total, failed_before=())


def _tries(number: float) -> str:
    return "1 try" if number == 1.0 else f"{number:.1f} tries".replace(".0 ", " ")
