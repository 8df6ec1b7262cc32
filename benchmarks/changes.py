"""Looks at a scene of many items, with and without the picture memory: CPU time, and errors after a change.

    python benchmarks/changes.py --items 300 --looks 20 --situations 100

Items stand in a grid below a camera, an eighth of them in touching pairs, and are set aside in the belief.
The first figure is the CPU time of a look when nothing changes. Then situations are drawn: an item is shifted
by up to 20 mm, turned, taken away, exchanged for another kind or colour, or another one is put next to it.
After one look the belief is compared with the drawn scene.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

from picktree.robot.perception import Perception, PictureMemory, update_belief
from picktree.world import PlanningScene, RgbdImage
from picktree.world.world_facts import ASIDE

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from tests.perception.perception_pictures import (
    BALL,
    BLOCK,
    BRICK,
    CAN,
    SCENE,
    Robot,
    Thing,
    empty_scene,
    photograph,
    standing,
)

SHAPES = (BLOCK, BRICK, CAN, BALL)
COLOURS = ("red", "green", "blue")
PITCH = 0.065
"""Distance of neighbours in the grid, m."""
NOISE = 0.002 / 0.7**2
"""Standard deviation of the depth for each square metre of squared depth, 1/m."""
NEAR = 0.005
"""Distance from its true place up to which an item is seen right, m."""


def grid(count: int, rng: np.random.Generator) -> list[Thing]:
    """Things in a grid around the middle of the picture; every eighth touches its neighbour."""
    columns = math.ceil(math.sqrt(count * 1.2))
    things: list[Thing] = []
    for n in range(count):
        row, column = divmod(n, columns)
        x = 0.5 + (row - count / columns / 2) * PITCH
        y = (column - columns / 2) * PITCH
        shape = SHAPES[int(rng.integers(len(SHAPES)))]
        colour = COLOURS[int(rng.integers(3))]
        yaw = float(rng.uniform(-math.pi, math.pi))
        if n % 8 == 7:
            shape, colour, yaw = BLOCK, "red", 0.0
            things[-1] = standing(BLOCK, x, y - 0.041, 0.0, "red")
        things.append(standing(shape, x, y, yaw, colour))
    return things


class Looker:
    """Belief that is kept from pictures of drawn things."""

    def __init__(self, *, remembers: bool) -> None:
        self.scene: PlanningScene = empty_scene()
        self.perception = Perception(SCENE, Robot())
        self.memory = PictureMemory() if remembers else None
        self.now = 0.0

    def look(self, still: RgbdImage, seed: int) -> float:
        """Look once with new noise at a drawn image; the CPU time, s."""
        self.now += 1.0
        noise = np.random.default_rng(seed).standard_normal(still.depth.shape)
        depth = still.depth * (1.0 + NOISE * still.depth * noise)
        image = replace(still, stamp=self.now, depth=depth.astype(np.float32))
        known = list(self.scene.objects)
        began = time.process_time()
        work = self.perception.understand(image, np.zeros(7), 0.08, None, known, self.memory, known)
        while True:
            try:
                next(work)
            except StopIteration as done:
                view = done.value
                break
        summary = update_belief(self.scene, view, self.now)
        if self.memory is not None:
            found = {n: self.scene.get(name) for n, name in summary.objects.items()}
            self.memory.keep(view, found)
        return time.process_time() - began

    def set_aside(self) -> None:
        for each in self.scene.objects:
            if each.role == "item":
                self.scene.put(replace(each, place=ASIDE), "set aside")

    def errors(self, things: list[Thing]) -> Counter[str]:
        """Numbers of things that the belief lacks, and of beliefs without a thing."""
        believed = [o for o in self.scene.objects if o.role == "item"]
        left = list(believed)
        counts: Counter[str] = Counter()
        for thing in things:
            near = [
                o
                for o in left
                if o.colour == thing.colour
                and o.shape == thing.shape
                and math.dist(o.pose.position[:2], thing.pose.position[:2]) < NEAR
            ]
            if near:
                left.remove(near[0])
            else:
                counts["missing"] += 1
        counts["phantom"] = len(left)
        return counts


def changed(things: list[Thing], rng: np.random.Generator) -> tuple[str, list[Thing]]:
    """One drawn change of a thing that touches nothing: its name and the things after it."""
    n = int(rng.choice([n for n in range(len(things)) if n % 8 < 6]))
    thing, others = things[n], [*things[:n], *things[n + 1 :]]
    what = str(rng.choice(["shift", "small shift", "turn", "remove", "kind", "colour", "touch"]))
    x, y, _ = thing.pose.position
    match what:
        case "shift" | "small shift":
            far = float(rng.uniform(0.006, 0.02) if what == "shift" else rng.uniform(0.001, 0.006))
            angle = float(rng.uniform(0, 2 * math.pi))
            return what, [
                *others,
                replace(thing, pose=thing.pose.shifted((far * math.cos(angle), far * math.sin(angle), 0.0))),
            ]
        case "turn":
            yaw = float(rng.uniform(0.2, 1.2))
            return what, [*others, standing(thing.shape, x, y, yaw, thing.colour)]
        case "remove":
            return what, others
        case "kind":
            kind = SHAPES[(SHAPES.index(thing.shape) + 1 + int(rng.integers(3))) % 4]
            return what, [*others, standing(kind, x, y, 0.3, thing.colour)]
        case "colour":
            colour = COLOURS[(COLOURS.index(thing.colour) + 1 + int(rng.integers(2))) % 3]
            return what, [*others, replace(thing, colour=colour)]
        case _:
            return what, [*things, standing(BALL, x + 0.041, y, 0.0, thing.colour)]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--items", type=int, default=300)
    parser.add_argument("--looks", type=int, default=20)
    parser.add_argument("--situations", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    things = grid(options.items, np.random.default_rng(options.seed))
    still = photograph(things, noise=0.0)
    for remembers in (False, True):
        looker = Looker(remembers=remembers)
        first = looker.look(still, 0)
        looker.set_aside()
        looker.look(still, 1)
        looker.look(still, 2)
        times = sorted(looker.look(still, 3 + n) for n in range(options.looks))
        print(
            f"memory {remembers}: {options.items} items, first look {first * 1000:.0f} ms, "
            f"later median {times[len(times) // 2] * 1000:.1f} ms, longest {times[-1] * 1000:.1f} ms, "
            f"{dict(looker.errors(things))}",
            flush=True,
        )
    totals: dict[bool, Counter[str]] = {False: Counter(), True: Counter()}
    for n in range(options.situations):
        things = grid(12, rng)
        what, after = changed(things, rng)
        still, later = photograph(things, noise=0.0), photograph(after, noise=0.0)
        for remembers in (False, True):
            looker = Looker(remembers=remembers)
            for look in range(3):
                looker.look(still, 10 * n + look)
            before = looker.errors(things)
            looker.look(later, 10 * n + 5)
            wrong = looker.errors(after) - before
            totals[remembers][f"{what}: {'wrong' if wrong.total() else 'right'}"] += 1
    for remembers in (False, True):
        print("memory", remembers, dict(sorted(totals[remembers].items())))


if __name__ == "__main__":
    main()
