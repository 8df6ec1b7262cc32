"""Whether the arm is over a place: by its links, seen from above."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from picktree.simulation import LightCurtain, Zone
from picktree.world.robot_model import RobotModel

from .simulated_cell import panda

MODEL = RobotModel(panda())


@cache
def curtain() -> LightCurtain:
    return LightCurtain(MODEL)


def over(
    x: float, y: float, pose: str = "home", yaw: float = 0.0, half: tuple[float, float] = (0.05, 0.05)
) -> bool:
    return curtain().crossed(Zone((x, y), yaw, half), MODEL.named(pose), 0.08)


@pytest.mark.parametrize(
    ("x", "y", "pose", "crossed"),
    [
        (0.3, 0.0, "home", True),  # the hand
        (0.1, 0.0, "home", True),  # the forearm
        (0.45, 0.0, "home", False),
        (0.9, 0.0, "home", False),
        (0.5, 0.3, "home", False),
        (0.0, 0.3, "observe", True),
        (0.3, 0.0, "observe", False),
    ],
)
def test_the_arm_is_where_its_links_are(x: float, y: float, pose: str, crossed: bool) -> None:
    assert over(x, y, pose) is crossed


def test_the_base_is_no_part_of_the_arm() -> None:
    straight_up = np.zeros(7)
    assert not curtain().crossed(Zone((-0.13, 0.0), 0.0, (0.01, 0.01)), straight_up, 0.0)


def test_fingers_count_with_their_opening() -> None:
    tcp = MODEL.tcp(MODEL.named("home"))
    across = tcp.rotation()[:, 1]
    x, y, _ = np.array(tcp.position) + 0.14 * across
    assert not over(float(x), float(y), half=(0.005, 0.005))
    assert over(float(x), float(y), half=(0.05, 0.05))


def test_a_zone_is_turned() -> None:
    # A long zone beside the hand reaches it along its length only.
    assert not over(0.3, 0.35, half=(0.3, 0.02))
    assert over(0.3, 0.35, yaw=np.pi / 2, half=(0.3, 0.02))


def test_a_rim_widens_it() -> None:
    zone = Zone((0.5, 0.3), 0.0, (0.05, 0.05))
    assert zone.grown(0.1) == Zone((0.5, 0.3), 0.0, (0.15000000000000002, 0.15000000000000002))
    assert not curtain().crossed(zone, MODEL.named("home"), 0.08)
    assert curtain().crossed(zone.grown(0.2), MODEL.named("home"), 0.08)
