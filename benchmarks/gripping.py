"""Campaign: how hard the fingers really press, on items that a firm grip crushes, and whether any is dropped.

    python benchmarks/gripping.py --runs 10
    python benchmarks/gripping.py --scene heavy --runs 5

Ten picks a run in `fragile` and in `heavy`. The force of each finger is the simulator's, in every
physics step; the robot knows its gripper's drive alone.
"""

from __future__ import annotations

import sys
from collections import Counter, defaultdict
from pathlib import Path
from statistics import median

from _campaign import MissionJob, Row, campaign, finished, mission_jobs, mission_options, rate
from picktree.world.event_types import PickEvent

COST_A_RUN = 7.0
"""CPU seconds."""


def one(job: MissionJob, folder: Path) -> Row:
    """Run one seed; what the fingers did to each item, and what became of it."""
    from picktree.analysis import Run
    from picktree.session import RunRequest, Session

    request = RunRequest(
        mission=Path(job.mission),
        scene=job.scene,
        seed=job.seed,
        out=folder,
    )
    session = Session(request)
    result = session.run()
    hardware = session.execution.hardware
    kinds = {body.id: body.kind for body in hardware.truth()}
    crushing = getattr(hardware, "crushing")  # noqa: B009  of the physical backend alone
    pressed = [
        {"kind": kinds[name], "force": p.force, "gripped": p.gripped, "limit": p.limit}
        for name, p in crushing.greatest_forces().items()
    ]
    with Run(result.log) as run:
        events = Counter(at.record.kind for at in run.events)
        grips = [at.record for at in run.events if isinstance(at.record, PickEvent)]
    return {
        "result": result.to_json(),
        "pressed": pressed,
        "events": dict(events),
        "forces": [[kinds_of(grip.object), grip.force, grip.load] for grip in grips],
    }


def kinds_of(object_id: str) -> str:
    """`red_cup_2` is a cup."""
    return object_id.split("_")[1]


def report(rows: list[Row]) -> str:
    results = [row["result"] for row in rows]
    total = sum(r["items"]["total"] for r in results)
    held, tried = (sum(r["picks"][key] for r in results) for key in ("held", "tried"))
    lost = sum(count for r in results for cause, count in r["failures"].items() if cause == "grasp.slipped")
    lines = [
        f"runs {len(rows)}, picks {tried}",
        rate("items sorted and whole", sum(r["items"]["sorted"] for r in results), total),
        rate("grasps held", held, tried),
        rate("dropped or slipped out", lost, tried),
    ]
    by_kind: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        for pressed in row["pressed"]:
            by_kind[pressed["kind"]].append(pressed)
    every = [p for pressed in by_kind.values() for p in pressed]
    if every:
        firm = sum(p["gripped"] > p["limit"] for p in every)
        lines.append(rate("gripped above the limit", firm, len(every)))
        bumped = sum(p["gripped"] <= p["limit"] < p["force"] for p in every)
        lines.append(rate("bumped above the limit", bumped, len(every)))
        lines.append("greatest force of a finger while it closes and holds, N")
        for kind, pressed in sorted(by_kind.items()):
            worst = max(p["gripped"] for p in pressed)
            middle, limit = median(p["gripped"] for p in pressed), pressed[0]["limit"]
            lines.append(
                f"  {kind:<10} {len(pressed):>4} items   median {middle:5.2f}   "
                f"worst {worst:5.2f}   limit {limit:g}"
            )
    forces: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        for kind, force, _ in row["forces"]:
            forces[kind].append(force)
    lines.append("grip that was chosen a finger, N")
    for kind, chosen in sorted(forces.items()):
        lines.append(
            f"  {kind:<10} {len(chosen):>4} picks   {min(chosen):5.2f} … {max(chosen):5.2f}   "
            f"median {median(chosen):5.2f}"
        )
    events: Counter[str] = Counter()
    causes: Counter[str] = Counter()
    for row in rows:
        events.update(row["events"])
        causes.update(row["result"]["failures"])
    told = {kind: events[kind] for kind in ("centred", "slip", "regrasp", "crushed")}
    lines.append("what happened                " + ", ".join(f"{kind} {n}" for kind, n in told.items()))
    failed = ", ".join(f"{cause} {n}" for cause, n in causes.most_common())
    lines.append(f"failures by cause            {failed or 'none'}")
    seconds = [r["sim_seconds"] / max(1, r["picks"]["held"]) for r in results]
    lines.append(f"simulated seconds a pick     median over runs {median(seconds):.2f}")
    return "\n".join(lines)


def main() -> int:
    given = mission_options(__file__, __doc__, "sort_by_colour", "fragile", runs=10).parse_args()
    rows = campaign(
        given,
        mission_jobs(given),
        one,
        cost=COST_A_RUN,
        short=lambda row: "{sorted} of {total}".format(**row["result"]["items"]),
    )
    print(report(finished(rows)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
