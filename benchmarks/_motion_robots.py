"""The robots that are shipped, and random scenes to move them in."""

from __future__ import annotations

import math
from pathlib import Path

import picktree.world
from picktree.world import (
    BeliefObject,
    Box,
    ConvexMesh,
    Cylinder,
    ObjectId,
    PlanningScene,
    Pose,
    Shape,
    Sphere,
    Vector3,
)
from picktree.world.robot_model import RobotModel, load_robot
from picktree.world.scene import Bin, Fixture

import numpy as np

HELD = 0.6
"""Share of the scenes in which something is in the hand."""


def shipped() -> dict[str, RobotModel]:
    """All robots of the package, by name."""
    assert picktree.world.__file__ is not None
    folder = Path(picktree.world.__file__).parent / "robots"
    return {file.stem: RobotModel(load_robot(file.stem)) for file in sorted(folder.glob("*.yaml"))}


def random_scene(rng: np.random.Generator, bodies: int = 20) -> PlanningScene:
    """A table, two bins, boxes, cylinders, spheres and hulls all around; often one of them in the hand."""
    table = Fixture(ObjectId("table"), Box((1.2, 1.6, 0.04)), Pose((0.5, 0.0, -0.02)))
    bins = [
        Bin(ObjectId(f"bin_{name}"), (0.25, 0.2, 0.1), 0.005, Pose((0.35, y, 0.0)))
        for name, y in (("left", 0.55), ("right", -0.55))
    ]
    scene = PlanningScene([table], bins)
    for k in range(bodies):
        at = _vector(rng.uniform([-0.6, -0.7, 0.0], [0.8, 0.7, 1.0]))
        scene.put(_thing(f"thing_{k}", random_shape(rng, k % 4), Pose.from_rpy(at, _turn(rng))), "made up")
    if rng.random() < HELD:
        scene.put(_thing("held", random_shape(rng, int(rng.integers(4))), Pose()), "made up")
        in_hand = Pose.from_rpy((0.0, 0.0, float(rng.uniform(0.0, 0.05))), _turn(rng))
        scene.attach(ObjectId("held"), in_hand)
    return scene


def random_shape(rng: np.random.Generator, kind: int) -> Shape:
    a, b, c = (float(s) for s in rng.uniform(0.015, 0.09, 3))
    if kind == 0:
        return Box((2 * a, 2 * b, 2 * c))
    if kind == 1:
        return Cylinder(a, 2 * b)
    if kind == 2:
        return Sphere(a)
    points = rng.normal(size=(int(rng.integers(8, 40)), 3))
    points *= rng.uniform(0.02, 0.06, 3) / np.linalg.norm(points, axis=1)[:, None]
    return ConvexMesh(tuple(_vector(point) for point in points - points.mean(axis=0)), "made up")


def _thing(name: str, shape: Shape, pose: Pose) -> BeliefObject:
    return BeliefObject("thing", "box", shape, "red", pose, 1e-3, 0.01, 1.0, 0.0, id=ObjectId(name))


def _turn(rng: np.random.Generator) -> Vector3:
    return _vector(rng.uniform(-math.pi, math.pi, 3))


def _vector(values: np.typing.NDArray[np.float64]) -> Vector3:
    x, y, z = (float(value) for value in values)
    return (x, y, z)
