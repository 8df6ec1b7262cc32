"""Rows of a run's results, from its log and from the scorer."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

from ...analysis.explain.explain import explain
from ...analysis.explain.investigation.explanation import FailureStory
from ...analysis.export.table_files import row_of
from ...analysis.run import Run
from ...logs.visits import Visit
from ...session.execution import Execution
from ...simulation.scoring.scorer import score
from ...world.values import ObjectId, Vector3
from ..results.tables import (
    EpisodeRow,
    JobFailureRow,
    JobItemRow,
    JobPickRow,
    JobPlanRow,
    JobRow,
    JobRows,
    JobTimingRow,
    Phase,
    PlantedRow,
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
        look = explanation.look_at
        return JobRows(
            job=row_of(
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
                root_cause=explanation.root_causes[0].cause if explanation.root_causes else "",
                look_at=f"{look[0].time:.2f} s: {look[0].why}" if look else "",
                folder="",
            ),
            items=tuple(_items(execution, run)),
            picks=tuple(row_of(JobPickRow, pick) for pick in run.picks),
            failures=tuple(
                row_of(JobFailureRow, f, handled_by=", ".join(each.handler for each in f.handled_by))
                for f in explanation.failures
            ),
            episodes=tuple(
                row_of(EpisodeRow, e, ended=e.end, handler=e.cure, tried=", ".join(e.tried))
                for e in explanation.recovery.episodes
            ),
            planted=tuple(row_of(PlantedRow, p, ended=p.end or "") for p in explanation.recovery.planted),
            plans=tuple(row_of(JobPlanRow, at.record, time=at.time) for at in run.plans),
            timings=_timings(run, explanation.failures),
            versions={
                **run.info.versions,
                **run.info.arithmetic.words(),
                "revision": run.info.revision,
            },
        )


def _items(execution: Execution, run: Run) -> Iterator[JobItemRow]:
    truth = execution.hardware.truth()
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

    Planning within a skill counts as thinking, a handler's time as recovery.
    """
    spent: defaultdict[Phase, float] = defaultdict(float)
    parents = {visit.parent for visit in run.visits}
    leaves = [visit for visit in run.visits if visit.number not in parents]
    cures = [(h.time, h.time + h.seconds) for f in failures for h in f.handled_by]
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


def _within(visit: Visit, time: float) -> bool:
    return visit.start <= time <= visit.end
