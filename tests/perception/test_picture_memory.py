"""Picture memory: what is confirmed without a fit, and which changes are recognised."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from picktree.logs import log_records
from picktree.robot.perception import (
    WORK_PER_TICK,
    Perception,
    PictureMemory,
    PictureState,
    PosedCamera,
    update_belief,
)
from picktree.world import BeliefObject, Box, PlanningScene, Pose, RgbdImage

from .perception_pictures import (
    BALL,
    BLOCK,
    BRICK,
    CAN,
    ELSEWHERE,
    SCENE,
    Robot,
    Thing,
    empty_scene,
    photograph,
    standing,
)

THREE = (
    standing(BLOCK, 0.45, -0.1, 0.3, "red"),
    standing(BRICK, 0.55, 0.0, 1.0, "green"),
    standing(CAN, 0.6, 0.15, 0.0, "blue"),
)


class Looker:
    """Belief that is kept from pictures of things, with the number of fits of each look."""

    def __init__(self, things: Sequence[Thing] = THREE) -> None:
        self.scene: PlanningScene = empty_scene()
        self.memory = PictureMemory()
        self.now = 0.0
        self.robot = Robot()
        self.look(things)

    def look(
        self, things: Sequence[Thing], *, after: float = 0.1, spoil: Callable[[RgbdImage], None] | None = None
    ) -> int:
        """Return the number of fits of one look; `spoil` changes the image before."""
        self.now += after
        image = replace(photograph(things, seed=round(10 * self.now)), stamp=self.now)
        if spoil is not None:
            spoil(image)
        known, fits = self.scene.objects, list[int]()
        work = Perception(SCENE, self.robot).understand(
            image, np.zeros(7), 0.08, None, known, self.memory, known
        )
        while True:
            try:
                fits.append(next(work))
            except StopIteration as done:
                view = done.value
                break
        summary = update_belief(self.scene, view, self.now)
        self.memory.keep(view, {n: self.scene.get(name) for n, name in summary.objects.items()})
        return max(fits) - 2 * WORK_PER_TICK

    def believed(self, colour: str) -> BeliefObject | None:
        return next((o for o in self.scene.objects if o.colour == colour), None)


def test_unchanged_items_are_confirmed_without_a_fit() -> None:
    looker = Looker()
    before = looker.scene.snapshot()
    assert looker.look(THREE) == 0
    now = looker.scene.snapshot()
    assert {o.last_seen for o in now.objects} == {looker.now}
    assert [replace(o, last_seen=0.0) for o in now.objects] == [
        replace(o, last_seen=0.0) for o in before.objects
    ]
    assert now.version == before.version


@pytest.mark.parametrize(
    "after",
    [
        standing(BLOCK, 0.453, -0.1, 0.3, "red"),
        standing(BLOCK, 0.45, -0.1, 0.8, "red"),
        standing(BALL, 0.45, -0.1, 0.0, "red"),
        standing(BLOCK, 0.45, -0.1, 0.3, "blue"),
    ],
    ids=["shifted by 3 mm", "turned", "another kind", "another colour"],
)
def test_only_a_changed_item_is_recognised_again(after: Thing) -> None:
    looker = Looker()
    whole = looker.look(THREE, after=20.0)
    fits = looker.look((after, *THREE[1:]))
    assert fits > 0
    (near,) = (
        o for o in looker.scene.objects if o.pose.distance(after.pose) < 0.004 and o.colour == after.colour
    )
    assert near.shape == after.shape
    assert len(looker.scene.objects) == 3
    assert whole < 40


def test_a_removed_item_leaves_the_belief_and_a_new_one_comes() -> None:
    looker = Looker()
    looker.look((*THREE[1:], standing(BALL, 0.4, 0.1, 0.0, "red")))
    (red,) = (o for o in looker.scene.objects if o.colour == "red")
    assert (red.kind, round(red.pose.position[0], 2)) == ("ball", 0.4)


def test_an_item_behind_the_robot_stays_believed_and_is_no_piece() -> None:
    looker = Looker()
    red = looker.believed("red")
    assert red is not None
    for height, confirmed in ((0.3, False), (5.0, True)):
        looker.robot.pose = Pose((0.45 + 0.02, -0.1, height))
        if height > 1.0:
            looker.robot.pose = ELSEWHERE
        arm = [Thing(looker.robot.box, looker.robot.pose, "grey")]
        assert looker.look([*THREE, *arm]) == 0
        now = looker.believed("red")
        assert now is not None and now.pose == red.pose
        assert (now.last_seen == looker.now) == confirmed


def test_an_item_believed_elsewhere_is_recognised_again() -> None:
    looker = Looker()
    red = looker.believed("red")
    assert red is not None
    looker.scene.put(replace(red, pose=red.pose.shifted((0.01, 0.0, 0.0))), "touched")
    assert looker.look(THREE) > 0
    again = looker.believed("red")
    assert again is not None and again.pose.distance(red.pose) < 0.002


def test_each_patch_is_reviewed_from_time_to_time() -> None:
    looker = Looker()
    assert looker.look(THREE, after=5.0) == 0
    fits = [looker.look(THREE, after=2.0) > 0 for _ in range(6)]
    assert fits == [False, False, True, True, True, False]


def test_an_uncertain_patch_is_recognised_three_times(monkeypatch: pytest.MonkeyPatch) -> None:
    leaning = Thing(BRICK, Pose.from_rpy((0.5, 0.0, 0.035), (0.5, 0.3, 0.2)), "red")
    looker = Looker((leaning,))
    looked = [looker.look((leaning,)) > 0 for _ in range(4)]
    assert looked == [True, True, False, False]


def test_a_restored_memory_confirms_the_same() -> None:
    looker = Looker((*THREE, standing(BLOCK, 0.45, -0.059, 0.3, "red")))
    state = looker.memory.state()
    adapter = log_records.record_adapter(PictureState)
    looker.memory = PictureMemory.from_state(adapter.validate_json(adapter.dump_json(state)))
    assert looker.memory.state() == state
    assert looker.look((*THREE, standing(BLOCK, 0.45, -0.059, 0.3, "red"))) == 0


def in_the_middle(
    looker: Looker, size: int, change: Callable[[RgbdImage, tuple[slice, slice]], None]
) -> Callable[[RgbdImage], None]:
    """Return a change of a square of `size` pixels in the middle of the red block."""
    red = looker.believed("red")
    assert red is not None

    def spoil(image: RgbdImage) -> None:
        sight = PosedCamera.at(image.intrinsics, image.camera_in_world)
        column, row = (round(float(n)) for n in sight.pixels(np.array([red.pose.position]))[0])
        change(image, (slice(row, row + size), slice(column, column + size)))

    return spoil


def nearer(image: RgbdImage, window: tuple[slice, slice]) -> None:
    image.depth[window] -= 0.03


def green(image: RgbdImage, window: tuple[slice, slice]) -> None:
    image.colour[window] = (0, 200, 0)


@pytest.mark.parametrize("change", [nearer, green])
@pytest.mark.parametrize(("size", "again"), [(1, False), (3, True)])
def test_a_few_changed_pixels_change_nothing(change: Any, size: int, *, again: bool) -> None:
    looker = Looker()
    fits = looker.look(THREE, spoil=in_the_middle(looker, size, change))
    assert (fits > 0) == again


def test_an_item_on_a_painted_surface_is_found() -> None:
    board = Thing(Box((0.45, 0.4, 0.01)), Pose((0.5, -0.42, 0.005)), "green")
    looker = Looker((*THREE, board))
    looker.look((*THREE, board, Thing(BLOCK, Pose((0.5, -0.42, 0.03)), "blue")))
    assert any(o.colour == "blue" and abs(o.pose.position[1] + 0.42) < 0.02 for o in looker.scene.objects)


def test_a_patch_that_rose_as_a_whole_is_recognised_again() -> None:
    looker = Looker()

    def risen(image: RgbdImage) -> None:
        image.depth[(image.colour[..., 2] > 120) & (image.colour[..., 0] < 60)] -= 0.003

    assert looker.look(THREE, spoil=risen) > 0


def test_a_body_that_comes_to_touch_an_item_has_it_recognised_again() -> None:
    looker = Looker()
    apart = looker.look((*THREE, standing(BALL, 0.40, 0.15, 0.0, "green")))
    looker = Looker()
    touching = looker.look((*THREE, standing(BALL, 0.56, 0.15, 0.0, "green")))
    assert 0 < apart < touching


def test_a_fresh_look_recognises_everything() -> None:
    looker = Looker()
    looker.memory.forget()
    assert looker.look(THREE) >= 3
