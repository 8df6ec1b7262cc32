"""WatchScene: when a picture is taken, known, or dropped, and when nobody sees any more."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from picktree.simulation.kinematic import KinematicHardware
from picktree.world import Failure, FailureReport, ObjectId, Pose, perception

from .cell import Cell, items, mission

WAIT = "{Delay: {delay_msec: 20 s, do: AlwaysSuccess}}"


class Watched:
    """A cell in which a branch waits below a WatchScene, through eyes that note when they are used."""

    def __init__(self, ports: str = "every: 500 ms") -> None:
        self.cell = Cell(mission("Observe: {camera: overhead}"), items(block=1))
        self.cell.finish()
        self.cell.start(mission(f"WatchScene: {{{ports}, do: {WAIT}}}"))
        eyes = self.cell.world.vision
        self.began = self.cell.world.clock.now
        self.taken, self.known = list[float](), list[float]()
        self.refuse: Failure | None = None
        self.removed: list[ObjectId] = []
        eyes.capture_now = self._glance  # type: ignore[method-assign]
        eyes.begin = self._begin  # type: ignore[method-assign]
        eyes.merge = self._take_in  # type: ignore[method-assign]
        self.advanced, self.work = 0, 0
        """Ticks in which the look was evaluated further, and the number that it needs."""

    @property
    def now(self) -> float:
        """Time since the branch began, s."""
        return round(self.cell.world.clock.now - self.began, 6)

    def _glance(self, camera: str) -> Any:
        assert camera == "overhead"
        self.taken.append(self.now)
        if self.refuse is not None:
            raise self.refuse
        return SimpleNamespace(stamp=self.cell.world.clock.now)

    def _begin(self, shot: Any, known: Any) -> Any:
        look = SimpleNamespace(shot=shot, done=self.work == 0)

        def advance() -> None:
            self.advanced += 1
            look.done = self.advanced >= self.work

        look.advance = advance
        return look

    def _take_in(self, look: Any) -> Any:
        self.known.append(self.now)
        self.cell.world.vision.newest = look.shot.stamp
        return SimpleNamespace(removed=self.removed)

    def until(self, seconds: float) -> None:
        while self.now < seconds - 1e-9:
            self.cell.tick()
            if not self.cell.running:
                return

    def failure(self) -> FailureReport | None:
        return self.cell.tree.failure

    def width(self, width: float) -> None:
        assert isinstance(self.cell.hardware, KinematicHardware)
        self.cell.hardware.gripper.width = self.cell.hardware.gripper.target = width

    def hold(self, *, holds: bool = True) -> None:
        """Believe that the block is held, or no longer."""
        scene = self.cell.world.scene
        (block,) = (o for o in scene.objects if o.role == "item")
        if holds:
            scene.attach(block.id, Pose())
        else:
            scene.detach(block.id, block.pose, "table", "test")


def test_pictures_are_taken_at_intervals_and_known_when_they_were_thought_about() -> None:
    watched = Watched()
    thought = list[float]()
    watched.cell.world.thinking.add_unowed = thought.append  # type: ignore[method-assign]
    cost = watched.cell.world.vision.cost = 0.2
    watched.until(1.6)
    assert watched.taken == pytest.approx([0.0, 0.5, 1.0, 1.5])
    assert watched.known == pytest.approx([0.2, 0.7, 1.2])
    assert thought == [cost] * 4


def test_one_picture_is_thought_about_at_a_time() -> None:
    watched = Watched("every: 100 ms")
    watched.cell.world.vision.cost = 0.3
    watched.until(0.7)
    assert watched.taken == pytest.approx([0.0, 0.3, 0.6])
    assert watched.known == pytest.approx([0.3, 0.6])


def test_a_picture_is_known_when_its_evaluation_is_done() -> None:
    watched = Watched()
    watched.cell.world.vision.cost, watched.work = 0.1, 6
    watched.until(0.4)
    assert (watched.advanced, watched.known) == (6, pytest.approx([0.25]))


def test_a_picture_older_than_what_is_known_says_nothing() -> None:
    watched = Watched()
    watched.cell.world.vision.cost = 0.2
    watched.until(0.15)
    watched.cell.world.vision.newest = watched.began  # somebody else has looked in that moment
    watched.until(0.5)
    assert (watched.taken, watched.known) == ([0.0], [])


def test_what_is_seen_to_be_gone_has_no_history() -> None:
    watched = Watched()
    attempts = watched.cell.world.attempts
    attempts.failed("Main/Grasp", ObjectId("gone"), "top 0")
    watched.removed = [ObjectId("gone")]
    watched.until(0.4)
    assert watched.known
    assert attempts.count("Main/Grasp", ObjectId("gone")) == 0


@pytest.mark.parametrize(("holds", "pause"), [(True, 0.25), (False, 0.5)])
def test_while_something_is_taken_or_let_go_no_picture_counts(holds: bool, pause: float) -> None:
    """One that was thought about is dropped; the next is taken when what fell lies."""
    watched = Watched("every: 200 ms")
    watched.cell.world.vision.cost = 0.1
    watched.hold()
    if holds:
        watched.hold(holds=False)
        watched.until(0.4)
    else:
        watched.until(0.8)
    watched.taken.clear()
    watched.known.clear()
    since = watched.now
    watched.hold(holds=holds)
    watched.until(since + 0.75)
    assert watched.taken[0] == pytest.approx(since + pause)
    assert watched.known[0] == pytest.approx(since + pause + 0.1)


@pytest.mark.parametrize(
    ("holds", "width", "pause"), [(True, 0.001, 0.0), (True, 0.0012, 0.5), (False, 0.01, 0.0)]
)
def test_fingers_that_move_around_something_stop_the_looking(holds: bool, width: float, pause: float) -> None:
    watched = Watched("every: 50 ms")
    watched.cell.world.vision.cost = 0.0
    watched.width(0.0)
    if holds:
        watched.hold()
    watched.until(1.0)
    watched.taken.clear()
    watched.width(width)
    since = watched.now
    watched.until(since + 0.7)
    assert watched.taken[0] == pytest.approx(since + pause)


@pytest.mark.parametrize(("blind", "longest"), [("1 s", 1.0), ("0 s", 0.0)])
def test_a_camera_may_show_nothing_for_a_while(blind: str, longest: float) -> None:
    watched = Watched(f"every: 250 ms, blind: {blind}")
    watched.until(0.6)
    last = watched.taken[-1]
    watched.refuse = Failure(perception.NO_IMAGE, "the cable is out")
    watched.until(5.0)
    failure = watched.failure()
    assert failure is not None
    assert failure.message == "the cable is out"
    assert watched.now == pytest.approx(last + longest + 0.25)
    assert "Delay" not in [n.wiring.id for n in watched.cell.tree.nodes if n.state.value == "RUNNING"]


def test_another_refusal_of_the_camera_is_a_failure_at_once() -> None:
    watched = Watched()
    watched.refuse = Failure(perception.NOT_FOUND, "there is no such camera")
    watched.until(1.0)
    failure = watched.failure()
    assert failure is not None
    assert (str(failure.cause), watched.now) == ("perception.not_found", 0.0)


def test_a_picture_that_was_thought_about_when_it_was_saved_or_halted_is_not_kept() -> None:
    for how in ("save", "halt", "neither"):
        watched = Watched("every: 2 s")
        watched.cell.world.vision.cost = 0.3
        watched.until(0.1)
        assert watched.taken == [0.0]
        if how == "save":
            watched.cell.tree.find("Main/WatchScene").save_state()
        if how == "halt":
            watched.cell.tree.find("Main/WatchScene").halt()
        since = watched.now
        watched.until(1.0)
        if how == "halt":  # it starts anew, and looks at once
            assert watched.taken[1] == pytest.approx(since)
            assert watched.known == pytest.approx([since + 0.3])
        else:
            assert watched.known == ([] if how == "save" else pytest.approx([0.3]))


def test_what_is_held_from_the_beginning_keeps_nobody_from_looking() -> None:
    watched = Watched()
    watched.width(0.04)
    watched.hold()
    watched.until(0.2)
    assert watched.taken == [0.0]


def test_a_picture_of_an_earlier_start_is_not_taken_in() -> None:
    watched = Watched()
    watched.cell.world.vision.cost = 0.3
    short = "{Delay: {delay_msec: 100 ms, do: AlwaysSuccess}}"
    body = f"{{WatchScene: {{every: 10 s, do: {short}}}}}"
    watched.cell.start(mission(f"Repeat: {{num_cycles: 5, do: {body}}}"))
    watched.until(1.0)
    assert len(watched.taken) >= 5
    assert watched.known == []
