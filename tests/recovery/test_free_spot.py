"""FreeSpot: where what the hand holds can be put down, over all the table and nowhere else."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from picktree.world import Box, Cylinder, ObjectId, Pose, Vector3
from picktree.world.scene import Fixture

from ..skills.cell import Cell, items, mission

TABLE = Fixture(ObjectId("table"), Box((1.2, 1.6, 0.04)), Pose((0.5, 0.0, -0.02)))


def holding() -> tuple[Cell, str]:
    """A bare table, and a block in the hand, 8 cm above it at (0.5, 0)."""
    scene = replace(items(block=1), bins=(), destinations=(), fixtures=(TABLE,))
    scene = replace(scene, spawn=(replace(scene.spawn[0], area=((0.499, -0.001), (0.501, 0.001))),))
    made = Cell(mission("Observe: {camera: overhead}"), scene)
    made.finish()
    (block,) = (str(o.id) for o in made.world.scene.objects if o.role == "item")
    assert made.do(f"Grasp: {{object: {block}, onward: false}}") == ""
    return made, block


def found(cell: Cell, block: str) -> Vector3:
    cell.do(f'FreeSpot: {{object: {block}, at: "{{spot}}"}}')
    assert cell.tree.failure is None, cell.tree.failure
    value = cell.tree.blackboard.save()["Main/spot"]
    assert isinstance(value, list)
    x, y, z = (float(c) for c in value)  # type: ignore[arg-type]
    return x, y, z


def free(cell: Cell, block: str, monkeypatch: pytest.MonkeyPatch) -> tuple[int, int]:
    """How many places are free, and of how many it was asked whether the arm reaches them: none."""
    asked: list[Pose] = []
    with monkeypatch.context() as patch:
        patch.setattr(cell.world.plan, "reachable", asked.append)
        cell.do(f'FreeSpot: {{object: {block}, at: "{{spot}}"}}')
    failure = cell.failure
    assert cell.told == f"place.occupied: there is no place within reach where {block} can be put down"
    free = failure.evidence["free"]
    assert isinstance(free, int)
    return free, len({(round(p.position[0], 4), round(p.position[1], 4)) for p in asked})


def expected(near: float = 0.32, far: float = 0.70) -> int:
    """Points of a grid of 3 cm about the table's middle, 8 cm from its edges, that an arm reaches."""
    xs, ys = np.arange(-17, 18) * 0.03 + 0.5, np.arange(-24, 25) * 0.03
    assert xs[-1] <= 1.1 - 0.08 < xs[-1] + 0.03
    assert ys[-1] <= 0.8 - 0.08 < ys[-1] + 0.03
    return sum(near < math.hypot(x, y) < far for x in xs for y in ys)


def test_all_of_the_table_within_reach_is_offered(monkeypatch: pytest.MonkeyPatch) -> None:
    made, block = holding()
    count, asked = free(made, block, monkeypatch)
    assert count == expected()
    assert asked == 25


@pytest.mark.parametrize(("gap", "taken"), [(0.038, True), (0.042, False)])
def test_around_it_there_is_room_for_the_hand(gap: float, taken: bool) -> None:
    """The nearest place to the hand is (0.5, 0); something stands that far from a block of 4 cm there."""
    made, block = holding()
    made.believe("thing", (0.01, 0.01, 0.2), (0.5 + 0.02 + gap + 0.005, 0.0, 0.1))
    at = found(made, block)
    assert (math.dist(at[:2], (0.5, 0.0)) > 0.02) is taken


def test_the_nearest_to_the_hand_comes_first_and_then_others() -> None:
    made, block = holding()
    hand = made.world.control.tcp.position
    spots = [found(made, block) for _ in range(3)]
    assert len(set(spots)) == 3
    away = [math.dist(spot[:2], hand[:2]) for spot in spots]
    assert away == sorted(away)
    assert away[0] < 0.022
    assert all(spot[2] == pytest.approx(0.0) for spot in spots)


def test_boards_alone_are_put_down_upon(monkeypatch: pytest.MonkeyPatch) -> None:
    """No drum, nothing higher than it is wide, nothing that leans, and nothing too small."""
    made, block = holding()
    scene, high = made.world.scene, Pose((0.5, 0.0, 0.6))
    shelf = Fixture(ObjectId("shelf"), Box((0.2, 0.2, 0.02)), high)
    others = (
        replace(shelf, shape=Box((0.2, 0.2, 0.21))),
        replace(shelf, shape=Cylinder(0.1, 0.02)),
        replace(shelf, shape=Box((0.2, 0.15, 0.02))),
        replace(shelf, pose=Pose.from_rpy(high.position, (0.03, 0.0, 0.0))),
        replace(shelf, pose=high.shifted((0.0, 0.0, 0.61))),
    )
    table = {"table": TABLE}
    for other in others:
        scene.fixtures = {**table, "shelf": other}
        assert free(made, block, monkeypatch)[0] == expected(), other
    scene.fixtures = {**table, "shelf": shelf}
    assert free(made, block, monkeypatch)[0] == expected() + 1


def test_an_empty_hand_has_nothing_to_put_down() -> None:
    made, block = holding()
    made.do("OpenGripper")
    for item, told in (
        (block, f"grasp.slipped: {block} is not in the hand"),
        ("red_nut_9", "world.unknown_object: no object 'red_nut_9' in the planning scene"),
    ):
        made.do(f'FreeSpot: {{object: {item}, at: "{{spot}}"}}')
        assert f"{made.failure.cause}: {made.failure.message}" == told
