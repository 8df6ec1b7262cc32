"""MotionBenchMaker's problems as tables; see `motion_bench_maker.py`, which tells more."""

from __future__ import annotations

from collections import Counter

from _bench_maker import ARCHIVE, SCENES, WANTED, admitted, archive, beyond_limits, problems
from _motion_tables import Column, Part, Table, Value, median, p95, share
from motion_bench_maker import Answer, answer
from picktree.planning.collision.trajectory_judge import TrajectoryVerifier
from picktree.robots.loading import load_robot
from picktree.robots.model import RobotModel

MEANING = """
ms: from request to simplified, timed trajectory, re-checked, making the collision checker included. bare
OMPL: RRT-Connect with OMPL's own simplification on the same shapes with the same margin, not timed.
narrow: problems whose goal admits less than the wanted margin of 5 mm; the largest that it admits is kept
there. judge: trajectories in which python-fcl finds penetration.
"""
COLUMNS = (
    Column("scene"),
    Column("solved"),
    Column("ms", ".1f"),
    Column("p95", ".1f"),
    Column("checks", ".0f"),
    Column("bare OMPL", ".1f"),
    Column("ms / bare", ".2f"),
    Column("narrow", "d"),
    Column("judge", "d"),
)


def _row(told: str, answers: list[Answer]) -> tuple[Value, ...]:
    ratios = [a.ms / a.bare_ms for a in answers if a.solved]
    return (
        told,
        share(sum(a.solved for a in answers), len(answers)),
        median([a.ms for a in answers]),
        p95([a.ms for a in answers]),
        median([a.checks for a in answers]),
        median([a.bare_ms for a in answers]),
        median(ratios),
        sum(a.margin < WANTED for a in answers),
        sum(bool(a.contacts) for a in answers),
    )


def measure(runs: int, seed: int) -> list[Table]:
    title = "MotionBenchMaker's problems"
    path = archive(None)
    if path is None or not path.exists():
        return [Table(title, (Column("scene"),), [], (f"No {ARCHIVE} in ../shared/data: nothing to do.",))]
    model = RobotModel(load_robot("panda"))
    judge, left_out = TrajectoryVerifier(model), list[str]()
    of: dict[str, list[Answer]] = {scene: [] for scene in SCENES}
    for problem in problems(path, list(SCENES), runs, model):
        margin = admitted(problem, model)
        if beyond := beyond_limits(problem, model):
            left_out.append(f"{problem.name} ({beyond})")
        elif margin < 0:
            left_out.append(f"{problem.name} (its goal penetrates by {-margin * 1e3:.1f} mm)")
        else:
            of[problem.scene].append(answer(problem, margin, seed + 1, model, judge, True))
    rows = [_row(told, of[scene]) for scene, told in SCENES.items() if of[scene]]
    everything = [one for answers in of.values() for one in answers]
    failed = Counter(f"{a.problem}: {a.outcome}" for a in everything if not a.solved)
    notes = (
        MEANING,
        f"left out: {'; '.join(left_out) or 'none'}",
        f"not solved: {'; '.join(failed) or 'none'}",
    )
    return [Table(title, COLUMNS, [*rows, _row("all", everything)] if everything else [], notes)]


PART = Part(
    "maker", "MotionBenchMaker's problems, where their archive is", "problems of each scene", 50, 2.5, measure
)
