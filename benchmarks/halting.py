"""Campaign: halt a mission at random ticks in physics; the arm must rest, the mission then finish.

    python benchmarks/halting.py --runs 200
    python benchmarks/halting.py --runs 200 --scene three_bins --out elsewhere
    python benchmarks/halting.py --mission examples/insert_pegs.yaml --leaf Insert --each --seeds 3

Each seed is run once and halted in branches of it, at ticks drawn from its length, or at each tick in which
one of the leaves runs. At rest no torque may stay applied, nothing may be NaN, and control must be back at
its everyday rate; then the same mission is begun anew in the same world.
"""

from __future__ import annotations

import importlib.util
import math
import sys
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from types import ModuleType

from _campaign import ROOT, Row, campaign, finished, options, rate

HALTS = 10
"""Number of halts in each seed's run; fewer when the run ends before."""
LAST_TICK = 250
"""A run of four items has about that many ticks."""
EACH = 120
"""Ticks of one seed in which the leaves run, about."""
COST = {"sort_small": 1.5, "three_bins": 7.0}
"""CPU seconds a halt, for the forecast."""


SLOW = 600.0
"""Simulated seconds that a mission which is halted at each tick may take."""


@dataclass(frozen=True)
class Job:
    scene: str
    seed: int
    halts: int
    mission: str
    leaves: tuple[str, ...]
    """Halted in these only; empty: in all."""
    each: bool


def _cell() -> ModuleType:
    """Load the module with which the tests drive missions."""
    spec = importlib.util.spec_from_file_location("cell", ROOT / "tests" / "skills" / "cell.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["cell"] = module
    spec.loader.exec_module(module)
    return module


def one(job: Job, folder: Path) -> Row:
    """Run one seed with its halts, each with its result."""
    from picktree.trees.loading import NodeRegistry, load_mission
    from picktree.world.scene import load_scene

    import numpy as np

    cell = _cell()
    mission = load_mission(Path(job.mission), NodeRegistry())
    scene = load_scene(job.scene or mission.scene or "sort_small", Path(job.mission).parent)
    last = LAST_TICK if job.scene == "sort_small" else 3 * LAST_TICK
    draw = np.random.default_rng([job.seed, 1])
    ticks = sorted(int(t) + 1 for t in draw.choice(last, job.halts, replace=False))
    run = cell.Cell(mission, scene, "physics", job.seed)
    answers: list[dict[str, object]] = []

    def wanted(tick: int) -> bool:
        if (job.each or tick in ticks) and (not job.leaves or run.leaf in job.leaves):
            try:
                halted = cell.branch(lambda: cell.halt_and_finish(run, tick, mission))
                answers.append({**asdict(halted), "fine": halted.fine})
            except AssertionError as error:
                answers.append({"tick": tick, "leaf": run.leaf, "fine": False, "died": str(error)})
        return False

    cell.halted_at(run, wanted, limit=SLOW)
    return {"unhalted": run.score().count.sorted, "halts": answers}


def report(rows: list[Row]) -> tuple[str, bool]:
    halts = [halt | {"seed": row["seed"]} for row in rows for halt in row["halts"]]
    fine = sum(halt["fine"] for halt in halts)
    lines = [rate("at rest and finished", fine, len(halts))]
    rests = sorted(halt["to_rest"] for halt in halts if "to_rest" in halt)
    if rests:
        lines.append(
            f"time to rest          {rests[len(rests) // 2]:.2f} s median, {rests[-1]:.2f} s at most"
        )
    leaves = Counter(halt["leaf"] or "between skills" for halt in halts)
    lines.append("halted in             " + ", ".join(f"{leaf} {n}" for leaf, n in leaves.most_common()))
    lines.append(f"needed recovery       {sum(bool(halt.get('recoveries')) for halt in halts)}")
    for halt in halts:
        if not halt["fine"]:
            what = halt.get("died") or (halt["status"], halt["sorted"], halt["total"], halt["complaints"])
            lines.append(f"  seed {halt['seed']} tick {halt['tick']} in {halt['leaf']}: {what}")
            lines += [f"    {recovery}" for recovery in halt.get("recoveries", ())]
    return "\n".join(lines), fine == len(halts)


def main() -> int:
    parser = options(__file__, __doc__, runs=200, what=f"halts, up to {HALTS} in each seed")
    parser.add_argument("--mission", default=str(ROOT / "examples" / "sort_by_colour.yaml"))
    parser.add_argument("--scene", help="else the mission's own; sort_small for sort_by_colour")
    parser.add_argument("--leaf", action="append", default=[], help="halt in this leaf only; may be repeated")
    parser.add_argument("--each", action="store_true", help="at each of its ticks, in --seeds seeds")
    parser.add_argument("--seeds", type=int, default=2, help="with --each")
    given = parser.parse_args()
    mission = Path(given.mission)
    scene = given.scene or ("sort_small" if mission.stem == "sort_by_colour" else "")
    count = given.seeds if given.each else math.ceil(1.08 * given.runs / HALTS)
    rows = campaign(
        given,
        [
            Job(scene, seed, HALTS, given.mission, tuple(given.leaf), given.each)
            for seed in range(given.first, given.first + count)
        ],
        one,
        cost=(EACH if given.each else HALTS) * COST.get(scene, 7.0),
        short=lambda row: f"{sum(halt['fine'] for halt in row['halts'])} of {len(row['halts'])}",
    )
    text, fine = report(finished(rows))
    print(text)
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
