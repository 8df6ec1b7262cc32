"""Poses of a region, near ones first."""

from __future__ import annotations

import math

import numpy as np

from ...world.values import Array, Pose
from ..requests import RegionGoal

SAMPLES = 64
"""Poses that are tried of a region, beside its middle."""


def poses(region: RegionGoal, count: int = SAMPLES) -> tuple[Pose, ...]:
    """The pose itself, then `count` others, spread evenly over the region and sorted by how far they are off.

    A turn, a tilt or a shift counts by the share of what is allowed of it. Additive recurrence on powers of
    the generalised golden ratio: Roberts, "The unreasonable effectiveness of quasirandom sequences" (2018).
    """
    freedoms = _freedoms(region)
    if not any(freedoms):
        return (region.tcp_in_world,)
    points = _spread(count, sum(freedoms))
    units = np.full((count, 6), 0.5)
    units[:, np.flatnonzero(freedoms)] = points
    off = [_off(region, freedoms, unit) for unit in units]
    nearest = sorted(range(count), key=lambda k: off[k])
    return (region.tcp_in_world, *(_pose(region, units[k]) for k in nearest))


def _freedoms(region: RegionGoal) -> tuple[bool, ...]:
    """Of turn, tilt, the direction of the tilt, x, y and z: which are free."""
    tilts = region.tilt > 0
    return (region.yaw > 0, tilts, tilts, *(r > 0 for r in region.reach))


def _spread(count: int, dimensions: int) -> Array:
    """(count, dimensions) in [0, 1), evenly spread for any count."""
    ratio = 2.0
    for _ in range(40):  # the positive root of x^(d+1) = x + 1
        ratio = (1 + ratio) ** (1 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1)
    return np.mod(0.5 + np.arange(1, count + 1)[:, None] * steps, 1.0)


def _off(region: RegionGoal, freedoms: tuple[bool, ...], unit: Array) -> float:
    shares = [abs(2 * float(u) - 1) for u in unit]
    shares[1], shares[2] = math.sqrt(float(unit[1])), 0.0
    return math.hypot(*(share for share, free in zip(shares, freedoms, strict=True) if free))


def _pose(region: RegionGoal, unit: Array) -> Pose:
    turn, spread, direction, *shift = (float(u) for u in unit)
    yaw = (2 * turn - 1) * region.yaw
    # The square root spreads tilts evenly over the cone's disc.
    tilt, towards = math.sqrt(spread) * region.tilt, 2 * math.pi * direction
    x, y, z = ((2 * s - 1) * r for s, r in zip(shift, region.reach, strict=True))
    half = math.sin(tilt / 2)
    leant = Pose((x, y, z), (half * math.cos(towards), half * math.sin(towards), 0.0, math.cos(tilt / 2)))
    turned = Pose((0.0, 0.0, 0.0), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))
    return region.tcp_in_world @ leant @ turned
