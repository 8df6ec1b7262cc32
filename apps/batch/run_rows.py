"""Rows of a finished run for the batch's tables."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

from picktree.analysis import Run
from picktree.analysis.explain import Explanation, FailureStory, RootCause, explain
from picktree.analysis.export import table_files
from picktree.logs import node_visits
from picktree.session import Execution
from picktree.simulation import score
from picktree.world import ObjectId, Vector3

from .tables import (
    EpisodeRow,
    FigureRow,
    JobFailureRow,
    JobItemRow,
    JobPickRow,
    JobPlanRow,
    JobRow,
    JobRows,
    JobTimingRow,
    Phase,
    PlantedRow,
    TimeToDoneRow,
)

_PHASES: dict[str, Phase] = {
    "Observe": "observe",
    "Grasp": "grasp",
    "Place": "place",
    "GoTo": "move",
    "SafeRetreat": "move",
}
"""Phase of a leaf's time outside of recovery, by node ID."""


def collect_run_rows(execution: Execution, folder: Path, attempts: int) -> JobRows:
    """Return the rows of a finished execution; `folder` is that of the run."""
    with Run(folder) as run:
        result = run.result
        assert result is not None, "a session that has ended writes its result"
        explanation = explain(run, items=False)
        root = root_of(explanation)
        return JobRows(
            job=table_files.row_of(
                JobRow,
                result,
                attempts=attempts,
                items_total=result.items.total,
                items_sorted=result.items.sorted,
                items_misplaced=result.items.misplaced,
                items_left=result.items.left,
                picks_tried=result.picks.tried,
                picks_held=result.picks.held,
                wall_seconds=result.wall_seconds.total,
                last_tick=len(run.ticks) - 1,
                root_cause=root.cause if root else "",
                look_at=look_at(explanation, root),
                folder="",
            ),
            items=tuple(_items(execution, run)),
            picks=tuple(table_files.row_of(JobPickRow, pick) for pick in run.picks),
            failures=tuple(
                table_files.row_of(
                    JobFailureRow, f, handled_by=", ".join(each.handler for each in f.handled_by)
                )
                for f in explanation.failures
            ),
            episodes=tuple(
                table_files.row_of(EpisodeRow, e, ended=e.end, handler=e.cure, tried=", ".join(e.tried))
                for e in explanation.recovery.episodes
            ),
            planted=tuple(
                table_files.row_of(PlantedRow, p, ended=p.end or "") for p in explanation.recovery.planted
            ),
            plans=tuple(table_files.row_of(JobPlanRow, at.record, time=at.time) for at in run.plans),
            timings=_timings(run, explanation.failures),
            figures=tuple(FigureRow.of(counts) for counts in run.operator_figures.runs),
            times_to_done=tuple(
                TimeToDoneRow(number, seconds)
                for number, seconds in enumerate(run.operator_figures.total.times)
            ),
            versions={
                **run.info.versions,
                **run.info.arithmetic.words(),
                "revision": run.info.revision,
            },
        )


def root_of(explanation: Explanation) -> RootCause | None:
    """Return the root cause that cost the goal, else the first; None without one."""
    roots = explanation.root_causes
    return next((root for root in roots if root.ended_run), roots[0] if roots else None)


def look_at(explanation: Explanation, root: RootCause | None) -> str:
    """Return a line on the root cause, or else on the first key moment; empty without both."""
    if root is not None:
        first = explanation.failures[root.failures[0]].time if root.failures else None
        time = first if root.time is None else root.time
        return root.title if time is None else f"{time:.2f} s: {root.title}"
    look = explanation.look_at
    return f"{look[0].time:.2f} s: {look[0].why}" if look else ""


def _items(execution: Execution, run: Run) -> Iterator[JobItemRow]:
    assert execution.stage is not None, "a batch runs in simulation"
    truth = execution.stage.simulation.truth()
    arrivals = _arrivals(run, {body.id for body in truth})
    scores = {item.id: item for item in score(truth, execution.recipe.scene).items}
    for body in truth:
        judged = scores[body.id]
        arrived, (x, y, _) = arrivals.get(body.id, (0.0, body.pose.position))
        yield JobItemRow(
            str(body.id), body.kind, body.form, body.colour, x, y, arrived,
            judged.destination, judged.bin, judged.verdict,
        )  # fmt: skip


def _arrivals(run: Run, wanted: set[ObjectId]) -> dict[ObjectId, tuple[float, Vector3]]:
    """Return time (simulated s) and place (m) of each item's first presence: at the start, or from a feed."""
    found: dict[ObjectId, tuple[float, Vector3]] = {}
    for number, at in enumerate(run.log.truths()):
        for body in at.record.bodies:
            if body.id in wanted and body.id not in found:
                found[ObjectId(body.id)] = (at.time if number else 0.0, body.pose.position)
        if len(found) == len(wanted):
            break
    return found


def _timings(run: Run, failures: Sequence[FailureStory]) -> tuple[JobTimingRow, ...]:
    """Return the simulated time by phase, s.

    Planning within a skill counts as thinking, a handler's time as recovery; one of `instead` is work.
    """
    spent: defaultdict[Phase, float] = defaultdict(float)
    parents = {visit.parent for visit in run.visits}
    leaves = [visit for visit in run.visits if visit.number not in parents]
    handled = (h for f in failures for h in (f.handled_by[:-1] if f.done_instead else f.handled_by))
    cures = [(h.time, h.time + h.seconds) for h in handled]
    thought = [(at.time, at.record.thinking) for at in run.plans]
    for leaf in leaves:
        if any(start <= leaf.start and leaf.end <= end for start, end in cures):
            spent["recover"] += leaf.duration
            continue
        thinking = sum(seconds for time, seconds in thought if _within(leaf, time))
        thinking = min(thinking, leaf.duration)
        spent["think"] += thinking
        spent[_PHASES.get(leaf.id, "other")] += leaf.duration - thinking
    return tuple(JobTimingRow(phase, round(seconds, 6)) for phase, seconds in spent.items() if seconds > 0)


def _within(visit: node_visits.Visit, time: float) -> bool:
    return visit.start <= time <= visit.end
