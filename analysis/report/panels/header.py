"""Header panel: the run's settings and outcome, and data for all panels: tick times, failures, landmarks."""

from __future__ import annotations

import numpy as np

from ...explain.investigation.explanation import ExplainedOutcome
from ...run import Run
from ..page_data.packing import Packable, Section

_OUTCOME_COLOURS = {"success": "success", "paused": "open", "interrupted": "open", "killed": "open"}
"""Colour class of the outcome; any other outcome is a failure."""


def pack_run(run: Run) -> Section:
    explanation = run.explanation
    failures: list[Packable] = [
        {
            "time": story.time,
            "tick": story.tick,
            "node": story.node,
            "cause": story.cause,
            "item": story.item,
            "fate": story.fate,
        }
        for story in explanation.failures
    ]
    done: list[Packable] = [
        {"time": at.time, "label": at.record.message} for at in run.events if at.record.kind == "item_done"
    ]
    faults: list[Packable] = [
        {"time": at.time, "label": at.record.message} for at in run.events if at.record.kind == "fault"
    ]
    return Section(
        "run",
        {
            "mission": run.info.mission,
            "remark": f"{run.info.scene} · seed {run.info.seed}",
            "outcome": _outcome(explanation.outcome),
            "facts": [[name, value] for name, value in _facts(run)],
            "notes": list(_notes(run)),
            "times": np.array(run.ticks.times, dtype=np.float64),
            "failures": failures,
            "done": done,
            "faults": faults,
        },
    )


def summary(run: Run) -> str:
    """Return the run in one line."""
    outcome = run.explanation.outcome
    items = _items(outcome)
    return f"{run.info.mission}, seed {run.info.seed}: {outcome.status}" + (f", {items}" if items else "")


def _outcome(outcome: ExplainedOutcome) -> Packable:
    return {
        "word": outcome.status,
        "kind": _OUTCOME_COLOURS.get(outcome.status, "failure"),
        "sentence": outcome.sentence,
        "items": _items(outcome),
    }


def _items(outcome: ExplainedOutcome) -> str:
    if outcome.items_total is None:
        return ""
    return f"{outcome.items_sorted} of {outcome.items_total} items sorted"


def _facts(run: Run) -> list[tuple[str, str]]:
    """Return names and values, the most important ones first."""
    info, result = run.info, run.result
    rows = [
        ("Outcome", run.explanation.outcome.sentence),
        ("Mission", info.mission),
        ("Scene", info.scene),
        ("Robot", info.robot),
        ("Seed", str(info.seed)),
        ("Backend", info.backend),
        ("Simulated", f"{run.end:.2f} s in {len(run.ticks)} ticks of {info.tick:g} s"),
    ]
    if info.parameters:
        rows.append(("Parameters", ", ".join(f"{name}={value}" for name, value in info.parameters.items())))
    if result is not None:
        picks = result.picks
        rows.append(("Grasps", f"{picks.held} of {picks.tried} held"))
        rows.append(("Thinking", "charged" if result.thinking_charged else "takes no simulated time"))
        rows.append(("Digest", result.digest))
    rows.append(("picktree", " ".join(filter(None, (info.versions.get("picktree", ""), info.revision)))))
    rows.append(("Log", str(run.path)))
    return rows


def _notes(run: Run) -> list[str]:
    """Return remarks that limit the reliability of the page."""
    notes: list[str] = []
    if run.recovered:
        notes.append(run.recovered)
    if run.log.format < 2:
        notes.append(
            "A log of format 1: it does not tell when nodes began and ended. Failures and lanes are what the "
            "statuses of its ticks tell."
        )
    return notes
