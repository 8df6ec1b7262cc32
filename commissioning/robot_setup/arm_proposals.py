"""Proposals for an arm: joint limits, as far as a URDF gives them, and named poses."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...planning.kinematics.inverse_kinematics import InverseKinematics
from ...robots.model import RobotModel
from ...robots.urdf_tree import UrdfJoint, UrdfTree, read_skeleton
from ...world.values import Array, Pose

LIMIT_RESERVE = math.radians(2.0)
"""Distance kept from a joint's limits where the URDF has no soft limits, rad; never more than
RESERVE_SHARE."""
RESERVE_SHARE = 0.01
"""Greatest distance kept from a joint's limits, as a share of its range."""
CONTINUOUS_RANGE = 2 * math.pi
"""Range to either side of a joint without limits, rad: cables do not turn without end."""
MAX_VELOCITY = math.pi
"""Greatest plausible velocity, rad/s; a higher one of the URDF is replaced."""
DEFAULT_VELOCITY = 1.0
"""Velocity of a joint for which the URDF gives none, rad/s."""
ACCELERATION_TORQUE_SHARE = 0.5
"""Share of the torque left by gravity with which an acceleration is estimated."""
MIN_SPEED_UP_TIME = 0.3
"""Least time in which a joint reaches its velocity, s: it bounds the estimated acceleration."""
MIN_ACCELERATION = 0.5
"""Least acceleration that is proposed for a joint, rad/s²."""
CONFIGURATION_COUNT = 300


@dataclass(frozen=True, slots=True)
class ProposedLimits:
    """Proposed limits of one joint, rad, rad/s, rad/s², Nm; `comment` gives the origin of the values."""

    name: str
    lower: float
    upper: float
    velocity: float
    acceleration: float
    torque: float
    comment: str


def propose_limits(skeleton: UrdfTree, joints: tuple[str, ...]) -> tuple[ProposedLimits, ...]:
    """Propose limits from the URDF alone; accelerations and missing torques are estimated later."""
    return tuple(_proposed(name, skeleton.joints[name]) for name in joints)


def _proposed(name: str, joint: UrdfJoint) -> ProposedLimits:
    told: list[str] = []
    if joint.soft_lower is not None and joint.soft_upper is not None and joint.soft_lower < joint.soft_upper:
        lower, upper = joint.soft_lower, joint.soft_upper
        told.append("soft limits of the URDF")
    elif joint.type == "continuous" or joint.lower is None or joint.upper is None:
        lower, upper = -CONTINUOUS_RANGE, CONTINUOUS_RANGE
        told.append("turns without end: one turn to either side, for the cables")
    else:
        reserve = min(LIMIT_RESERVE, RESERVE_SHARE * (joint.upper - joint.lower))
        lower, upper = joint.lower + reserve, joint.upper - reserve
        told.append(f"the URDF's limits less {math.degrees(reserve):.1f} deg")
    if lower < -CONTINUOUS_RANGE or upper > CONTINUOUS_RANGE:
        lower, upper = max(lower, -CONTINUOUS_RANGE), min(upper, CONTINUOUS_RANGE)
        told.append("at most one turn to either side")
    velocity = joint.velocity or 0.0
    if velocity <= 0.0:
        velocity = DEFAULT_VELOCITY
        told.append("no velocity in the URDF: slow")
    elif velocity > MAX_VELOCITY:
        told.append(f"the URDF's {velocity:g} rad/s are not believed")
        velocity = MAX_VELOCITY
    torque = joint.effort or 0.0
    if torque <= 0.0:
        told.append("no torque in the URDF: three times what gravity needs")
        torque = 0.0
    return ProposedLimits(
        name, round(lower, 5), round(upper, 5), velocity, MIN_ACCELERATION, torque, "; ".join(told)
    )


def estimate(
    model: RobotModel, given: tuple[ProposedLimits, ...], seed: int = 0
) -> tuple[ProposedLimits, ...]:
    """Estimate accelerations: half of the torque that gravity leaves, over the largest inertia that the joint
    sees.

    Gravity torque and inertia are the largest of random configurations. No joint reaches its velocity in less
    than MIN_SPEED_UP_TIME.
    """
    generator = np.random.default_rng([seed, 3])
    gravity: Array = np.zeros(model.n)
    inertia: Array = np.full(model.n, 1e-6)
    for _ in range(CONFIGURATION_COUNT):
        q = generator.uniform(model.lower, model.upper)
        gravity = np.maximum(gravity, np.abs(model.gravity(q)))
        inertia = np.maximum(inertia, np.diag(model.mass_matrix(q)))
    found: list[ProposedLimits] = []
    for limit, weight, seen in zip(given, gravity.tolist(), inertia.tolist(), strict=True):
        torque = limit.torque if limit.torque > 0.0 else round(3.0 * weight + 1.0, 1)
        comment = limit.comment
        if torque <= weight:
            comment += f"; gravity alone needs {weight:.1f} Nm"
        acceleration = min(
            ACCELERATION_TORQUE_SHARE * max(torque - weight, 0.0) / seen, limit.velocity / MIN_SPEED_UP_TIME
        )
        acceleration = float(f"{max(acceleration, MIN_ACCELERATION):.2g}")
        found.append(replace(limit, torque=torque, acceleration=acceleration, comment=comment))
    return tuple(found)


FINGER_DIRECTIONS = 8
"""Number of finger directions that are tried."""
HOME_DISTANCES = (0.36, 0.42, 0.48, 0.3, 0.24)
"""Horizontal distances of the tool from the base that are tried for `home`, as shares of the reach."""
HOME_HEIGHTS = (0.5, 0.42, 0.58, 0.35, 0.65)
"""Heights of the tool over the base that are tried for `home`, as shares of the reach."""
REST_DISTANCES = (0.3, 0.36, 0.42)
REST_HEIGHTS = (0.55, 0.65, 0.45, 0.75)
WORK_AREA = ((0.35, -0.25), (0.65, 0.25))
"""Corners of the part of the table where scenes have their items, m in the world."""
CAMERA_HEIGHT = 0.8
"""Height of a camera above the middle of that part, m."""
HALF_LINK_WIDTH = 0.08
"""Half of a link's width, as far as it hides the table from the camera, m."""
HIDING_COST = 2.0
"""Cost of a `home` that hides the whole of that part, in units of a posture's value."""
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


def hidden_share(model: RobotModel, tree: UrdfTree, q: Array) -> float:
    """Return the share of the items' part of the table, 0 … 1, that the arm hides from a camera above it.

    `tree`: that of the model's URDF.
    """
    poses = model.link_poses(q, 0.0)
    ends = [[poses[j.parent].position, poses[j.child].position] for j in tree.joints.values()]
    shares = np.linspace(0.0, 1.0, 9)[:, None, None]
    low: Array = np.array(WORK_AREA[0])
    high: Array = np.array(WORK_AREA[1])
    segments: Array = np.array(ends)
    points = ((1.0 - shares) * segments[:, 0] + shares * segments[:, 1]).reshape(-1, 3)
    points = points[(points[:, 2] > 0.0) & (points[:, 2] < CAMERA_HEIGHT - HALF_LINK_WIDTH)]
    larger = (CAMERA_HEIGHT / (CAMERA_HEIGHT - points[:, 2]))[:, None]
    middle = (low + high) / 2
    shadow = middle + (points[:, :2] - middle) * larger
    share: Array = np.linspace(0.0, 1.0, 12)
    both = np.column_stack([np.repeat(share, len(share)), np.tile(share, len(share))])
    cells: Array = (low + both * (high - low))[:, None]
    hidden = np.linalg.norm(cells - shadow, axis=2) < HALF_LINK_WIDTH * larger[:, 0]
    return float(hidden.any(axis=1).mean())


class _Search:
    def __init__(self, model: RobotModel, free: Callable[[Array], bool], seed: int) -> None:
        self._model = model
        self._tree = read_skeleton(Path(model.description.urdf))
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
                        _Posture(q, self._value(q) - self._cost(q, most, folded=folded))
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

    def _cost(self, q: Array, most: float, *, folded: bool) -> float:
        if folded:
            return 2.0 * self._extent(q, most)
        return HIDING_COST * hidden_share(self._model, self._tree, q)

    def _extent(self, q: Array, most: float) -> float:
        base = self._model.description.base_in_world.inverse()
        poses = self._model.link_poses(q, 0.0).values()
        away = [np.hypot(*base.apply(np.array(pose.position))[:2]) for pose in poses]
        return float(max(away)) / most
