"""Moments of a run in order of time, each with content and caption of an image."""

from __future__ import annotations

import bisect
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from picktree.files import PicktreeError
from picktree.logs import RunLog, Stamped, log_records, node_visits
from picktree.world import Plan, Tick, event_types

from .captions import Caption, CaptionFailure
from .scene_view import SceneContent, Show

MAX_JOINT_DIFFERENCE = 0.02
"""Difference below which two joint positions are equal, rad."""
ARRIVAL_TOLERANCE = 0.1
"""Time after its end for which a plan still counts as followed, s: the arm has to arrive."""


@dataclass(frozen=True, slots=True)
class _Span:
    """Plan, and the span in which it is followed, simulated s."""

    start: float
    end: float
    plan: Plan


class FollowedPlans:
    """Successful plans with the times at which they are followed.

    The times are inferred, because the log does not record execution. A plan that begins at the end of the
    one before follows it; any other replaces it.
    """

    def __init__(self, plans: Iterable[Stamped[Plan]]) -> None:
        self._all: list[_Span] = []
        for at in plans:
            plan = at.record
            if plan.outcome != "found":
                continue
            start = at.time + plan.thinking
            if self._all and _continues_plan(self._all[-1].plan, plan):
                start = max(start, self._all[-1].end)
            self._all.append(_Span(start, start + plan.duration, plan))
        self._starts = [following.start for following in self._all]

    def at(self, time: float) -> Plan | None:
        """Return the plan that is followed at that time, simulated s; None for none."""
        number = bisect.bisect_right(self._starts, time) - 1
        if number < 0 or time > self._all[number].end + ARRIVAL_TOLERANCE:
            return None
        return self._all[number].plan


def _continues_plan(before: Plan, plan: Plan) -> bool:
    return bool(before.path and plan.path) and all(
        abs(a - b) < MAX_JOINT_DIFFERENCE for a, b in zip(before.path[-1], plan.path[0], strict=True)
    )


R = TypeVar("R")

_LEAD_TIME = 60.0
"""Time before the first moment from which nodes are followed, simulated s. Visits that began earlier are
shown without their item."""
_TIME_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class FrameContent:
    """Content of an image and its caption."""

    shown: SceneContent
    caption: Caption


class _Latest(Generic[R]):
    """Last record at a time or before, for times that never decrease."""

    def __init__(self, first: Stamped[R] | None, coming: Iterator[Stamped[R]]) -> None:
        self._now, self._coming = first, coming
        self._next = next(coming, None)

    def at(self, time: float) -> Stamped[R] | None:
        while self._next is not None and self._next.time <= time + _TIME_TOLERANCE:
            self._now, self._next = self._next, next(self._coming, None)
        return self._now


class NodeActivity:
    """Activity and failures of nodes from `start` to `end`, simulated s."""

    def __init__(self, log: RunLog, start: float, end: float) -> None:
        trees = list(log.trees())
        following = node_visits.VisitBuilder()
        if trees:
            following.follow(trees[0].record)
        coming = trees[1:]
        self._times: list[float] = []
        self._tips: list[tuple[str, str, str]] = []
        for at in log.ticks(max(0.0, start - _LEAD_TIME), end):
            while coming and coming[0].time <= at.time:
                following.follow(coming.pop(0).record)
            following.take(at.time, at.record)
            self._times.append(at.time)
            self._tips.append(_tip(at.record))
        visits = following.finish()
        self._visits: dict[str, list[node_visits.Visit]] = {}
        for visit in visits:
            self._visits.setdefault(visit.path, []).append(visit)
        self.failures = tuple(sorted((v for v in visits if v.failed_itself), key=lambda visit: visit.end))

    def doing(self, time: float) -> tuple[str, str]:
        """Return the deepest running node with the item that it is about, and its message."""
        number = bisect.bisect_right(self._times, time + _TIME_TOLERANCE) - 1
        if number < 0:
            return "", ""
        path, node, message = self._tips[number]
        visits = self._visits.get(path, [])
        begun = bisect.bisect_right(visits, time + _TIME_TOLERANCE, key=lambda visit: visit.start) - 1
        visit = visits[begun] if begun >= 0 else None
        if visit is None or not visit.item:
            return node, message
        words = [visit.item]
        into = visit.inputs.get("into")
        if isinstance(into, str):
            words.append(f"→ {into}")
        if visit.attempt > 1:
            words.append(f"· attempt {visit.attempt}")
        if message:
            words.append(f"· {message}")
        return node, " ".join(words)

    def trouble(self, time: float, hold: float) -> CaptionFailure | None:
        """Return the last failure of the `hold` simulated seconds before; None for none."""
        number = bisect.bisect_right(self.failures, time + _TIME_TOLERANCE, key=lambda visit: visit.end) - 1
        if number < 0 or time - self.failures[number].end >= hold - _TIME_TOLERANCE:
            return None
        return CaptionFailure(self.failures[number].cause, self.failures[number].message)


def moments(
    log: RunLog,
    times: Iterable[float],
    span: tuple[float, float],
    *,
    show: Show = "belief",
    hold: float = 2.0,
    speed: float = 1.0,
    bar: bool = False,
) -> Iterator[FrameContent]:
    """Yield the moments at `times` (rising, simulated s) within `span`.

    A failure is shown for `hold` simulated seconds; `speed` is shown when it is not 1. `bar` adds the share
    of the span that has passed, with its failures. Raises PicktreeError where the log lacks the content.
    """
    start, end = span
    story = NodeActivity(log, start, end)
    frames = _Latest(log.transforms_at(start), log.transforms(start, end))
    beliefs = _Latest(log.belief_at(start), log.beliefs(start, end))
    truths = _Latest(log.truth_at(start), _truths(log, span) if show != "belief" else iter(()))
    followed = FollowedPlans(log.plans(max(0.0, start - 10.0), end))
    items = ItemCounter(log, end)
    note = " · ".join(_notes(show, speed))
    long = max(end - start, 1e-9)
    shares = ((visit.end - start) / long for visit in story.failures)
    marks = tuple(share for share in shares if bar and share >= 0)
    for time in times:
        belief, truth = beliefs.at(time), truths.at(time)
        solid = belief if show != "truth" else truth
        if solid is None:
            wanted = "truth" if show == "truth" else "belief"
            raise PicktreeError(f"{log.path}: the log holds no {wanted} at {time:g} s or before")
        transforms, scene = frames.at(time), solid.record
        if belief is not None and not scene.fixed:
            scene = log_records.Scene(scene.bodies, belief.record.fixed)
        node, message = story.doing(time)
        yield FrameContent(
            SceneContent(
                {t.child: t.pose for t in transforms.record} if transforms else {},
                scene,
                truth.record if show == "both" and truth else None,
                plan.tool_path if (plan := followed.at(time)) else (),
            ),
            Caption(
                time,
                node,
                message,
                items.done(time),
                note,
                story.trouble(time, hold),
                (time - start) / long if bar else None,
                marks,
            ),
        )


def _truths(log: RunLog, span: tuple[float, float]) -> Iterator[Stamped[log_records.Scene]]:
    """Yield the truth within a span as often as the log has it: a held item stays in the hand."""
    from picktree.analysis.explain import true_scenes, true_states  # slow to import

    start, end = span
    for at in true_scenes(list(log.truths(end=end)), true_states(log)):
        if start <= at.time <= end:
            yield at


class ItemCounter:
    """Number of items done at a time.

    The count of a resumed run begins with the number of its checkpoint. A later file of a rotated log counts
    its own items only.
    """

    def __init__(self, log: RunLog, end: float) -> None:
        done: dict[str, float] = {}
        for at in log.events(end=end):
            if isinstance(at.record, event_types.ItemDoneEvent):
                done.setdefault(at.record.object, at.time)
        self._times = sorted(done.values())
        self._before = self._all = 0
        self._since = ""
        if log.part > 1:
            self._since = next((f" since {at.time:.1f} s" for at in log.ticks()), "")
            return
        if log.run.continues is not None:
            self._before = log.run.continues.items_done
        truth = log.truth_at(0.0) or next(log.truths(end=end), None)
        self._all = sum(1 for body in truth.record.bodies if body.role == "item") if truth else 0

    def done(self, time: float) -> str:
        """Return the number as text."""
        number = self._before + bisect.bisect_right(self._times, time + _TIME_TOLERANCE)
        if self._all >= max(1, self._before + len(self._times)):
            return f"{number} of {self._all} items done"
        return f"{number} item{'' if number == 1 else 's'} done{self._since}"


def _notes(show: Show, speed: float) -> Iterator[str]:
    """Yield remarks without which the image could be misread."""
    if show == "both":
        yield "outlines: truth"
    elif show == "truth":
        yield "truth"
    if speed != 1:
        yield f"{speed:g}×"


def _tip(tick: Tick) -> tuple[str, str, str]:
    """Return path, type and message of the deepest running node; the outcome when none runs."""
    node = next((n for n in tick.nodes if n.path == tick.tip), None)
    if node is not None:
        return node.path, node.id, node.message
    return "", "" if tick.root_status in ("RUNNING", "IDLE") else tick.root_status, ""
