"""Pictures of simple shapes with known truth, by sphere tracing: no code is shared with perception."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from picktree.robot.perception import Perception
from picktree.robot.perception.obstacle_volumes import merge_cells, obstacle_from_cells
from picktree.robot.perception.view import PerceivedView
from picktree.world import (
    COLOURS,
    Array,
    BeliefObject,
    Box,
    Cylinder,
    Intrinsics,
    ObjectId,
    PlanningScene,
    Pose,
    RgbdImage,
    Sphere,
)
from picktree.world.robot_model import LinkShape
from picktree.world.scene import Bin, CameraDescription, CatalogueEntry, Fixture, SceneDescription

Solid: TypeAlias = Box | Cylinder | Sphere
"""Shapes of which pictures are drawn."""

HEIGHT = 0.9
BLOCK, BRICK = Box((0.04, 0.04, 0.04)), Box((0.06, 0.03, 0.04))
CAN, BALL, PLATE = Cylinder(0.02, 0.07), Sphere(0.02), Box((0.06, 0.045, 0.006))
CATALOGUE = (
    CatalogueEntry("block", "box", BLOCK, 0.1, 0.6),
    CatalogueEntry("brick", "box", BRICK, 0.1, 0.6),
    CatalogueEntry("can", "cylinder", CAN, 0.1, 0.6),
    CatalogueEntry("ball", "sphere", BALL, 0.1, 0.6),
    CatalogueEntry("plate", "plate", PLATE, 0.1, 0.6),
)
TABLE = Fixture(ObjectId("table"), Box((1.2, 1.6, 0.04)), Pose((0.5, 0.0, -0.02)))
RED_BIN = Bin(ObjectId("red_bin"), (0.25, 0.2, 0.1), 0.005, Pose((0.4, 0.4, 0.0)), "red")
DOWN = Pose((0.5, 0.0, HEIGHT), (math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0))
CAMERA = CameraDescription("overhead", DOWN, size=(320, 240), fov=math.radians(60))
SCENE = SceneDescription(
    name="test",
    robot="none",
    fixtures=(TABLE,),
    bins=(RED_BIN,),
    cameras=(CAMERA,),
    catalogue=CATALOGUE,
    spawn=(),
    destinations=(),
)
SMALL, ELSEWHERE = Box((0.1, 0.1, 0.1)), Pose((-5.0, 0.0, 1.0))
LYING = Pose((0, 0, 0), (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)))


@dataclass(frozen=True)
class Thing:
    shape: Solid
    pose: Pose
    colour: str


class Robot:
    """A robot of one box, at a pose that the test says; the TCP is at the same pose."""

    def __init__(self, box: Box = SMALL, pose: Pose = ELSEWHERE) -> None:
        self.box, self.pose = box, pose

    def tcp(self, q: Array) -> Pose:
        return self.pose

    @property
    def finger_links(self) -> tuple[str, ...]:
        return ()

    def link_poses(self, q: Array, width: float) -> dict[str, Pose]:
        return {"hand": self.pose}

    def collision_shapes(self) -> tuple[LinkShape, ...]:
        return (LinkShape("hand", self.box, Pose()),)


def standing(shape: Solid, x: float, y: float, yaw: float, colour: str, lying: bool = False) -> Thing:
    """A thing on the table at z = 0."""
    match shape:
        case Box(size):
            below = size[2] / 2
        case Cylinder(radius, height):
            below = radius if lying else height / 2
        case Sphere(radius):
            below = radius
    turned = Pose.from_rpy((x, y, below), (0.0, 0.0, yaw))
    return Thing(shape, turned @ LYING if lying else turned, colour)


def photograph(
    things: Sequence[Thing],
    *,
    seed: int = 0,
    noise: float = 0.002,
    camera: CameraDescription = CAMERA,
    scene: SceneDescription = SCENE,
) -> RgbdImage:
    """Return the camera's image of the things, table and bins, with depth noise and dropouts at edges."""
    lens, rays = _lens(camera)
    true = camera.pose @ camera.error
    depth, colour = (layer.copy() for layer in _scenery(scene, camera))
    _paint(depth, colour, things, true, rays)
    rng = np.random.default_rng([seed, 7])
    step = np.zeros(depth.shape, dtype=bool)
    step[:, 1:] |= np.abs(np.diff(depth, axis=1)) > 0.01
    step[1:] |= np.abs(np.diff(depth, axis=0)) > 0.01
    measured = depth + rng.standard_normal(depth.shape) * noise * (depth / 0.7) ** 2
    measured[~np.isfinite(depth) | (step & (rng.random(depth.shape) < 0.5))] = 0.0
    shade = np.clip(colour * 255 * 0.9 + rng.integers(-4, 5, colour.shape), 0, 255)
    return RgbdImage(camera.name, shade.astype(np.uint8), measured.astype(np.float32), 1.5, lens, camera.pose)


def _lens(camera: CameraDescription) -> tuple[Intrinsics, Array]:
    width, height = camera.size
    focal = height / 2 / math.tan(camera.fov / 2)
    lens = Intrinsics(width, height, focal, focal, width / 2, height / 2 - 1)
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    return lens, np.stack([(u - lens.cx) / focal, (v - lens.cy) / focal, np.ones(u.shape)], axis=2)


@lru_cache(maxsize=8)
def _scenery(scene: SceneDescription, camera: CameraDescription) -> tuple[Array, Array]:
    width, height = camera.size
    depth, colour = np.full((height, width), np.inf), np.zeros((height, width, 3))
    bodies = [Thing(f.shape, f.pose, f.colour) for f in scene.fixtures]
    bodies += [Thing(s, p, b.colour) for b in scene.bins for s, p in b.parts()]
    _paint(depth, colour, bodies, camera.pose @ camera.error, _lens(camera)[1])
    return depth, colour


def _paint(depth: Array, colour: Array, things: Sequence[Thing], camera: Pose, rays: Array) -> None:
    for thing in things:
        local = thing.pose.inverse() @ camera
        hit = _trace(thing.shape, np.array(local.position), rays.reshape(-1, 3) @ local.rotation().T)
        nearer = hit.reshape(depth.shape) < depth
        depth[nearer] = hit.reshape(depth.shape)[nearer]
        colour[nearer] = COLOURS[thing.colour]


def _trace(shape: Solid, origin: Array, directions: Array) -> Array:
    """Depths (n,) at which rays from `origin` in the shape's frame meet it; inf where they miss."""
    match shape:
        case Box(size):
            reach = float(np.linalg.norm(size)) / 2
        case Cylinder(radius, height):
            reach = math.hypot(radius, height / 2)
        case Sphere(radius):
            reach = radius
    length = np.linalg.norm(directions, axis=1)
    unit = directions / length[:, None]
    ahead = -unit @ origin
    near = np.flatnonzero(np.linalg.norm(origin + unit * ahead[:, None], axis=1) <= reach)
    travelled = np.maximum(0.0, ahead[near] - reach)
    hit = np.full(len(directions), np.inf)
    for _ in range(300):
        gap = _distance(shape, origin + unit[near] * travelled[:, None])
        touching = gap < 1e-6
        hit[near[touching]] = travelled[touching] / length[near[touching]]
        going = ~touching & (travelled < ahead[near] + reach)
        near, travelled = near[going], (travelled + gap)[going]
        if not len(near):
            break
    return hit


def _distance(shape: Solid, points: Array) -> Array:
    """Signed distance of points (n, 3) from the surface."""
    match shape:
        case Box(size):
            q = np.abs(points) - np.array(size) / 2
        case Cylinder(radius, height):
            q = np.stack(
                [np.hypot(points[:, 0], points[:, 1]) - radius, np.abs(points[:, 2]) - height / 2], axis=1
            )
        case Sphere(radius):
            return np.linalg.norm(points, axis=1) - radius
    return np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0)


def empty_scene() -> PlanningScene:
    return PlanningScene(SCENE.fixtures, SCENE.bins)


def view_of(
    things: Sequence[Thing],
    *,
    robot: Robot | None = None,
    scene: PlanningScene | None = None,
    seed: int = 0,
    description: SceneDescription = SCENE,
    known: Sequence[BeliefObject] = (),
) -> PerceivedView:
    """Return the view that perception gets from a picture of the things, given the known objects."""
    robot = robot or Robot()
    image = photograph(things, seed=seed, camera=description.cameras[0], scene=description)
    return Perception(description, robot).detect(
        image, np.zeros(7), 0.08, None if scene is None else scene.held, known
    )


def obstacle(
    cells: Array, name: str = "obstacle_1", colour: str = "red", supposed: Array | None = None
) -> BeliefObject:
    """What is believed to take up these cells, by their keys (n,), and was seen at 1 s."""
    further = () if supposed is None else merge_cells(supposed)
    shape, pose, blocks = obstacle_from_cells(merge_cells(cells), further)
    known = ("unknown", "unknown", shape, colour, pose, 0.005, 0.1, 0.5, 1.0)
    return BeliefObject(*known, id=ObjectId(name), role="obstacle", blocks=blocks)
