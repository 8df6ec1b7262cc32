"""Whether an item can be had at all: a definition for scorers, from the truth and the arm's geometry alone.

An item is *within reach* when, where it lies as the run begins, there is a pose of the open hand

- about its middle, or slid along it by a quarter of its length: the finger tips a millimetre over what it may
  stand on or at its middle, whichever is higher,
- from straight above or leaning by 20° to any of four sides, with the fingers closing in any of twelve
  directions, across no more than the gripper opens,
- for which the arm has a configuration within its soft limits that touches no fixture, no bin and not itself.

Other items do not count: they can be taken first. Nor does it matter what the robot's own choice of grasps
would offer, or whether a camera sees it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from picktree.simulation import TrueBody
    from picktree.world import Pose
    from picktree.world.scene import SceneDescription

TURNS = 12
LEAN = math.radians(20.0)
SLIDES = (0.0, 0.25, -0.25)
OVER = 0.001
"""Of the finger tips over what the item may stand on, m."""
WIDER = 0.004
"""The hand opens by at least so much more than the item is wide, m."""


@dataclass(frozen=True)
class Within:
    """What keeps an item from being had; empty when nothing does."""

    item: str
    why_not: str


def within_reach(scene: SceneDescription, items: list[TrueBody]) -> dict[str, Within]:
    """For each item by id."""
    from picktree.robot.planning import PoseGoal, Request
    from picktree.session import assemble_world
    from picktree.simulation import build_hardware
    from picktree.world.robot_model import load_robot

    robot = load_robot(scene.robot)
    empty = replace(scene, spawn=())
    world = assemble_world(build_hardware("kinematic", empty, robot, 0), empty, robot, 0)
    home = world.robot.named("home")
    found: dict[str, Within] = {}
    for item in items:
        why = "no direction in which the fingers open wide enough"
        for tcp, width in poses(item, robot.gripper.max_width, robot.gripper.tip):
            answer = world.plan.reached(Request(PoseGoal((tcp,)), start=home, width=width))
            if answer.q is not None:
                why = ""
                break
            why = answer.why_not
        found[str(item.id)] = Within(str(item.id), why)
    return found


def poses(item: TrueBody, widest: float, tip: float) -> Iterator[tuple[Pose, float]]:
    """Poses of the TCP in the world with the opening there, m: the upright ones first."""
    from picktree.world import Pose, extents

    turned, middle = item.pose.rotation(), np.array(item.pose.position)
    lowest = float(middle[2] + extents(item.shape, turned)[0][2])
    for lean in (None, 0.0, math.pi / 2, math.pi, -math.pi / 2):
        for k in range(TURNS):
            yaw = math.pi * k / TURNS
            closing = np.array([math.cos(yaw), math.sin(yaw), 0.0])
            down = np.array([0.0, 0.0, -1.0])
            rotation = np.column_stack([np.cross(closing, down), closing, down])
            if lean is not None:
                rotation = _about(math.cos(lean), math.sin(lean)) @ rotation
            low, high = extents(item.shape, rotation.T @ turned)
            width = float(high[1] - low[1]) + WIDER
            if width > widest:
                continue
            for slide in SLIDES:
                at = middle + rotation[:, 0] * slide * float(high[0] - low[0])
                at[2] = max(at[2], lowest + tip + OVER)
                for opening in (width, widest):
                    yield Pose.from_rotation((float(at[0]), float(at[1]), float(at[2])), rotation), opening


def _about(x: float, y: float) -> np.ndarray:
    """The rotation by LEAN about a horizontal axis (Rodrigues' formula)."""
    cross = np.array([[0.0, 0.0, y], [0.0, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(LEAN) * cross + (1.0 - math.cos(LEAN)) * cross @ cross
