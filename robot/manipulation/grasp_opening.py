"""Opening of the fingers before a grasp: wider than the grasp needs, where neighbours leave room."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ...world.belief.planning_scene import BeliefObject
from ...world.robot_model.description import GripperDescription
from ...world.robot_model.finger_linkage import fingers_of
from ...world.shapes import CompoundMesh
from ..planning.tool_room import WORKSPACE_MARGIN
from .grasp_candidates import GraspCandidate

if TYPE_CHECKING:
    from ..planning.scene_queries import SceneQueries

WIDE_EXCESSES = (0.036, 0.028)
"""Excesses of the opening over the object's width, m, the widest first. A finger comes down beside an object
that stands up to half of that from its believed place. A camera that hangs 8 mm beside its believed place,
along both axes of the table, moves objects by 11 mm."""
MIN_TIP_REACH = WORKSPACE_MARGIN + 0.002
"""Least reach of the finger tips beyond the TCP beside a flat object, m. The tips meet what it lies on
before the TCP comes to the edge of the workspace, which may be there, too."""
OUTER_ROOM = 0.007
"""Distance beyond the margin that each finger of a wider hand keeps from what stands outside of it, m."""


def widened(
    queries: SceneQueries, belief: BeliefObject, grasp: GraspCandidate, gripper: GripperDescription
) -> GraspCandidate:
    """Return the grasp of an object with the fingers opened further, as far as nothing stands beside them.

    The wider hand keeps the margin of the grasp, and `OUTER_ROOM` more outside of its fingers. Otherwise a
    finger would only come nearer to a neighbour than to the object. Hinged fingers retract their tips as
    they open: beside a flat object these stay ahead of the TCP. Without room the grasp is `narrow`. The
    grasps of a heap, and of a body that is not convex, stay as they are: a map shows where the fingers fit.
    """
    if belief.role == "heap" or isinstance(belief.shape, CompoundMesh):
        return grasp
    for excess in WIDE_EXCESSES:
        opening = min(grasp.expected_width + excess, gripper.max_width)
        if opening < grasp.expected_width + WIDE_EXCESSES[-1]:
            break
        if grasp.flat and fingers_of(gripper).reach(opening) < MIN_TIP_REACH:
            continue
        if not any(
            queries.hand_contacts(grasp.tcp_in_world, width, (belief.id,), grasp.margin)
            for width in (opening, opening + 2 * OUTER_ROOM)
        ):
            return replace(grasp, opening=opening)
    return replace(grasp, narrow=True)
