"""Inverse kinematics: poses that can be reached, solved; and what it costs beside forward kinematics."""

from __future__ import annotations

import time

from _motion_robots import shipped
from _motion_tables import Column, Part, Table, cpu, median, p95, share
from picktree.robot.planning import InverseKinematics
from picktree.world import Array, Pose
from picktree.world.robot_model import RobotModel

import numpy as np
import pinocchio as pin

POSITION = 1e-4
"""m"""
ANGLE = 1e-3
"""rad"""
BLOCK = 250
"""Poses between two measurements of the bare call: what else runs on the machine changes with time."""
SEVERAL = 4
FEWER = 10
"""Of the poses every so manieth is asked for several solutions."""
MEANING = """
solved: within the joint limits, 0.1 mm and 1 mrad, by forward kinematics of its own. bare FK: pinocchio's
forwardKinematics and updateFramePlacement. median, p95: one solution, looked for from `home` on; in bare
FK: the median of each time over the bare call's of its block of 250 poses. of 4: different solutions
found when four are asked for; for 4: the median of that.
"""


def _right(model: RobotModel, q: Array, wanted: Pose) -> bool:
    """Checked by forward kinematics of its own: pose, and limits."""
    reached = model.tcp(q)
    turned = reached.rotation().T @ wanted.rotation()
    angle = float(np.arccos(np.clip((np.trace(turned) - 1.0) / 2.0, -1.0, 1.0)))
    inside = bool(np.all(q >= model.lower) and np.all(q <= model.upper))
    return inside and reached.distance(wanted) <= POSITION and angle <= ANGLE


def _bare(model: RobotModel, configurations: Array) -> float:
    """CPU seconds of pinocchio's forward kinematics and frame placement, one call of each."""
    arm, data, frame = model.arm, model.arm.createData(), model.tcp_frame

    def all_of_them() -> None:
        for q in configurations:
            pin.forwardKinematics(arm, data, q)
            pin.updateFramePlacement(arm, data, frame)

    all_of_them()
    return cpu(all_of_them) / len(configurations)


def _row(name: str, model: RobotModel, runs: int, seed: int) -> tuple[str | float | None, ...]:
    rng = np.random.default_rng([seed, 2])
    ik, home = InverseKinematics(model), model.named("home")
    solved = 0
    times, calls, bares, several = list[float](), list[float](), list[float](), list[float]()
    counts = list[int]()
    for begin in range(0, runs, BLOCK):
        count = min(BLOCK, runs - begin)
        reaching: Array = rng.uniform(model.planned_lower, model.planned_upper, (count, model.n))
        bare = _bare(model, reaching)
        bares.append(bare)
        for k, pose in enumerate([model.tcp(q) for q in reaching]):
            draws = np.random.default_rng([seed, begin + k])
            begun = time.process_time()
            found = ik.solutions(pose, draws, home, want=1)
            spent = time.process_time() - begun
            times.append(spent)
            calls.append(spent / bare)
            solved += bool(found) and _right(model, found[0], pose)
            if k % FEWER == 0:
                begun = time.process_time()
                counts.append(len(ik.solutions(pose, draws, home, want=SEVERAL)))
                several.append(time.process_time() - begun)
    middle = median(times)
    return (
        name,
        model.n,
        share(solved, runs),
        1e6 * (median(bares) or 0.0),
        1e6 * (middle or 0.0),
        median(calls),
        1e3 * (p95(times) or 0.0),
        float(np.mean(counts)),
        1e3 * (median(several) or 0.0),
    )


def measure(runs: int, seed: int) -> list[Table]:
    return [
        Table(
            "Inverse kinematics of poses that some configuration within the limits reaches",
            (
                Column("robot"),
                Column("joints", "d"),
                Column("solved"),
                Column("bare FK, µs", ".2f"),
                Column("median, µs", ".0f"),
                Column("in bare FK", ".0f"),
                Column("p95, ms", ".2f"),
                Column("of 4", ".2f"),
                Column("for 4, ms", ".2f"),
            ),
            [_row(name, model, runs, seed) for name, model in shipped().items()],
            (MEANING,),
        )
    ]


PART = Part("ik", "inverse kinematics of every shipped robot", "poses of each robot", 10000, 0.0015, measure)
