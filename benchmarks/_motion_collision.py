"""Collision: what a check costs beside the bare call, and whether three checkers agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from _motion_robots import random_scene, shipped
from _motion_tables import Column, Part, Table, cpu, median, share
from picktree.robot.planning import CollisionChecker
from picktree.robot.planning.trajectory_verifier import TightestPair, TrajectoryVerifier
from picktree.world import Array
from picktree.world.robot_model import RobotModel

import numpy as np
import pinocchio as pin

BLOCK = 200
"""Configurations in one scene."""
AGREED = 1e-4
"""Signed distances may differ by this at the margin, m."""
REACH = 0.002
"""How near to its margin a pair is measured, m."""
HALVINGS = 40
COSTS = """
ours: Collision.free. bare call: pinocchio's computeCollisions with all bodies in one naive manager; AABB
tree: with the other one that misses nothing; naive: every pair. All with the same pairs and margins, up
to the first hit. python-fcl: the judge's tightest pair, 200 configurations at once. Medians over scenes
of 200.
"""
AGREEMENT = """
against: different answers; with python-fcl one counts when its signed distance lies more than 0.1 mm on
the other side of the margin. edges: configurations halved down to where ours changes its answer; there
python-fcl's distance should be the margin, and the worst is told.
"""


@dataclass
class _Tally:
    """Answers of the checker for one robot."""

    configurations: int = 0
    free: int = 0
    against_naive: int = 0
    against_fcl: list[str] = field(default_factory=list[str])
    edges: list[float] = field(default_factory=list[float])
    """Distances minus margin, by python-fcl, where the checker's answer changes, m."""
    times: dict[str, list[float]] = field(default_factory=dict[str, list[float]])
    """Of one configuration, in µs, the mean of each scene."""
    ratios: list[float] = field(default_factory=list[float])
    """Ours to the bare call with all bodies in one naive manager, of each scene."""


class _Bare:
    """pinocchio's own calls on the same geometry, pairs and margins, the configurations ready."""

    def __init__(self, model: RobotModel, collision: CollisionChecker) -> None:
        built = collision._now  # pyright: ignore[reportPrivateUsage]
        self._model, self._data = model.full, model.full.createData()
        self._geometry = built.geometry
        self._plain = self._scratch(built.least)
        self._tree = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(
            self._model, self._geometry, self._scratch(built.least)
        )
        self._same = pin.BroadPhaseManager_NaiveCollisionManager(
            self._model, self._geometry, self._scratch(built.least)
        )

    def _scratch(self, least: Array) -> pin.GeometryData:
        data = pin.GeometryData(self._geometry)
        data.setSecurityMargins(self._geometry, least, True, False)
        return data

    def tree(self, q: Array) -> bool:
        return pin.computeCollisions(self._model, self._data, self._tree, q, True)

    def same(self, q: Array) -> bool:
        return pin.computeCollisions(self._model, self._data, self._same, q, True)

    def naive(self, q: Array) -> bool:
        return pin.computeCollisions(self._model, self._data, self._geometry, self._plain, q, True)


def _scene(
    model: RobotModel, judge: TrajectoryVerifier, rng: np.random.Generator, count: int, tally: _Tally
) -> None:
    scene = random_scene(rng)
    width = float(rng.uniform(0.0, model.description.gripper.max_width))
    collision = CollisionChecker(model)
    collision.update(scene, width)
    bare = _Bare(model, collision)
    configurations: Array = rng.uniform(model.lower, model.upper, (count, model.n))
    whole = [model.full_q(q, width) for q in configurations]
    answers: dict[str, list[bool]] = {}
    spent: dict[str, float] = {}

    def timed(name: str, ask: Callable[[Array], bool], of: Sequence[Array]) -> None:
        ask(of[0])
        answers[name] = []
        spent[name] = cpu(lambda: answers[name].extend([ask(q) for q in of])) * 1e6 / count
        tally.times.setdefault(name, []).append(spent[name])

    timed("ours", collision.free, list(configurations))
    timed("same", bare.same, whole)
    timed("tree", bare.tree, whole)
    timed("naive", bare.naive, whole)
    tally.ratios.append(spent["ours"] / spent["same"])
    found: list[TightestPair | None] = []
    judging = cpu(lambda: found.extend(judge.tightest(configurations, scene, width, reach=REACH)))
    tally.times.setdefault("fcl", []).append(judging * 1e6 / count)
    tally.configurations += count
    tally.free += sum(answers["ours"])
    tally.against_naive += sum(
        ours == hit for ours, hit in zip(answers["ours"], answers["naive"], strict=True)
    )
    for free, tightest in zip(answers["ours"], found, strict=True):
        room = REACH if tightest is None else tightest.distance - tightest.margin
        if (free and room < -AGREED) or (not free and room > AGREED):
            tally.against_fcl.append(
                f"{'free' if free else 'hit'}, by python-fcl {room * 1e3:+.2f} mm: {tightest}"
            )
    edges = _edges(collision, configurations, answers["ours"], max(1, count // 20))
    for tightest in judge.tightest(np.array(edges), scene, width, reach=REACH) if edges else ():
        tally.edges.append(REACH if tightest is None else tightest.distance - tightest.margin)


def _edges(
    collision: CollisionChecker, configurations: Array, free: Sequence[bool], count: int
) -> list[Array]:
    """Configurations where the checker's answer changes, between one that is free and one that is not."""
    inside = [q for q, answer in zip(configurations, free, strict=True) if answer]
    outside = [q for q, answer in zip(configurations, free, strict=True) if not answer]
    found: list[Array] = []
    for a, b in list(zip(inside, outside, strict=False))[:count]:
        low, high = a, b
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if collision.free(middle) else (low, middle)
        found.append(low)
    return found


def measure(runs: int, seed: int) -> list[Table]:
    tallies: dict[str, _Tally] = {}
    for name, model in shipped().items():
        rng, judge = np.random.default_rng([seed, 1]), TrajectoryVerifier(model)
        tally = tallies[name] = _Tally()
        while tally.configurations < runs:
            _scene(model, judge, rng, min(BLOCK, runs - tally.configurations), tally)
    cost = Table(
        "A collision check of one configuration among 20 bodies, a table and two bins, µs",
        (
            Column("robot"),
            Column("ours", ".1f"),
            Column("bare call", ".1f"),
            Column("ours / bare", ".2f"),
            Column("bare, AABB tree", ".1f"),
            Column("naive", ".1f"),
            Column("python-fcl", ".0f"),
        ),
        [
            (
                name,
                *(median(t.times[key]) for key in ("ours", "same")),
                median(t.ratios),
                *(median(t.times[key]) for key in ("tree", "naive", "fcl")),
            )
            for name, t in tallies.items()
        ],
        (COSTS,),
    )
    agree = Table(
        "Do they agree? Scenes of boxes, cylinders, spheres, hulls; in 6 of 10 something is in the hand",
        (
            Column("robot"),
            Column("free"),
            Column("against naive"),
            Column("against python-fcl"),
            Column("edges", "d"),
            Column("worst at an edge, mm", ".4f"),
        ),
        [
            (
                name,
                f"{t.free} of {t.configurations}",
                share(t.against_naive, t.configurations),
                share(len(t.against_fcl), t.configurations),
                len(t.edges),
                1e3 * float(np.abs(t.edges).max()) if t.edges else None,
            )
            for name, t in tallies.items()
        ],
        (
            AGREEMENT,
            *(f"{name}: {told}" for name, t in tallies.items() for told in t.against_fcl[:5]),
        ),
    )
    return [cost, agree]


PART = Part(
    "collision",
    "collision checks beside pinocchio's bare call, the naive check and python-fcl",
    "configurations of each robot",
    20000,
    0.0035,
    measure,
)
