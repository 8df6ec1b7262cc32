"""Inverse kinematics: descents from the arm's configuration and from seeds that reach nearby poses."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from ...world.robot_model.joint_limits import is_hinge
from ...world.robot_model.model import RobotModel
from ...world.values import Array, Pose
from .levenberg_marquardt import (
    FULL_TURN,
    IMPROVEMENT_SHARE,
    MAX_STALLED_STEPS,
    IkDescent,
    IkSeeds,
    pose_key,
    target_of,
)
from .unreachable_poses import NearestReach, ReachExplainer

MAX_FAILED_DESCENTS = 40
"""Number of failed descents after which a pose counts as out of reach.

Of a thousand reachable poses one takes more than twenty.
"""
MAX_FAILED_AFTER_SOLUTION = 10
"""Number of failed descents after which the found solutions count as all: an arm of six joints has eight at
most."""
SEEDS_NEAR_POSE = 48
"""Number of IK seeds near a pose that are tried."""
MIN_SOLUTION_DIFFERENCE = 0.1
"""Difference of all joints below which two solutions are the same, rad."""
MIN_SEED_DIFFERENCE = 0.7
"""Difference of all joints below which a seed would lead to a known solution again, rad."""
PATIENT_STALL_AND_GAIN = (5, 0.9)
"""Steps and gain of the stall test for a descent from a requested seed. It is given up later than one of
many."""

MAX_HINGE_GAP = 0.2
"""Greatest gap of a hinge's range that still counts as endless during a descent, rad."""
ENDLESS_LIMIT = 1e3
"""Limits of a hinge that counts as endless, rad."""
NON_REDUNDANT_JOINTS = 6
"""Number of joints of an arm without redundancy: its first joint must turn towards the pose."""
MIN_AXIS_DISTANCE = 0.05
"""Distance to the axis of the first joint below which a point has no direction from it, m."""


class InverseKinematics:
    """Inverse kinematics for the TCP of a robot. `solves` counts descents; answers depend on the arguments
    alone."""

    def __init__(self, model: RobotModel) -> None:
        self.model = model
        self.solves = 0
        self._descent = IkDescent(model)
        self._first_joint: list[float] = model.arm.jointPlacements[1].translation.tolist()
        self._length = _length(model)
        self._atlas: IkSeeds | None = None
        self._winding = _winding(model)
        self._facing = _Facing(model, self._descent) if model.n <= NON_REDUNDANT_JOINTS else None
        open_joints = [joint for joint, _, _ in self._winding]
        self._open_lower: Array = model.planned_lower.copy()
        self._open_upper: Array = model.planned_upper.copy()
        self._open_lower[open_joints], self._open_upper[open_joints] = -ENDLESS_LIMIT, ENDLESS_LIMIT

    def descend(self, tcp_in_world: Pose, seed: Array) -> Array | None:
        """Return the solution (n,) that the seed leads to, within the planned limits, or None."""
        return self._descend(target_of(tcp_in_world), seed, *PATIENT_STALL_AND_GAIN)

    def solutions(
        self, tcp_in_world: Pose, rng: np.random.Generator, near: Array, want: int = 4
    ) -> list[Array]:
        """Return up to `want` different solutions, sorted by their distance in joint space to `near` (n,).

        A joint that may turn more than once round is as few turns from `near` as its limits allow. A pose
        that is further away than the arm is long is answered without a descent.
        """
        if math.dist(tcp_in_world.position, self._first_joint) > self._length:
            return []
        target = target_of(tcp_in_world)
        found: list[Array] = []
        in_vain = 0
        for seed in self._seeds(target, rng, near, found):
            q = self._found(target, seed, near)
            if q is not None and (
                not found or all(np.abs(q - other).max() > MIN_SOLUTION_DIFFERENCE for other in found)
            ):
                found.append(q)
                in_vain = 0
            else:
                in_vain += 1
            if len(found) == want or in_vain == (MAX_FAILED_AFTER_SOLUTION if found else MAX_FAILED_DESCENTS):
                break
        return found if len(found) < 2 else sorted(found, key=lambda q: float(np.linalg.norm(q - near)))

    def unwound(self, q: Array, near: Array) -> Array:
        """Turn joints by whole turns towards `near`, within the limits; the pose of q (n,) stays."""
        if not self._winding:
            return q
        angles = q.tolist()
        for joint, low, high in self._winding:
            angle = angles[joint]
            turns = round((float(near[joint]) - angle) / FULL_TURN)
            if not low <= angle + FULL_TURN * turns <= high:
                fewest, most = math.ceil((low - angle) / FULL_TURN), math.floor((high - angle) / FULL_TURN)
                # The limits may have a gap that no number of turns leads out of.
                turns = min(max(turns, fewest), most) if fewest <= most else fewest
            angles[joint] = angle + FULL_TURN * turns
        return np.array(angles)

    def _found(self, target: pin.SE3, seed: Array, near: Array) -> Array | None:
        """Descend from a seed; joints that turn (almost) all the way round may do so during the descent."""
        if not self._winding:
            return self._descend(target, seed)
        self.solves += 1
        reached = self._descent.run(target, seed, self._open_lower, self._open_upper)
        if not reached.solved:
            return None
        q = self.unwound(reached.q, near)
        for joint, low, high in self._winding:
            if not low <= q[joint] <= high:
                return self._descend(target, q)
        return q

    def nearest(self, tcp_in_world: Pose, near: Array) -> NearestReach:
        """Explain how near the arm comes to an unreachable pose, and what keeps it from the pose.

        `near` (n,) is one of the seeds. For explanations: some ten milliseconds, not counted.
        """
        return ReachExplainer(self.model, self._descent, self._known()).nearest(tcp_in_world, near)

    def _known(self) -> IkSeeds:
        # Created on first use from the robot alone, so that no answer depends on the time of creation.
        if self._atlas is None:
            self._atlas = IkSeeds(self.model, self._descent)
        return self._atlas

    def _descend(
        self, target: pin.SE3, seed: Array, stall: int = MAX_STALLED_STEPS, gain: float = IMPROVEMENT_SHARE
    ) -> Array | None:
        self.solves += 1
        lower, upper = self.model.planned_lower, self.model.planned_upper
        q: Array = np.minimum(np.maximum(seed, lower), upper)
        reached = self._descent.run(target, q, lower, upper, stall=stall, gain=gain)
        return reached.q if reached.solved else None

    def _seeds(
        self, target: pin.SE3, rng: np.random.Generator, near: Array, found: list[Array]
    ) -> Iterator[Array]:
        """Yield seeds without end.

        First `near` (its first joint turned, for an arm without redundancy). Then IK seeds of nearby poses,
        alternately the nearest to `near` and a random one, without those near solutions in `found`. Then
        random configurations.
        """
        yield near if self._facing is None else self._facing.turned(near, target)
        around = self._known().around(pose_key(target), SEEDS_NEAR_POSE)
        far = np.abs(around - near).max(axis=1)
        order = np.argsort(far, kind="stable")
        left = [around[int(k)] for k in order]
        attempt = 0
        while left:
            attempt += 1
            seed = left.pop(0 if attempt % 2 else int(rng.integers(len(left))))
            if all(float(np.abs(seed - q).max()) > MIN_SEED_DIFFERENCE for q in found):
                yield seed
        while True:
            yield rng.uniform(self.model.planned_lower, self.model.planned_upper)


class _Facing:
    """Turn of the first joint that brings the TCP into the plane of that joint's axis and the target."""

    def __init__(self, model: RobotModel, descent: IkDescent) -> None:
        self._model = model
        self._descent = descent
        self._origin: list[float] = model.arm.jointPlacements[1].translation.tolist()
        self._axis: list[float] = model.jacobian(model.named("home"))[3:, 0].tolist()

    def turned(self, q: Array, target: pin.SE3) -> Array:
        ax, ay, az = self._axis
        ox, oy, oz = self._origin
        x, y, z = self._descent.place(q).translation.tolist()
        u, v, w = target.translation.tolist()
        x, y, z, u, v, w = x - ox, y - oy, z - oz, u - ox, v - oy, w - oz
        across = ax * (y * w - z * v) + ay * (z * u - x * w) + az * (x * v - y * u)
        along = x * u + y * v + z * w - (ax * x + ay * y + az * z) * (ax * u + ay * v + az * w)
        if across * across + along * along < MIN_AXIS_DISTANCE**4:
            return q
        angle = float(q[0]) + math.atan2(across, along)
        low, high = float(self._model.planned_lower[0]), float(self._model.planned_upper[0])
        if not low <= angle <= high:
            other = angle - math.copysign(FULL_TURN, angle)
            angle = other if low <= other <= high else min(max(angle, low), high)
        turned = q.copy()
        turned[0] = angle
        return turned


def _length(model: RobotModel) -> float:
    """Return an upper bound of the distance of any TCP pose from the first joint, m."""
    arm = model.arm
    links = sum(float(np.linalg.norm(placement.translation)) for placement in arm.jointPlacements[2:])
    slides = [k for k, joint in enumerate(arm.joints[1:]) if not is_hinge(joint)]
    strokes = sum(max(abs(float(model.lower[k])), abs(float(model.upper[k]))) for k in slides)
    return links + strokes + float(np.linalg.norm(arm.frames[model.tcp_frame].placement.translation))


def _winding(model: RobotModel) -> list[tuple[int, float, float]]:
    """Return the hinges that can turn all the way round, but for a small gap: number, lower and upper
    limit."""
    limits = zip(
        model.arm.joints[1:], model.planned_lower.tolist(), model.planned_upper.tolist(), strict=True
    )
    return [
        (k, low, high)
        for k, (joint, low, high) in enumerate(limits)
        if is_hinge(joint) and high - low > FULL_TURN - MAX_HINGE_GAP
    ]
