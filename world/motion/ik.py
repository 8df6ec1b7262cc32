"""Inverse kinematics: descents from where the arm is and from configurations known to reach nearby poses."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from ..robot.model import RobotModel
from ..values import Array, Pose
from .atlas import Atlas, key
from .descent import ANGLE, GAIN, POSITION, STALL, TURN, Descent, is_hinge, target_of
from .nearest import Beyond, Nearby, Nearest

__all__ = ["ANGLE", "APART", "POSITION", "RESTARTS", "Beyond", "InverseKinematics", "Nearest"]

RESTARTS = 40
"""Descents in vain after which a pose is taken to be out of reach: of a thousand poses that can be reached
one takes more than twenty."""
NO_MORE = 10
"""Descents in vain after which what was found is taken to be all: an arm of six joints has eight at most."""
AROUND = 48
"""Configurations of the atlas that are looked at."""
APART = 0.1
"""Solutions whose joints all differ by less are the same one, rad."""
OTHER = 0.7
"""A seed whose joints all differ by less from a solution that is known would lead there again, rad."""
PATIENT = (5, 0.9)
"""A descent that somebody asked for by its seed is given up later than one of many: steps, gain."""


class InverseKinematics:
    """Solutions for the TCP of a robot. `solves` counts descents; answers depend on the arguments alone."""

    def __init__(self, model: RobotModel) -> None:
        self.model = model
        self.solves = 0
        self._descent = Descent(model)
        self._first_joint: Array = model.arm.jointPlacements[1].translation.copy()
        self._length = _length(model)
        self._atlas: Atlas | None = None
        self._winding = _winding(model)

    def descend(self, tcp_in_world: Pose, seed: Array) -> Array | None:
        """The solution (n,) that the seed leads to, within the limits that are planned with, or None."""
        return self._descend(target_of(tcp_in_world), seed, *PATIENT)

    def solutions(
        self, tcp_in_world: Pose, rng: np.random.Generator, near: Array, want: int = 4
    ) -> list[Array]:
        """Up to `want` different solutions, sorted by their distance in joint space to `near` (n,).

        A joint that may turn more than once round stands as few turns from `near` as its limits allow. A pose
        that is further away than the arm is long is answered without a descent.
        """
        if math.dist(tcp_in_world.position, self._first_joint) > self._length:
            return []
        target = target_of(tcp_in_world)
        found: list[Array] = []
        in_vain = 0
        for seed in self._seeds(target, rng, near, found):
            q = self._descend(target, seed)
            if q is not None:
                q = self.unwound(q, near)
            if q is not None and (not found or all(np.abs(q - other).max() > APART for other in found)):
                found.append(q)
                in_vain = 0
            else:
                in_vain += 1
            if len(found) == want or in_vain == (NO_MORE if found else RESTARTS):
                break
        return found if len(found) < 2 else sorted(found, key=lambda q: float(np.linalg.norm(q - near)))

    def unwound(self, q: Array, near: Array) -> Array:
        """The same configuration (n,) with joints turned by whole turns towards `near`, within the limits."""
        if not self._winding:
            return q
        angles = q.tolist()
        for joint, low, high in self._winding:
            turns = round((float(near[joint]) - angles[joint]) / TURN)
            fewest, most = math.ceil((low - angles[joint]) / TURN), math.floor((high - angles[joint]) / TURN)
            angles[joint] += TURN * min(max(turns, fewest), most)
        return np.array(angles)

    def nearest(self, tcp_in_world: Pose, near: Array) -> Nearest:
        """How near the arm comes to a pose that it cannot reach, and what keeps it from it; `near` (n,) is
        one of the configurations to begin with. For explanations: some ten milliseconds, not counted."""
        return Nearby(self.model, self._descent, self._known()).nearest(tcp_in_world, near)

    def _known(self) -> Atlas:
        # Made when it is first needed: from the robot alone, so that no answer depends on when.
        if self._atlas is None:
            self._atlas = Atlas(self.model, self._descent)
        return self._atlas

    def _descend(self, target: pin.SE3, seed: Array, stall: int = STALL, gain: float = GAIN) -> Array | None:
        self.solves += 1
        lower, upper = self.model.planned_lower, self.model.planned_upper
        q: Array = np.minimum(np.maximum(seed, lower), upper)
        reached = self._descent.run(target, q, lower, upper, stall=stall, gain=gain)
        return reached.q if reached.solved else None

    def _seeds(
        self, target: pin.SE3, rng: np.random.Generator, near: Array, found: list[Array]
    ) -> Iterator[Array]:
        """Endless. First `near`, then of the atlas those that reach nearby poses: by turns the nearest to
        `near` and any, passing over what would lead to what is `found` already; then anything."""
        yield near
        around = self._known().around(key(target), AROUND)
        far = np.abs(around - near).max(axis=1)
        order = np.argsort(far, kind="stable")
        left = [around[int(k)] for k in order]
        attempt = 0
        while left:
            attempt += 1
            seed = left.pop(0 if attempt % 2 else int(rng.integers(len(left))))
            if all(float(np.abs(seed - q).max()) > OTHER for q in found):
                yield seed
        while True:
            yield rng.uniform(self.model.planned_lower, self.model.planned_upper)


def _length(model: RobotModel) -> float:
    """No pose of the TCP is further from the first joint, m."""
    arm = model.arm
    links = sum(float(np.linalg.norm(placement.translation)) for placement in arm.jointPlacements[2:])
    slides = [k for k, joint in enumerate(arm.joints[1:]) if not is_hinge(joint)]
    strokes = sum(max(abs(float(model.lower[k])), abs(float(model.upper[k]))) for k in slides)
    return links + strokes + float(np.linalg.norm(arm.frames[model.tcp_frame].placement.translation))


def _winding(model: RobotModel) -> list[tuple[int, float, float]]:
    """Hinges that can stand at one angle in more than one way: number, lower and upper limit."""
    limits = zip(
        model.arm.joints[1:], model.planned_lower.tolist(), model.planned_upper.tolist(), strict=True
    )
    return [
        (k, low, high) for k, (joint, low, high) in enumerate(limits) if is_hinge(joint) and high - low > TURN
    ]
