"""LookAround: through all cameras, from all poses, until what is looked for is seen."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from picktree.simulation.fault_entries import AtTime, CameraDrop
from picktree.simulation.kinematic import KinematicHardware
from picktree.trees import Doing
from picktree.world import Pose
from picktree.world.scene import load_scene

from ..skills.cell import Cell, mission

POSES = ("observe", "rest", "home")


def cell(body: str) -> tuple[Cell, KinematicHardware, list[tuple[str, str]]]:
    """A cell with a camera over the table and one on the hand, and a list of the looks: the camera, and the
    pose in which the arm stood, if it was one of those that robots look from."""
    scene = load_scene("three_bins_wrist")
    scene = replace(scene, spawn=(replace(scene.spawn[0], counts={"block": 1, "can": 1}, lying=0.0),))
    made = Cell(mission(body), scene)
    hardware, looks = made.hardware, list[tuple[str, str]]()
    assert isinstance(hardware, KinematicHardware)
    look = made.world.vision.observe

    def looking(camera: str, *, fresh: bool = False) -> object:
        q = made.world.control.state.position
        near = (p for p in POSES if np.abs(q - made.world.robot.named(p)).max() < 1e-3)
        looks.append((camera, next(near, "")))
        return look(camera, fresh=fresh)

    made.world.vision.observe = looking  # type: ignore[method-assign,assignment]
    return made, hardware, looks


def outcome(cell: Cell) -> str:
    cell.finish()
    return cell.told


def listed(cell: Cell) -> list[str]:
    value = cell.tree.blackboard.save()["Main/items"]
    assert isinstance(value, list)
    return [str(item) for item in value]


LOOK = 'LookAround: {objects: "{items}"}'


def test_every_camera_looks_once_those_that_hang_still_from_where_the_arm_is() -> None:
    made, _, looks = cell(f"Sequence: [{{GoTo: {{pose: rest}}}}, {{{LOOK}}}]")
    assert outcome(made) == ""
    assert looks == [("overhead", "rest"), ("wrist", "observe")]
    believed = {o.id for o in made.world.scene.objects if o.role == "item"}
    assert set(listed(made)) == believed
    assert len(believed) == 2


def test_what_is_seen_at_once_needs_no_motion() -> None:
    made, hardware, looks = cell("Observe")
    assert outcome(made) == ""
    wanted = made.world.scene.objects[0].id
    before = hardware.arm.read().position.copy()
    looks.clear()
    assert made.do(f"LookAround: {{expect: {wanted}}}") == ""
    assert looks == [("overhead", "home")]
    assert np.abs(hardware.arm.read().position - before).max() < 1e-6


def test_what_is_nowhere_is_looked_for_by_all_from_everywhere() -> None:
    made, _, looks = cell("LookAround: {expect: green_nut_7}")
    assert outcome(made) == "perception.not_found: green_nut_7 is not in the view of any camera"
    assert looks == [("overhead", "home"), *((c, p) for p in POSES for c in ("overhead", "wrist"))]
    assert made.failure.evidence == {"object": "green_nut_7"}


def test_a_camera_that_gives_no_picture_is_passed_over_while_another_sees() -> None:
    made, hardware, looks = cell(LOOK)
    hardware.afflict(0, CameraDrop(AtTime(0.0), camera="overhead"))
    assert outcome(made) == ""
    # It is asked again from the next poses, for one picture; the other has looked by then.
    assert looks == [("overhead", "home"), ("overhead", "observe"), ("wrist", "observe"),
                     ("overhead", "rest"), ("overhead", "home")]  # fmt: skip


def test_cameras_that_all_give_no_picture_are_told() -> None:
    made, hardware, _ = cell(LOOK)
    hardware.afflict(0, CameraDrop(AtTime(0.0)))
    told = outcome(made)
    assert told.startswith("perception.no_image: ")


def test_a_pose_that_cannot_be_reached_is_passed_over() -> None:
    made, _, looks = cell("LookAround: {expect: green_nut_7}")
    answers = iter([True, False, False])
    made.world.plan.finds_nothing = lambda: next(answers)
    # What did not work is told rather than that nothing was seen.
    assert outcome(made).startswith("planning.no_path: ")
    assert looks == [("overhead", "home"), *((c, p) for p in POSES[1:] for c in ("overhead", "wrist"))]


def test_what_was_tried_on_something_that_is_gone_is_forgotten() -> None:
    made, hardware, _ = cell("Observe")
    assert outcome(made) == ""
    one, other = (o.id for o in made.world.scene.objects if o.role == "item")
    hardware.remove(next(b.id for b in hardware.bodies.items if b.entry.kind in one))
    for name in (one, other):
        made.world.attempts.failed("Main/Grasp", name, "top 0")
    assert made.do(LOOK) == ""
    assert made.world.attempts.state() == {f"Main/Grasp|{other}": ["top 0"]}
    assert listed(made) == [other]


def test_items_come_by_the_travel_of_the_hand_and_what_is_held_first() -> None:
    made, _, _ = cell(LOOK)
    assert outcome(made) == ""
    items = [o for o in made.world.scene.objects if o.role == "item"]
    scene, z = made.world.scene, items[0].pose.position[2]
    places = ((0.05, 0.35), (0.50, -0.2))  # The hand ends over the first one.
    for near, far in (items, items[::-1]):
        for item, (x, y) in zip((near, far), places, strict=True):
            scene.put(replace(item, pose=Pose((x, y, z))), "test")
        made.world.vision.observe = lambda _: seen()  # type: ignore[method-assign,assignment]
        assert made.do(LOOK) == ""
        assert listed(made) == [near.id, far.id]
    scene.attach(items[1].id, Pose())
    scene.put(replace(scene.get(items[0].id), pose=Pose((0.0, 0.0, z))), "test")
    assert made.do(LOOK) == ""
    assert listed(made) == [items[1].id, items[0].id]
    same = replace(scene.get(items[0].id), object_in_tcp=None, pose=Pose((0.5, 0.0, z)))
    for item in items:
        scene.put(replace(same, id=item.id), "test")
    assert made.do(LOOK) == ""
    assert listed(made) == sorted(item.id for item in items)


def seen() -> Doing[object]:
    """A picture that shows nothing new."""
    yield
    return SimpleNamespace(removed=(), seen=())
