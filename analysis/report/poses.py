"""Poses of one frame over many ticks: arrays (n, 7) of position, m, and unit quaternion xyzw."""

from __future__ import annotations

import numpy as np

from ...world.values import Array, Pose


def row(pose: Pose) -> tuple[float, ...]:
    return (*pose.position, *pose.orientation)


def rotated(q: Array, v: Array) -> Array:
    """Rotate vectors (n, 3) by quaternions (n, 4)."""
    u, w = q[:, :3], q[:, 3:]
    t = 2.0 * np.cross(u, v)
    return v + w * t + np.cross(u, t)


def product(a: Array, b: Array) -> Array:
    """Return the Hamilton product of quaternions (n, 4)."""
    u, s = a[:, :3], a[:, 3:]
    v, t = b[:, :3], b[:, 3:]
    vector = s * v + t * u + np.cross(u, v)
    scalar = s * t - np.sum(u * v, axis=1, keepdims=True)
    return np.hstack([vector, scalar])


def composed(a: Array, b: Array) -> Array:
    """Return the pose `b`, given in frame `a`, in the parent frame of `a`."""
    return np.hstack([rotated(a[:, 3:], b[:, :3]) + a[:, :3], product(a[:, 3:], b[:, 3:])])


def inverse(a: Array) -> Array:
    turned = a[:, 3:] * np.array([-1.0, -1.0, -1.0, 1.0])
    return np.hstack([-rotated(turned, a[:, :3]), turned])


def between(a: Array, b: Array, share: Array) -> Array:
    """Interpolate from `a` (share 0) to `b` (share 1); `share` (n,).

    Quaternions are interpolated along the chord, which is enough for a tick or a small angle.
    """
    s = share[:, None]
    sign = np.where(np.sum(a[:, 3:] * b[:, 3:], axis=1, keepdims=True) < 0, -1.0, 1.0)
    q = (1 - s) * a[:, 3:] + s * sign * b[:, 3:]
    return np.hstack([(1 - s) * a[:, :3] + s * b[:, :3], q / np.linalg.norm(q, axis=1, keepdims=True)])


def continuous(a: Array) -> Array:
    """Return the same poses with quaternions that do not change their sign from row to row."""
    if len(a) < 2:
        return a
    flips = np.sum(a[1:, 3:] * a[:-1, 3:], axis=1) < 0
    signs = np.concatenate([[1.0], np.where(np.cumsum(flips) % 2 == 1, -1.0, 1.0)])
    return np.hstack([a[:, :3], a[:, 3:] * signs[:, None]])


def filled(a: Array) -> Array:
    """Replace rows of NaN by the last valid row before them, or the first one after."""
    known = ~np.isnan(a[:, 0])
    if not known.any():
        return np.tile(np.array(row(Pose())), (len(a), 1))
    places = np.where(known, np.arange(len(a)), -1)
    last = np.maximum.accumulate(places)
    return a[np.where(last < 0, int(np.argmax(known)), last)]
