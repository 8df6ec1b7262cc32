"""Pose of a pushed object from contact and vision: a Kalman filter of place and heading in the plane.

A stroke that ended in contact measures the object across the touched side, and its heading, far better than a
camera. Along the side some precision is lost. An observation that contradicts the contact counts alone: then
something else has happened.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...world.belief.planning_scene import BeliefObject
from ...world.planar_geometry import PlanarOutline, PlanarPose, moved, outline, planar, wrap_angle
from ...world.values import Array, ObjectId
from .stroke_planning import PushStroke

if TYPE_CHECKING:
    from ..control.trajectory_motion import Doing
    from ..world import World
    from .push_stroke import PushResult


SHARED_PICTURE_ERROR = 3e-4
"""Systematic error that pictures of the same object share, m."""


def observe_closely(world: World, camera: str, name: ObjectId, pictures: int) -> Doing[BeliefObject | None]:
    """Return the belief of an object from several pictures: its place is their mean. None: most of them do
    not show it."""
    yield from world.control.settle()
    found: list[BeliefObject] = []
    for _ in range(pictures):
        summary = yield from world.vision.look(camera)
        belief = world.scene.find(name)
        if name in summary.seen and belief is not None:
            found.append(belief)
    if 2 * len(found) <= pictures:
        return None
    last = found[-1]
    here = [b for b in found if b.kind == last.kind]
    places = [planar(b.shape, b.pose) for b in here]
    turn = outline(last.shape, last.pose).turn
    first = places[0]
    yaw = first.yaw + float(np.median([wrap_angle(p.yaw - first.yaw, turn) for p in places]))
    mean = PlanarPose(
        float(np.mean([p.x for p in places])), float(np.mean([p.y for p in places])), wrap_angle(yaw)
    )
    height = float(np.mean([b.pose.position[2] for b in here]))
    pose = moved(last.shape, last.pose, mean)
    pose = replace(pose, position=(mean.x, mean.y, height))
    sigma = math.hypot(last.sigma_position / math.sqrt(len(here)), SHARED_PICTURE_ERROR)
    mean_belief = replace(
        last, pose=pose, sigma_position=sigma, sigma_angle=last.sigma_angle / math.sqrt(len(here))
    )
    world.scene.put(mean_belief, f"the mean of {len(here)} pictures")
    return mean_belief


SIGHT_SIGMA = 5e-4
"""Standard deviation of a mean of several pictures along an axis, m: noise, and the grid of pixels."""
SIGHT_ANGLE_SIGMA = math.radians(0.8)
"""Standard deviation of the heading from pictures, rad."""
CONTACT_SIGMA, CONTACT_ANGLE_SIGMA = 2e-4, math.radians(0.25)
"""Standard deviations after a contact to the end: across the touched side, m, and of the heading, rad."""
SLIP_SIGMA = 2e-4
"""Standard deviation along the side, m; `SLIP_SIGMA_SHARE` is added for each metre of travel:"""
SLIP_SIGMA_SHARE = 0.03
ROTATION_SHARE = 0.5
"""Share of the expected rotation during a push that counts: friction at the corner holds some back."""
WIDE_CONTACT_HALF_LENGTH = 0.016
"""Half contact length from which the heading has that precision, m."""
MAX_AGREEING_SIGMAS = 4.0
"""Difference between vision and contact that is a contradiction, in standard deviations."""


@dataclass(frozen=True, slots=True, eq=False)
class PlanarEstimate:
    """Estimate of place and heading: covariance (2, 2) m², and standard deviation of the heading, rad."""

    at: PlanarPose
    covariance: Array
    turned: float

    @property
    def sigma(self) -> float:
        """Standard deviation of the place along the worse axis, m."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance)[-1]))


def estimate_from_camera(at: PlanarPose) -> PlanarEstimate:
    """Return the estimate from a camera alone."""
    return PlanarEstimate(at, np.eye(2) * SIGHT_SIGMA**2, SIGHT_ANGLE_SIGMA)


def estimate_from_contact(
    before: PlanarEstimate, stroke: PushStroke, ends: PlanarPose, shape: PlanarOutline
) -> PlanarEstimate:
    """Return the estimate after a stroke that ended in contact, with the object at `ends` by the tool's
    pose."""
    side, way = stroke.side, stroke.way.length
    if shape.round:
        return PlanarEstimate(ends, np.eye(2) * CONTACT_SIGMA**2 * 2, math.pi)
    nx, ny = side.carrier(ends).direction
    normal, along = np.array([nx, ny]), np.array([-ny, nx])
    lateral = float(along @ before.covariance @ along) + SLIP_SIGMA**2 + (SLIP_SIGMA_SHARE * way) ** 2
    covariance = np.outer(normal, normal) * CONTACT_SIGMA**2 + np.outer(along, along) * lateral
    # Pushed at one corner, the object turns until its side is flat against the fingers.
    askew = abs(wrap_angle(stroke.way.start.yaw - side.carrier(before.at).yaw)) + 2.0 * before.turned
    turning = side.half / (shape.inertia() + side.half**2)
    squared = ROTATION_SHARE * turning * max(0.0, way - 2.0 * SIGHT_SIGMA) > askew
    narrow = max(1.0, WIDE_CONTACT_HALF_LENGTH / side.half) ** 2
    return PlanarEstimate(ends, covariance, CONTACT_ANGLE_SIGMA * narrow if squared else askew)


def fuse_estimates(touch: PlanarEstimate, sight: PlanarEstimate, turn: float) -> PlanarEstimate:
    """Return the fused estimate, or the visual one alone where both contradict each other.

    `turn`: angle of the object's rotational symmetry, rad; 0: the heading does not count.
    """
    off = np.array([sight.at.x - touch.at.x, sight.at.y - touch.at.y])
    yaw = wrap_angle(sight.at.yaw - touch.at.yaw, turn)
    both = touch.covariance + sight.covariance
    spread = touch.turned**2 + sight.turned**2
    apart = float(off @ np.linalg.solve(both, off)) + (yaw**2 / spread if turn else 0.0)
    if apart > MAX_AGREEING_SIGMAS**2:
        return sight
    gain = touch.covariance @ np.linalg.inv(both)
    x, y = np.array([touch.at.x, touch.at.y]) + gain @ off
    share = touch.turned**2 / spread if turn else 1.0
    covariance = (np.eye(2) - gain) @ touch.covariance
    return PlanarEstimate(
        PlanarPose(float(x), float(y), touch.at.yaw + share * yaw),
        (covariance + covariance.T) / 2,
        math.sqrt(1.0 / (1.0 / touch.turned**2 + 1.0 / sight.turned**2)),
    )


def estimate_after_stroke(
    before: PlanarEstimate, after: BeliefObject, stroke: PushStroke, pushed: PushResult
) -> PlanarEstimate:
    """Return the estimate from what was felt during a stroke and what is seen after it."""
    shape, sight = outline(after.shape, after.pose), estimate_from_camera(planar(after.shape, after.pose))
    if pushed.blocked or pushed.lost or not pushed.in_contact or stroke.side.rolls:
        return sight
    return fuse_estimates(estimate_from_contact(before, stroke, pushed.ends, shape), sight, shape.turn)
