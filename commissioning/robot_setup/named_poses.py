"""Named poses proposed for an arm: tool down, far from singularities, from limits and from self-collision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...planning.kinematics.inverse_kinematics import InverseKinematics
from ...robots.model import RobotModel
from ...world.values import Array, Pose

FINGER_DIRECTIONS = 8
"""Number of finger directions that are tried."""
HOME_DISTANCES = (0.36, 0.42, 0.48, 0.3)
"""Horizontal distances of the tool from the base that are tried for `home`, as shares of the reach."""
HOME_HEIGHTS = (0.5, 0.42, 0.58, 0.35, 0.65)
"""Heights of the tool over the base that are tried for `home`, as shares of the reach."""
REST_DISTANCES = (0.3, 0.36, 0.42)
REST_HEIGHTS = (0.55, 0.65, 0.45, 0.75)
IK_SEED_COUNT = 4
"""Number of random configurations from which inverse kinematics starts."""
OBSERVE_ROTATION = np.pi / 2
"""Rotation of the first joint that moves the arm out of a camera's view of the table, rad."""


@dataclass(frozen=True, slots=True)
class NamedPose:
    """Proposed configuration (n,), rad, with a comment."""

    name: str
    joints: tuple[float, ...]
    comment: str


@dataclass(frozen=True, slots=True)
class _Posture:
    q: Array
    value: float


def reach(model: RobotModel, samples: int = 2000, seed: int = 0) -> float:
    """Return the tool's reach from the first joint's axis, m: the 99th percentile of random
    configurations."""
    generator = np.random.default_rng([seed, 1])
    base = model.description.base_in_world.inverse()
    found = [
        np.hypot(*base.apply(np.array(model.tcp(generator.uniform(model.lower, model.upper)).position))[:2])
        for _ in range(samples)
    ]
    return float(np.percentile(found, 99))


def propose_poses(model: RobotModel, free: Callable[[Array], bool], seed: int = 0) -> tuple[NamedPose, ...]:
    """Propose `home`, `observe` and `rest`; the comment says when a pose is a substitute.

    `free` returns whether a configuration (n,) is free of self-collision.
    """
    most = reach(model, seed=seed)
    search = _Search(model, free, seed)
    home = search.best(most, HOME_DISTANCES, HOME_HEIGHTS)
    comment = "Tool down in front of the base."
    if home is None:
        home = search.anywhere()
        comment = "No pose with the tool down was found that is free: this one is free and away from limits."
    aside = _turned(model, free, home)
    rest = search.best(most, REST_DISTANCES, REST_HEIGHTS, folded=True)
    return (
        NamedPose("home", _rounded(home), comment),
        NamedPose(
            "observe",
            _rounded(home if aside is None else aside),
            "As home, turned to the side, out of the view of a camera above the table."
            if aside is not None
            else "As home: turned to the side, the arm would hit itself or a limit.",
        ),
        NamedPose(
            "rest",
            _rounded(home if rest is None else rest),
            "Folded over the base, for standing by."
            if rest is not None
            else "As home: no folded pose is free.",
        ),
    )


def _rounded(q: Array) -> tuple[float, ...]:
    return tuple(round(float(v), 3) for v in q)


def _turned(model: RobotModel, free: Callable[[Array], bool], home: Array) -> Array | None:
    for turn in (OBSERVE_ROTATION, -OBSERVE_ROTATION):
        aside = home.copy()
        aside[0] += turn
        if model.planned_lower[0] <= aside[0] <= model.planned_upper[0] and free(aside):
            return aside
    return None


class _Search:
    def __init__(self, model: RobotModel, free: Callable[[Array], bool], seed: int) -> None:
        self._model = model
        self._free = free
        self._ik = InverseKinematics(model)
        self._generator = np.random.default_rng([seed, 2])

    def best(
        self, most: float, near: tuple[float, ...], high: tuple[float, ...], *, folded: bool = False
    ) -> Array | None:
        """Return the free configuration of greatest value with the tool down in front of the base; None:
        there is none."""
        found: list[_Posture] = []
        for share in near:
            for height in high:
                for k in range(FINGER_DIRECTIONS):
                    tool = Pose.from_rpy(
                        (share * most, 0.0, height * most), (np.pi, 0.0, 2 * np.pi * k / FINGER_DIRECTIONS)
                    )
                    tool = self._model.description.base_in_world @ tool
                    found += [
                        _Posture(q, self._value(q) - (2.0 * self._extent(q, most) if folded else 0.0))
                        for q in self._solutions(tool)
                    ]
        for posture in sorted(found, key=lambda p: (-p.value, tuple(p.q))):
            if self._free(posture.q):
                return posture.q
        return None

    def anywhere(self) -> Array:
        """Return the free configuration of greatest value among random ones, or the best of all when none is
        free."""
        model = self._model
        drawn = [self._generator.uniform(model.planned_lower, model.planned_upper) for _ in range(500)]
        drawn.sort(key=lambda q: (-self._value(q), tuple(q)))
        return next((q for q in drawn if self._free(q)), drawn[0])

    def _solutions(self, tool: Pose) -> list[Array]:
        middle = np.clip(np.zeros(self._model.n), self._model.planned_lower, self._model.planned_upper)
        seeds = [middle]
        for k in range(IK_SEED_COUNT):
            seed = self._generator.uniform(self._model.planned_lower, self._model.planned_upper)
            if k % 2 == 0:
                # From a seed whose twisting joints are straight, the arm stays in its plane.
                seed[::2] = middle[::2]
            seeds.append(seed)
        return [q for seed in seeds if (q := self._ik.descend(tool, seed)) is not None]

    def _value(self, q: Array) -> float:
        """Return the value of a configuration: greater far from singularities and limits, with the first
        joint ahead."""
        model = self._model
        singular = np.linalg.svd(model.jacobian(q), compute_uv=False)
        spread = model.upper - model.lower
        to_limit = float((np.minimum(q - model.lower, model.upper - q) / np.minimum(spread, 2 * np.pi)).min())
        ease = min(float(singular[-1]) / 0.15, 1.0)
        straight = float(np.abs(q).sum()) / (np.pi * model.n)
        return ease + 2.0 * min(to_limit, 0.2) - straight - 0.5 * abs(float(q[0])) / np.pi

    def _extent(self, q: Array, most: float) -> float:
        base = self._model.description.base_in_world.inverse()
        poses = self._model.link_poses(q, 0.0).values()
        away = [np.hypot(*base.apply(np.array(pose.position))[:2]) for pose in poses]
        return float(max(away)) / most
