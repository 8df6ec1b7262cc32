"""Campaign: missions in MuJoCo, in a process of its own, and beside it in pybullet.

    python benchmarks/another_engine.py --runs 20 --workers 1
    python benchmarks/another_engine.py --runs 20 --only sort_small,pegs
    python benchmarks/another_engine.py --faults --runs 10 --workers 1

`picktree_cell` serves each scene in lockstep over the protocol of drivers, with its default imperfections.
*Sorted* is the truth of the engine in which the run took place: the cell's own score, which picktree does
not see, or pybullet's. The force is that at the wrist by the plant's own measure: in MuJoCo the contact force
over 10 ms of each step, in pybullet the greatest force of the log. `--faults` runs `sort_tirelessly` with one
fault of the cell at a time. The runs come seed by seed, so that a campaign that is cut off has the same seeds
of all rows.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final

from _campaign import ROOT, Row, campaign, options, seeds
from picktree.logs import rate
from sorting import largest_force

if TYPE_CHECKING:
    from picktree.session import RunRequest

MISSIONS: Final[Mapping[str, str]] = {
    "sort_small": "sort_by_colour",
    "three_bins": "sort_by_colour",
    "touching": "sort_by_colour",
    "pegs": "insert_pegs",
    "dense": "sort_by_colour",
}
"""Mission of each scene."""
ENGINES: Final = ("mujoco", "pybullet")
FAULTS: Final[Mapping[str, Mapping[str, float]]] = {
    "none": {},
    "gripper latency 250 ms": {"gripper_latency": 0.25},
    "wrench noise 1 N": {"wrench_noise": 1.0},
    "joint friction 1 Nm": {"joint_friction": 1.0},
    "delay 40 ms": {"command_latency": 0.02, "state_latency": 0.02},
    "masses ± 30 %": {"inertia_error": 0.3, "hand_mass_error": 0.02, "item_mass_error": 0.3},
    "depth": {"depth_holes": 0.03, "depth_edges": 0.8, "depth_ripple": 0.002, "flying_pixels": 0.3},
}
"""Faults of the cell by name, each alone."""
FAULTY: Final = ("sort_small", "sort_tirelessly")
"""Scene and mission of the runs with faults."""
COST: Final[Mapping[str, float]] = {"sort_small": 8.0, "three_bins": 25.0, "touching": 15.0, "pegs": 25.0}
"""CPU seconds a run, for the forecast; of other scenes `LONG_COST`."""
LONG_COST: Final = 40.0
END_TIME: Final = 60.0
"""Longest wait for the score of a cell, s of wall time."""


@dataclass(frozen=True)
class Job:
    engine: str
    scene: str
    mission: str
    seed: int
    fault: str = "none"
    """Name in `FAULTS`."""
    robot: str | None = None
    """Shipped name of the robot; None: the scene's."""


def one(job: Job, folder: Path) -> Row:
    """Carry a mission out in the engine of a job."""
    return _in_mujoco(job, folder) if job.engine == "mujoco" else _in_pybullet(job, folder)


def _in_mujoco(job: Job, folder: Path) -> Row:
    from picktree.session import Session

    with _served(job) as cell:
        result = Session(_request(job, folder, cell.address)).run().to_json()
    items = cell.score["items"].items()
    return {
        "result": result,
        "sorted": cell.score["sorted"],
        "total": cell.score["total"],
        "force": cell.score["greatest_force"],
        "unsorted": [name for name, item in items if item["destination"] and not item["sorted"]],
    }


def _in_pybullet(job: Job, folder: Path) -> Row:
    from picktree.logs import RunRecord
    from picktree.session import Session

    session = Session(_request(job, folder))
    result = session.run().to_json()
    with RunRecord(session.folder) as run:
        force = round(largest_force(run), 3)
    items: Any = result["items"]
    return {"result": result, "sorted": items["sorted"], "total": items["total"], "force": force}


def _request(job: Job, folder: Path, robot_at: str = "") -> RunRequest:
    from picktree.session import RunRequest

    mission = ROOT / "examples" / f"{job.mission}.yaml"
    return RunRequest(mission, job.scene, job.robot, job.seed, out=folder, robot_at=robot_at)


@dataclass
class Served:
    """Cell that is served for one client; after the block with its score."""

    address: str
    score: dict[str, Any]


@contextmanager
def _served(job: Job) -> Generator[Served]:
    """Serve the cell of a job."""
    from picktree.simulation import cell_file
    from picktree.world.robot_model import load_robot
    from picktree.world.scene import load_scene

    scene = load_scene(job.scene)
    robot = load_robot(job.robot or scene.robot)
    with TemporaryDirectory(prefix="cell-") as name:
        at = Path(name)
        cell, faults, score, socket = (at / n for n in ("cell.json", "faults.json", "score.json", "socket"))
        cell.write_text(json.dumps(cell_file(scene, robot, job.seed)), encoding="utf-8")
        faults.write_text(json.dumps(FAULTS[job.fault]), encoding="utf-8")
        command = [sys.executable, "-m", "picktree_cell", cell, "--at", socket, "--seed", str(job.seed)]
        command += ["--clients", "1", "--faults", faults, "--score", score]
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            if not process.stdout.readline().startswith("ready"):
                raise RuntimeError(f"the cell's process ended with exit code {process.wait()}")
            served = Served(str(socket), {})
            yield served
            process.communicate(timeout=END_TIME)
            served.score = json.loads(score.read_text(encoding="utf-8"))
        finally:
            process.kill()
            process.communicate()


def short(row: Row) -> str:
    result = row["result"]
    return f"{row['sorted']} of {row['total']}, {result['status']}, {result['cpu_seconds']:.0f} s CPU"


def table(rows: Sequence[Row], kinds: Sequence[tuple[str, ...]]) -> str:
    """Return a Markdown table with a row for each kind of job, and a list of the runs that left items."""
    lines = [
        "| scene, mission | engine | fault | runs | sorted | held at the first try | seconds | force, N "
        "| failures |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for kind in kinds:
        lines += _line(kind, [row for row in rows if _kind(row["job"]) == kind])
    lines.append("")
    for row in rows:
        job = row["job"]
        what = f"{job['scene']}, {job['engine']}, {job['fault']}, seed {row['seed']}"
        if "crash" in row:
            lines.append(f"- {what}: crashed: {row['crash']}")
        elif row["sorted"] < row["total"] or row["result"]["status"] != "success":
            told = " ".join(filter(None, [", ".join(row.get("unsorted", ())), row["result"]["message"]]))
            lines.append(f"- {what}: {row['sorted']} of {row['total']}, {row['result']['status']}: {told}")
    return "\n".join(lines)


def _line(kind: tuple[str, ...], rows: Sequence[Row]) -> list[str]:
    done = [row for row in rows if "result" in row]
    if not done:
        return []
    results = [row["result"] for row in done]
    sorted_ = rate(sum(row["sorted"] for row in done), sum(row["total"] for row in done))
    held = rate(
        sum(result["picks"]["held_first_try"] for result in results),
        sum(result["picks"]["objects"] for result in results),
    )
    seconds = sorted(result["sim_seconds"] for result in results)
    forces = sorted(row["force"] for row in done)
    failures: Counter[str] = Counter()
    for result in results:
        failures.update(result["failures"])
    scene, mission, robot, fault, engine = kind
    cells = [
        ", ".join(filter(None, (f"`{scene}`", f"`{mission}`", robot and f"`{robot}`"))),
        engine,
        fault,
        str(len(done)),
        str(sorted_),
        str(held),
        f"{median(seconds):.1f}, {seconds[-1]:.1f} at most",
        f"{median(forces):.0f}, {forces[-1]:.0f} at most",
        ", ".join(f"{cause} {count}" for cause, count in failures.most_common()) or "none",
    ]
    return [f"| {' | '.join(cells)} |"]


def _kind(job: Mapping[str, Any]) -> tuple[str, ...]:
    return job["scene"], job["mission"], job["robot"] or "", job["fault"], job["engine"]


def main() -> int:
    parser = options(__file__, __doc__, runs=20)
    parser.add_argument("--only", default=",".join(MISSIONS), help="scenes, with commas between them")
    parser.add_argument("--robot", help="another robot than the scene's")
    parser.add_argument("--faults", action="store_true", help="the cell's own faults, each alone")
    given = parser.parse_args()
    scenes = given.only.split(",")
    if unknown := [scene for scene in scenes if scene not in MISSIONS]:
        parser.error(f"no scene {', '.join(unknown)}; there are {', '.join(MISSIONS)}")
    scene, mission = FAULTY
    jobs = [
        job
        for seed in seeds(given)
        for job in (
            [Job("mujoco", scene, mission, seed, fault, given.robot) for fault in FAULTS]
            if given.faults
            else [
                Job(engine, scene, MISSIONS[scene], seed, robot=given.robot)
                for scene in scenes
                for engine in ENGINES
            ]
        )
    ]
    rows = campaign(given, jobs, one, cost=_cost, short=short, order=lambda job: job.seed)
    kinds = list(dict.fromkeys(_kind(asdict(job)) for job in jobs))
    print(table(rows, kinds))
    return 0


def _cost(job: Job) -> float:
    return COST.get(job.scene, LONG_COST)


if __name__ == "__main__":
    sys.exit(main())
