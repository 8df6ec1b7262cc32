"""Campaign: sort on and on beside a feed; how well, how fast, and whether memory stays where it is.

python benchmarks/continuous.py --items 200 --runs 3
python benchmarks/continuous.py --items 40 --runs 10 --scene my_feed.yaml
"""

from __future__ import annotations

import resource
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from _campaign import ROOT, Row, campaign, options, rate, seeds
from picktree.session import Observer

if TYPE_CHECKING:
    from picktree.session import Execution
    from picktree.world import Tick

COST_AN_ITEM = 1.0
"""CPU seconds, for the forecast."""
EVERY = 20
"""Items between two looks at the memory."""
PAGE = resource.getpagesize() / 1e6
"""MB"""


@dataclass(frozen=True)
class Job:
    mission: str
    scene: str | None
    seed: int
    items: int
    backend: str


class Memory(Observer):
    """Watches a run: resident memory in MB whenever so many items more are done."""

    def __init__(self) -> None:
        self.seen: dict[int, float] = {}

    def started(self, run: Execution, folder: Path) -> None:
        self.seen[0] = resident()

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        if items_done % EVERY == 0 and items_done not in self.seen:
            self.seen[items_done] = resident()


def resident() -> float:
    """MB of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE


def one(job: Job, folder: Path) -> Row:
    """Run one seed; the JSON of its result with memory and log."""
    from picktree.session import RunRequest, Session

    memory = Memory()
    request = RunRequest(
        mission=Path(job.mission),
        scene=job.scene,
        seed=job.seed,
        parameters={"items": str(job.items)},
        out=folder,
        backend="kinematic" if job.backend == "kinematic" else "physics",
        limit=60.0 * job.items,
    )
    session = Session(request, observers=[memory])
    result = session.run()
    logs = [path.stat().st_size for path in result.folder.glob("*.mcap")]
    return {
        "result": result.to_json(),
        "memory": {str(items): mb for items, mb in memory.seen.items()},
        "memory_at_end": resident(),
        "log_files": len(logs),
        "log_bytes": sum(logs),
        "belief": len(session.execution.world.scene.objects),
        "attempts": len(session.execution.world.attempts.state()),
    }


def growth(memory: dict[str, float]) -> float:
    """Return the growth of memory, kB an item: least squares over all looks but the first."""
    points = sorted((int(items), mb) for items, mb in memory.items() if int(items) > 0)
    if len(points) < 3:
        return 0.0
    mean_x = sum(x for x, _ in points) / len(points)
    mean_y = sum(y for _, y in points) / len(points)
    over = sum((x - mean_x) ** 2 for x, _ in points)
    return 1000 * sum((x - mean_x) * (y - mean_y) for x, y in points) / over


def report(rows: list[Row]) -> str:
    done = [row for row in rows if "result" in row]
    results = [row["result"] for row in done]
    lines = [f"runs {len(rows)}, crashed {len(rows) - len(done)}"]
    if not done:
        return "\n".join(lines + [f"  seed {row['seed']}: {row['crash']}" for row in rows])
    lines.append(
        rate(
            "items sorted",
            sum(r["items"]["sorted"] for r in results),
            sum(r["items"]["total"] for r in results),
        )
    )
    lines.append(
        rate("runs that reached the goal", sum(r["status"] == "success" for r in results), len(done))
    )
    held = sum(r["picks"]["held"] for r in results)
    lines.append(
        rate(
            "held at the first try",
            sum(r["picks"]["held_first_try"] for r in results),
            sum(r["picks"]["objects"] for r in results),
        )
    )
    simulated = sum(r["sim_seconds"] for r in results)
    each = ", ".join(f"{3600 * r['picks']['held'] / r['sim_seconds']:.0f}" for r in results)
    lines.append(f"picks a simulated hour       {3600 * held / simulated:.0f} ({each})")
    walls = [r["wall_seconds"]["total"] for r in results]
    cpu = sum(r["cpu_seconds"] for r in results)
    lines.append(
        f"wall time of a run           {min(walls):.0f} … {max(walls):.0f} s; {cpu / held:.2f} CPU s a pick"
    )
    feeds = [r["feed"] for r in results]
    for key in ("deliveries", "exchanges", "set_aside"):
        lines.append(f"{key.replace('_', ' '):<28} {', '.join(str(feed[key]) for feed in feeds)}")
    for row in done:
        memory = row["memory"]
        lines.append(
            f"memory, seed {row['seed']:<16}{memory['0']:.0f} MB at the start, "
            f"{memory.get(str(EVERY), float('nan')):.0f} after {EVERY} items, "
            f"{row['memory_at_end']:.0f} at the end; {growth(memory):+.1f} kB an item; "
            f"belief {row['belief']} objects, attempts on {row['attempts']}"
        )
    for row in done:
        lines.append(
            f"log, seed {row['seed']:<19}{row['log_bytes'] / 1e6:.1f} MB in {row['log_files']} files"
        )
    causes: Counter[str] = Counter()
    for r in results:
        causes.update(r["failures"])
    counted = ", ".join(f"{cause} {count}" for cause, count in causes.most_common())
    lines.append(f"failures by cause            {counted or 'none'}")
    for row in rows:
        if "crash" in row:
            lines.append(f"  seed {row['seed']}: {row['crash']}")
        elif row["result"]["status"] != "success":
            r = row["result"]
            counts = ", ".join(f"{key} {r['items'][key]}" for key in ("sorted", "misplaced", "left"))
            lines.append(f"  seed {row['seed']}: {r['status']}: {counts}; {r['folder']}")
    return "\n".join(lines)


def main() -> int:
    parser = options(__file__, __doc__, runs=3)
    parser.add_argument("--mission", default=str(ROOT / "examples" / "continuous_sort.yaml"))
    parser.add_argument("--scene", help="for the mission's own")
    parser.add_argument("--items", type=int, default=200, help="of each run; the last load is finished")
    parser.add_argument("--backend", choices=("physics", "kinematic"), default="physics")
    given = parser.parse_args()
    rows = campaign(
        given,
        [Job(given.mission, given.scene, seed, given.items, given.backend) for seed in seeds(given)],
        one,
        cost=COST_AN_ITEM * given.items,
        short=lambda row: "{sorted} of {total}".format(**row["result"]["items"]),
    )
    print(report(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
