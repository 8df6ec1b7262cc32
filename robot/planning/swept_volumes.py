"""Swept volumes: the solids of a robot along a trajectory, and their distances at each sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from picktree.world import Array, Pose, Trajectory
from picktree.world.robot_model import RobotModel

from .scene_queries import (
    FclDistance,
    FclMovedSolid,
    FclPlacedSolid,
    FclSolid,
    distance_between,
)

MAX_TCP_STEP = 0.005
"""Greatest travel of the TCP between two moments, m."""


MAX_JOINT_STEP = 0.03
"""Greatest distance in joint space between two moments, rad: the elbow may move while the TCP does not."""


Pairs = NDArray[np.intp]


_CHECK_ROTATIONS = tuple(
    Pose.from_rpy((0.0, 0.0, 0.0), rpy).rotation() for rpy in ((0.7, 1.1, 2.3), (-1.3, 0.4, 0.9))
)


class LinkSolid:
    """Solid on a joint of the whole robot (0: fixed part), at a pose in that joint's frame."""

    def __init__(self, solid: FclSolid, joint: int, pose_in_joint: Pose) -> None:
        self.solid = solid
        self.joint = joint
        self.rotation: Array = pose_in_joint.rotation()
        self.position: Array = np.array(pose_in_joint.position)
        low, high = solid.corners.min(axis=0), solid.corners.max(axis=0)
        self.centre: Array = 0.5 * (low + high)
        self.half: Array = 0.5 * (high - low)


@dataclass(frozen=True, slots=True, eq=False)
class TrajectorySamples:
    """Samples of a trajectory: times (t,) s and configurations (t, n) rad."""

    times: Array
    configurations: Array


def moments_of(model: RobotModel, trajectory: Trajectory) -> TrajectorySamples:
    """Sample a trajectory evenly, at most MAX_TCP_STEP and MAX_JOINT_STEP apart, from start to end."""
    q = trajectory.position
    data, frame = model.arm.createData(), model.tcp_frame
    points: Array = np.empty((len(q), 3))
    for k, configuration in enumerate(q):
        pin.forwardKinematics(model.arm, data, configuration)
        points[k] = pin.updateFramePlacement(model.arm, data, frame).translation
    ways = np.maximum(
        np.linalg.norm(np.diff(points, axis=0), axis=1) / MAX_TCP_STEP,
        np.linalg.norm(np.diff(q, axis=0), axis=1) / MAX_JOINT_STEP,
    )
    along = np.concatenate([[0.0], np.cumsum(ways)])
    total = float(along[-1])
    # Between samples the travel is taken to be even in time, which is not exact.
    marks: Array = np.linspace(0.0, total, max(2, int(np.ceil(1.1 * total)) + 1))
    times: Array = np.interp(marks, along, trajectory.times)
    return TrajectorySamples(times, _at(trajectory, times))


def _at(trajectory: Trajectory, times: Array) -> Array:
    """Return the configurations (t, n) at those times: between samples the arm follows their polynomials."""
    q = trajectory.position
    k = np.clip(np.searchsorted(trajectory.times, times, side="right") - 1, 0, len(q) - 2)
    u = (times - trajectory.times[k])[:, None]
    powers = trajectory.polynomials()[k]
    configurations = powers[:, -1]
    for power in range(powers.shape[1] - 2, -1, -1):
        configurations = configurations * u + powers[:, power]
    configurations[0], configurations[-1] = q[0], q[-1]
    return configurations


class RobotSweep:
    """Solids on a robot at a number of moments, among bodies at rest.

    Pairs (p, 2) are numbers: of carried solids and, from their count on, of the bodies around.
    """

    def __init__(
        self,
        model: RobotModel,
        carried: Sequence[LinkSolid],
        around: Sequence[FclPlacedSolid],
        configurations: Array,
        width: float,
    ) -> None:
        self._around = around
        turn, at = _joints(model, [c.joint for c in carried], configurations, width)
        self._rotation: Array = turn @ np.array([c.rotation for c in carried])
        self._position: Array = at + _rotate_points(turn, np.array([c.position for c in carried]))
        centre, half = np.array([c.centre for c in carried]), np.array([c.half for c in carried])
        middle = self._position + _rotate_points(self._rotation, centre)
        reach = _rotate_points(np.abs(self._rotation), half)
        self._low: Array = middle - reach
        self._high: Array = middle + reach
        self._around_low: Array = np.array([b.low for b in around]).reshape(-1, 3)
        self._around_high: Array = np.array([b.high for b in around]).reshape(-1, 3)
        self._travel = self._travelled(centre, half)
        self._moved = [FclMovedSolid(c.solid) for c in carried]

    def _travelled(self, centre: Array, half: Array) -> Array:
        """Return (moments, carried): the travel of the fastest point of each solid up to each moment, m.

        The displacement of a rigid motion is affine in the point: over a box it is greatest at a corner.
        """
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
        corners = centre[:, None] + signs * half[:, None]
        points = np.einsum("tcij,ckj->tcki", self._rotation, corners) + self._position[:, :, None]
        ways = np.linalg.norm(np.diff(points, axis=0), axis=3).max(axis=2)
        return np.concatenate([np.zeros((1, len(centre))), np.cumsum(ways, axis=0)])

    def near(self, pairs: Pairs, reach: float) -> Pairs:
        """Select the pairs whose bounding boxes over the whole motion come within `reach` m of each other."""
        low = np.concatenate([self._low.min(axis=0), self._around_low])
        high = np.concatenate([self._high.max(axis=0), self._around_high])
        a, b = pairs[:, 0], pairs[:, 1]
        return pairs[((low[a] <= high[b] + reach) & (low[b] <= high[a] + reach)).all(axis=1)]

    def bounds(self, pairs: Pairs) -> Array:
        """Return lower bounds (moments, pairs) of distances by bounding boxes, m; -inf where they overlap."""
        low, high = (
            [_rows_of(moving, still, pairs[:, k]) for k in (0, 1)]
            for moving, still in ((self._low, self._around_low), (self._high, self._around_high))
        )
        apart = np.maximum(np.maximum(low[0] - high[1], low[1] - high[0]), 0.0)
        distance = np.sqrt(np.einsum("tpk,tpk->tp", apart, apart))
        return np.where(distance > 0.0, distance, -np.inf)

    def travel(self, pairs: Pairs) -> Array:
        """Return (moments, pairs): the sum of both bodies' travel up to each moment, m.

        Between two moments their distance changes by no more than the difference.
        """
        still = np.zeros((len(self._travel), len(self._around)))
        ways = np.concatenate([self._travel, still], axis=1)
        return ways[:, pairs[:, 0]] + ways[:, pairs[:, 1]]

    def gap(self, moment: int, i: int, j: int) -> FclDistance:
        """Return the signed distance of a pair at a moment, by python-fcl."""
        return distance_between(self._body(moment, i), self._body(moment, j))

    def remeasure(self, moment: int, i: int, j: int) -> tuple[float, ...]:
        """Measure the same distance in other ways, m: in reverse order, and with both bodies turned about the
        origin.

        Each is the distance of two points of the bodies, so that the least shows an error upwards.
        """
        a, b = self._body(moment, i), self._body(moment, j)
        found = [distance_between(b, a).distance]
        for turn in _CHECK_ROTATIONS:
            one, other = (_turned_copy(body, turn) for body in (a, b))
            found += [distance_between(one, other).distance, distance_between(other, one).distance]
        return tuple(found)

    def _body(self, moment: int, i: int) -> FclMovedSolid:
        if i >= len(self._moved):
            return self._around[i - len(self._moved)]
        body = self._moved[i]
        body.move(self._rotation[moment, i], self._position[moment, i])
        return body


def _turned_copy(body: FclMovedSolid, turn: Array) -> FclMovedSolid:
    turned = FclMovedSolid(body.solid)
    turned.move(turn @ body.object.getRotation(), turn @ body.object.getTranslation())
    return turned


def _rows_of(moving: Array, still: Array, numbers: NDArray[np.intp]) -> Array:
    """Select the rows of numbered bodies: (moments, numbers, 3)."""
    picked: Array = np.empty((len(moving), len(numbers), 3))
    moves = numbers < moving.shape[1]
    picked[:, moves] = moving[:, numbers[moves]]
    picked[:, ~moves] = still[numbers[~moves] - moving.shape[1]]
    return picked


def _joints(
    model: RobotModel, wanted: Sequence[int], configurations: Array, width: float
) -> tuple[Array, Array]:
    """Return rotations (moments, wanted, 3, 3) and positions (moments, wanted, 3) of joints in the world."""
    joints = sorted(set(wanted))
    full, data = model.full, model.full.createData()
    whole = model.full_q(configurations[0], width)
    arm = [full.joints[full.getJointId(name)].idx_q for name in model.description.joints]
    at: Array = np.empty((len(configurations), len(joints), 4, 4))
    for moment, q in enumerate(configurations):
        whole[arm] = q
        pin.forwardKinematics(full, data, whole)
        for column, joint in enumerate(joints):
            at[moment, column] = data.oMi[joint].homogeneous
    each = at[:, [joints.index(joint) for joint in wanted]]
    return each[..., :3, :3], each[..., :3, 3]


def _rotate_points(rotations: Array, points: Array) -> Array:
    """Turn points (c, 3) by rotations (t, c, 3, 3): (t, c, 3)."""
    return np.einsum("tcij,cj->tci", rotations, points)
