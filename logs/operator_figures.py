"""Operators' figures of a run and of many: units an hour, times between failures and assists, first-pass
yield, time to done, utilisation. `docs/operators-figures.md` defines them.

`FigureCounter` counts during a run or over a log, `FigureCounts` is its result, and `OperatorFigures` derives
the figures with their intervals.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Final, Literal, TypeAlias, get_args

import numpy as np

from picktree.world import JournalEvent, Plain, event_types

from .item_episodes import Decision, NodeLike, TransitionLike
from .rates import CONFIDENCE, Interval, Rate, poisson_interval, rate

Activity: TypeAlias = Literal["moving", "thinking", "feed", "recovering", "person"]
"""Use of the cell's time: the first of `person`, `feed`, `recovering`, `moving`, `thinking` that applies."""
ACTIVITIES: Final[tuple[Activity, ...]] = get_args(Activity)
ACTIVITY_TEXTS: Final[Mapping[Activity, str]] = {
    "moving": "moving",
    "thinking": "thinking",
    "feed": "waiting for the feed",
    "recovering": "recovering",
    "person": "waiting for a person",
}
Assist: TypeAlias = Literal["answer", "pause", "take_over", "exchange"]
"""Action of a person: an answer, a pause, another mission or value for the run, a bin exchanged by hand."""
ASSIST_TEXTS: Final[Mapping[Assist, tuple[str, str]]] = {
    "answer": ("answer", "answers"),
    "pause": ("pause", "pauses"),
    "take_over": ("take-over", "take-overs"),
    "exchange": ("bin exchanged by hand", "bins exchanged by hand"),
}
_FEED_NODES: Final = frozenset({"AwaitItems", "ExchangeBin"})
_HOLDING: Final = "Hold"
"""Controller of an arm at rest, as the log has it."""
_MIN_FINGER_MOTION: Final = 3e-4
"""Change of the fingers' joints in a tick from which they move, m or rad."""
_HOUR: Final = 3600.0


@dataclass(frozen=True, slots=True)
class CellMotion:
    """Motion of arm and fingers at a tick."""

    controller: str
    """Name of the arm's controller, such as `Hold` or `Track`."""
    fingers: float
    """Sum of the positions of the fingers' joints, m or rad."""


@dataclass(frozen=True, slots=True)
class FigureCounts:
    """Counts from which the operators' figures of one run, or of a part of it, follow."""

    seconds: float = 0.0
    """Simulated time, s."""
    units: int = 0
    """Number of items at their destination: as scored, or as the robot believes before the end."""
    entered: int = 0
    """Number of items on which the fingers closed, or that failed."""
    first_pass: int = 0
    """Number of units without a grasp in vain and without a failure."""
    set_aside: int = 0
    given_up: int = 0
    """Number of items whose failure nothing cured, and that were not set aside."""
    misplaced: int = 0
    """Number of misplaced items, as scored; crushed ones are left out."""
    crushed: int = 0
    assists: Mapping[Assist, int] = field(default_factory=dict["Assist", int])
    activities: Mapping[Activity, float] = field(default_factory=dict["Activity", float])
    """Simulated time by use, s; empty when the log lacks it."""
    times: tuple[float, ...] = ()
    """Time to done of each unit in the robot's belief, in order, simulated s."""

    @property
    def failures(self) -> int:
        """Number of items that were set aside, given up, misplaced or crushed."""
        return self.set_aside + self.given_up + self.misplaced + self.crushed

    @property
    def assisted(self) -> int:
        """Number of assists."""
        return sum(self.assists.values())

    def minus(self, before: FigureCounts) -> FigureCounts:
        """Return the counts since an earlier moment of the same run.

        An item that failed before and was done since lowers its count of failures, to 0 at least.
        """
        numbers: dict[str, Any] = {
            name: max(getattr(self, name) - getattr(before, name), 0)
            for name in ("seconds", "units", "entered", "first_pass", *FAILURES)
        }
        return FigureCounts(
            **numbers,
            assists={kind: n - before.assists.get(kind, 0) for kind, n in self.assists.items()},
            activities={use: s - before.activities.get(use, 0.0) for use, s in self.activities.items()},
            times=self.times[len(before.times) :],
        )

    def to_json(self) -> dict[str, Plain]:
        values: dict[str, Any] = asdict(self)
        uses = {use: round(seconds, 6) for use, seconds in self.activities.items()}
        values |= {"seconds": round(self.seconds, 6), "activities": uses, "times": list(self.times)}
        return values

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> FigureCounts:
        """Read the counts; further keys are ignored. Raises KeyError or TypeError for other data."""
        counts: dict[str, Any] = {each.name: values[each.name] for each in fields(cls)}
        counts["times"] = tuple(counts["times"])
        return cls(**counts)


FAILURES: Final = ("set_aside", "given_up", "misplaced", "crushed")
"""Counts of failures in `FigureCounts`."""


def added_counts(counts: Iterable[FigureCounts]) -> FigureCounts:
    """Return the sum of the counts of several runs; the times to done in the order of the runs."""
    total, times = FigureCounts(), list[float]()
    for each in counts:
        times += each.times
        total = FigureCounts(
            **{
                name: getattr(total, name) + getattr(each, name)
                for name in ("seconds", "units", "entered", "first_pass", *FAILURES)
            },
            assists=_added(total.assists, each.assists),
            activities=_added(total.activities, each.activities),
        )
    return replace(total, times=tuple(times))


def _added(one: Mapping[Any, Any], other: Mapping[Any, Any]) -> dict[Any, Any]:
    return {key: one.get(key, 0) + other.get(key, 0) for key in (*one, *(k for k in other if k not in one))}


ItemState: TypeAlias = Literal["open", "done", "elsewhere", "aside", "given_up"]


@dataclass
class ItemProgress:
    """Progress of one item, as the robot believes."""

    state: ItemState = "open"
    grasped: bool = False
    troubled: bool = False
    """Whether a grasp was in vain or a failure concerned the item."""


@dataclass
class FigureCounter:
    """Counter of the operators' figures of one run, from belief and sensors only, and its own state in a
    checkpoint.

    Besides a time for each unit its memory does not grow: items that leave with their bin become numbers.
    """

    time: float | None = None
    """Time of the last tick, simulated s; None before the first."""
    began: float = 0.0
    """Time up to which the last unit was done, or failed, simulated s."""
    activity: Activity | None = None
    """Use of the time from the last tick on; None: unknown."""
    fingers: float | None = None
    activities: dict[Activity, float] = field(default_factory=dict["Activity", float])
    assists: dict[Assist, int] = field(default_factory=dict["Assist", int])
    items: dict[str, ItemProgress] = field(default_factory=dict[str, ItemProgress])
    """Items that are still in the cell, by their ids in the belief."""
    gone_units: int = 0
    """Number of units that left with their bins."""
    gone_first_pass: int = 0
    times: list[float] = field(default_factory=list[float])
    waiting: dict[str, Activity] = field(default_factory=dict[str, "Activity"])
    """Running nodes that wait for the feed or a person, by path."""
    recovering: dict[str, str] = field(default_factory=dict[str, str])
    """Path of the failed child by the path of the node that runs a handler against the failure."""

    def __post_init__(self) -> None:
        self._nodes: Mapping[str, NodeLike] = {}
        self.fixed: frozenset[str] = frozenset()
        """Ids of fixtures, bins and totes. A tote that is given up is a failure, but no item."""

    def follow(self, nodes: Iterable[NodeLike]) -> None:
        """Use another tree from the next tick on."""
        self._nodes = {node.path: node for node in nodes}

    def assist(self, kind: Assist) -> None:
        """Count an action of a person that is no event of the run."""
        self.assists[kind] = self.assists.get(kind, 0) + 1

    def take(
        self,
        time: float,
        events: Iterable[JournalEvent],
        decisions: Iterable[Decision],
        changes: Iterable[TransitionLike],
        motion: CellMotion | None,
    ) -> None:
        """Count one tick; arguments as in `RunCounters.take`. `motion` None: unknown."""
        self._pass(time, motion)
        for event in events:
            self._happened(time, event)
        last = {change.path: change.status for change in changes}
        for path, status in last.items():
            self._changed(path, runs=status == "RUNNING")
        for decision in decisions:
            self._decided(time, decision)
        self.activity = self._use(motion)

    def counts(self, now: float) -> FigureCounts:
        """Return the counts up to `now`, simulated s."""
        states = [item.state for item in self.items.values()]
        uses = dict(self.activities)
        if self.time is not None and self.activity is not None and now > self.time:
            uses[self.activity] = uses.get(self.activity, 0.0) + now - self.time
        return FigureCounts(
            seconds=round(now, 6),
            units=self.gone_units + states.count("done"),
            entered=self.gone_units
            + sum(
                item.grasped or item.state != "open"
                for name, item in self.items.items()
                if name not in self.fixed
            ),
            first_pass=self.gone_first_pass
            + sum(item.state == "done" and not item.troubled for item in self.items.values()),
            set_aside=states.count("aside"),
            given_up=states.count("given_up"),
            assists=dict(self.assists),
            activities={use: round(seconds, 6) for use, seconds in uses.items()},
            times=tuple(self.times),
        )

    def _pass(self, time: float, motion: CellMotion | None) -> None:
        """Charge the time since the last tick."""
        use = self.activity
        if motion is not None:
            before, self.fingers = self.fingers, motion.fingers
            if use == "thinking" and before is not None:
                use = "moving" if abs(motion.fingers - before) > _MIN_FINGER_MOTION else use
        if self.time is not None and use is not None:
            self.activities[use] = round(self.activities.get(use, 0.0) + time - self.time, 6)
        self.time = time

    def _use(self, motion: CellMotion | None) -> Activity | None:
        waits = set(self.waiting.values())
        if motion is None:
            return None
        if waits:
            return "person" if "person" in waits else "feed"
        if self.recovering:
            return "recovering"
        return "thinking" if motion.controller == _HOLDING else "moving"

    def _changed(self, path: str, *, runs: bool) -> None:
        if not runs:
            self.waiting.pop(path, None)
            self.recovering.pop(path, None)
            return
        node = self._nodes.get(path)
        if node is not None and node.id in _FEED_NODES:
            self.waiting[path] = "feed"
        if node is not None and node.parent and self.recovering.get(node.parent) == path:
            del self.recovering[node.parent]

    def _happened(self, time: float, event: JournalEvent) -> None:
        match event:
            case event_types.PickEvent(object=subject, held=held):
                item = self._item(subject)
                item.grasped = True
                item.troubled |= not held
            case event_types.ItemDoneEvent(object=subject, into=into):
                self._end(time, subject, "done" if into else "elsewhere")
            case event_types.TookStockEvent(done=done):
                for subject in done or ():
                    self._item(subject).state = "done"
            case event_types.SetAsideEvent(object=subject):
                self._end(time, subject, "aside")
            case event_types.BinEmptiedEvent(objects=objects):
                self._forget(objects)
            case event_types.RecoveryEvent(node=node, failed=failed, ends=False):
                if (child := self._child(node, failed)) is not None:
                    self.recovering[node] = child
            case event_types.HelpWantedEvent(node=node):
                self.waiting[node] = "person"
            case event_types.OperatorAnswerEvent(node=node):
                self.waiting.pop(node, None)
                self.assist("answer")
            case (
                event_types.MissionEditedEvent()
                | event_types.MissionChangedEvent()
                | event_types.BlackboardSetEvent()
            ):
                self.assist("take_over")
            case event_types.BinExchangedEvent(by="person"):
                self.assist("exchange")
            case _:
                pass

    def _decided(self, time: float, decision: Decision) -> None:
        match decision:
            case event_types.EpisodeEvent(item=subject, end=end) if subject and end != "done_instead":
                item = self._item(subject)
                item.troubled = True
                if end in ("given_up", "unhandled") and item.state in ("open", "elsewhere"):
                    self._end(time, subject, "given_up")
            case _:
                pass

    def _end(self, time: float, subject: str, state: ItemState) -> None:
        item = self._item(subject)
        if state == "done" and item.state != "done":
            self.times.append(round(time - self.began, 3))
        item.state = state
        self.began = time

    def _item(self, subject: str) -> ItemProgress:
        return self.items.setdefault(subject, ItemProgress())

    def _forget(self, objects: Iterable[str]) -> None:
        for subject in objects:
            item = self.items.pop(subject, None)
            if item is not None and item.state == "done":
                self.gone_units += 1
                self.gone_first_pass += not item.troubled

    def _child(self, node: str, failed: str) -> str | None:
        """Return the path of the node's child that contains the node `failed`; None for an unknown node."""
        children = self._nodes[node].children if node in self._nodes else ()
        within = (each for each in children if failed == each or failed.startswith(f"{each}/"))
        return next(within, None)


@dataclass(frozen=True, slots=True)
class Estimate:
    """Value with its 95 % interval; None for a value or a limit that the counts leave open."""

    value: float | None
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True)
class TimeToDone:
    """Distribution of the time to done over the units that ended. Failed ones are never done."""

    times: tuple[float, ...]
    """Times of the units, ascending, simulated s."""
    ended: int
    """Number of units and failed items."""

    def share(self, time: float) -> float | None:
        """Return the share of units done within `time`, s; None when none ended."""
        return bisect_right(self.times, time) / self.ended if self.ended else None

    def within(self, share: float) -> float | None:
        """Return the least time within which at least this share was done, s; None when it never was."""
        number = math.ceil(share * self.ended - 1e-9)
        return self.times[number - 1] if 0 < number <= len(self.times) else None

    @property
    def band(self) -> float:
        """Half width of the curve's 95 % band (Dvoretzky, Kiefer, Wolfowitz 1956; Massart 1990)."""
        return min(math.sqrt(math.log(2 / (1 - CONFIDENCE)) / (2 * self.ended)), 1.0) if self.ended else 1.0

    def curve(self, most: int = 200) -> tuple[tuple[float, float], ...]:
        """Return steps of the curve, at most `most` of them: time, s, and share of units done within it."""
        last = {time: number / self.ended for number, time in enumerate(self.times, 1)}
        steps = tuple(last.items())
        stride = math.ceil(len(steps) / most)
        return steps[::-1][::stride][::-1] if stride else ()


_RESAMPLES: Final = 1999
MIN_RUNS_TO_RESAMPLE: Final = 5
"""Least number of runs for an interval by bootstrap over the runs."""


@dataclass(frozen=True)
class OperatorFigures:
    """Operators' figures of one run, or of several together. Times are simulated."""

    runs: tuple[FigureCounts, ...]

    @cached_property
    def total(self) -> FigureCounts:
        return added_counts(self.runs)

    @cached_property
    def units_an_hour(self) -> Estimate:
        """Units an hour. Interval: bootstrap over five runs or more, else exact Poisson."""
        total = self.total
        hours = total.seconds / _HOUR
        if len(self.runs) >= MIN_RUNS_TO_RESAMPLE and hours > 0.0:
            per_second = self._resampled([each.units for each in self.runs])
            return Estimate(total.units / hours, _HOUR * per_second.low, _HOUR * per_second.high)
        return _an_hour(total.units, hours)

    @property
    def failures_an_hour(self) -> Estimate:
        """Failures an hour with the exact Poisson interval."""
        return _an_hour(self.total.failures, self.total.seconds / _HOUR)

    @property
    def assists_an_hour(self) -> Estimate:
        """Assists an hour with the exact Poisson interval."""
        return _an_hour(self.total.assisted, self.total.seconds / _HOUR)

    @property
    def mtbf(self) -> Estimate:
        """Mean time between failures, s, with the exact Poisson interval. No value without a failure."""
        return _between(self.total.failures, self.total.seconds)

    @property
    def mtbf_a(self) -> Estimate:
        """Mean time between failures or assists, s, with the exact Poisson interval."""
        return _between(self.total.failures + self.total.assisted, self.total.seconds)

    @property
    def first_pass_yield(self) -> Rate:
        """Share of the items that entered and were done at the first pass, with Wilson's interval."""
        return rate(self.total.first_pass, self.total.entered)

    @cached_property
    def utilisation(self) -> Mapping[Activity, Estimate]:
        """Share of each use of the time; empty when no run has it. Interval: bootstrap over five runs or
        more."""
        total = self.total.activities
        whole = sum(total.values())
        if whole <= 0.0:
            return {}
        found: dict[Activity, Estimate] = {}
        uses: list[Activity] = [each for each in ACTIVITIES if total.get(each)]
        known = [each for each in self.runs if each.activities]
        for use in uses:
            interval = None
            if len(known) >= MIN_RUNS_TO_RESAMPLE:
                spent = [each.activities.get(use, 0.0) for each in known]
                interval = _resampled_ratio(spent, [sum(each.activities.values()) for each in known])
            share = total[use] / whole
            found[use] = Estimate(share, *((interval.low, interval.high) if interval else (None, None)))
        return found

    @cached_property
    def time_to_done(self) -> TimeToDone:
        total = self.total
        return TimeToDone(tuple(sorted(total.times)), len(total.times) + total.set_aside + total.given_up)

    def to_json(self) -> dict[str, Plain]:
        """Return the derived figures; shares are 0 … 1, times s."""
        first, done = self.first_pass_yield, self.time_to_done
        named: dict[str, Any] = {name: asdict(getattr(self, name)) for name in ESTIMATES}
        return {
            **named,
            "first_pass_yield": {
                "successes": first.successes,
                "total": first.total,
                **asdict(first.interval),
            },
            "utilisation": {use: asdict(each) for use, each in self.utilisation.items()},
            "time_to_done": {
                "ended": done.ended,
                "median": done.within(0.5),
                "within_90": done.within(0.9),
                "band": done.band,
                "curve": [list(step) for step in done.curve()],
            },
        }

    def lines(self) -> Iterator[tuple[str, str]]:
        """Yield title and text of each figure, for a summary."""
        yield "units", f"{_rate_text(self.units_an_hour)}; first pass {self.first_pass_yield}"
        seconds, assisted = self.total.seconds, self.total.assisted
        events = self._failures_text() if assisted else f"{self._failures_text()}, no assist"
        yield "MTBF", _between_text(self.mtbf, events, seconds)
        if assisted:
            yield "MTBF/A", _between_text(self.mtbf_a, self._assists_text(), seconds)
        done = self.time_to_done
        if (half := done.within(0.5)) is not None:
            most = done.within(0.9)
            late = f"90 % within {most:.1f} s" if most is not None else "90 % are never done"
            yield "to done", f"half of the units within {half:.1f} s, {late}"
        if self.utilisation:
            parts = (f"{ACTIVITY_TEXTS[use]} {_share_text(each)}" for use, each in self.utilisation.items())
            yield "time", ", ".join(parts)

    def to_text(self) -> str:
        """Return one line for a live view: `1305 units an hour, MTBF 4.0 min, no assist`."""
        hourly, between = self.units_an_hour.value, self.mtbf.value
        failed = f"MTBF {duration_text(between)}" if between is not None else "no failure"
        return f"{hourly or 0.0:.0f} units an hour, {failed}, {self._assists_text()}"

    def _failures_text(self) -> str:
        counts = ((name.replace("_", " "), getattr(self.total, name)) for name in FAILURES)
        return ", ".join(f"{number} {name}" for name, number in counts if number) or "no failure"

    def _assists_text(self) -> str:
        counts = ((ASSIST_TEXTS[kind], number) for kind, number in self.total.assists.items() if number)
        return ", ".join(f"{number} {words[number > 1]}" for words, number in counts) or "no assist"

    def _resampled(self, counts: Sequence[float]) -> Interval:
        return _resampled_ratio(counts, [each.seconds for each in self.runs])


ESTIMATES: Final = ("units_an_hour", "failures_an_hour", "assists_an_hour", "mtbf", "mtbf_a")
"""Names of the estimates in `OperatorFigures`."""


def _resampled_ratio(above: Sequence[float], below: Sequence[float]) -> Interval:
    """Return the percentile interval of the ratio of sums over runs drawn with replacement."""
    pairs = np.array([above, below], dtype=float)
    drawn = np.random.default_rng(0).integers(pairs.shape[1], size=(_RESAMPLES, pairs.shape[1]))
    sums = pairs[:, drawn].sum(axis=2)
    ratios = sums[0] / np.maximum(sums[1], 1e-12)
    tail = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(ratios, (tail, 100 - tail)).tolist()
    return Interval(low, high)


def _an_hour(events: int, hours: float) -> Estimate:
    if hours <= 0.0:
        return Estimate(None)
    interval = poisson_interval(events)
    return Estimate(events / hours, interval.low / hours, interval.high / hours)


def _between(events: int, seconds: float) -> Estimate:
    interval = poisson_interval(events)
    return Estimate(
        seconds / events if events else None,
        seconds / interval.high,
        seconds / interval.low if events else None,
    )


def _rate_text(found: Estimate) -> str:
    if found.value is None or found.low is None or found.high is None:
        return "none"
    return f"{found.value:.0f} an hour ({found.low:.0f} … {found.high:.0f})"


def _share_text(found: Estimate) -> str:
    value = f"{100 * (found.value or 0.0):.0f}"
    if found.low is None or found.high is None:
        return f"{value} %"
    return f"{value} % ({100 * found.low:.0f} … {100 * found.high:.0f})"


def _between_text(found: Estimate, events: str, seconds: float) -> str:
    if found.low is None:
        return events
    if found.value is None or found.high is None:
        return f"at least {duration_text(found.low)}: {events} in {duration_text(seconds)}"
    interval = f"{duration_text(found.low)} … {duration_text(found.high)}"
    return f"{duration_text(found.value)} ({interval}): {events}"


def duration_text(seconds: float) -> str:
    """Return a duration with a fitting unit.

    >>> duration_text(240.0)
    '4.0 min'
    """
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    return f"{seconds / 60:.1f} min" if seconds < 2 * _HOUR else f"{seconds / _HOUR:.1f} h"
