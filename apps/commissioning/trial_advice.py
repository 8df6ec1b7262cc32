"""Advice of a self-test: what to change in a robot file, by the cause that a trial has measured."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ...robot.manipulation.grasp_candidates import MIN_SPARE_OPENING, grasp_candidates
from ...robot.planning.inverse_kinematics import InverseKinematics
from ...world.belief.planning_scene import BeliefObject
from ...world.robot_model.description import GripperDescription
from ...world.robot_model.model import RobotModel
from ...world.values import Array, Pose
from .arm_poses import first_joint, reach
from .base_pose import YAWS, TargetPlace, propose_base
from .model_checks import RobotUnderTest

DISTANCE_STEP = 0.02
"""Step of the distances at which the tool is held down, m."""
MAX_OVERHANG = 0.1
"""Distance beyond the measured reach up to which the tool is tried, m."""


def opening_advice(gripper: GripperDescription, item: BeliefObject, file: str) -> tuple[str, str] | None:
    """Return how far a gripper opens for an item, and what to change; None: it opens far enough."""
    if grasp_candidates(item, gripper):
        return None
    wider = replace(gripper, max_width=1.0)
    width = min((grasp.expected_width for grasp in grasp_candidates(item, wider)), default=0.0)
    told = (
        f"it opens {1000 * gripper.max_width:.0f} mm; the {item.kind} is {1000 * width:.0f} mm wide, and "
        f"needs {1000 * (width + MIN_SPARE_OPENING):.0f} mm"
    )
    change = f"look at 'max_width' in {file}; else mount another gripper, or lay out a scene"
    return told, change


def reach_advice(
    tested: RobotUnderTest, places: tuple[TargetPlace, ...], file: str
) -> tuple[str, str] | None:
    """Return what was measured of the reach, and what to change; None: each place is within it.

    The reach is that of the tool pointing down, at the height of the place and in its direction.
    """
    model = tested.model
    for place in places:
        away = place.position[:2] - first_joint(model)[:2]
        distance = float(np.linalg.norm(away))
        span = _span(model, away / max(distance, 1e-9), float(place.position[2]))
        if span is None:
            told = f"with the tool down it reaches nothing {1000 * place.position[2]:.0f} mm above the table"
            return told, _other_base(tested, file)
        near, far = span
        if not near - DISTANCE_STEP <= distance <= far + DISTANCE_STEP:
            told = (
                f"its reach is {far:.2f} m with the tool down, from {near:.2f} m on; {place.name} is "
                f"{distance:.2f} m from its first joint"
            )
            return told, _other_base(tested, file)
    return None


def _other_base(tested: RobotUnderTest, file: str) -> str:
    """Return the advice for an arm that is too short, or too high or low, where it stands."""
    better = propose_base(tested.model, tested.skeleton, tested.solids)
    if better is None:
        return f"lay out a scene for that reach: no other 'base:' in {file} brings more of this one within it"
    x, y, z = better.at
    return f"write 'at: [{x:g}, {y:g}, {z:g}]' under 'base:' in {file}: {better.sentence}"


def _span(model: RobotModel, direction: Array, height: float) -> tuple[float, float] | None:
    """Return the least and the greatest distance from the first joint, m, at which the tool points down."""
    ik, generator = InverseKinematics(model), np.random.default_rng(0)
    home, centre = model.named("home"), first_joint(model)[:2]
    found: list[float] = []
    for distance in np.arange(DISTANCE_STEP, reach(model) + MAX_OVERHANG, DISTANCE_STEP).tolist():
        x, y = (centre + distance * direction).tolist()
        poses = (Pose.from_rpy((x, y, height), (np.pi, 0.0, yaw)) for yaw in YAWS)
        if any(ik.solutions(pose, generator, home, 1) for pose in poses):
            found.append(distance)
    return (found[0], found[-1]) if found else None


def advice(cause: str, message: str, file: str, links: tuple[str, ...], bodies: tuple[str, ...]) -> str:
    """Return what to change after a failure with that cause and message.

    `links` are the robot's, `bodies` those of the scene.
    """
    told_links = [name for name in links if _names(message, name)]
    told_bodies = [name for name in bodies if _names(message, name)]
    if _TOUCH.search(message) and told_links:
        if told_bodies and cause.startswith(("grasp", "place")):
            return (
                f"look at the collision geometry of {told_links[0]} in the URDF, and at 'tip', 'palm' and "
                f"'hand' under 'gripper:' in {file}: it meets {told_bodies[0]}"
            )
        if told_bodies:
            return (
                f"choose other 'poses:' in {file}, or move its 'base:', so that {told_links[0]} keeps away "
                f"from {told_bodies[0]}"
            )
        if len(told_links) > 1:
            return (
                f"look at the collision geometry of {told_links[0]} and {told_links[1]} in the URDF, and at "
                f"'disabled_pairs:' in {file}"
            )
    for head, change in _CHANGES.items():
        if cause.startswith(head) or head in message:
            return change.format(file=file)
    return f"look at 'joints:' in {file}"


_TOUCH = re.compile(r" mm (deep|from|in each other|apart)")
_CHANGES: Mapping[str, str] = {
    "outside the workspace": "choose 'poses:' in {file} with the tool inside of the scene's workspace, or "
    "move 'base:'",
    "outside of the workspace": "choose 'poses:' in {file} with the tool inside of the scene's workspace, or "
    "move 'base:'",
    "safety.torque_limit": "compare 'torque' under 'joints:' in {file} with the data sheet, and masses under "
    "'inertias:'",
    "safety": "look at 'inertias:', and at 'velocity' and 'torque' under 'joints:' in {file}",
    "grasp": "look at 'pads:', 'palm' and 'tip' under 'gripper:', and at 'tcp:' in {file}",
    "place": "look at 'pads:' under 'gripper:', and at 'tcp:' in {file}",
    "planning": "look at 'poses:', 'base:' and 'disabled_pairs:' in {file}",
    "control": "look at 'acceleration' and 'torque' under 'joints:', and at 'inertias:' in {file}",
    "perception": "look at 'home' under 'poses:', and at 'base:' in {file}",
}
"""Changes by a part of the message, or by the begin of the cause; the more exact one comes first."""


def _names(message: str, name: str) -> bool:
    """Return whether a message names a body as a word of its own."""
    return bool(name) and re.search(rf"(?<![\w/]){re.escape(name)}(?![\w/])", message) is not None
