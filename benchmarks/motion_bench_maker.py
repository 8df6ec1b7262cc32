"""Campaign: MotionBenchMaker's problems from request to timed trajectory, beside OMPL as a reference.

    python benchmarks/motion_bench_maker.py                        all problems, two planner seeds
    python benchmarks/motion_bench_maker.py --runs 10 --first 3 --scene box --scene cage
    python benchmarks/motion_bench_maker.py --data FOLDER          where motion_bench_maker.tar.bz2 lies

CPU milliseconds of one thread, for the whole way: the planning scene into the checker, the search, the
shortened path, the timed trajectory and its check. The reference gets there by OMPL's RRT-Connect and
simplification, with picktree's collision checks, edge steps, margins, timing and check. Both are judged by
python-fcl.

A second table has the paths that look-ahead makes of the same searches, with the checks that it may spend,
and the shortest of the reference's paths over eight planner seeds.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from _bench_maker import ARCHIVE, SCENES, WANTED, Problem, admitted, beyond_limits, problems, required_archive
from _campaign import Row, campaign, finished, options, rate
from _ompl_reference import OmplReference
from picktree.robot.planning import JointGoal, Request, RequestSolver
from picktree.robot.planning.collision_model import CollisionMargins
from picktree.robot.planning.lookahead_planning import IMPROVING_CHECKS
from picktree.robot.planning.trajectory_verifier import TrajectoryVerifier
from picktree.world import Array, Failure, Trajectory
from picktree.world.robot_model import RobotModel, load_robot

import numpy as np

BLOCK = 10
"""Number of problems of a job."""
COST = 0.4
"""CPU seconds of a problem with one seed: both planners, both judgements, and making the checkers."""
BEST_OF = 8
"""Number of the reference's planner seeds whose shortest path counts in the second table."""
FURTHER_COST = 0.06
"""CPU seconds of the reference alone."""
PUBLISHED = """
Figures of others, not comparable line by line:
  VAMP, `scripts/README.md` of KavrakiLab/vamp: all 700 problems on a Ryzen 9 7950X, search 35 µs in the
    median and 343 µs at p95, simplification 57 and 156 µs, mean length 5.18 rad; 86 µs of search on a machine
    like this one. Vectorised C++, spheres for links, no margin, no timing, no check of a trajectory.
  roboplan 0.7 (C++, pinocchio and coal), measured on a machine like this one over the problems 0051 … 0100:
    23.8 ms in the median with shortening.
"""


@dataclass(frozen=True)
class Job:
    """Problems of one scene, from the one at index `begin` on, with one planner seed."""

    scene: str
    begin: int
    count: int
    seed: int
    data: str
    further: tuple[int, ...] = ()
    """Planner seeds with which only the reference plans."""


@dataclass(frozen=True, slots=True)
class Attempt:
    """Result of one planner for one problem; the time is in CPU milliseconds."""

    outcome: str
    """Planner that found the path, or the failure."""
    solved: bool
    ms: float
    checks: int
    seconds: float
    """Duration of the trajectory."""
    length: float
    """Length of the path, rad."""
    contacts: tuple[str, ...]
    """Penetrations that the judge found."""


class Bench:
    """One problem at a time, planned and judged."""

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        self._judge = TrajectoryVerifier(model)

    def ours(self, problem: Problem, margin: float, seed: int, improving: int = 0) -> Attempt:
        """Plan a problem with picktree. `improving`: number of checks that a shorter path may cost."""
        solver = RequestSolver(
            self._model,
            problem.world,
            configuration=lambda: problem.start,
            width=lambda: problem.width,
            margins=CollisionMargins(margin, margin, margin, margin),
        )
        solver.improving = improving
        request = Request(JointGoal(problem.goal), allowed=problem.allowed)
        begun = time.process_time()
        try:
            plan = solver.solve(request, seed)
        except Failure as failure:
            return Attempt(str(failure), False, _since(begun), solver.collision.checks, 0.0, 0.0, ())
        ms = _since(begun)
        return self._judged(problem, plan.planner, ms, solver.collision.checks, plan.path, plan.trajectory)

    def reference(self, problem: Problem, margin: float, seed: int) -> Attempt:
        """Plan a problem with OMPL."""
        planner = OmplReference(self._model, CollisionMargins(margin, margin, margin, margin))
        begun = time.process_time()
        scene = problem.world.supposing(allowed=problem.allowed)
        plan = planner.plan(scene, problem.width, problem.start, problem.goal, seed)
        ms, checks = _since(begun), planner.collision.checks
        if plan is None or plan.trajectory is None:
            return Attempt("nothing found", False, ms, checks, 0.0, 0.0, ())
        return self._judged(problem, "OMPL", ms, checks, plan.path, plan.trajectory)

    def _judged(
        self, problem: Problem, planner: str, ms: float, checks: int, path: Array, trajectory: Trajectory
    ) -> Attempt:
        scene = problem.world.supposing(allowed=problem.allowed)
        found = self._judge.judge(trajectory, scene, problem.width)
        contacts = tuple(f"{c.a} {-c.distance * 1000:.2f} mm deep in {c.b}" for c in found)
        length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
        return Attempt(planner, True, ms, checks, trajectory.duration, length, contacts)


def _since(begun: float) -> float:
    return (time.process_time() - begun) * 1e3


def one(job: Job, folder: Path) -> Row:
    """Plan the problems of one job. Returns an answer for each, and the reasons why some are left out."""
    model = RobotModel(load_robot("panda"))
    bench = Bench(model)
    answers: list[Row] = []
    left_out: list[str] = []
    for problem in problems(Path(job.data), job.scene, job.begin, job.count, model):
        margin = admitted(problem, model)
        if beyond := beyond_limits(problem, model):
            left_out.append(f"{problem.name}: {beyond}")
        elif margin < 0:
            left_out.append(f"{problem.name}: the goal penetrates by {-margin * 1000:.1f} mm")
        else:
            ours = asdict(bench.ours(problem, margin, job.seed))
            ahead = asdict(bench.ours(problem, margin, job.seed, IMPROVING_CHECKS))
            reference = asdict(bench.reference(problem, margin, job.seed))
            others = [bench.reference(problem, margin, seed) for seed in job.further]
            answers.append(
                {
                    "problem": problem.name,
                    "margin": margin,
                    "ours": ours,
                    "ahead": ahead,
                    "reference": reference,
                    "further": [each.length for each in others if each.solved],
                }
            )
    return {"answers": answers, "left_out": left_out}


def report(rows: list[Row]) -> str:
    """Return the table by scene, and everything that is not as it should be."""
    done = finished(rows)
    answers = [{**answer, "seed": row["seed"]} for row in done for answer in row["answers"]]
    narrow = sorted({f"{a['problem']} {a['margin'] * 1000:.1f} mm" for a in answers if a["margin"] < WANTED})
    left_out = sorted({text for row in done for text in row["left_out"]})
    lines = [f"left out: {len(left_out) or 'none'}", *(f"  {text}" for text in left_out)]
    told = f", but what the goal admits in {len(narrow)}: {', '.join(narrow)}" if narrow else ""
    lines += [f"margin {WANTED * 1000:g} mm{told}", ""]
    head = f"{'solved':>8} {'clean':>8} {'median':>7} {'p95':>7} {'checks':>7} {'length':>7} {'s':>5}"
    lines += [f"{'':18}{'picktree':^56}  {'OMPL':^56}", f"{'scene':17} {head}   {head}"]
    for scene, name in SCENES.items():
        of_scene = [a for a in answers if a["problem"].startswith(f"{scene} ")]
        if of_scene:
            lines.append(f"{name:17} {_part(of_scene, 'ours')}   {_part(of_scene, 'reference')}")
    lines.append(f"{'all':17} {_part(answers, 'ours')}   {_part(answers, 'reference')}")
    lines.append("median and p95: CPU ms; checks, length (rad), s (duration of the trajectory): medians")
    lines += ["", *_lengths(answers)]
    for planner in ("ours", "ahead", "reference"):
        lines += ["", *_faults(answers, planner)]
    return "\n".join([*lines, PUBLISHED])


def _lengths(answers: list[Row]) -> list[str]:
    """Return the lines of the second table: paths as they are, from look-ahead, and the reference's best."""
    best: dict[str, list[float]] = {}
    for answer in answers:
        solved = [answer["reference"]["length"]] if answer["reference"]["solved"] else []
        best.setdefault(answer["problem"], []).extend([*solved, *answer["further"]])
    runs = max(map(len, best.values()), default=0)
    lines = [f"{'length, rad':17} {'picktree':>9} {'ahead':>9} {f'OMPL, best of {runs}':>18}"]
    for scene, name in [*SCENES.items(), ("", "all")]:
        of = [a for a in answers if not scene or a["problem"].startswith(f"{scene} ")]
        shortest = [min(best[p]) for p in {a["problem"]: 0 for a in of} if best[p]]
        if of and shortest:
            mine, ahead = (
                _median([a[part] for a in of if a[part]["solved"]], "length") for part in ("ours", "ahead")
            )
            lines.append(f"{name:17} {mine:9.2f} {ahead:9.2f} {median(shortest):18.2f}")
    return [*lines, "medians; ahead: as look-ahead plans, with a shorter path searched for"]


def _part(answers: list[Row], planner: str) -> str:
    """Return one planner's half of a line of the table."""
    of = [answer[planner] for answer in answers]
    ms, solved = [a["ms"] for a in of], [a for a in of if a["solved"]]
    clean = sum(not a["contacts"] for a in solved)
    middle = partial(_median, solved)
    row = f"{len(solved):4}/{len(of):<3} {clean:4}/{len(solved):<3} {median(ms):7.1f}"
    row += f" {np.percentile(ms, 95):7.1f}"
    return f"{row} {_median(of, 'checks'):7.0f} {middle('length'):7.2f} {middle('seconds'):5.2f}"


def _median(of: list[Any], key: str) -> float:
    return median(a[key] for a in of) if of else float("nan")


def _faults(answers: list[Row], planner: str) -> list[str]:
    """Return the rates of one planner with their intervals, and each answer that is no clean path."""
    of = [(f"{a['problem']}, seed {a['seed']}", a[planner]) for a in answers]
    solved = [(name, a) for name, a in of if a["solved"]]
    by = Counter(a["outcome"] for _, a in solved).most_common()
    lines = [
        rate(f"{planner}: solved", len(solved), len(of)) + "; by " + ", ".join(f"{how} {n}" for how, n in by),
        rate(f"{planner}: clean", sum(not a["contacts"] for _, a in solved), len(solved)),
    ]
    lines += [f"  {name}: {a['outcome']}" for name, a in of if not a["solved"]]
    return lines + [f"  {name}: {'; '.join(a['contacts'])}" for name, a in solved if a["contacts"]]


def main() -> int:
    parser = options(__file__, __doc__, runs=50, what="problems of each scene")
    parser.set_defaults(first=1)
    parser.add_argument("--scene", action="append", choices=list(SCENES), help="only this one; repeatable")
    parser.add_argument("--seeds", type=int, default=2, metavar="N", help="planner seeds, from --first on; 2")
    parser.add_argument("--data", type=Path, help=f"the folder of {ARCHIVE}, or the file")
    given = parser.parse_args()
    path = required_archive(given.data)
    if path is None:
        return 0
    jobs = [
        Job(
            scene,
            begin,
            min(BLOCK, given.runs - begin),
            seed,
            str(path.absolute()),
            tuple(range(given.first + given.seeds, given.first + BEST_OF)) if seed == given.first else (),
        )
        for scene in given.scene or SCENES
        for begin in range(0, given.runs, BLOCK)
        for seed in range(given.first, given.first + given.seeds)
    ]
    rows = campaign(
        given,
        jobs,
        one,
        cost=lambda job: job.count * (COST + FURTHER_COST * len(job.further)),
        short=lambda row: f"{len(row['answers'])} problems",
    )
    print(report(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
