"""Survey and TouchTarget without physics: what is looked at and touched, and what is passed over."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from picktree.robot.calibration import calibration_targets, target_detection
from picktree.robot.calibration.calibration_targets import TouchPoint
from picktree.robot.calibration.observations import DetectedTile, TargetImage
from picktree.simulation.fault_entries import AtTime, CameraDrop
from picktree.trees import Steps
from picktree.world import Array, Pose, RgbdImage, Vector3
from picktree.world.event_types import CalibrationShotEvent, CalibrationTouchEvent
from picktree.world.scene import load_scene

from .cell import Cell, mission

SHOT, SKIPPED, TOUCHED = "calibration_shot", "calibration_skipped", "calibration_touch"


def cell(body: str) -> Cell:
    return Cell(mission(body), load_scene("calibrating"))


def failed(cell: Cell) -> str:
    cell.finish()
    return cell.told


def notes(cell: Cell, *kinds: str) -> list[str]:
    return [e.message for e in cell.events if e.kind in kinds]


def shots(cell: Cell) -> list[TargetImage]:
    return [TargetImage.from_event(e) for e in cell.events if isinstance(e, CalibrationShotEvent)]


class Eyes:
    """`find_tiles` as it is, but for the pictures that are to show nothing; counts the pictures."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *empty: int) -> None:
        self.pictures, self._empty, self._find = 0, empty, target_detection.detect_tiles
        monkeypatch.setattr(target_detection, "detect_tiles", self)

    def __call__(self, image: RgbdImage, tiles: object) -> tuple[DetectedTile, ...]:
        self.pictures += 1
        return () if self.pictures in self._empty else self._find(image, tiles)  # type: ignore[arg-type]


def test_a_camera_on_the_hand_looks_from_as_many_places_as_are_wanted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made, eyes = cell("Survey: {target: target, camera: wrist, views: 4}"), Eyes(monkeypatch)
    assert failed(made) == ""
    assert notes(made, SHOT, SKIPPED) == [
        f"wrist: 6 squares of target view {n}, the {n}. of 4" for n in range(1, 5)
    ]
    assert eyes.pictures == 8
    seen = shots(made)
    assert all(shot.on_hand and shot.camera == "wrist" for shot in seen)
    places = [shot.tcp @ shot.believed for shot in seen]
    assert min(a.distance(b) for n, a in enumerate(places) for b in places[:n]) > 0.05


def test_where_the_target_is_not_seen_well_another_place_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    made = cell("Survey: {target: target, camera: wrist, views: 4}")
    Eyes(monkeypatch, 3)  # one of two pictures: not most of them show it
    assert failed(made) == ""
    told = notes(made, SHOT, SKIPPED)
    assert told[1] == "wrist: view 2: the target is not seen well enough"
    assert told[-1] == "wrist: 6 squares of target view 5, the 4. of 4"
    assert len(told) == 5


def test_a_target_that_no_picture_shows_is_not_found(monkeypatch: pytest.MonkeyPatch) -> None:
    for body, pictures in (
        ("Survey: {target: target, camera: wrist, views: 4}", 24),
        ("Survey: {target: target, camera: overhead}", 3),
    ):
        with monkeypatch.context() as patch:
            made, eyes = cell(body), Eyes(patch, *range(1, 100))
            camera = "wrist" if "wrist" in body else "overhead"
            assert failed(made) == f"perception.not_found: target is not in any view of {camera}"
            assert shots(made) == []
            # Three places are offered for each that is wanted; from three poses the arm looks aside.
            assert eyes.pictures == pictures


def test_a_place_out_of_reach_is_passed_over() -> None:
    made = cell("Survey: {target: target, camera: wrist, views: 4}")
    answers = iter([True] * 6)
    made.world.plan.finds_nothing = lambda: next(answers, False)
    assert failed(made) == ""
    first, *others = notes(made, SHOT, SKIPPED)
    assert first.startswith("wrist: view 1 is out of reach: ")
    assert others == [f"wrist: 6 squares of target view {n + 1}, the {n}. of 4" for n in range(1, 5)]


def test_before_a_camera_that_hangs_still_the_arm_goes_aside(monkeypatch: pytest.MonkeyPatch) -> None:
    made, eyes = cell("Survey: {target: target, camera: overhead, pictures: 3}"), Eyes(monkeypatch, 1)
    assert failed(made) == ""
    assert notes(made, SHOT) == ["overhead: 6 squares of target from where it hangs"]
    assert eyes.pictures == 1 + 1 + 3
    (shot,) = shots(made)
    assert not shot.on_hand
    # In the first pose the target was hidden; the second one is `rest`.
    assert np.abs(made.world.control.state.position - made.world.robot.named("rest")).max() < 2e-3
    assert shot.believed == next(c.pose for c in made.world.description.cameras if c.name == "overhead")


@pytest.mark.parametrize(
    ("ports", "expected"),
    [
        ("camera: overhead, pictures: 3", ["settle", "shoot", "settle", "shoot", "shoot", "shoot"]),
        ("camera: wrist, views: 4", ["settle", "shoot", "shoot"] * 4),
    ],
)
def test_pictures_are_taken_when_the_arm_has_settled(ports: str, expected: list[str]) -> None:
    made = cell(f"Survey: {{target: target, {ports}}}")
    made.start(mission(f"Sequence: [{{GoTo: {{pose: rest}}}}, {{Survey: {{target: target, {ports}}}}}]"))
    while made.leaf != "Survey":
        made.tick()
    did, world = list[str](), made.world
    settle, shoot = world.control.settle, world.vision.capture

    def settling() -> Steps:
        did.append("settle")
        return settle()

    def shooting(camera: str) -> Any:
        did.append("shoot")
        return shoot(camera)

    world.control.settle = settling  # type: ignore[method-assign]
    world.vision.capture = shooting  # type: ignore[method-assign]
    assert failed(made) == ""
    # Motions settle, too; what counts is what comes right before the pictures.
    kept = [one for n, one in enumerate(did) if one == "shoot" or did[n + 1 : n + 2] == ["shoot"]]
    assert kept[-len(expected) :] == expected


def test_what_is_not_there_is_told() -> None:
    made = cell("Survey: {target: target, camera: wrist, views: 4}")
    camera = replace(made.world.description.cameras[0], name="other")
    made.world = replace(made.world, description=replace(made.world.description, cameras=(camera,)))
    made.start(mission("Survey: {target: target, camera: wrist, views: 4}"))
    assert failed(made) == "perception.not_found: there is no camera 'wrist'"
    made = cell("Survey: {target: target, camera: wrist}")
    hardware = made.kinematic
    hardware.afflict(0, CameraDrop(AtTime(0.0)))
    assert failed(made).startswith("perception.no_image: ")
    for skill in ("Survey", "TouchTarget"):
        told = "world.unknown_object: there is no target 'table': it is a fixture with 'marker'"
        assert failed(cell(f"{skill}: {{target: table}}")) == told


def wanted(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """So many touches, of the top; those beside it are nothing that a cell without physics feels."""

    touch_points = calibration_targets.touch_points

    def tops(target: Pose, size: Vector3, at_tips: Array, turned: float) -> tuple[TouchPoint, ...]:
        found = [c for c in touch_points(target, size, at_tips, turned) if c.name.startswith("top")]
        return tuple((*found, *found)[:count])

    monkeypatch.setattr("picktree.robot.calibration.calibration_targets.touch_points", tops)


def test_touches_are_made_with_two_forces_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted(8, monkeypatch)
    made = cell("TouchTarget: {target: target}")
    assert failed(made) == ""
    found = [e for e in made.events if isinstance(e, CalibrationTouchEvent)]
    names = [f"top {n}" for n in range(1, 5)] + [f"top leaning {n}" for n in range(1, 5)]
    assert [e.message.partition(":")[0] for e in found] == [f"target, {name}" for name in names]
    forces = [e.force for e in found]
    assert forces == pytest.approx([3.0, 6.0] * 4, abs=1.0)
    assert [e.message.rpartition(" with ")[2] for e in found] == [f"{force:.1f} N" for force in forces]
    assert made.world.gripper.width > 0.07


def test_fewer_than_eight_touches_are_not_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted(8, monkeypatch)
    made = cell("TouchTarget: {target: target}")
    answers = iter([True])
    made.world.plan.finds_nothing = lambda: next(answers, False)
    assert failed(made) == ("planning.no_path: 7 of 8 touches of target are within reach; 8 are needed")
    assert made.failure.evidence == {"touched": 7}
    (skipped,) = notes(made, SKIPPED)
    assert skipped.startswith("target, top 1: ")


def test_what_is_not_where_it_should_be_is_not_touched(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is felt for 2 cm behind where its top should be: it is believed to be higher than it is."""
    wanted(1, monkeypatch)
    made = cell("TouchTarget: {target: target}")
    target = made.world.scene.fixtures["target"]
    for off, told in ((0.018, TOUCHED), (0.022, SKIPPED)):
        moved = replace(target, pose=target.pose.shifted((0.0, 0.0, off)))
        made.world.scene.fixtures = {**made.world.scene.fixtures, "target": moved}
        made.events.clear()
        made.start(mission("TouchTarget: {target: target}"))
        assert failed(made).startswith("planning.no_path: ")
        (event,) = (e for e in made.events if e.kind in (TOUCHED, SKIPPED))
        assert event.kind == told, off
        if told == SKIPPED:
            assert event.message == "target, top 1: there is nothing to be felt"


def test_a_hand_that_holds_something_touches_nothing() -> None:
    scene = load_scene("calibrating")
    block = load_scene("sort_small").spawn[0]
    spawn = replace(block, counts={"block": 1}, area=((0.35, -0.3), (0.45, -0.2)))
    made = Cell(mission("Observe"), replace(scene, spawn=(spawn,)))
    made.finish()
    (item,) = (str(o.id) for o in made.world.scene.objects if o.role == "item")
    made.start(mission(f"Sequence: [{{Grasp: {{object: {item}, onward: false}}}}, TouchTarget]"))
    assert failed(made) == f"grasp.no_candidate: the hand is not free: it holds {item}"
