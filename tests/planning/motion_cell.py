"""A Panda, a table and what the tests of motion put on it."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeVar

import numpy as np

from picktree.robot.planning import PlanService, SceneQueries
from picktree.world import (
    Array,
    BeliefObject,
    Box,
    ComputeTimeAccount,
    Cylinder,
    Journal,
    ObjectId,
    PlanningScene,
    Pose,
    RandomStreams,
    Shape,
    Sphere,
)
from picktree.world.robot_model import RobotModel, load_robot
from picktree.world.scene import Bin, Fixture

MODEL = RobotModel(load_robot("panda"))
HOME = MODEL.named("home")
TICK = 0.05
T = TypeVar("T")


def down(x: float, y: float, z: float, yaw: float = 0.0) -> Pose:
    """The TCP at a point, looking down."""
    return Pose.from_rpy((x, y, z), (np.pi, 0.0, yaw))


def item(name: str, shape: Shape, pose: Pose) -> BeliefObject:
    return BeliefObject("thing", "box", shape, "red", pose, 0.001, 0.01, 1.0, 0.0, id=ObjectId(name))


def table_scene(*objects: BeliefObject) -> PlanningScene:
    """A table top at z = 0, a bin on either side, and the objects."""
    table = Fixture(ObjectId("table"), Box((1.0, 1.4, 0.04)), Pose((0.5, 0.0, -0.02)))
    bins = [
        Bin(ObjectId(f"bin_{n}"), (0.2, 0.25, 0.1), 0.006, Pose((0.35, y, 0.0)))
        for n, y in ((1, 0.4), (2, -0.4))
    ]
    scene = PlanningScene([table], bins)
    for belief in objects:
        scene.put(belief, "test")
    return scene


def shelf_scene() -> PlanningScene:
    """Two boards and three walls in front of the robot: the hand must reach into them."""
    boards = {
        "floor": (Box((0.3, 0.7, 0.02)), Pose((0.6, 0.0, 0.2))),
        "roof": (Box((0.3, 0.7, 0.02)), Pose((0.6, 0.0, 0.6))),
        "left": (Box((0.3, 0.02, 0.4)), Pose((0.6, 0.35, 0.4))),
        "right": (Box((0.3, 0.02, 0.4)), Pose((0.6, -0.35, 0.4))),
        "middle": (Box((0.3, 0.02, 0.4)), Pose((0.6, 0.0, 0.4))),
    }
    return PlanningScene([Fixture(ObjectId(k), shape, pose) for k, (shape, pose) in boards.items()], [])


def littered(seed: int, count: int = 15, high: float = 0.0) -> PlanningScene:
    """A table with things of all shapes at random, some of them up to `high` m in the air."""
    rng = np.random.default_rng(seed)
    scene = table_scene()
    for k in range(count):
        x, y, z = rng.uniform([0.2, -0.5, 0.03], [0.8, 0.5, 0.03 + high])
        turned = Pose.from_rpy((float(x), float(y), float(z)), tuple(rng.uniform(-3, 3, 3)))
        shape: Shape = (Box((0.05, 0.08, 0.06)), Cylinder(0.03, 0.08), Sphere(0.03))[k % 3]
        scene.put(item(f"thing_{k}", shape, turned), "test")
    return scene


class Cell:
    """A plan service with its surroundings; `at` is where the arm stands."""

    def __init__(
        self,
        scene: PlanningScene,
        *,
        seed: int = 1,
        verify: bool = True,
        worker: bool = False,
        width: float = 0.08,
        cost: float = 25e-6,
    ) -> None:
        self.scene = scene
        self.at: Array = HOME.copy()
        self.width = width
        self.now = 0.0
        self.journal = Journal()
        self.thinking = ComputeTimeAccount(TICK)
        self.queries = SceneQueries(MODEL, scene)
        self.plan = PlanService(
            MODEL,
            scene,
            self.queries,
            RandomStreams(seed),
            self.journal,
            self.thinking,
            cost,
            configuration=lambda: self.at,
            width=lambda: self.width,
            now=lambda: self.now,
            verify=verify,
            worker=worker,
        )


def run(steps: Generator[None, None, T]) -> tuple[T, int]:
    """What a generator returns, and how many ticks it took."""
    ticks = 0
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value, ticks
        ticks += 1
