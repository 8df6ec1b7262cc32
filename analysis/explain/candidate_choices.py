"""What was chosen from shortly before a failure: candidates of grasps, and plans, and who dropped out."""

from __future__ import annotations

import re
from collections import Counter
from typing import TYPE_CHECKING

from ...logs.run_log import At
from ...logs.schema.records import Candidates, Plan
from ...logs.visits import Visit
from ...manipulation.pick.candidate_rejections import fates
from .investigation.explanation import Choice, Rejection

if TYPE_CHECKING:
    from ...logs.run_record import RunRecord

PLANS = 3
"""Failing plans in a row that are told."""


def choices_before(run: RunRecord, source: Visit) -> tuple[Choice, ...]:
    """Those within the visit that failed and of its item, in the order of time."""
    found = [
        _of_candidates(at)
        for at in run.candidates
        if source.start - 1e-6 <= at.time <= source.end + 1e-6 and at.record.object == source.item
    ]
    plans = [at for at in run.plans if source.start - 1e-6 <= at.time <= source.end + 1e-6]
    refused = [at for at in plans if at.record.outcome != "found"]
    if refused and plans[-1] is refused[-1]:
        found.append(_of_plans(refused, len(plans), source.item))
    return tuple(sorted(found, key=lambda choice: choice.time))


def _of_candidates(at: At[Candidates]) -> Choice:
    record = at.record
    stages = tuple((stage.name, stage.count) for stage in record.stages)
    found = fates(record.tried, record.into)
    if found:
        rejections = tuple(Rejection(f.name, f.words, f.count, f.stage, f.by) for f in found)
        return Choice(at.time, record.purpose, record.object, stages, rejections)
    refused = Counter(c.verdict for c in record.tried if c.verdict != "accepted")
    names: dict[str, str] = {}
    for candidate in record.tried:
        names.setdefault(candidate.verdict, candidate.name)
    return Choice(
        at.time,
        record.purpose,
        record.object,
        stages,
        tuple(Rejection(names[reason], reason, count) for reason, count in refused.most_common()),
    )


def _of_plans(refused: list[At[Plan]], plans: int, item: str) -> Choice:
    """Plans that failed with the same words, numbers aside, are told as one."""
    alike: dict[str, list[At[Plan]]] = {}
    for at in refused:
        words = re.sub(r"[\d.]+", "#", f"{at.record.outcome} {at.record.message}")
        alike.setdefault(words, []).append(at)
    return Choice(
        refused[-1].time,
        "plan",
        item,
        (("asked for", plans), ("found", plans - len(refused))),
        tuple(
            Rejection(
                group[0].record.request, f"{group[0].record.outcome}: {group[0].record.message}", len(group)
            )
            for group in sorted(alike.values(), key=len, reverse=True)
        ),
    )
