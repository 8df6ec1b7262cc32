"""Planners by name on MotionBenchMaker's table, shelf and cage: solved, CPU time, length of the path.

python benchmarks/planners.py                                   20 problems a scene, all planners
python benchmarks/planners.py --runs 50 --planner auto --planner aorrtc --budget 200000
python benchmarks/planners.py --data FOLDER                     where motion_bench_maker.tar.bz2 lies

CPU milliseconds of one thread from request to timed trajectory, its re-check and the planning scene's update
included. Lengths in joint space are compared on the problems that `auto` and the planner both solve: the
ratio is the median over these. Every trajectory is judged by python-fcl.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from _bench_maker import ARCHIVE, SCENES, Problem, admitted, beyond_limits, problems, required_archive
from picktree.robot.planning import DEFAULT_CHECK_BUDGET, JointGoal, Request, RequestSolver
from picktree.robot.planning.collision_model import CollisionMargins
from picktree.robot.planning.trajectory_verifier import TrajectoryVerifier
from picktree.world import Failure
from picktree.world.planner_names import AUTO, planner_names
from picktree.world.robot_model import RobotModel, load_robot

import numpy as np

SHOWN = ("table_pick", "bookshelf_small", "cage")
COST = 0.25
"""CPU seconds of one problem with one planner at the default budget, about."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer to one problem; not solved: a length and a duration of nan."""

    ms: float
    length: float = float("nan")
    """Length of the path, rad."""
    seconds: float = float("nan")
    """Duration of the trajectory, s."""
    clean: bool = True
    """Whether python-fcl finds no penetration."""


def answer(
    problem: Problem,
    planner: str,
    seed: int,
    budget: int,
    model: RobotModel,
    margin: float,
    judge: TrajectoryVerifier,
) -> Answer:
    solver = RequestSolver(
        model,
        problem.world,
        configuration=lambda: problem.start,
        width=lambda: problem.width,
        margins=CollisionMargins(margin, margin, margin, margin),
    )
    request = Request(JointGoal(problem.goal), allowed=problem.allowed, planner=planner, budget=budget)
    begun = time.process_time()
    try:
        plan = solver.solve(request, seed)
    except Failure:
        return Answer((time.process_time() - begun) * 1e3)
    ms = (time.process_time() - begun) * 1e3
    scene = problem.world.supposing(allowed=problem.allowed)
    length = float(np.linalg.norm(np.diff(plan.path, axis=0), axis=1).sum())
    clean = not judge.judge(plan.trajectory, scene, problem.width)
    return Answer(ms, length, plan.trajectory.duration, clean)


def row(planner: str, found: list[Answer], auto: list[Answer]) -> str:
    ms, length = np.array([one.ms for one in found]), np.array([one.length for one in found])
    ratio = length / np.array([one.length for one in auto])
    solved = np.isfinite(length)
    seconds = np.array([one.seconds for one in found])
    both = ratio[np.isfinite(ratio)]
    return (
        f"{planner:18} {int(solved.sum()):3}/{len(found):<3}"
        f" {np.median(ms):8.0f} {np.percentile(ms, 95):8.0f}"
        f" {_median(length[solved]):8.2f} {_median(both):6.2f} {_median(seconds[solved]):6.2f}"
        f" {sum(not one.clean for one in found):6}"
    )


def _median(values: np.typing.NDArray[np.float64]) -> float:
    return float(np.median(values)) if len(values) else float("nan")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=20, help="problems of each scene")
    parser.add_argument("--scene", action="append", choices=list(SCENES), help="only this one; repeatable")
    parser.add_argument("--planner", action="append", choices=planner_names(), help="only this; repeatable")
    parser.add_argument("--budget", type=int, default=DEFAULT_CHECK_BUDGET, help="collision checks")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--data", type=Path, help=f"the folder of {ARCHIVE}, or the file")
    given = parser.parse_args()
    path = required_archive(given.data)
    if path is None:
        return 0
    scenes = given.scene or list(SHOWN)
    planners = [AUTO, *(name for name in given.planner or planner_names() if name != AUTO)]
    cost = given.runs * len(scenes) * len(planners) * COST * given.budget / DEFAULT_CHECK_BUDGET
    print(f"about {cost / 60:.1f} CPU minutes; budget {given.budget} checks", flush=True)
    model = RobotModel(load_robot("panda"))
    judge = TrajectoryVerifier(model)
    for scene in scenes:
        tasks = [p for p in problems(path, [scene], given.runs, model) if not beyond_limits(p, model)]
        margins = [(problem, admitted(problem, model)) for problem in tasks]
        margins = [(problem, margin) for problem, margin in margins if margin >= 0]
        print(f"\n{SCENES[scene]}, {len(margins)} problems")
        heads = f"{'ms':>8} {'p95':>8} {'rad':>8} {'ratio':>6} {'s':>6} {'unclean':>6}"
        print(f"{'planner':18} {'solved':>7} {heads}")
        auto: list[Answer] = []
        for planner in planners:
            found = [
                answer(problem, planner, given.seed, given.budget, model, margin, judge)
                for problem, margin in margins
            ]
            auto = auto or found
            print(row(planner, found, auto), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
