"""The order of items: short ways of the empty hand, what is held first, the same order each time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from picktree.robot import World
from picktree.robot.manipulation import travel_order
from picktree.world import BeliefObject, Box, ObjectId, Pose
from picktree.world.robot_model import RobotModel, load_robot

MODEL = RobotModel(load_robot("panda"))
BINS = {"left": Pose((0.42, 0.48, 0.0)), "right": Pose((0.42, -0.48, 0.0))}


def item(name: str, turned: float, *, reach: float = 0.5) -> BeliefObject:
    """An item at an angle about the robot's axis, rad; its name begins with the bin where it belongs."""
    pose = Pose((reach * math.cos(turned), reach * math.sin(turned), 0.02))
    shape = Box((0.04, 0.04, 0.04))
    return BeliefObject("block", "box", shape, "red", pose, 0.001, 0.0, 1.0, 0.0, id=ObjectId(name))


def ordered(items: Sequence[BeliefObject]) -> list[str]:
    bins = {name: SimpleNamespace(pose=pose) for name, pose in BINS.items()}

    def destination(name: str) -> str | None:
        return next((each for each in bins if name.startswith(each)), None)

    scene = SimpleNamespace(destination=destination, bins=bins, fixtures={})
    control = SimpleNamespace(tcp=Pose((0.5, 0.0, 0.4)))
    world = cast("World", SimpleNamespace(scene=scene, control=control, robot=MODEL))
    return [str(o.id) for o in travel_order(world, items)]


def turned(items: Sequence[BeliefObject], order: Sequence[str]) -> float:
    """Angle by which the first joint turns with an empty hand, rad."""
    at = {str(o.id): math.atan2(o.pose.position[1], o.pose.position[0]) for o in items}
    bins = {name: math.atan2(pose.position[1], pose.position[0]) for name, pose in BINS.items()}
    angle, whole = 0.0, 0.0
    for name in order:
        whole += abs(at[name] - angle)
        angle = next((bins[b] for b in bins if name.startswith(b)), at[name])
    return whole


def test_the_hand_goes_on_to_what_is_near_the_bin() -> None:
    """From the bin at the right nothing is fetched at the far left, whatever lies nearer to the robot."""
    near = item("right_1", 0.6, reach=0.4)
    items = [near, item("left_1", -0.6), item("right_2", 0.5), item("left_2", -0.5)]
    order = ordered(items)
    assert [name.split("_")[0] for name in order] in (["left", "right"] * 2, ["right", "left"] * 2)


def test_it_is_shorter_than_the_nearest_first_and_than_any_other_place_of_a_single_item() -> None:
    rng = np.random.default_rng(20)
    shorter = 0
    for _ in range(12):
        bins = rng.choice(["left", "right"], 10)
        items = [
            item(f"{into}_{k}", a)
            for k, (into, a) in enumerate(zip(bins, rng.uniform(-0.6, 0.6, 10), strict=True))
        ]
        order = ordered(items)
        assert sorted(order) == sorted(str(o.id) for o in items)
        first = turned(items, order)
        shorter += first < turned(items, [str(o.id) for o in items]) - 0.5
    assert shorter >= 11


def test_what_is_held_comes_first_wherever_it_is() -> None:
    items = [item("left_1", -0.1), item("right_1", 0.1), item("left_2", 1.2)]
    held = replace(items[2], object_in_tcp=Pose())
    assert ordered([*items[:2], held])[0] == "left_2"


def test_the_order_does_not_depend_on_that_of_the_belief() -> None:
    items = [item(f"left_{k}", 0.1 * k) for k in range(5)]
    assert ordered(items) == ordered(items[::-1])


@pytest.mark.parametrize("count", [0, 1])
def test_few_items(count: int) -> None:
    items = [item("on_no_rule", 0.2)][:count]
    assert ordered(items) == [str(o.id) for o in items]
