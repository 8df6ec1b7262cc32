"""Carrying upright: how often a motion is found under a constraint, and what it costs.

`python benchmarks/constrained.py --scene shelf --runs 100 --tilt 10` asks for motions between random poses of
a level tool that are free at both ends, on a table or inside a shelf. Each trajectory is held against the
definition of the constraint, sample by sample, and judged by the second collision checker. About 0.5 s CPU a
motion in the shelf, 0.05 s on the table.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from math import degrees, pi, radians
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from picktree.logs import rate
from picktree.robot.planning import PoseGoal, Request, RequestSolver, UprightConstraint
from picktree.robot.planning.trajectory_verifier import TrajectoryVerifier
from picktree.world import Array, Failure, Pose, Vector3

from tests.planning.motion_cell import HOME, MODEL, down, shelf_scene, table_scene

WIDTH = 0.08


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", choices=("table", "shelf"), default="shelf")
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--tilt", type=float, default=10.0, help="deg")
    parser.add_argument("--seed", type=int, default=7)
    given = parser.parse_args()
    shelf = given.scene == "shelf"
    print(f"about {given.runs * (0.5 if shelf else 0.05):.0f} s CPU", flush=True)
    scene = shelf_scene() if shelf else table_scene()
    axis: Vector3 = (-1.0, 0.0, 0.0) if shelf else (0.0, 0.0, -1.0)
    solver = RequestSolver(MODEL, scene, configuration=lambda: HOME, width=lambda: WIDTH)
    solver.look()
    rng = np.random.default_rng(given.seed)
    upright = (UprightConstraint(radians(given.tilt), axis),)
    judge = TrajectoryVerifier(MODEL)
    outcomes: Counter[str] = Counter()
    seconds: list[float] = []
    checks: list[int] = []
    worst, disagreed, asked = 0.0, 0, 0
    while asked < given.runs:
        start, goal = free_at(solver, pose(rng, shelf), rng), pose(rng, shelf)
        if start is None or free_at(solver, goal, rng) is None:
            continue
        asked += 1
        began = time.process_time()
        try:
            plan = solver.solve(Request(PoseGoal((goal,)), start, constraints=upright), asked)
        except Failure as failure:
            outcomes[failure.cause.name] += 1
            print(f"{asked}: {failure}", flush=True)
            continue
        seconds.append(time.process_time() - began)
        outcomes[plan.planner] += 1
        checks.append(plan.checks)
        ups = [float((MODEL.tcp(q).rotation() @ np.array(axis))[2]) for q in plan.trajectory.position]
        worst = max(worst, degrees(float(np.arccos(np.clip(min(ups), -1.0, 1.0)))))
        disagreed += bool(judge.judge(plan.trajectory, scene, WIDTH))
    share = rate(len(seconds), asked)
    print(f"{given.scene}, {given.tilt:g} deg: planned {share}; {dict(outcomes)}")
    print(f"CPU ms, median and p95: {np.median(seconds) * 1e3:.0f} {np.percentile(seconds, 95) * 1e3:.0f}")
    print(f"checks, median and p95: {np.median(checks):.0f} {np.percentile(checks, 95):.0f}")
    print(f"greatest tilt {worst:.3f} deg; judged to collide: {disagreed}")


def pose(rng: np.random.Generator, shelf: bool) -> Pose:
    """At random, the tool level in the shelf or looking down on the table."""
    if not shelf:
        x, y, z, yaw = (float(c) for c in rng.uniform([0.3, -0.5, 0.05, -1.5], [0.7, 0.5, 0.5, 1.5]))
        return down(x, y, z, yaw)
    x, y, z, turn = (float(c) for c in rng.uniform([0.45, -0.3, 0.28, -0.6], [0.68, 0.3, 0.52, 0.6]))
    return Pose.from_rpy((x, y, z), (0.0, pi / 2, 0.0)) @ Pose.from_rpy((0.0, 0.0, 0.0), (turn, 0.0, 0.0))


def free_at(solver: RequestSolver, tcp: Pose, rng: np.random.Generator) -> Array | None:
    """A free configuration for a pose, or None."""
    solver.look()
    return next((q for q in solver.ik.solutions(tcp, rng, HOME) if solver.collision.free(q)), None)


if __name__ == "__main__":
    main()
