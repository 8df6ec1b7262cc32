"""Report of a batch: results on one page, with links to reports of the worst runs; and as JUnit XML."""

from __future__ import annotations

import json
import os
import shlex
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

from picktree.analysis import Run
from picktree.analysis.report import write_report as write_run_report
from picktree.files import JunitCase, Outcome, PicktreeError, file_system, junit_text
from picktree.logs import rate

from .plan import Job, read_plan
from .store import RESULTS_FILE, Store
from .summary import WorstJob, summarise
from .tables import CELL_SIZE, JobRow

_PAGE = Path(__file__).parent / "page"
MAX_SHOWN_JOBS = 5_000
"""Maximum number of jobs shown one by one, the first ones of the plan."""


def write_report(folder: Path, output: Path, runs: int = 5) -> None:
    """Write the batch in `folder` as one page. The worst `runs` runs with a log get pages next to their logs.

    Raises PicktreeError when there is no batch, or the page cannot be written.
    """
    with Store(folder / RESULTS_FILE) as store:
        data = _data(folder, store, output, runs)
    text = Template((_PAGE / "page.html").read_text(encoding="utf-8")).substitute(
        title=_escaped(f"Batch {read_plan(folder).name}"),
        style=(_PAGE / "page.css").read_text(encoding="utf-8"),
        data=json.dumps(data, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c"),
        libraries=(_PAGE / "libraries.js").read_text(encoding="utf-8"),
        script=(_PAGE / "page.js").read_text(encoding="utf-8"),
    )
    with file_system.whole([output], output) as (beside,):
        beside.write_text(text, encoding="utf-8")


def _data(folder: Path, store: Store, output: Path, runs: int) -> dict[str, Any]:
    summary = summarise(store)
    rates: Any = store.query("SELECT variant, rate FROM units_an_hour").rows
    reports = _reports(folder, summary.worst, runs)
    done = summary.total - summary.waiting
    reached = rate(sum(r.success.successes for r in summary.recipes), done)
    versions: Any = store.query(
        "SELECT library, group_concat(DISTINCT version) FROM versions WHERE library NOT LIKE '% of %' "
        "GROUP BY library ORDER BY library"
    ).rows
    return {
        **summary.to_json(),
        "subtitle": f"{done} of {summary.total} jobs run, goal reached {reached}",
        "rates": [{"label": label, "rate": value} for label, value in rates],
        "jobs": _jobs(folder, store, output),
        "cell": CELL_SIZE,
        "worst": [_worst(*each, folder, output) for each in zip(summary.worst, reports, strict=True)],
        "footer": ", ".join(f"{library} {version}" for library, version in versions if version),
    }


def _jobs(folder: Path, store: Store, output: Path) -> list[dict[str, Any]]:
    rows = store.query(
        "SELECT variant AS label, seed, status, items_sorted AS sorted, items_total AS items, "
        f"sim_seconds AS seconds, look_at, folder AS report FROM jobs ORDER BY number LIMIT {MAX_SHOWN_JOBS}"
    )
    return [
        {**row, "report": _link(folder / str(row["report"]) / "report.html", output) if row["report"] else ""}
        for row in rows
    ]


def _reports(folder: Path, worst: tuple[WorstJob, ...], runs: int) -> list[Path | None]:
    """Return the page of each run; None without a page. The first `runs` missing ones are written."""
    found: list[Path | None] = []
    made = 0
    for job in worst:
        report = folder / job.folder / "report.html" if job.folder else None
        if report is not None and not report.is_file():
            report = _write_run_page(report) if made < runs else None
            made += 1
        found.append(report)
    return found


def _write_run_page(report: Path) -> Path | None:
    """Write the page of a run next to its log; None when the log is missing or unreadable."""
    try:
        with Run(report.parent) as run:
            write_run_report(run, report)
    except PicktreeError:
        return None
    return report


def _worst(job: WorstJob, report: Path | None, folder: Path, output: Path) -> dict[str, Any]:
    kept = folder / job.folder if job.folder else None
    columns = ("seed", "label", "status", "missed", "look_at", "root_cause")
    return {
        **{name: getattr(job, name) for name in columns},
        "report": "" if report is None else _link(report, output),
        "command": shlex.join(
            ["picktree", "explain", str(kept)] if kept else ["picktree", "resim", f"{folder}@{job.job}"]
        ),
    }


def _link(page: Path, output: Path) -> str:
    """Return a relative link to another page; empty when that does not exist."""
    if not page.is_file():
        return ""
    return quote(Path(os.path.relpath(page, output.parent)).as_posix())


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace("$", "&#36;")


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
    lines = [f"job {job.id}: {row.status}" + (f": {row.message}" if row.message else "")]
    if row.sim_seconds is not None:
        items = f"{row.items_sorted} of {row.items_total} items sorted"
        lines.append(f"{items} in {row.sim_seconds:g} simulated s")
    pointers = (("root cause", row.root_cause), ("look at", row.look_at), ("run", row.folder))
    lines += [f"{what}: {value}" for what, value in pointers if value]
    outcome = _OUTCOMES.get(row.status, "failure")
    text, passed = "\n".join(lines), outcome == "passed"
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
