"""Campaign: of the items that are within reach, how many does a mission sort?

    python benchmarks/reachable.py --scene tumbled --runs 40
    python benchmarks/reachable.py --scene three_bins_camera_off_8mm --runs 40

What counts as within reach is defined in `_reach.py`, and asked of the truth before the run begins: the robot
knows nothing of it. Items that are not within reach are left out, sorted or not.

The logs of runs that lost an item stay in the folder, for `picktree explain`.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from shutil import rmtree

from _campaign import MissionJob, Row, campaign, mission_jobs, mission_options, rate

COST_A_RUN = 20.0
"""CPU seconds that a run of twelve items takes, for the forecast."""


def one(job: MissionJob, folder: Path) -> Row:
    """Run one seed; what became of each item."""
    from _reach import within_reach
    from picktree.session import RunRequest, Session
    from picktree.simulation import score

    session = Session(RunRequest(mission=Path(job.mission), scene=job.scene, seed=job.seed, out=folder))
    before = list(session.execution.hardware.truth())
    reach = within_reach(session.execution.recipe.scene, before)
    result = session.run()
    after = {str(body.id): body for body in session.execution.hardware.truth()}
    verdicts = {str(item.id): item for item in score(after.values(), session.execution.recipe.scene).items}
    items = [
        {
            "id": str(body.id),
            "what": f"{body.colour} {body.kind}",
            "within": not reach[str(body.id)].why_not,
            "why_not": reach[str(body.id)].why_not,
            "verdict": verdicts[str(body.id)].verdict,
            "began": [round(c, 3) for c in body.pose.position],
            "ended": [round(c, 3) for c in after[str(body.id)].pose.position],
        }
        for body in before
    ]
    if all(item["verdict"] == "sorted" for item in items if item["within"]):
        rmtree(result.folder, ignore_errors=True)
    return {
        "items": items,
        "status": result.status,
        "failures": dict(result.failures),
        "seconds": round(result.sim_seconds, 2),
        "cpu": round(result.cpu_seconds, 2),
        "folder": str(result.folder),
    }


def report(rows: list[Row]) -> str:
    done = [row for row in rows if "items" in row]
    items = [item for row in done for item in row["items"]]
    within = [item for item in items if item["within"]]
    won = sum(item["verdict"] == "sorted" for item in within)
    lines = [
        f"runs {len(rows)}, crashed {len(rows) - len(done)}; {len(items)} items, "
        f"{len(items) - len(within)} of them out of reach",
        rate("sorted of those within reach", won, len(within)),
        rate("  left", sum(i["verdict"] == "left" for i in within), len(within)),
        rate("  misplaced", sum(i["verdict"] == "misplaced" for i in within), len(within)),
        rate("sorted of all", sum(i["verdict"] == "sorted" for i in items), len(items)),
    ]
    causes: Counter[str] = Counter()
    for row in done:
        causes.update(row["failures"])
    told = ", ".join(f"{cause} {count}" for cause, count in causes.most_common())
    lines.append(f"failures by cause            {told or 'none'}")
    if won:
        seconds, cpu = sum(row["seconds"] for row in done), sum(row["cpu"] for row in done)
        lines.append(f"an item sorted takes         {seconds / won:.2f} s simulated, {cpu / won:.2f} s CPU")
    for row in rows:
        if "crash" in row:
            lines.append(f"  seed {row['seed']}: {row['crash']}")
            continue
        lines += [
            f"  seed {row['seed']}: {item['what']} ({item['id']}) {item['verdict']}, "
            f"lay at {item['began']}, lies at {item['ended']}; {row['folder']}"
            for item in row["items"]
            if item["within"] and item["verdict"] != "sorted"
        ]
    return "\n".join(lines)


def _short(row: Row) -> str:
    within = [item for item in row["items"] if item["within"]]
    won = sum(item["verdict"] == "sorted" for item in within)
    return f"{won} of {len(within)} within reach, {len(row['items']) - len(within)} out of it"


def main() -> int:
    given = mission_options(__file__, __doc__, "sort_tirelessly", "tumbled", runs=40).parse_args()
    print(report(campaign(given, mission_jobs(given), one, cost=COST_A_RUN, short=_short)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
