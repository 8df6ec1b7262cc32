"""Advice of a self-test: what to change in a robot file, by the cause that a trial has measured."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..planning.kinematics.inverse_kinematics import InverseKinematics
from ..robots.model import RobotModel
from ..world.values import Array, Pose
from .robot_setup.arm_poses import first_joint, reach

DISTANCE_STEP = 0.02
"""Step of the distances at which the tool is held down, m."""
MAX_OVERHANG = 0.1
"""Distance beyond the measured reach up to which the tool is tried, m."""
YAWS = (0.0, np.pi / 4, np.pi / 2, 3 * np.pi / 4)
"""Directions of the fingers that are tried, rad."""
BASE_SPARE = 0.05
"""Distance by which a moved base brings a place into the reach, m."""


@dataclass(frozen=True, slots=True)
class TargetPlace:
    """Place that a trial needs: name, and position (3,) of the tool there in the world, m."""

    name: str
    position: Array


def reach_advice(model: RobotModel, places: tuple[TargetPlace, ...], file: str) -> tuple[str, str] | None:
    """Return what was measured of the reach, and what to change; None: each place is within it.

    The reach is that of the tool pointing down, at the height of the place and in its direction.
    """
    for place in places:
        away = place.position[:2] - first_joint(model)[:2]
        distance = float(np.linalg.norm(away))
        span = _span(model, away / max(distance, 1e-9), float(place.position[2]))
        if span is None:
            told = f"with the tool down it reaches nothing {1000 * place.position[2]:.0f} mm above the table"
            change = f"raise or lower 'base:' in {file}, or look at the limits under 'joints:'"
            return told, change
        near, far = span
        if near - DISTANCE_STEP <= distance <= far + DISTANCE_STEP:
            continue
        nearer = distance > far
        by = (distance - far if nearer else near - distance) + BASE_SPARE
        told = (
            f"its reach is {far:.2f} m with the tool down, from {near:.2f} m on; {place.name} is "
            f"{distance:.2f} m from its first joint"
        )
        where = f"nearer to {place.name}" if nearer else f"away from {place.name}"
        return told, f"move 'base:' in {file} by {by:.2f} m, {where}; or lay out a scene for that reach"
    return None


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
