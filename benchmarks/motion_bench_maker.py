"""MotionBenchMaker's problems from request to timed trajectory: solved, judged, and what it costs.

python benchmarks/motion_bench_maker.py                        all problems, one planner seed
python benchmarks/motion_bench_maker.py --runs 10 --seed 3 --scene box --scene cage
python benchmarks/motion_bench_maker.py --data FOLDER          where motion_bench_maker.tar.bz2 lies

CPU milliseconds of one thread, for the whole way: the planning scene into the checker, the search, the
shortened path, the timed trajectory and its re-check. Beside each problem stands a bare OMPL solve of the
same run on the same shapes with the same margin: RRT-Connect, OMPL's simplification, pinocchio's broad phase;
no scene, no timing. The bare solves are most of the cost; --no-bare leaves them out.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from _bare_ompl import BarePlanner
from _bench_maker import ARCHIVE, SCENES, WANTED, Problem, admitted, archive, beyond_limits, problems
from _campaign import wilson
from picktree.planning.collision.collision_bodies import CollisionMargins
from picktree.planning.collision.trajectory_judge import TrajectoryVerifier
from picktree.planning.requests import JointGoal, Request
from picktree.planning.service.solver import RequestSolver
from picktree.robots.loading import load_robot
from picktree.robots.model import RobotModel
from picktree.world.causes import Failure

import numpy as np

COST = 0.5
"""CPU seconds of one problem with its judge, its reference and making the checkers, about."""
COST_ALONE = 0.2
"""The same without the reference."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of one problem with one seed; times in CPU milliseconds."""

    problem: str
    scene: str
    seed: int
    margin: float
    """m"""
    outcome: str
    """The planner that found it, or the cause of the failure with its sentence."""
    solved: bool
    ms: float
    checks: int
    seconds: float
    """Duration of the trajectory."""
    length: float
    """Of the path, rad."""
    contacts: tuple[str, ...]
    """What the judge found against it."""
    bare_ms: float
    bare_length: float
    """Of the bare OMPL path, rad; nan where it found none."""


def answer(
    problem: Problem, margin: float, seed: int, model: RobotModel, judge: TrajectoryVerifier, bare: bool
) -> Answer:
    margins = CollisionMargins(margin, margin, margin, margin)
    solver = RequestSolver(
        model,
        problem.world,
        configuration=lambda: problem.start,
        width=lambda: problem.width,
        margins=margins,
    )
    request = Request(JointGoal(problem.goal), allowed=problem.allowed)
    begun = time.process_time()
    try:
        plan = solver.solve(request, seed)
        failure = None
    except Failure as failed:
        plan, failure = None, failed
    ms = (time.process_time() - begun) * 1e3
    contacts = ()
    if plan is not None:
        scene = problem.world.supposing(allowed=problem.allowed)
        contacts = judge.judge(plan.trajectory, scene, problem.width)
    bare_ms, bare_length = (float("nan"),) * 2
    if bare:
        reference = BarePlanner(model, problem.world, problem.width, problem.allowed, margin)
        begun = time.process_time()
        path = reference.plan(problem.start, problem.goal, seed)
        bare_ms = (time.process_time() - begun) * 1e3
        bare_length = float("nan") if path is None else _length(path)
    return Answer(
        problem.name,
        problem.scene,
        seed,
        margin,
        str(failure) if plan is None else plan.planner,
        plan is not None,
        ms,
        solver.collision.checks,
        float("nan") if plan is None else plan.trajectory.duration,
        float("nan") if plan is None else _length(plan.path),
        tuple(f"{c.a} {-c.distance * 1000:.2f} mm deep in {c.b}" for c in contacts),
        bare_ms,
        bare_length,
    )


def _length(path: np.typing.NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def report(answers: list[Answer], bare: bool) -> None:
    head = f"\n{'scene':18} {'solved':>9} {'median':>7} {'p95':>7} {'checks':>7} {'length':>7} {'s':>5}"
    print(head + (f"   {'bare OMPL':>9} {'p95':>7} {'length':>7} {'ratio':>6}" if bare else ""))
    for scene, told in SCENES.items():
        of = [a for a in answers if a.scene == scene]
        if of:
            print(_row(told, of, bare))
    print(_row("all", answers, bare))
    print("median and p95: CPU ms; checks, length (rad), s (of the trajectory), ratio (of ms): medians")
    solved = sum(a.solved for a in answers)
    low, high = wilson(solved, len(answers))
    print(f"\nsolved {solved} of {len(answers)} ({low:.1%} … {high:.1%}); by", end=" ")
    print(", ".join(f"{how} {n}" for how, n in Counter(a.outcome for a in answers if a.solved).most_common()))
    for a in answers:
        if not a.solved:
            print(f"  {a.problem}, seed {a.seed}: {a.outcome}")
    bad = [a for a in answers if a.contacts]
    print(f"judged by python-fcl: {solved - len(bad)} clean, {len(bad)} not")
    for a in bad:
        print(f"  {a.problem}, seed {a.seed}: {'; '.join(a.contacts)}")


def _row(told: str, of: list[Answer], bare: bool) -> str:
    ms, solved = np.array([a.ms for a in of]), [a for a in of if a.solved]
    length = np.median([a.length for a in solved]) if solved else float("nan")
    seconds = np.median([a.seconds for a in solved]) if solved else float("nan")
    row = f"{told:18} {len(solved):4}/{len(of):<4} {np.median(ms):7.1f} {np.percentile(ms, 95):7.1f}"
    row += f" {np.median([a.checks for a in of]):7.0f} {length:7.2f} {seconds:5.2f}"
    if bare:
        other, found = np.array([a.bare_ms for a in of]), [a.bare_length for a in of if a.bare_length > 0]
        row += f"   {np.median(other):9.1f} {np.percentile(other, 95):7.1f}"
        row += f" {np.median(found) if found else float('nan'):7.2f} {np.median(ms / other):6.2f}"
    return row


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=50, help="problems of each scene")
    parser.add_argument("--scene", action="append", choices=list(SCENES), help="only this one; repeatable")
    parser.add_argument("--seed", type=int, default=1, help="the planner's first seed")
    parser.add_argument("--seeds", type=int, default=1, help="how many seeds, from --seed on")
    parser.add_argument("--data", type=Path, help=f"the folder of {ARCHIVE}, or the file")
    parser.add_argument("--no-bare", action="store_true", help="leave the bare OMPL solve out")
    given = parser.parse_args()
    path = archive(given.data)
    if path is None or not path.exists():
        where = "beside the project" if path is None else str(path)
        print(f"no {ARCHIVE} {where}: nothing to do; --data FOLDER says where it is")
        return 0
    model = RobotModel(load_robot("panda"))
    tasks = problems(path, given.scene or list(SCENES), given.runs, model)
    minutes = len(tasks) * given.seeds * (COST_ALONE if given.no_bare else COST) / 60
    print(f"{len(tasks)} problems × {given.seeds} seeds: about {minutes:.1f} CPU minutes", flush=True)
    judge, answers = TrajectoryVerifier(model), list[Answer]()
    narrow, out = Counter[str](), list[str]()
    for problem in tasks:
        margin = admitted(problem, model)
        if beyond := beyond_limits(problem, model):
            out.append(f"{problem.name}: {beyond}")
        elif margin < 0:
            out.append(f"{problem.name}: the goal penetrates by {-margin * 1000:.1f} mm")
        else:
            if margin < WANTED:
                narrow[f"{problem.name} {margin * 1000:.1f} mm"] += 1
            for seed in range(given.seed, given.seed + given.seeds):
                answers.append(answer(problem, margin, seed, model, judge, not given.no_bare))
    print(f"\nleft out: {len(out) or 'none'}")
    for line in out:
        print(f"  {line}")
    told = f", but what the goal admits in {len(narrow)}: {', '.join(narrow)}" if narrow else ""
    print(f"margin {WANTED * 1000:g} mm{told}")
    if not answers:
        return 0
    report(answers, not given.no_bare)
    return 0


if __name__ == "__main__":
    sys.exit(main())
