"""Campaign: pegs picked from the table and inserted by feeling, over many seeds, and straight down beside it.

    python benchmarks/insertion.py --runs 200
    python benchmarks/insertion.py --runs 20 --only round-1.0,square-0.5

Round and square pegs of 30 mm, held by friction in a real grasp; holes 30 mm deep with sharp edges.
Clearance is that of both sides together, to the circle inscribed in a round hole's 32 sides. The board
stands up to 5 mm from where the belief has it along each of its axes, turned by up to 2 deg and tilted by up
to 2 deg. An insertion counts when the scorer calls the peg sorted, and peg and board were never deeper in
each other than 0.15 mm for two steps in a row, 4 ms; the share that never was so deep at any step stands
beside it.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

from _campaign import Row, campaign, options, rate, seeds
from _insertion_cell import Setting, run

SETTINGS = tuple(Setting(form, c) for c in (0.002, 0.001, 0.0005) for form in ("round", "square"))
WAYS = ("feeling", "straight")
COST = {"feeling": {"round": 4.5, "square": 3.0}, "straight": {"round": 2.5, "square": 2.5}}
"""CPU seconds a run, for the forecast; by feeling with less than 1 mm of clearance twice as much."""
HAIR = 0.15e-3
"""Penetration below which a run counts as free of any, m."""


@dataclass(frozen=True)
class Job:
    setting: Setting
    way: str
    seed: int


def one(job: Job, folder: Path) -> Row:
    """Insert one peg."""
    return run(job.setting, job.way, job.seed)


def stands(row: Row) -> bool:
    """The scorer finds the peg upright at the bottom, and in no wall in the last second."""
    return row.get("verdict") == "sorted"


def counts(row: Row) -> bool:
    return stands(row) and row["lasting"] < HAIR


def short(row: Row) -> str:
    if "crash" in row:
        return str(row["crash"])
    depth = "not in" if row["depth"] is None else f"{row['depth'] * 1000:.1f} mm deep"
    told = "; ".join(row["failures"])
    return (
        f"{row['verdict']}, {depth}, {row['penetration'] * 1000:.2f} mm in walls, {row['grasps']} grasps, "
        f"{row['cpu']:.1f} s CPU{': ' + told if told else ''}"
    )


def report(name: str, rows: list[Row]) -> str:
    good = [row for row in rows if counts(row)]
    lines = [rate(name, len(good), len(rows))]
    lines.append(rate("  however deep in walls", sum(map(stands, rows)), len(rows)))
    never = sum(stands(row) and row["penetration"] < HAIR for row in rows)
    lines.append(rate("  at no step too deep", never, len(rows)))
    first = [row for row in good if row["grasps"] == 1]
    if "straight" not in name:
        lines.append(rate("  with the first grasp", len(first), len(rows)))
    forces = sorted(row["force"] for row in good if "force" in row)
    times = sorted(row["seconds"] for row in good if "seconds" in row)
    if forces and times:
        late = times[int(0.95 * (len(times) - 1))]
        lines.append(
            f"  greatest force {median(forces):.0f} N median, {forces[-1]:.0f} N at most; by feeling "
            f"{median(times):.1f} s median, {late:.1f} s at the 95th percentile"
        )
    worst, spike = (max((row[key] for row in good), default=0.0) for key in ("lasting", "penetration"))
    lines.append(
        f"  penetration of those that count: {worst * 1000:.2f} mm at most, {spike * 1000:.2f} mm for a step"
    )
    found = Counter(row["found_by"] for row in good if "found_by" in row)
    if found:
        lines.append("  found by " + ", ".join(f"{way} {n}" for way, n in found.most_common()))
    for row in rows:
        if not counts(row):
            why = f" - {row['reason']}" if row.get("reason") else ""
            lines.append(f"    seed {row['seed']}: {short(row)}{why}")
    cpu = [row["cpu"] for row in rows if "cpu" in row]
    if cpu:
        lines.append(f"  {sum(cpu) / len(cpu):.1f} s CPU a run")
    return "\n".join(lines)


def main() -> int:
    parser = options(__file__, __doc__, runs=200, what="seeds of each setting")
    parser.add_argument("--only", default="", help="settings: " + ",".join(s.name for s in SETTINGS))
    parser.add_argument("--ways", default=",".join(WAYS), help="feeling, straight: position control")
    given = parser.parse_args()
    only = set(filter(None, given.only.split(",")))
    if unknown := only - {s.name for s in SETTINGS}:
        known = ", ".join(s.name for s in SETTINGS)
        parser.error(f"no setting {', '.join(sorted(unknown))}; there are {known}")
    kinds = [
        (setting, way)
        for setting in SETTINGS
        for way in WAYS
        if way in given.ways.split(",") and (not only or setting.name in only)
    ]
    jobs = [Job(setting, way, seed) for seed in seeds(given) for setting, way in kinds]
    rows = campaign(given, jobs, one, cost=_cost, short=short)
    for setting, way in kinds:
        of = [row for row in rows if row["job"]["setting"] == asdict(setting) and row["job"]["way"] == way]
        print(report(f"{setting.name}-{way}", of))
    return 0


def _cost(job: Job) -> float:
    fine = job.way == "feeling" and job.setting.clearance < 0.001
    return COST[job.way][job.setting.form] * (2.0 if fine else 1.0)


if __name__ == "__main__":
    sys.exit(main())
