"""Representations of an unknown volume: cost of a collision check, tightness, and how they clear.

    python benchmarks/volumes.py

Random posts, walls, bars and balls are seen four times each, with noise, in a scene with twelve items. For
each representation: time of a check (median of ratios to the check without the obstacle, configurations near
it and anywhere), volume that is blocked beyond what was seen, number of bodies.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import median

from picktree.robot.perception import Perception, update_belief
from picktree.robot.perception.obstacle_volumes import (
    CELL_SIZE,
    cell_centres,
    cell_indices,
    cells_in_body,
    cells_of,
    obstacle_from_cells,
)
from picktree.robot.planning import CollisionChecker
from picktree.robot.planning.collision_model import CollisionBody, bodies_of
from picktree.simulation.kinematic import KinematicHardware
from picktree.world import BeliefObject, Box, Cylinder, ObjectId, PlanningScene, Pose, Sphere
from picktree.world.robot_model import RobotModel, load_robot
from picktree.world.scene import Fixture, SceneDescription, load_scene

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class Found:
    """Results of one representation, over all things."""

    near: list[float]
    anywhere: list[float]
    bodies: list[int]
    litres: list[float]


def things(count: int, rng: np.random.Generator) -> list[Fixture]:
    made: list[Fixture] = []
    for k in range(count):
        x, y = (float(c) for c in rng.uniform([0.4, 0.26], [0.6, 0.34]))
        y *= -1 if rng.random() < 0.5 else 1
        high = float(rng.uniform(0.15, 0.4))
        shape = (
            Box((float(rng.uniform(0.04, 0.1)), float(rng.uniform(0.04, 0.1)), high)),
            Cylinder(float(rng.uniform(0.02, 0.05)), high),
            Box((float(rng.uniform(0.12, 0.25)), 0.04, high)),
            Sphere(0.06),
        )[k % 4]
        z = 0.06 if isinstance(shape, Sphere) else high / 2
        pose = Pose.from_rpy((x, y, z), (0.0, 0.0, float(rng.uniform(-3, 3))))
        made.append(Fixture(ObjectId(f"thing_{k}"), shape, pose))
    return made


def seen(scene: SceneDescription, thing: Fixture, model: RobotModel, seed: int) -> PlanningScene:
    """The belief after four looks at it, the arm at home."""
    hardware = KinematicHardware(replace(scene, unknown=(thing,)), model.description, seed)
    belief = PlanningScene(scene.fixtures, scene.bins)
    perceive = Perception(scene, model)
    rng = np.random.default_rng(seed)
    home = model.named("home")
    for n in range(4):
        image = hardware.cameras["overhead"].capture()
        noise = rng.standard_normal(image.depth.shape) * 0.002 * (image.depth / 0.7) ** 2
        noisy = replace(image, depth=np.where(image.depth > 0, image.depth + noise, 0.0).astype(np.float32))
        update_belief(belief, perceive.detect(noisy, home, 0.08, belief.held), float(n))
    return belief


def as_it_is(o: BeliefObject) -> BeliefObject:
    return o


def as_blocks(o: BeliefObject) -> BeliefObject:
    return replace(o, role="heap")


def as_columns(o: BeliefObject) -> BeliefObject:
    """A box for each column of cells."""
    cells = cell_indices(cells_of(o))
    spans: list[tuple[NDArray[np.int64], NDArray[np.int64]]] = []
    for x, y in np.unique(cells[:, :2], axis=0):
        z = cells[(cells[:, 0] == x) & (cells[:, 1] == y), 2]
        spans.append((np.array([x, y, z.min()]), np.array([x + 1, y + 1, z.max() + 1])))
    _, pose, blocks = obstacle_from_cells(spans)
    return replace(o, role="heap", pose=pose, blocks=blocks)


def as_one_box(o: BeliefObject) -> BeliefObject:
    low, high = _corners(o)
    return replace(o, shape=Box(tuple((high - low).tolist())), blocks=())


def _corners(o: BeliefObject) -> tuple[Array, Array]:
    low = np.min([np.array(b.at) - np.array(b.size) / 2 for b in o.blocks], axis=0)
    return low, np.max([np.array(b.at) + np.array(b.size) / 2 for b in o.blocks], axis=0)


KINDS: dict[str, Callable[[BeliefObject], BeliefObject]] = {
    "hulls": as_it_is,
    "one box": as_one_box,
    "blocks": as_blocks,
    "columns": as_columns,
}


def configurations(model: RobotModel, belief: PlanningScene, rng: np.random.Generator) -> tuple[Array, Array]:
    """Near the obstacle, the tool within 25 cm of it, and anywhere."""
    (thing,) = [o for o in belief.objects if o.role == "obstacle"][:1]
    near: list[Array] = []
    drawn = rng.uniform(model.lower, model.upper, (4000, model.n))
    for q in drawn:
        if np.linalg.norm(np.array(model.tcp(q).position) - thing.pose.position) < 0.25:
            near.append(q)
    return np.array(near[:150] or [model.named("home")]), drawn[:300]


def seconds(collision: CollisionChecker, configurations: Array) -> float:
    """CPU seconds of one check, the least of three rounds."""
    rounds: list[float] = []
    for _ in range(3):
        started = time.process_time()
        for q in configurations:
            collision.free(q)
        rounds.append((time.process_time() - started) / len(configurations))
    return min(rounds)


def octree(cells: Array, model: RobotModel, q: Array) -> float:
    """CPU seconds of coal's octree against one link's box, for comparison; NaN where it is not to be had."""
    make = getattr(coal, "makeOctree", None)
    if make is None:
        return float("nan")
    tree = make(np.asarray(cells), float(CELL_SIZE[0]))
    box, request, result = coal.Box(0.1, 0.1, 0.2), coal.CollisionRequest(), coal.CollisionResult()
    place = pin.SE3(np.eye(3), cells.mean(axis=0) + 0.15)
    at = coal.Transform3s(place.rotation, place.translation)
    started = time.process_time()
    for _ in range(200):
        coal.collide(tree, coal.Transform3s(np.eye(3), np.zeros(3)), box, at, request, result)
    return (time.process_time() - started) / 200


def blocked(bodies: Sequence[CollisionBody]) -> float:
    """Litres that the bodies take up together, by cells."""
    cells = np.unique(np.concatenate([cells_in_body(body.shape, body.pose) for body in bodies]))
    return len(cells) * float(np.prod(CELL_SIZE)) * 1000


def main() -> int:
    parser = argparse.ArgumentParser(description="What an unknown volume is made of.")
    parser.add_argument("--things", type=int, default=12)
    options = parser.parse_args()
    scene = load_scene("three_bins")
    model = RobotModel(load_robot(scene.robot))
    rng = np.random.default_rng(5)
    found = {name: Found([], [], [], []) for name in KINDS}
    trees: list[float] = []
    print(f"about {options.things * 5} CPU seconds")
    for k, thing in enumerate(things(options.things, rng)):
        belief = seen(scene, thing, model, k)
        unknown = [o for o in belief.objects if o.role == "obstacle"]
        if not unknown:
            print(f"  {thing.shape} was not seen", file=sys.stderr)
            continue
        near, anywhere = configurations(model, belief, rng)
        bare = PlanningScene(scene.fixtures, scene.bins)
        for o in belief.objects:
            if o.role == "item":
                bare.put(o, "kept")
        without = CollisionChecker(model)
        without.update(bare, 0.08)
        base = seconds(without, near), seconds(without, anywhere)
        trees.append(octree(np.concatenate([cell_centres(cells_of(o)) for o in unknown]), model, near[0]))
        exact = sum(len(cells_of(o)) for o in unknown) * float(np.prod(CELL_SIZE)) * 1000
        for name, kind in KINDS.items():
            made = [kind(o) for o in unknown]
            full = PlanningScene(scene.fixtures, scene.bins)
            for o in (*bare.objects, *made):
                full.put(o, "kept")
            collision = CollisionChecker(model)
            collision.update(full, 0.08)
            one = found[name]
            one.near.append(seconds(collision, near) / base[0])
            one.anywhere.append(seconds(collision, anywhere) / base[1])
            bodies = [body for o in made for body in bodies_of(o)]
            one.bodies.append(len(bodies))
            one.litres.append(blocked(bodies) / exact)
    print(f"{'representation':<20} {'near':>6} {'anywhere':>9} {'bodies':>7} {'volume':>7}   (medians)")
    for name, one in found.items():
        print(
            f"{name:<20} {median(one.near):>6.2f} {median(one.anywhere):>9.2f} {median(one.bodies):>7.0f} "
            f"{median(one.litres):>7.2f}"
        )
    print(f"coal's octree against a single box: {1e6 * median(trees):.0f} µs")
    return 0


if __name__ == "__main__":
    sys.exit(main())
