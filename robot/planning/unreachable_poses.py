"""Unreachable poses: how near the arm comes to them, and what keeps it from them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pinocchio as pin

from ...world.robot_model.joint_limits import is_hinge
from ...world.robot_model.model import RobotModel, pose_of
from ...world.values import Array, Pose
from .levenberg_marquardt import FULL_TURN, IkDescent, IkResult, IkSeeds, pose_key, target_of

EXPLANATION_SEEDS = 12
"""Number of seeds for each answer; the best result counts."""
POSITION_WEIGHTS = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
"""Weights of the position alone."""
MOSTLY_POSITION_WEIGHTS = np.array([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
"""Weights of position and orientation, for the orientation as near as possible where the position is nearly
reached."""
REACHED_DISTANCE = 1e-4
"""Position error below which a position is reached, m."""
LIMIT_TOLERANCE = 1e-6
"""Distance to a limit within which a joint is at it, rad or m."""

Obstacle = Literal["", "position", "orientation", "limits"]


@dataclass(frozen=True, slots=True)
class LimitExcess:
    """Joint that would have to go beyond a limit: its position and the limit, rad (m for a slider)."""

    joint: str
    wanted: float
    limit: float


@dataclass(frozen=True, slots=True, eq=False)
class NearestReach:
    """Nearest approach of the arm to a pose of the TCP, within the planned limits."""

    q: Array
    """Configuration (n,), rad."""
    tcp_in_world: Pose
    """Pose of the TCP in that configuration."""
    distance: float
    """Distance from the wanted position, m."""
    angle: float
    """Angle from the wanted orientation, rad."""
    obstacle: Obstacle
    """Obstacle that keeps the arm from the pose; "": none.

    `position`: no configuration brings the TCP to the point, in any orientation. `limits`: only the limits of
    `beyond` forbid it. `orientation`: the point can be reached, but not in that orientation.
    """
    at_limit: tuple[str, ...] = ()
    """Joints at a limit in q."""
    beyond: tuple[LimitExcess, ...] = ()
    """Joints that would have to exceed their limits, in the configuration that needs the least excess; ()
    unless the obstacle is `limits`."""


class ReachExplainer:
    """Explanations of unreachable poses for one robot."""

    def __init__(self, model: RobotModel, descent: IkDescent, atlas: IkSeeds) -> None:
        self._model = model
        self._descent = descent
        self._atlas = atlas
        hinge = np.array([is_hinge(joint) for joint in model.arm.joints][1:])
        self._open_lower: Array = np.where(hinge, -FULL_TURN, model.planned_lower)
        self._open_upper: Array = np.where(hinge, FULL_TURN, model.planned_upper)
        self._hinge = hinge

    def nearest(self, tcp_in_world: Pose, near: Array) -> NearestReach:
        """Return how near the arm comes to a pose; it depends on the pose, on `near` (n,) and the robot
        alone."""
        model, target = self._model, target_of(tcp_in_world)
        lower, upper = model.planned_lower, model.planned_upper
        seeds: list[Array] = [
            np.clip(near, lower, upper),
            *self._atlas.around(pose_key(target), EXPLANATION_SEEDS - 1),
        ]
        for seed in seeds:
            reached = self._minimum(target, seed, None)
            if reached.solved:
                return self._answer(reached.q, tcp_in_world, "")
        beyond = self._beyond(target, seeds)
        turned = [
            self._minimum(target, self._minimum(target, seed, MOSTLY_POSITION_WEIGHTS).q, POSITION_WEIGHTS).q
            for seed in seeds
        ]
        pointed = [self._minimum(target, seed, POSITION_WEIGHTS).q for seed in seeds]
        answers = [self._answer(q, tcp_in_world, "orientation") for q in (*turned, *pointed)]
        best = min(
            answers, key=lambda a: (0.0, a.angle) if a.distance < REACHED_DISTANCE else (a.distance, 0.0)
        )
        if beyond:
            return replace(best, obstacle="limits", beyond=beyond)
        return best if best.distance < REACHED_DISTANCE else replace(best, obstacle="position")

    def _minimum(self, target: pin.SE3, seed: Array, weights: Array | None) -> IkResult:
        lower, upper = self._model.planned_lower, self._model.planned_upper
        return self._descent.run(target, seed, lower, upper, weights=weights, stall=8, gain=0.9999, steps=150)

    def _beyond(self, target: pin.SE3, seeds: list[Array]) -> tuple[LimitExcess, ...]:
        """Return the joints beyond their limits in the solution that violates them least; () when there is no
        solution."""
        model = self._model
        lower, upper = model.planned_lower, model.planned_upper
        best, least = None, math.inf
        for seed in seeds:
            reached = self._descent.run(target, seed, self._open_lower, self._open_upper)
            if reached.solved:
                middle = 0.5 * (lower + upper)
                turns = np.rint((middle - reached.q) / FULL_TURN)
                q = np.where(self._hinge, reached.q + FULL_TURN * turns, reached.q)
                over = float(np.linalg.norm(np.maximum(lower - q, 0.0) + np.maximum(q - upper, 0.0)))
                if over < least:
                    best, least = q, over
        if best is None:
            return ()
        joints = zip(model.description.joints, best.tolist(), lower.tolist(), upper.tolist(), strict=True)
        return tuple(
            LimitExcess(name, angle, low if angle < low else high)
            for name, angle, low, high in joints
            if not low <= angle <= high
        )

    def _answer(self, q: Array, tcp_in_world: Pose, obstacle: Obstacle) -> NearestReach:
        model = self._model
        reached = pose_of(self._descent.place(q))
        stands = (q <= model.planned_lower + LIMIT_TOLERANCE) | (q >= model.planned_upper - LIMIT_TOLERANCE)
        names = zip(model.description.joints, stands.tolist(), strict=True)
        at_limit = tuple(name for name, at in names if at)
        distance, angle = reached.distance(tcp_in_world), reached.angle(tcp_in_world)
        return NearestReach(q, reached, distance, angle, obstacle, at_limit)
