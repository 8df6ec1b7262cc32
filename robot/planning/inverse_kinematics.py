"""Inverse kinematics: Levenberg-Marquardt descents from the arm and from seeds, and the nearest reach of
other poses.

Joint limits are an active set of a descent.

Damping after Sugihara, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", IEEE
Transactions on Robotics 27 (2011).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
import pinocchio as pin

from picktree.files import library_parts
from picktree.world import Array, Pose
from picktree.world.robot_model import RobotModel, is_hinge, pose_of

if TYPE_CHECKING:
    from scipy.linalg.lapack import dposv
else:
    dposv = library_parts.library_part("scipy.linalg._flapack", "scipy.linalg.lapack.dposv")

POSITION_ACCURACY = 1e-5
"""Accuracy of the position, m."""
ANGLE_ACCURACY = 1e-4
"""Accuracy of the orientation, rad."""
MAX_DESCENT_STEPS = 60
MAX_STALLED_STEPS = 4
"""Number of steps without an improvement after which a descent is given up."""
IMPROVEMENT_SHARE = 0.7
"""Share of the least squared error so far that counts as an improvement."""
DAMPING_SHARE = 1e-2
"""Damping as a share of the remaining squared error; fewer steps than with a tenth or ten times as much."""
MAX_STEP_LENGTH = 1.5
"""Greatest length of a step in joint space, rad."""
MAX_POSITION_PULL = 0.1
"""Greatest travel that a step aims at where the target need not be reached, m.

After Buss and Kim, "Selectively damped least squares for inverse kinematics", Journal of Graphics Tools 10
(2005).
"""
FULL_TURN = 2 * math.pi


@dataclass(frozen=True, slots=True, eq=False)
class IkResult:
    """Best configuration (n,) of a descent; `solved`: it reaches the target within the accuracy."""

    q: Array
    solved: bool
    square: float
    """Remaining squared (weighted) distance and angle together, m² + rad²."""


class IkDescent:
    """IK descents for one robot, with scratch memory only. A step costs about ten bare forward kinematics.

    Most of that is the overhead of numpy calls, so calls are few and work on preallocated arrays.
    """

    def __init__(self, model: RobotModel) -> None:
        self._arm = model.arm
        self._frame = model.tcp_frame
        self._data = model.arm.createData()
        self._hessian: Array = np.empty((6, 6))
        self._diagonal: Array = self._hessian.ravel()[::7]

    def place(self, q: Array) -> pin.SE3:
        """Return the TCP in the world at q (n,): a live view, until the next call."""
        pin.forwardKinematics(self._arm, self._data, q)
        return pin.updateFramePlacement(self._arm, self._data, self._frame)

    def run(
        self,
        target: pin.SE3,
        seed: Array,
        lower: Array,
        upper: Array,
        *,
        weights: Array | None = None,
        stall: int = MAX_STALLED_STEPS,
        gain: float = IMPROVEMENT_SHARE,
        steps: int = MAX_DESCENT_STEPS,
    ) -> IkResult:
        """Descend from a seed (n,) within the limits (n,) towards the TCP's target in the world.

        `weights` (6,) scale the error's three linear and three angular parts, in the TCP's axes: 0 leaves one
        free.
        """
        arm, data, frame, hessian, diagonal = (
            self._arm,
            self._data,
            self._frame,
            self._hessian,
            self._diagonal,
        )
        joint_jacobians, frame_jacobian = pin.computeJointJacobians, pin.getFrameJacobian
        lows, highs = lower.tolist(), upper.tolist()
        q = best_q = seed
        angles = q.tolist()
        best, patience = math.inf, stall
        at_limit = True
        for _ in range(steps):
            joint_jacobians(arm, data, q)
            offset = pin.updateFramePlacement(arm, data, frame).actInv(target)
            if weights is None:
                error = pin.log6(offset).vector
            else:
                # Taken apart, because the logarithm's linear part is the travel along a screw.
                error = np.concatenate([offset.translation, pin.log3(offset.rotation)]) * weights
            x, y, z, a, b, c = error.tolist()
            position, angle = x * x + y * y + z * z, a * a + b * b + c * c
            left = position + angle
            if weights is not None and position > MAX_POSITION_PULL**2:
                # A target out of reach would pull the arm to and fro.
                error[:3] *= MAX_POSITION_PULL / math.sqrt(position)
            if position < POSITION_ACCURACY**2 and angle < ANGLE_ACCURACY**2:
                return IkResult(q, True, left)
            if left < gain * best:
                best, best_q, patience = left, q, stall
            else:
                patience -= 1
                if patience == 0:
                    break
            jacobian = frame_jacobian(arm, data, frame, pin.LOCAL)
            if weights is not None:
                jacobian *= weights[:, None]
            if at_limit:
                # Joints at a limit that would go on beyond it leave the set that moves.
                slopes = error.dot(jacobian).tolist()
                for joint, (at, low, high) in enumerate(zip(angles, lows, highs)):  # noqa: B905  it costs
                    if (at <= low and slopes[joint] < 0.0) or (at >= high and slopes[joint] > 0.0):
                        jacobian[:, joint] = 0.0
            # The damped step among the six errors: J^T (J J^T + d)^-1 e equals (J^T J + d)^-1 J^T e.
            np.dot(jacobian, jacobian.T, out=hessian)
            diagonal += DAMPING_SHARE * left + 1e-7
            step = dposv(hessian, error)[1].dot(jacobian)
            length = math.hypot(*step.tolist())
            if length > MAX_STEP_LENGTH:
                step *= MAX_STEP_LENGTH / length
            q = q + step
            angles = q.tolist()
            at_limit = False
            for joint, (at, low, high) in enumerate(zip(angles, lows, highs)):  # noqa: B905  it costs
                if not low < at < high:
                    angles[joint] = low if at <= low else high
                    at_limit = True
            if at_limit:
                q = np.array(angles)
        return IkResult(best_q, False, best)


def target_of(pose: Pose) -> pin.SE3:
    """Return a pose as pinocchio's rigid transform, made in one call."""
    return pin.XYZQUATToSE3(np.array((*pose.position, *pose.orientation)))


SEED_COUNT = 2048
"""Number of configurations. Finding the nearest takes as long as two steps of a descent; twice as many save
no step."""
TURN_LEVER = 0.3
"""Weight of a turn relative to a travel, m/rad."""


class IkSeeds:
    """IK seeds of one robot, computed from it alone in 10 ms; the same in each process."""

    def __init__(self, model: RobotModel, descent: IkDescent) -> None:
        shares = np.random.default_rng(0).uniform(size=(SEED_COUNT, model.n))
        self.configurations: Array = model.planned_lower + shares * (
            model.planned_upper - model.planned_lower
        )
        """Configurations (SIZE, n), rad."""
        self._keys: Array = np.array([pose_key(descent.place(q)) for q in self.configurations])
        self._half_squares: Array = 0.5 * np.einsum("ij,ij->i", self._keys, self._keys)

    def nearest(self, wanted: Array) -> int:
        """Return the index of the configuration whose pose is nearest to the one with that key (12,)."""
        return int(self._nearness(wanted).argmax())

    def around(self, wanted: Array, count: int) -> Array:
        """Return the `count` configurations (count, n) whose poses are nearest to the one with that key
        (12,)."""
        nearness = self._nearness(wanted)
        some = np.argpartition(nearness, -count)[-count:]
        return self.configurations[some[np.argsort(-nearness[some], kind="stable")]]

    def _nearness(self, wanted: Array) -> Array:
        # |k - w|² = |k|² - 2 k·w + |w|², and the last is the same for all.
        return self._keys.dot(wanted) - self._half_squares


def pose_key(place: pin.SE3) -> Array:
    """Return a pose as a point (12,): equal distances (m) for equal travels and, for small turns, equal
    arcs."""
    point: Array = np.empty(12)
    point[:3] = place.translation
    # Two rotations that differ by a small angle a are 2^½ a apart in the Frobenius norm.
    point[3:] = (TURN_LEVER / 2**0.5) * place.rotation.ravel()
    return point


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
        """Explain how near the arm comes to an unreachable pose, and the obstruction.

        `near` (n,) is one of the seeds. For explanations: some ten milliseconds, not counted.
        """
        return ReachExplainer(self.model, self._descent, self._ik_seeds()).nearest(tcp_in_world, near)

    def _ik_seeds(self) -> IkSeeds:
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
        around = self._ik_seeds().around(pose_key(target), SEEDS_NEAR_POSE)
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
