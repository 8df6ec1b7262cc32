"""Calibration targets of a scene, and the touches at which closed fingers measure the TCP in all three
directions.

Together the touches determine the finger tips in all three directions.

On a side face the tip's place along the face's normal counts. Turned by half a turn about the vertical it
counts with the other sign, so the two together part the tip from the face. Leaning with the tip ahead, how
far the tip reaches out of the hand counts, too. How the hand is turned about its tip shows in none of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from picktree.world import Array, Box, Failure, Pose, Vector3, vector3
from picktree.world import world as world_causes
from picktree.world.scene import TargetTile

if TYPE_CHECKING:
    from collections.abc import Iterable

    from picktree.world.robot_model import RobotModel
    from picktree.world.scene import Fixture

LEAN_ANGLE = math.radians(30.0)
"""Tilt of the hand for touches with the tip ahead, rad."""
SIDE_TOUCH_HEIGHT = 0.4
"""Height of the fingers' lowest corner at a side face, as a share of the target's height."""
MAX_PAD_SHARE = 0.8
"""Greatest depth of a touch at a side face, as a share of the pads' length: behind them fingers are wider."""
TOP_TOUCH_DISTANCE = 0.35
"""Distance of touches on the top from its middle, as a share of the edges."""
CONTACT_TOLERANCE = 1e-4
"""Tolerance within which further corners of the tips count as touching, m."""


@dataclass(frozen=True, slots=True)
class TouchPoint:
    """Touch point: a face of the target and TCP poses that touch it."""

    name: str
    face: Vector3
    """Normal of the face in the target's frame."""
    normal: Vector3
    """Normal of the face in the world."""
    tcp: tuple[Pose, ...]
    """TCP poses in the world in which the tips meet the face; any one will do."""


def fingertip_corners(model: RobotModel, width: float = 0.0) -> Array:
    """Return the corners (16, 3) of both pads in the TCP frame with the fingers `width` m open, m."""
    q = model.named("home")
    links, tcp = model.link_poses(q, width), model.tcp(q)
    gripper = model.description.gripper
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    found = [
        (tcp.inverse() @ links[link] @ pose).apply(corners * np.array(box.size))
        for link, (box, pose) in zip(gripper.fingers, gripper.pads, strict=True)
    ]
    return np.concatenate(found)


def touch_points(target: Pose, size: Vector3, at_tips: Array, turned: float) -> tuple[TouchPoint, ...]:
    """Return all touch points of a block of `size` m at `target` in the world; `at_tips` as from
    `fingertip_corners`.

    `turned`: angle of the upright hand's x axis to the target's, rad, a multiple of a right angle. It only
    changes the reachability of the points.
    """
    deepest = size[2] / 2 - MAX_PAD_SHARE * float(np.ptp(at_tips[:, 2]))
    low = max((SIDE_TOUCH_HEIGHT - 0.5) * size[2], deepest)
    return tuple(
        _contact(target, name, face, point, hands, at_tips, low)
        for name, face, point, hands in _touch_directions(size, turned)
    )


def _touch_directions(size: Vector3, turned: float) -> Iterator[tuple[str, Array, Array, tuple[Array, ...]]]:
    """Yield name, normal, point and the hand's axes (3, 3), in the target's frame."""
    x, y, z = (length / 2 for length in size)
    up = np.array([0.0, 0.0, 1.0])
    upright = np.array([math.cos(turned), math.sin(turned), 0.0])
    for name, face, reach, along in (
        ("+x", (1.0, 0.0, 0.0), x, y),
        ("-x", (-1.0, 0.0, 0.0), x, y),
        ("+y", (0.0, 1.0, 0.0), y, x),
        ("-y", (0.0, -1.0, 0.0), y, x),
    ):
        normal = np.array(face)
        beside = np.cross(up, normal)
        for number, side in enumerate((1.0, -1.0)):
            point = normal * reach + beside * side * 0.25 * along
            # The hand turned by half a turn: so each face is touched by two sides of it.
            yield f"{name} side {number + 1}", normal, point, (_hand(-up, side * upright),)
        ahead = -math.cos(LEAN_ANGLE) * up - math.sin(LEAN_ANGLE) * normal
        hands = (_hand(ahead, normal), _hand(ahead, -normal))
        yield f"{name} leaning", normal, normal * reach, hands
    for number, (right, front) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        point = np.array([right * TOP_TOUCH_DISTANCE * 2 * x, front * TOP_TOUCH_DISTANCE * 2 * y, z])
        yield f"top {number + 1}", up, point, (_hand(-up, upright if number % 2 else -upright),)
    for number, aside in enumerate(((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0))):
        ahead = -math.cos(LEAN_ANGLE) * up + math.sin(LEAN_ANGLE) * np.array(aside)
        hands = (_hand(ahead, np.array(aside)), _hand(ahead, -np.array(aside)))
        yield f"top leaning {number + 1}", up, up * z, hands


def _hand(forward: Array, x: Array) -> Array:
    """Return the axes (3, 3) of a TCP that points along `forward`, its x as close to `x` as possible."""
    across = np.cross(forward, x)
    across = across / np.linalg.norm(across)
    return np.column_stack([np.cross(across, forward), across, forward])


def _contact(
    target: Pose, name: str, face: Array, point: Array, hands: tuple[Array, ...], at_tips: Array, low: float
) -> TouchPoint:
    """Return the touch point at `point` on a face. At a side face the tips' lowest corner comes to height
    `low` in the target's frame."""
    turn = target.rotation()
    normal = turn @ face
    poses: list[Pose] = []
    for hand in hands:
        axes = turn @ hand
        reach = at_tips @ (axes.T @ normal)
        touching = at_tips[reach < reach.min() + CONTACT_TOLERANCE].mean(axis=0)
        place = point - hand @ touching
        if face[2] == 0.0:
            place[2] = low - float((at_tips @ hand[2]).min())
        poses.append(Pose.from_rotation(target.apply(place), axes))
    return TouchPoint(name, vector3(face), vector3(normal), tuple(poses))


@dataclass(frozen=True, slots=True)
class CalibrationTarget:
    """Calibration target: a block with coloured squares on its top."""

    name: str
    pose: Pose
    """Believed pose of the target's centre in the world."""
    size: Vector3
    """Edge lengths along x, y, z, m."""
    tiles: tuple[TargetTile, ...]


def targets(fixtures: Iterable[Fixture]) -> tuple[CalibrationTarget, ...]:
    """Return the calibration targets among the fixtures."""
    return tuple(
        CalibrationTarget(str(f.id), f.pose, f.shape.size, f.tiles)
        for f in fixtures
        if f.tiles and isinstance(f.shape, Box)
    )


def target_named(fixtures: Iterable[Fixture], name: str) -> CalibrationTarget:
    """Return the target of that name. Raises Failure(world.unknown_object) for an unknown name."""
    known = targets(fixtures)
    for target in known:
        if target.name == name:
            return target
    raise Failure(
        world_causes.UNKNOWN_OBJECT,
        f"there is no target {name!r}: it is a fixture with 'marker'",
        known=[target.name for target in known],
    )
