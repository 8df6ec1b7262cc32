"""Syntax of `--to` and `--from`: a pose, an object, a bin, or numbers become planning requests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np

from picktree.files import PicktreeError, quantities
from picktree.robot import World
from picktree.robot.manipulation import grasp_candidates
from picktree.robot.planning import LineGoal, NamedGoal, RegionGoal, Request, Target
from picktree.world import Array, BeliefObject, Pose
from picktree.world.scene import Bin

from .base_pose import HEIGHT_OVER_BIN

TOOL_DOWN_RPY = (math.pi, 0.0, 0.0)
"""Roll, pitch and yaw of a tool that points down, rad."""


@dataclass(frozen=True, slots=True)
class GoalAttempt:
    """Attempt to reach the goal: motions, each from the end of the one before."""

    name: str
    """Name of the grasp; empty for goals without one."""
    legs: tuple[Request, ...]


@dataclass(frozen=True, slots=True)
class ParsedGoal:
    """Goal of `--to`. `attempts`: in order of preference; `rejected`: why others were ruled out before."""

    words: str
    attempts: tuple[GoalAttempt, ...]
    rejected: tuple[str, ...] = ()


def parse_goal(world: World, text: str, request: Request, *, line: bool) -> ParsedGoal:
    """Parse the goal of `--to`; `request` has the other values of each motion. Raises PicktreeError."""
    if "," in text:
        numbers = text.split(",")
        pose = _pose(numbers)
        target: Target = (
            LineGoal(pose) if line else RegionGoal(pose, yaw=math.pi if len(numbers) == 3 else 0.0)
        )
        return _single(f"to {text}", replace(request, target=target))
    if text in world.robot.description.named:
        if line:
            target = LineGoal(world.robot.tcp(world.robot.named(text)))
            return _single(f"to the tool's pose at {text}", replace(request, target=target))
        return _single(f"to {text}", replace(request, target=NamedGoal(text)))
    if text in world.scene.bins:
        above = _over(world.scene.bins[text])
        target = LineGoal(above) if line else RegionGoal(above, yaw=math.pi)
        return _single(f"over {text}", replace(request, target=target))
    belief = world.scene.find(text)
    if belief is not None:
        if line:
            raise PicktreeError(
                f"--line to {text}: leave out --line for an object; its approach ends with a line down anyway"
            )
        return _grasp(world, belief, request)
    raise PicktreeError(_unknown(world, text))


def parse_start(world: World, text: str) -> Array:
    """Parse the configuration (n,) of `--from`: a pose, or a number per joint. Raises PicktreeError."""
    named, names = world.robot.description.named, world.robot.description.joints
    if "," not in text:
        if text in named:
            return world.robot.named(text)
        raise PicktreeError(
            f"--from {text}: not a pose of the robot; known: {', '.join(named)}; or give a number "
            "for each of its "
            f"{len(names)} joints, as 10deg,-45deg,…"
        )
    words = text.split(",")
    if len(words) != len(names):
        raise PicktreeError(f"--from {text}: {len(words)} numbers; the arm has {len(names)} joints")
    return np.array([quantity("--from", word, "rad") for word in words])


def _single(words: str, request: Request) -> ParsedGoal:
    return ParsedGoal(words, (GoalAttempt("", (request,)),))


def _over(bin_: Bin) -> Pose:
    x, y, z = bin_.pose.position
    return Pose.from_rpy((x, y, z + bin_.size[2] + HEIGHT_OVER_BIN), TOOL_DOWN_RPY)


def _grasp(world: World, belief: BeliefObject, request: Request) -> ParsedGoal:
    """Return an attempt for each grasp with room for the hand: above it, then straight down."""
    attempts: list[GoalAttempt] = []
    rejected: list[str] = []
    for grasp in grasp_candidates(belief, world.robot.description.gripper):
        touched = world.queries.hand_contacts(
            grasp.tcp_in_world, grasp.opening, ignore=(belief.id,), margin=grasp.margin
        )
        if touched:
            rejected.append(f"the hand would touch {touched[0].b}")
            continue
        over = grasp.tcp_in_world.shifted((0.0, 0.0, world.handling.approach))
        above = replace(request, target=RegionGoal(over), width=grasp.opening)
        down = replace(
            request,
            target=LineGoal(grasp.tcp_in_world),
            start=None,
            width=grasp.opening,
            allowed=(("gripper", belief.id),),
            scaling=world.handling.slowly,
            clearance=0.0,
        )
        attempts.append(GoalAttempt(grasp.name, (above, down)))
    return ParsedGoal(f"onto {belief.id}", tuple(attempts), tuple(rejected))


def _pose(words: Sequence[str]) -> Pose:
    if len(words) not in (3, 6):
        raise PicktreeError(
            f"--to {','.join(words)}: write x,y,z or x,y,z,roll,pitch,yaw, as in --to 500mm,0,200mm"
        )
    x, y, z = (quantity("--to", word, "m") for word in words[:3])
    if len(words) == 3:
        return Pose.from_rpy((x, y, z), TOOL_DOWN_RPY)
    roll, pitch, yaw = (quantity("--to", word, "rad") for word in words[3:])
    return Pose.from_rpy((x, y, z), (roll, pitch, yaw))


def quantity(option: str, text: str, unit: str) -> float:
    """Parse a number with a unit into SI. Raises PicktreeError.

    >>> quantity("--clearance", "20 mm", "m")
    0.02
    """
    try:
        return quantities.parse_quantity(text, unit)
    except ValueError as error:
        raise PicktreeError(f"{option} {text}: {error}") from None


def _unknown(world: World, text: str) -> str:
    groups: Sequence[tuple[str, Sequence[str]]] = (
        ("poses", list(world.robot.description.named)),
        ("bins", list(world.scene.bins)),
        ("objects", [str(o.id) for o in world.scene.objects]),
    )
    close = get_close_matches(text, [name for _, names in groups for name in names], n=1)
    suggestion = f"; did you mean {close[0]!r}?" if close else ""
    lists = "".join(f"\n  {what}: {', '.join(names)}" for what, names in groups if names)
    return f"--to {text}: there is no such pose, bin or object{suggestion}{lists}"
