"""Fingers that do not do what they are told: jammed, weak, held open or shut; said with figures."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from picktree.robot.control import GripperControl
from picktree.world import Failure, GripperCommand, GripperState

from .control_cell import ROBOT, TICK


@dataclass
class Fingers:
    """A gripper whose fingers move as told towards `stop` m and press there with a share of the force."""

    stop: float = 0.0
    share: float = 1.0
    jammed: bool = False
    width: float = 0.08
    now: float = 0.0
    target: float = 0.08
    force: float = 0.0

    def read(self) -> GripperState:
        pressing = (
            self.force * self.share if self.target < self.stop >= self.width and not self.jammed else 0.0
        )
        return GripperState(self.width, 0.0, pressing)

    def command(self, command: GripperCommand) -> None:
        self.target, self.force = command.width, command.force

    def tick(self) -> None:
        self.now += TICK
        if not self.jammed:
            aim = max(self.target, self.stop) if self.target < self.width else self.target
            self.width += min(max(aim - self.width, -0.2 * TICK), 0.2 * TICK)


def closed(fingers: Fingers, force: float = 20.0) -> float:
    grip = GripperControl(fingers, fingers, ROBOT.gripper)
    doing = grip.close(force)
    while True:
        try:
            next(doing)
        except StopIteration as end:
            return float(end.value)
        fingers.tick()


def test_fingers_that_press_as_told_or_meet_are_sound() -> None:
    assert closed(Fingers(stop=0.04)) == 0.04
    assert closed(Fingers(stop=0.04, share=0.8)) == 0.04
    assert closed(Fingers(share=0.1)) == 0.0


@pytest.mark.parametrize(
    ("fingers", "message"),
    [
        (
            Fingers(stop=0.04, share=0.3),
            "control.gripper: the fingers press with 6.0 N each, though told 20 N",
        ),
        (
            Fingers(jammed=True),
            "control.gripper: the fingers stand at 80.0 mm and have not moved, though told to close "
            "with 20 N",
        ),
    ],
)
def test_weak_and_jammed_fingers_are_said(fingers: Fingers, message: str) -> None:
    with pytest.raises(Failure) as raised:
        closed(fingers)
    assert str(raised.value) == message
    assert raised.value.evidence["told"] == 20.0


def test_fingers_that_should_open_on_the_way_are_late_soon_when_they_do_not_move() -> None:
    fingers = Fingers(jammed=True, width=0.01)
    grip = GripperControl(fingers, fingers, ROBOT.gripper)
    assert grip.overdue_failure() is None
    grip.start(0.06)
    for _ in range(5):
        fingers.tick()
        assert grip.overdue_failure() is None
    fingers.tick()
    late = grip.overdue_failure()
    assert late is not None
    assert str(late) == "control.gripper: the fingers opened 10 mm of 60 mm"
    fingers.jammed = False
    for _ in range(6):
        fingers.tick()
        assert grip.overdue_failure() is None


def test_a_motion_meets_the_opening_that_the_fingers_are_on_the_way_to() -> None:
    fingers = Fingers(width=0.04)
    grip = GripperControl(fingers, fingers, ROBOT.gripper)
    assert grip.widest() == 0.04
    assert grip.widest(0.06) == 0.06
    assert (grip.span(0.06), grip.span(0.01)) == ((0.06, 0.04), (0.04, 0.01))
    grip.start(0.07)
    for _ in range(4):
        assert grip.widest() == grip.widest(0.05) == 0.07
        fingers.tick()
    grip.start(0.02)
    fingers.tick()
    assert grip.widest() == fingers.width
    assert fingers.width > 0.05


def test_fingers_that_something_holds_open_no_further() -> None:
    fingers = Fingers(jammed=True, width=0.04)
    grip = GripperControl(fingers, fingers, ROBOT.gripper)
    grip.start(0.07)
    fingers.tick()
    assert grip.widest() == 0.07
    for _ in range(20):
        fingers.tick()
    assert grip.widest() == 0.04


def test_fingers_that_cannot_open_say_so() -> None:
    fingers = Fingers(jammed=True, width=0.03)
    doing = GripperControl(fingers, fingers, ROBOT.gripper).open()
    with pytest.raises(Failure, match=r"^control.gripper: the fingers opened 30 mm of 80 mm$"):
        for _ in doing:
            fingers.tick()


def released(fingers: Fingers, share: float) -> tuple[float, float]:
    """Release by 30 mm; the opening when the call ends, and the one that is commanded."""
    for _ in GripperControl(fingers, fingers, ROBOT.gripper).release(0.03, share):
        fingers.tick()
    return fingers.width, fingers.target


def test_a_release_ends_at_its_share_while_the_fingers_go_on() -> None:
    width, target = released(Fingers(width=0.04), 0.33)
    assert (0.05 <= width <= 0.051, target) == (True, pytest.approx(0.07))
    assert released(Fingers(width=0.04), 1.0) == (pytest.approx(0.07), pytest.approx(0.07))


def test_a_release_in_part_fails_where_the_fingers_are_held() -> None:
    with pytest.raises(Failure, match=r"^control.gripper: the fingers opened 30 mm of 60 mm$"):
        released(Fingers(jammed=True, width=0.03), 0.33)


def test_fingers_that_press_against_something_while_they_release_move_back() -> None:
    fingers = Fingers(width=0.04, target=0.04)
    grip = GripperControl(fingers, fingers, ROBOT.gripper)
    doing = grip.release(0.03, pressed=lambda: fingers.width > 0.055)
    while True:
        try:
            next(doing)
        except StopIteration:
            break
        fingers.tick()
    assert 0.055 < fingers.width < 0.067
    assert fingers.target == pytest.approx(fingers.width - 0.003)
