"""Simulated time of a pick by skill and phase, beside the shortest time on the same paths.

    python benchmarks/pick_time.py --runs 5
    python benchmarks/pick_time.py --scene dense --runs 3

In every tick the generators of the running skill show what it waits for; a motion is split at the ends of its
legs. The bound is a bare TOPP-RA on the path of each motion, with the full limits of speed and acceleration,
and the time in which only the fingers move. `thinking` is the simulated time of collision checks and images,
waited for or not.
"""

from __future__ import annotations

import sys
from collections import Counter, defaultdict
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import GeneratorType
from typing import TYPE_CHECKING, Any, cast

from _campaign import Row, campaign, mission_options, rate, seeds
from _motion_timing import bare_profile
from picktree.robot.control.joint_controllers import TrajectoryController
from picktree.robot.planning import LineGoal, OffsetGoal, Request
from picktree.robot.planning.path_curves import distinct, rounded_polyline, spline_through
from picktree.session import Observer, RunRequest, Session
from picktree.trees import Skill

import numpy as np

if TYPE_CHECKING:
    from picktree.session import Execution
    from picktree.world import Tick, Trajectory
    from picktree.world.robot_model import RobotModel

COST_A_RUN = 8.0
"""CPU seconds that a run of twelve items takes, for the forecast."""
WAITS = {
    "charge": "computing",
    "wait": "computing",
    "settle": "settling",
    "_until_rest": "coming to rest",
    "along": "arrival",
    "finish": "arrival",
    "close": "closing",
    "sound": "closing",
    "comply": "giving way",
    "guarded": "guarded move",
    "_open": "opening",
    "move": "opening",
}
"""Phase of a skill by the name of its innermost generator that is listed here."""
MOTIONS = ("empty travel", "descent", "lift", "transfer", "lowering", "arrival")
BOUND_PHASES = ("closing", "opening")
"""Phases that count in the bound as they are."""


@dataclass(frozen=True)
class Job:
    mission: str
    scene: str
    robot: str
    seed: int


class PickTimes(Observer):
    """Simulated seconds by skill and phase, and of each motion the shortest time on its path."""

    def __init__(self) -> None:
        self.seconds: dict[tuple[str, str], float] = defaultdict(float)
        self.bound = self.planned = 0.0
        self.use: list[float] = []
        """Share of its speed limit of the joint that is nearest to it, in each tick of a motion."""
        self._known: list[Trajectory] = []

    def started(self, run: Execution, folder: Path) -> None:
        self._run = run

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        node, chain = self._running()
        world, tick = self._run.world, self._run.world.tick
        track = world.control._drive.controller  # pyright: ignore[reportPrivateUsage]
        if "_follow" in chain and isinstance(track, TrajectoryController):
            self._motion(node, track, tick)
            limit = world.robot.velocity_limit
            self.use.append(float((np.abs(world.control.state.velocity) / limit).max()))
            return
        phase = next((WAITS[name] for name in reversed(chain) if name in WAITS), "other")
        self.seconds[node, phase] += tick

    def _running(self) -> tuple[str, list[str]]:
        """The id of the running skill, and the names of its generators, the innermost last."""
        for node in self._run.tree.nodes:
            steps: object = getattr(node, "_steps", None) if isinstance(node, Skill) else None
            if steps is None:
                continue
            chain: list[str] = []
            while isinstance(steps, GeneratorType):
                chain.append(steps.gi_code.co_name)
                steps = cast("object", steps.gi_yieldfrom)
            return node.wiring.id, chain
        return "tree", []

    def _motion(self, node: str, track: TrajectoryController, tick: float) -> None:
        world, trajectory = self._run.world, track.trajectory
        made = world.plan.made.of(trajectory)
        if not any(trajectory is known for known in self._known):
            self._known.append(trajectory)
            self.planned += trajectory.duration
            self.bound += shortest(world.robot, trajectory)
        begin, end = track.progress, track.progress + tick
        requests = () if made is None else made.requests
        passes = (0.0, *(() if made is None else made.passes))
        for request, (a, b) in zip(requests, pairwise(passes), strict=True):
            self.seconds[node, leg_name(request)] += max(0.0, min(b, end) - max(a, begin))
        done = trajectory.duration
        self.seconds[node, "arrival"] += max(0.0, end - max(begin, done))
        if made is None:
            self.seconds[node, "other"] += max(0.0, min(done, end) - begin)

    def figures(self) -> dict[str, Any]:
        return {
            "seconds": [[node, phase, s] for (node, phase), s in self.seconds.items()],
            "bound": self.bound,
            "planned": self.planned,
            "thinking": self._run.world.thinking.total,
            "use": float(np.mean(self.use)) if self.use else 0.0,
        }


def leg_name(request: Request) -> str:
    """Return the row of a leg of a motion."""
    match request.target:
        case OffsetGoal(by):
            return "lift" if by[2] > 0.0 else "lowering"
        case LineGoal():
            return "descent"
        case _:
            return "empty travel" if request.holding is None else "transfer"


def shortest(model: RobotModel, trajectory: Trajectory) -> float:
    """Return the duration of a bare TOPP-RA on the path of a trajectory, s."""
    points = distinct(trajectory.position)
    if len(points) < 3:
        return trajectory.duration
    keep = np.unique(np.linspace(0, len(points) - 1, min(len(points), 80)).astype(int))
    curve = spline_through(points[keep]) if len(keep) > 2 else rounded_polyline(points[keep], 0.0)
    found = bare_profile(model, curve)
    return trajectory.duration if found is None else min(found.duration, trajectory.duration)


def one(job: Job, folder: Path) -> Row:
    """Run one seed; its result with the seconds by skill and phase."""
    request = RunRequest(
        mission=Path(job.mission),
        scene=job.scene,
        robot=job.robot or None,
        seed=job.seed,
        out=folder,
    )
    times = PickTimes()
    result = Session(request, observers=[times]).run()
    return {"result": result.to_json(), "times": times.figures()}


def report(rows: list[Row]) -> str:
    done = [row for row in rows if "result" in row]
    lines = [f"runs {len(rows)}, crashed {len(rows) - len(done)}"]
    if not done:
        return "\n".join(lines + [f"  seed {row['seed']}: {row['crash']}" for row in rows])
    results = [row["result"] for row in done]
    held = max(1, sum(r["picks"]["held"] for r in results))
    seconds: dict[tuple[str, str], float] = defaultdict(float)
    for row in done:
        for node, phase, s in row["times"]["seconds"]:
            seconds[node, phase] += s
    total = sum(seconds.values())
    lines.append(f"{'skill':<12} {'phase':<16} {'s a pick':>9} {'share':>7}")
    for (node, phase), s in sorted(seconds.items(), key=lambda each: (each[0][0], -each[1])):
        if s / held >= 0.0005:
            lines.append(f"{node:<12} {phase:<16} {s / held:9.3f} {100 * s / total:6.1f} %")
    lines.append(f"{'all':<29} {total / held:9.3f}   {3600 * held / total:.0f} picks an hour")
    motion = sum(s for (_, phase), s in seconds.items() if phase in MOTIONS)
    waits = sum(s for (_, phase), s in seconds.items() if phase in BOUND_PHASES)
    planned, bound = (sum(row["times"][name] for row in done) for name in ("planned", "bound"))
    lines.append(f"{'in motion':<29} {motion / held:9.3f}   trajectories {planned / held:.3f}")
    parts = f"TOPP-RA {bound / held:.3f}, fingers {waits / held:.3f}"
    lines.append(f"{'bound':<29} {(bound + waits) / held:9.3f}   {parts}")
    use = float(np.mean([row["times"]["use"] for row in done]))
    lines.append(f"speed of the fastest joint    {100 * use:.0f} % of its limit, mean over motions")
    items = [r["items"] for r in results]
    lines.append(rate("items sorted", sum(i["sorted"] for i in items), sum(i["total"] for i in items)))
    tried = sum(r["picks"]["tried"] for r in results)
    lines.append(rate("grasps held", sum(r["picks"]["held"] for r in results), tried))
    causes: Counter[str] = Counter()
    for r in results:
        causes.update(r["failures"])
    counted = ", ".join(f"{cause} {count}" for cause, count in causes.most_common())
    lines.append(f"failures by cause            {counted or 'none'}")
    thinking = sum(row["times"]["thinking"] for row in done)
    cpu = sum(r["cpu_seconds"] for r in results)
    lines.append(f"CPU                          {cpu / held:.3f} s a pick; thinking {thinking / held:.4f} s")
    return "\n".join(lines)


def main() -> int:
    parser = mission_options(__file__, __doc__, "sort_by_colour", "three_bins", runs=5)
    parser.add_argument("--robot", default="", help="another arm than the scene's")
    given = parser.parse_args()
    rows = campaign(
        given,
        [Job(given.mission, given.scene, given.robot, seed) for seed in seeds(given)],
        one,
        cost=COST_A_RUN,
        short=lambda row: "{sorted} of {total}".format(**row["result"]["items"]),
    )
    print(report(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
