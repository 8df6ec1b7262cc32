"""Matching of true and believed bodies, and interpolation of the ground truth between its samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....world.values import Array
from .body_frames import BelievedBody, TrueBodySamples
from .poses import between, composed, filled, inverse

MAX_HELD_OFFSET = 0.03
"""Maximum distance between truth and belief of a held body that moves with the hand, m."""
MAX_MATCH_DISTANCE = 0.3
"""Distance above which two bodies match equally badly, m."""
OTHER_ROLE_COST = 10.0
"""Cost of a pair of an item and an obstacle, m."""
OTHER_LOOK_COST = 0.1
"""Cost of a different kind, and of a different colour, in a match, m each."""


def match_bodies(believed: Sequence[BelievedBody], truths: Sequence[TrueBodySamples]) -> list[int | None]:
    """Return for each true body the number of the believed one, or None.

    The sum of mean distances is minimal.
    """
    from scipy.optimize import linear_sum_assignment

    costs = np.array([[_cost(one, truth) for one in believed] for truth in truths])
    found: list[int | None] = [None] * len(truths)
    if not costs.size:
        return found
    for truth, column in zip(*linear_sum_assignment(costs), strict=True):
        if costs[truth, column] < MAX_MATCH_DISTANCE + OTHER_LOOK_COST:
            found[int(truth)] = int(column)
    return found


def _cost(one: BelievedBody, truth: TrueBodySamples) -> float:
    poses = one.track[truth.ticks]
    there = ~np.isnan(poses[:, 0])
    body = one.looks[-1].body
    if body.role != truth.body.role:
        return OTHER_ROLE_COST
    unlike = OTHER_LOOK_COST * ((body.kind != truth.body.kind) + (body.colour != truth.body.colour))
    if not there.any():
        return MAX_MATCH_DISTANCE + OTHER_LOOK_COST + unlike
    apart = np.linalg.norm(poses[there, :3] - truth.poses[there, :3], axis=1)
    return float(np.median(np.minimum(apart, MAX_MATCH_DISTANCE))) + unlike


def true_poses(truth: TrueBodySamples, one: BelievedBody | None, ticks: int) -> Array:
    """Return the poses of a true body at each tick, (n, 7); NaN before its first and after its last
    sample.

    Between two samples it moves with the believed body while both agree that it is in the hand. Otherwise it
    moves straight from one sample to the other, since nothing was recorded between them.
    """
    found = np.full((ticks, 7), np.nan)
    poses = None if one is None else filled(one.track)
    for k in range(len(truth.ticks)):
        first = int(truth.ticks[k])
        last = int(truth.ticks[k + 1]) if k + 1 < len(truth.ticks) else ticks - 1
        if k + 1 == len(truth.ticks):
            found[first] = truth.poses[k]
            continue
        span = np.arange(first, last + 1)
        share = (span - first) / max(last - first, 1)
        start, end = (np.tile(truth.poses[n], (len(span), 1)) for n in (k, k + 1))
        held = np.zeros(len(span), dtype=np.bool_) if one is None else one.held[span]
        if poses is None or not held.any():
            found[span] = between(start, end, share)
        else:
            found[span] = _in_hand(poses[span], held, start, end, share)
    return found


def _in_hand(poses: Array, held: np.ndarray, start: Array, end: Array, share: Array) -> Array:
    """Interpolate between two samples during which the robot holds the body for some time."""
    before = composed(inverse(poses[:1]), start[:1])
    after = composed(inverse(poses[-1:]), end[-1:])
    rides_before = held[0] and np.linalg.norm(before[0, :3]) < MAX_HELD_OFFSET
    rides_after = held[-1] and np.linalg.norm(after[0, :3]) < MAX_HELD_OFFSET
    ones = np.ones((len(poses), 1))
    if rides_before and rides_after:
        return composed(poses, between(ones * before, ones * after, share))
    if rides_after:  # gripped between the samples
        taken = int(np.argmax(held))
        riding = composed(poses, ones * after)
        return np.where(np.arange(len(poses))[:, None] < taken, start, riding)
    if rides_before:  # released or lost between the samples
        let_go = int(np.argmin(held)) if not held.all() else 0
        riding = composed(poses, ones * before)
        rest = np.clip((np.arange(len(poses)) - let_go) / max(len(poses) - 1 - let_go, 1), 0.0, 1.0)
        return between(riding, end, rest)
    return between(start, end, share)
