"""Straight lines of the TCP: how many get to their end, what ends the others, and what they cost."""

from __future__ import annotations

import math
import time
from collections import Counter

from _motion_robots import shipped
from _motion_tables import Column, Part, Table, cpu, median, p95, share
from picktree.robot.planning import CollisionChecker, InverseKinematics
from picktree.robot.planning.cartesian_lines import plan_line
from picktree.robot.planning.trajectory_check import StartTolerance
from picktree.world import Array, PlanningScene, Pose
from picktree.world.robot_model import RobotModel

import numpy as np
import pinocchio as pin

LENGTH = 0.2
"""m"""
POSTURES = 6
MEANING = """
reach, jump: lines that ended because the arm reaches no further, or would have to swing round. from any
posture: to the end from one of up to six solutions at the start. / bare: over pinocchio's Jacobian and
frame placement once a step. backwards: complete lines that lead back again, and how far from the first
configuration they end (median): a joint to spare drifts.
"""


def _bare(model: RobotModel, path: Array) -> float:
    """CPU seconds of forward kinematics and a Jacobian at each configuration of a path, by pinocchio."""
    arm, data, frame = model.arm, model.arm.createData(), model.tcp_frame

    def all_of_them() -> None:
        for q in path:
            pin.computeJointJacobians(arm, data, q)
            pin.updateFramePlacement(arm, data, frame)
            pin.getFrameJacobian(arm, data, frame, pin.LOCAL)

    return cpu(all_of_them)


class _Nothing(StartTolerance):
    """Nothing is in the way: what is measured is the line alone."""

    def free(self, q: Array) -> bool:
        return True


def _row(name: str, model: RobotModel, runs: int, seed: int) -> tuple[str | float | None, ...]:
    rng = np.random.default_rng([seed, 3])
    ik, home = InverseKinematics(model), model.named("home")
    collision = CollisionChecker(model)
    collision.update(PlanningScene([], []), 0.0)
    way = _Nothing(collision, home)
    ended: Counter[str] = Counter()
    back = lines = any_posture = 0
    times, ratios, drift = list[float](), list[float](), list[float]()
    while lines < runs:
        x, y, z, yaw = (
            float(c) for c in rng.uniform([0.3, -0.35, 0.05, -math.pi], [0.65, 0.35, 0.4, math.pi])
        )
        begin = Pose.from_rpy((x, y, z), (math.pi, 0.0, yaw))
        direction = rng.normal(size=3)
        end = begin.shifted(direction * LENGTH / np.linalg.norm(direction))
        starts = ik.solutions(begin, rng, home, POSTURES)
        if not starts:
            continue
        lines += 1
        begun = time.process_time()
        line = plan_line(model, ik, way, starts[0], end)
        spent = time.process_time() - begun
        ended[line.ended_by] += 1
        any_posture += not all(plan_line(model, ik, way, start, end).ended_by for start in starts)
        if line.ended_by:
            continue
        times.append(spent * 1e3)
        ratios.append(spent / max(_bare(model, line.path), 1e-9))
        again = plan_line(model, ik, way, line.path[-1], begin)
        back += not again.ended_by
        drift.append(float(np.abs(again.path[-1] - starts[0]).max()))
    return (
        name,
        share(ended[""], lines),
        ended["reach"],
        ended["jump"],
        share(any_posture, lines),
        median(times),
        p95(times),
        median(ratios),
        share(back, ended[""]),
        median(drift),
    )


def measure(runs: int, seed: int) -> list[Table]:
    return [
        Table(
            "Lines of 20 cm in any direction, looking down, in steps of 5 mm, without collision checks",
            (
                Column("robot"),
                Column("to the end"),
                Column("reach", "d"),
                Column("jump", "d"),
                Column("from any posture"),
                Column("median, ms", ".2f"),
                Column("p95, ms", ".2f"),
                Column("/ bare", ".1f"),
                Column("backwards"),
                Column("off, rad", ".3f"),
            ),
            [_row(name, model, runs, seed) for name, model in shipped().items()],
            (MEANING,),
        )
    ]


PART = Part("lines", "straight lines of the tool", "lines of each robot", 500, 0.015, measure)
