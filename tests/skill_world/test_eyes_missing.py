"""A camera that gives no image, or old ones: a look tries again, then says so with figures."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import closing
from dataclasses import replace
from typing import TypeVar

import pytest

from picktree.robot import World
from picktree.session import assemble_world
from picktree.session.execution import TICK_LENGTH
from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.physics import PhysicsHardware
from picktree.world import Camera, Failure, JournalEvent, NoImage, RgbdImage
from picktree.world.robot_model import load_robot
from picktree.world.scene import load_scene

T = TypeVar("T")


class Failing:
    """A camera of which only some shots come: `x` one, `-` none, `o` an old one, the last for ever."""

    def __init__(self, camera: Camera, shots: str) -> None:
        self._camera = camera
        self.shots = shots

    def capture(self) -> RgbdImage:
        shot, self.shots = self.shots[0], self.shots[1:] or self.shots
        if shot == "-":
            raise NoImage
        image = self._camera.capture()
        return image if shot == "x" else replace(image, stamp=image.stamp - 1.5)


def cell(shots: str) -> World:
    scene, robot = load_scene("sort_small"), load_robot("panda")
    hardware = KinematicHardware(scene, robot, 3)
    hardware.cameras = {"overhead": Failing(hardware.cameras["overhead"], shots)}
    world = assemble_world(hardware, scene, robot, 3)
    for _ in range(40):
        world.control.step_tick(TICK_LENGTH)
    return world


def driven(world: World, doing: Generator[None, None, T]) -> T:
    while True:
        try:
            next(doing)
        except StopIteration as end:
            return end.value
        world.control.step_tick(TICK_LENGTH)


def test_a_frame_that_is_missing_is_waited_for_and_noted() -> None:
    world = cell("-o-x")
    summary = driven(world, world.vision.observe("overhead"))
    assert len(summary.seen) == 4
    events = [e for e in world.journal.take() if isinstance(e, JournalEvent) and e.kind == "frames_missed"]
    assert [(e.message, e.data) for e in events] == [("3 of 4 frames did not come", {"missed": 3})]
    assert world.vision.newest == pytest.approx(2.3)


@pytest.mark.parametrize(
    ("shots", "message"),
    [
        ("-", "overhead gives no image (4 frames in 0.30 s)"),
        ("o", "overhead gives no new image: the last one is 1.50 s old (4 frames in 0.30 s)"),
    ],
)
def test_a_camera_without_image_is_said_and_nothing_is_believed(shots: str, message: str) -> None:
    world = cell(shots)
    for look in (world.vision.observe, world.vision.capture):
        with pytest.raises(Failure) as raised:
            driven(world, look("overhead"))
        assert str(raised.value) == f"perception.no_image: {message}"
        assert raised.value.evidence["frames"] == 4
    assert world.vision.observations == 0
    assert world.scene.objects == ()


class Frozen:
    """A camera whose clock goes on while its picture stands still from a time on, s."""

    def __init__(self, camera: Camera, since: float) -> None:
        self._camera, self._since = camera, since
        self._last: RgbdImage | None = None

    def capture(self) -> RgbdImage:
        image = self._camera.capture()
        if self._last is None or image.stamp < self._since:
            self._last = image
        return replace(self._last, stamp=image.stamp)


def test_a_picture_that_stands_still_is_no_image(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, robot = load_scene("sort_small"), load_robot("panda")
    with closing(PhysicsHardware(scene, robot, 3)) as hardware:
        frozen = {"overhead": Frozen(hardware.cameras["overhead"], 2.6)}
        monkeypatch.setattr(PhysicsHardware, "cameras", frozen)
        world = assemble_world(hardware, scene, robot, 3)
        for _ in range(40):
            world.control.step_tick(TICK_LENGTH)
        for _ in range(2):
            driven(world, world.vision.observe("overhead"))
            for _ in range(6):
                world.control.step_tick(TICK_LENGTH)
        taken = world.vision.newest
        with pytest.raises(Failure) as raised:
            driven(world, world.vision.observe("overhead"))
        assert raised.value.cause.name == "perception.no_image"
        still = raised.value.evidence["frozen"]
        assert still == pytest.approx(world.clock.now - taken)
        assert str(raised.value).endswith(
            f"overhead stands still: it has given the same image for {still:.2f} s (4 frames in 0.30 s)"
        )
        assert world.vision.newest == taken


def test_an_ideal_camera_may_repeat_its_picture() -> None:
    world = cell("x")
    for _ in range(2):
        driven(world, world.vision.observe("overhead"))
        world.control.step_tick(TICK_LENGTH)
    assert world.vision.observations == 2
