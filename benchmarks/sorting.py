"""Campaign: run a sorting mission over many seeds and say how well it does, with intervals.

python benchmarks/sorting.py --scene three_bins --runs 40
python benchmarks/sorting.py --scene dense --runs 20
python benchmarks/sorting.py --scene sort_small --runs 20 --robot panda --robot gen3 --robot my_arm.yaml
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, cast

from _campaign import Row, campaign, mission_options, rate, seeds, split
from picktree.world.event_types import SafetyStopEvent

import numpy as np

if TYPE_CHECKING:
    from picktree.logs import RunRecord

COST_A_RUN = 10.0
"""CPU seconds that a run of twelve items takes, for the forecast."""


@dataclass(frozen=True)
class Job:
    mission: str
    scene: str
    seed: int
    verify: bool
    faults: str | None
    robot: str | None = None
    """Shipped name or path of the robot; None: the scene's."""


def one(job: Job, folder: Path) -> Row:
    """Run one seed; the JSON of its result, and its largest force."""
    from picktree.logs import RunRecord
    from picktree.session import RunRequest, Session

    request = RunRequest(
        mission=Path(job.mission),
        scene=job.scene,
        seed=job.seed,
        out=folder,
        verify=job.verify,
        faults=Path(job.faults) if job.faults else None,
        robot=job.robot,
    )
    session = Session(request)
    result = session.run().to_json()
    with RunRecord(session.folder) as run:
        force, limit = largest_force(run), session.execution.world.description.limits.force
    return {"result": result, "force": round(force, 1), "limit": limit}


def largest_force(run: RunRecord) -> float:
    """Force on the hand, N: the largest mean over a tick, guard's reading or stop of the run."""
    forces = [0.0, *np.linalg.norm(run.wrenches.forces, axis=1).tolist()]
    for visit in run.visits:
        if visit.cause == "world.disturbed" and isinstance(force := visit.evidence.get("force"), float):
            forces.append(force)
    for at in run.events:
        if isinstance(at.record, SafetyStopEvent) and (stop := at.record.extra.get("force")):
            forces.append(math.hypot(*cast("list[float]", stop)))
    return max(forces)


def report(rows: list[Row]) -> str:
    done = [row["result"] for row in rows if "result" in row]
    lines = [f"runs {len(rows)}, crashed {len(rows) - len(done)}"]
    if not done:
        return "\n".join(lines + [f"  seed {row['seed']}: {row['crash']}" for row in rows])
    total = sum(r["items"]["total"] for r in done)
    lines.append(rate("items sorted", sum(r["items"]["sorted"] for r in done), total))
    lines.append(rate("items misplaced", sum(r["items"]["misplaced"] for r in done), total))
    lines.append(rate("runs that reached the goal", sum(r["status"] == "success" for r in done), len(done)))
    forms: Counter[str] = Counter()
    right: Counter[str] = Counter()
    for r in done:
        for form, counts in r["items"]["by_form"].items():
            forms[form] += counts["total"]
            right[form] += counts["sorted"]
    lines.append("items sorted by form")
    lines += [rate(f"  {form}", right[form], forms[form]) for form in sorted(forms)]
    first = sum(r["picks"]["held_first_try"] for r in done)
    lines.append(rate("held at the first try", first, sum(r["picks"]["objects"] for r in done)))
    lines.append(
        rate("grasps held", sum(r["picks"]["held"] for r in done), sum(r["picks"]["tried"] for r in done))
    )
    held = max(1, sum(r["picks"]["held"] for r in done))
    simulated, cpu = sum(r["sim_seconds"] for r in done), sum(r["cpu_seconds"] for r in done)
    lines.append(
        f"picks a simulated hour       {3600 * held / simulated:.0f}; "
        f"a pick takes {simulated / held:.2f} s simulated and {cpu / held:.2f} s CPU"
    )
    wall = sum(r["wall_seconds"]["planning"] for r in done)
    tries = max(1, sum(r["picks"]["tried"] for r in done))
    each = [r["sim_seconds"] / max(1, r["picks"]["held"]) for r in done]
    lines.append(
        f"planning                     {1000 * wall / held:.0f} ms of wall time a pick held, "
        f"{1000 * wall / tries:.0f} ms a pick tried"
    )
    lines.append(
        f"simulated seconds a pick     {min(each):.2f} … {max(each):.2f} over runs, median {median(each):.2f}"
    )
    costs = [r["cpu_seconds"] / max(1, r["picks"]["held"]) for r in done]
    speeds = [r["sim_seconds"] / r["cpu_seconds"] for r in done]
    lines.append(
        f"medians over runs            {median(costs):.2f} CPU s a pick, "
        f"{median(speeds):.1f} simulated s a CPU second"
    )
    lines.append("wall time                    " + split((r["wall_seconds"] for r in done), "total"))
    crushed = sum(len(r["crushed"]) for r in done)
    lines.append(f"items crushed                {crushed}")
    measured = [row for row in rows if "force" in row]
    worst = max(measured, key=lambda row: row["force"])
    lines.append(
        f"largest force                {worst['force']:.0f} N in seed {worst['seed']}; "
        f"limit {worst['limit']:.0f} N"
    )
    above = sum(row["force"] > row["limit"] for row in measured)
    lines.append(rate("runs above the limit of force", above, len(measured)))
    causes: Counter[str] = Counter()
    for r in done:
        causes.update(r["failures"])
    counted = ", ".join(f"{cause} {count}" for cause, count in causes.most_common())
    lines.append(f"failures by cause            {counted or 'none'}")
    judged = [r["disagreements"] for r in done if r["disagreements"] is not None]
    if judged:
        lines.append(f"judge against planner        {sum(judged)} disagreements in {len(judged)} runs")
    for row in rows:
        items = row["result"]["items"] if "result" in row else {}
        if "crash" in row or items["sorted"] < items["total"]:
            counts = (
                ", ".join(f"{key} {items[key]}" for key in ("sorted", "misplaced", "left")) if items else ""
            )
            lines.append(f"  seed {row['seed']}: {row.get('crash') or counts}")
    return "\n".join(lines)


def main() -> int:
    parser = mission_options(__file__, __doc__, "sort_by_colour", "three_bins", runs=40)
    parser.add_argument("--verify", action="store_true", help="judge every trajectory by python-fcl too")
    parser.add_argument("--faults")
    parser.add_argument("--robot", action="append", help="another robot; several times: each runs all seeds")
    given = parser.parse_args()
    robots: list[str | None] = given.robot or [None]
    jobs = [
        Job(given.mission, given.scene, seed, given.verify, given.faults, robot)
        for seed in seeds(given)
        for robot in robots
    ]
    rows = campaign(
        given,
        jobs,
        one,
        cost=COST_A_RUN,
        short=lambda row: "{sorted} of {total}".format(**row["result"]["items"]),
    )
    for robot in robots:
        if robot is not None:
            print(f"\n{robot}")
        print(report([row for row in rows if row["job"]["robot"] == robot]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
