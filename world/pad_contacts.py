"""Contacts of two parallel pads that close on a body: where they meet it, by rays along their motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .shapes import MIN_DIRECTION, CompoundMesh, ConvexMesh, convex_parts, half_spaces
from .values import Array, Pose

RAYS_ACROSS, RAYS_UP = 5, 4
"""Rays over the width and over the height of a pad."""
PAD_EDGE = 0.001
"""Distance of the outermost rays from the pad's edges, m."""
CONTACT_DEPTH = 0.0015
"""Distance behind the first contact within which a ray is in contact, m: pads give way, bodies tilt."""


@dataclass(frozen=True, slots=True)
class PadContacts:
    """Contacts of both pads on a body."""

    left: float
    right: float
    """Places at which the pads first meet it, along the closing direction in the TCP frame, m."""
    touched: tuple[NDArray[np.bool_], NDArray[np.bool_]]
    """Rays of the left and of the right pad that are in contact (across, up)."""

    @property
    def width(self) -> float:
        """Distance of the pads in contact, m."""
        return self.right - self.left

    @property
    def opposed(self) -> bool:
        """Whether each pad has contact opposite to that of the other one, so that they turn no body."""
        spans = [np.flatnonzero(side.any(axis=1)) for side in self.touched]
        return bool(max(spans[0][0], spans[1][0]) <= min(spans[0][-1], spans[1][-1]))


def pad_contacts(
    mesh: CompoundMesh, mesh_in_tcp: Pose, opening: float, half_x: float, heights: tuple[float, float]
) -> PadContacts | None:
    """Return where pads that close from an opening, m, meet a body; None: nothing is between them.

    The pads reach to `half_x` on both sides along x of the TCP frame, and along z between the `heights`, m.
    """
    low, high = heights[0] + PAD_EDGE, heights[1] - PAD_EDGE
    across, up = (
        np.linspace(-half_x + PAD_EDGE, half_x - PAD_EDGE, RAYS_ACROSS),
        np.linspace(low, high, RAYS_UP),
    )
    x, z = np.meshgrid(across, up, indexing="ij")
    starts = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()])
    left, right = np.full(x.size, np.inf), np.full(x.size, -np.inf)
    for part in convex_parts(mesh):
        near, far = _spans(part, mesh_in_tcp, starts, 1)
        between = (near <= far) & (far > -opening / 2) & (near < opening / 2)
        left = np.where(between, np.minimum(left, np.maximum(near, -opening / 2)), left)
        right = np.where(between, np.maximum(right, np.minimum(far, opening / 2)), right)
    if not np.isfinite(left).any():
        return None
    first, last = float(left.min()), float(right.max())
    touched = (left <= first + CONTACT_DEPTH, right >= last - CONTACT_DEPTH)
    return PadContacts(first, last, (touched[0].reshape(x.shape), touched[1].reshape(x.shape)))


def top_heights(mesh: CompoundMesh, pose: Pose, points: Array) -> Array:
    """Return the greatest height (n,) of a body at `pose` over points (n, 2), m; -inf where it is not."""
    starts = np.column_stack([points, np.zeros(len(points))])
    highest = np.full(len(points), -np.inf)
    for part in convex_parts(mesh):
        near, far = _spans(part, pose, starts, 2)
        highest = np.where(near <= far, np.maximum(highest, far), highest)
    return highest


def _spans(part: ConvexMesh, pose: Pose, starts: Array, axis: int) -> tuple[Array, Array]:
    """Return where lines along an axis through points (n, 3) enter and leave a convex part at `pose`, (n,)
    each, m."""
    normals, offsets = half_spaces(part)
    turned = normals @ pose.rotation().T
    room = offsets + turned @ np.array(pose.position) - starts @ turned.T
    along = turned[:, axis]
    speed = np.where(np.abs(along) < MIN_DIRECTION, MIN_DIRECTION, along)
    at = room / speed
    entering = speed < 0
    near = np.where(entering, at, -np.inf).max(axis=1)
    far = np.where(entering, np.inf, at).min(axis=1)
    return near, far
