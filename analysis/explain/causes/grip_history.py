"""What the hand did and felt during one visit: when it closed, how hard, and what it carried."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....world.values import Array
from ..investigation.case import Case

SQUEEZING = 0.5
"""Share of the greatest finger force above which the fingers are taken to press on something."""
STEADY = 3
"""Readings over which the load is averaged, so that a jolt does not count as weight."""
CLOSING = 0.002
"""By how much the opening must have shrunk to count as closing, m."""
RESTING = 3
"""Readings in a row without motion that count as standing."""
STILL = 0.001
"""Motion of the fingers that is noise, m."""


@dataclass(frozen=True, slots=True)
class Grip:
    """One closing of the fingers on something."""

    closed: float
    """When the fingers began to close, s."""
    force: float
    """The greatest force of a finger, N."""
    load: float
    """The greatest steady pull downwards while the fingers pressed on something, N; 0 when they never did."""
    width: float
    """Opening at the end, m."""


def grip_within(case: Case, start: float, end: float) -> Grip | None:
    """The last closing between two times, s; None when the fingers did not close then."""
    joints, wrenches = case.run.joints, case.run.wrenches
    fingers = [n for n, name in enumerate(joints.names) if "finger" in name]
    if not fingers or not len(joints.times):
        return None
    here = np.flatnonzero((joints.times >= start - 1e-6) & (joints.times <= end + 1e-6))
    if not len(here):
        return None
    width = joints.positions[here][:, fingers].sum(axis=1)
    efforts = joints.efforts[here][:, fingers].max(axis=1)
    closed = _closing(width, efforts)
    if closed is None:
        return None
    times = joints.times[here][closed:]
    effort = efforts[closed:]
    force = float(effort.max())
    pressing = effort > SQUEEZING * force
    load = 0.0
    if force > 0.0 and bool(pressing.any()):
        steady = _steady(-wrenches.forces[:, 2])
        felt = np.interp(times, wrenches.times, steady) if len(wrenches.times) else np.zeros(len(times))
        load = max(float(felt[pressing].max()), 0.0)
    return Grip(float(times[0]), force, load, float(width[-1]))


def _closing(width: Array, effort: Array) -> int | None:
    """Index at which the fingers last stood open, at rest and pressing on nothing, before they closed."""
    free = effort < SQUEEZING * max(float(effort.max()), 1.0)
    for k in range(len(width) - 1, RESTING - 1, -1):
        still = float(np.ptp(width[k - RESTING : k + 1])) < STILL
        if still and free[k] and width[k] > float(width[k:].min()) + CLOSING:
            return k
    return None


def _steady(values: Array) -> Array:
    """The least of neighbouring readings: what did not last is left out."""
    if len(values) < STEADY:
        return values
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, STEADY // 2, mode="edge"), STEADY)
    return windows.min(axis=1)
