"""Results of a batch as JUnit XML: a test case for each job."""

from __future__ import annotations

from ...files.junit import JunitCase, Outcome, junit_text
from .plan import Job
from .store import Store
from .tables import JobRow

_OUTCOMES: dict[str, Outcome] = {"success": "passed", "crashed": "error"}
"""Outcomes of a job by its status; all others are failures."""


def to_junit(store: Store) -> str:
    """Return a file with all jobs of a batch. Times are wall seconds. Jobs that have not run are skipped."""
    cases = [_case(job, store.row(job.id)) for job in store.jobs()]
    return junit_text(store.path.parent.name, cases, {"folder": str(store.path.parent)})


def _case(job: Job, row: JobRow | None) -> JunitCase:
    label, name = job.variant.label or job.variant.mission.stem, f"seed {job.seed}"
    if row is None:
        return JunitCase(label, name, outcome="skipped", message="the job has not run")
    told = [f"job {job.id}: {row.status}" + (f": {row.message}" if row.message else "")]
    if row.sim_seconds is not None:
        items = f"{row.items_sorted} of {row.items_total} items sorted"
        told.append(f"{items} in {row.sim_seconds:g} simulated s")
    told += [f"{what}: {value}" for what, value in _pointers(row) if value]
    outcome = _OUTCOMES.get(row.status, "failure")
    text, passed = "\n".join(told), outcome == "passed"
    return JunitCase(
        label,
        name,
        row.wall_seconds or 0.0,
        outcome,
        row.root_cause or row.status,
        row.message or row.look_at or f"the run ended as {row.status}",
        "" if passed else text,
        text if passed else "",
    )


def _pointers(row: JobRow) -> tuple[tuple[str, str], ...]:
    return ("root cause", row.root_cause), ("look at", row.look_at), ("run", row.folder)
