"""Grasps of an object of a known kind: across a convex body; by walls and rims of any other body, too.

Protruding parts of a body that is not convex are found on a height map of it, as in a heap. Here the map is
computed from the believed shape and pose. Rays along the pads' motion show what the pads meet.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from picktree.world import Array, BeliefObject, CompoundMesh, Pose, extents, heap_geometry, top_heights
from picktree.world.robot_model import GripperDescription

from .grasps import GRASP_YAWS, GraspCandidate, contacts_at, grasp_candidates, heading_of, leaning_grasps

CELL = 0.002
"""Edge length of a cell of the map, m: that of a heap's."""
MAP_MARGIN = 0.06
"""Free place around the object on its map, m: a hand fits there."""
MAX_OFF_CENTRE = 0.004
"""Greatest distance of the surfaces that the pads meet from the middle between them, m."""
MIN_SPARE = 0.004
"""Least distance between open pads and the surfaces that they meet, both sides together, m."""
NAMED_STEP = 5.0
"""Step of the places in the names of grasps, mm: an object that is seen again has the same names."""


def object_grasps(
    belief: BeliefObject, gripper: GripperDescription, yaws: int = GRASP_YAWS
) -> list[GraspCandidate]:
    """Return the grasps of an object from above, best first; empty when the gripper does not open so wide.

    `yaws`: closing directions of an object without a preferred one.
    """
    found = grasp_candidates(belief, gripper, yaws)
    mesh = belief.shape
    if not isinstance(mesh, CompoundMesh):
        return found
    across = [met for one in found if (met := _met(belief, mesh, gripper, one)) is not None]
    by_walls = _by_height(belief, mesh, gripper, leaning=False)
    return sorted([*across, *by_walls], key=lambda c: (c.score, c.name))


def leaning_object_grasps(belief: BeliefObject, gripper: GripperDescription) -> list[GraspCandidate]:
    """Return the grasps of an object with the hand leaning, best first."""
    mesh = belief.shape
    if not isinstance(mesh, CompoundMesh):
        return leaning_grasps(belief, gripper)
    return _by_height(belief, mesh, gripper, leaning=True)


def _by_height(
    belief: BeliefObject, mesh: CompoundMesh, gripper: GripperDescription, *, leaning: bool
) -> list[GraspCandidate]:
    """Return the grasps on the body's height map, each once, with the surfaces that the pads meet."""
    from . import heap_grasps as heaps  # loads OpenCV

    upright = ((heaps.STRICT_TIER, (heaps.VERTICAL,)), (heaps.LOOSE_TIER, (heaps.VERTICAL,)))
    stages = ((heaps.LOOSE_TIER, (heaps.TILTED, heaps.MORE_TILTED)),) if leaning else upright
    found: dict[str, GraspCandidate] = {}
    heap = heap_geometry.Heap(_height_map(belief, mesh))
    to_object = belief.pose.inverse()
    for stage in heaps.grasps(heap, gripper, stages):
        for one in stage:
            met = _met(belief, mesh, gripper, one)
            if met is None:
                continue
            place = (to_object @ met.tcp_in_world).position
            x, y, z = (round(1000 * c / NAMED_STEP) * NAMED_STEP for c in place)
            name = f"{one.name.partition(' at ')[0]} at {x:g} {y:g} {z:g}"
            found.setdefault(name, replace(met, name=name))
    return list(found.values())


def _met(
    belief: BeliefObject, mesh: CompoundMesh, gripper: GripperDescription, grasp: GraspCandidate
) -> GraspCandidate | None:
    """Return the grasp with the width that the pads meet, in their middle; None: they do not hold there."""
    contacts = contacts_at(mesh, grasp.tcp_in_world.inverse() @ belief.pose, gripper, grasp.opening)
    if contacts is None or not contacts.opposed or contacts.width > grasp.opening - MIN_SPARE:
        return None
    off = (contacts.left + contacts.right) / 2
    if abs(off) > MAX_OFF_CENTRE:
        return None
    centred = grasp.tcp_in_world @ Pose((0.0, off, 0.0))
    return replace(grasp, tcp_in_world=centred, expected_width=contacts.width)


def _height_map(belief: BeliefObject, mesh: CompoundMesh) -> heap_geometry.HeightMap:
    """Return the body's heights over its lowest point, on a map that is turned as its longest side is."""
    pose = belief.pose
    level = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, heading_of(mesh, pose)))
    turned = level.inverse() @ pose
    low, high = extents(mesh, turned.rotation())
    size = np.ceil(((high - low)[:2] + 2 * MAP_MARGIN) / CELL).astype(int)
    middle = np.array(turned.position)[:2] + (low + high)[:2] / 2
    corner = middle - size * CELL / 2
    bottom = pose.position[2] + float(low[2])
    steps: list[Array] = [(np.arange(n) + 0.5) * CELL for n in size.tolist()]
    x, y = np.meshgrid(*steps, indexing="ij")
    heights = top_heights(mesh, turned, np.column_stack([x.ravel(), y.ravel()]) + corner).reshape(x.shape)
    heights = np.where(np.isfinite(heights), heights - bottom, 0.0)
    frame = level @ Pose((float(corner[0]), float(corner[1]), bottom))
    nothing, one_colour = np.zeros(x.shape, np.bool_), np.ones(x.shape, np.uint8)
    return heap_geometry.HeightMap.of(frame, CELL, (0.0, 0.0), heights, nothing, one_colour)
