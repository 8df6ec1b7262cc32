"""Push, in a cell without physics: objects slide before the fingers, the camera is ideal."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import pytest

from picktree.files import FileError
from picktree.robot import World
from picktree.robot.manipulation.closed_loop_pushing import observe_closely
from picktree.robot.manipulation.singulation import has_room
from picktree.robot.manipulation.stroke_planning import PushGoal, PushStroke, push_strokes
from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.kinematic.bodies import KinematicBody
from picktree.trees import Doing
from picktree.world import BeliefObject, FailureReport, ObjectId, Pose
from picktree.world.event_types import PushEvent
from picktree.world.planar_geometry import PlanarPose, planar, wrap_angle
from picktree.world.scene import SceneDescription, load_scene

from .cell import Cell, items, mission

LOOK = 'Observe: {camera: overhead, objects: "{items}"}'


def beside(**moved: tuple[float, float, float]) -> Cell:
    """A cell with these items, each at a place (x, y) with a heading, which are believed as they are seen."""
    cell = Cell(mission(LOOK), items(**dict.fromkeys(moved, 1)))
    hardware = cell.kinematic
    for body in hardware.bodies.items:
        x, y, yaw = moved[body.entry.kind]
        turned = Pose.from_rpy((x, y, body.pose.position[2]), (0.0, 0.0, yaw))
        hardware.bodies.put(replace(body, pose=turned))
    cell.finish()
    return cell


def named(cell: Cell, kind: str) -> ObjectId:
    return next(o.id for o in cell.world.scene.objects if o.kind == kind)


def push(cell: Cell, ports: str) -> str:
    """The cause that a push ends in; empty when it succeeds."""
    return cell.do(f"Push: {{{ports}}}").partition(":")[0]


def where(cell: Cell) -> PlanarPose:
    """Where the only item stands."""
    (body,) = cell.hardware.truth()
    return planar(body.shape, body.pose)


def test_a_block_is_pushed_to_a_pose() -> None:
    cell = beside(block=(0.50, 0.0, 0.3))
    assert push(cell, f"object: {named(cell, 'block')}, to: [0.48, 0.03], yaw: 0.7") == ""
    at = where(cell)
    assert math.hypot(at.x - 0.48, at.y - 0.03) < 0.0015
    assert abs(wrap_angle(at.yaw - 0.7, math.pi / 2)) < math.radians(1.5)
    assert [e.split(":")[0] for e in cell.happened("push")] == ["push"]


def test_a_can_is_pushed_along_a_line() -> None:
    cell = beside(can=(0.50, 0.05, 0.0))
    assert push(cell, f"object: {named(cell, 'can')}, direction: [0, -2], distance: 50 mm") == ""
    (body,) = cell.hardware.truth()
    assert body.pose.position[:2] == pytest.approx((0.50, 0.0), abs=0.0015)


def test_nothing_is_pushed_off_its_table_or_into_something_else() -> None:
    cell = beside(block=(0.50, 0.0, 0.0), can=(0.50, 0.09, 0.0))
    block = named(cell, "block")
    before = [body.pose for body in cell.hardware.truth()]
    for ports, why in (
        ("direction: [0, 1], distance: 90 mm", f"(0.500, 0.090): it would touch {named(cell, 'can')}"),
        ("to: [0.50, -0.78]", "(0.500, -0.780): it would come to the edge of table"),
        ("to: [0.42, -0.42]", "(0.420, -0.420): it would touch blue_bin"),
    ):
        told = cell.do(f"Push: {{object: {block}, {ports}}}")
        assert told == f"push.no_stroke: {block} cannot be pushed to {why}"
    assert [body.pose for body in cell.hardware.truth()] == before


def test_so_few_strokes_are_not_enough() -> None:
    cell = beside(block=(0.50, 0.0, 0.0))
    assert (
        push(cell, f"object: {named(cell, 'block')}, to: [0.45, 0.05], yaw: 0, strokes: 1") == "push.missed"
    )
    assert cell.failure.message.endswith("off after 1 strokes")


def test_a_full_hand_does_not_push() -> None:
    cell = beside(block=(0.50, 0.0, 0.0), can=(0.45, 0.15, 0.0))
    block, can = named(cell, "block"), named(cell, "can")
    told = cell.do(f"Sequence: [{{Grasp: {{object: {can}}}}}, {{Push: {{object: {block}, to: [0.4, 0]}}}}]")
    assert told.partition(": ")[2] == f"the hand is not free: it holds {can}"


def test_room_is_made_around_what_is_hemmed_in() -> None:
    scene: SceneDescription = load_scene("touching")
    cell = Cell(mission(LOOK), scene, seed=0)
    cell.finish()
    world = cell.world
    hemmed = next(o.id for o in world.scene.objects if not has_room(world, o))
    assert push(cell, f"object: {hemmed}, singulate: true") == ""
    assert has_room(world, world.scene.get(hemmed))
    (told,) = cell.happened("push")
    assert re.fullmatch(f"push: {hemmed}: the hand fits around it after [12] strokes", told)


def test_what_has_room_is_not_pushed() -> None:
    cell = beside(block=(0.50, 0.0, 0.3))
    before = [body.pose for body in cell.hardware.truth()]
    assert push(cell, "singulate: true") == ""
    assert push(cell, f"singulate: true, object: {named(cell, 'block')}") == ""
    assert [body.pose for body in cell.hardware.truth()] == before
    assert cell.happened("push") == []


def test_what_stands_right_but_turned_is_squared_up_on_a_way() -> None:
    cell = beside(block=(0.50, 0.0, math.radians(10.0)))
    block = named(cell, "block")
    assert push(cell, f"object: {block}, to: [0.50, 0.0], yaw: 0 deg, tolerance: 20 mm") == ""
    assert abs(wrap_angle(where(cell).yaw, math.pi / 2)) < math.radians(1.5)


def made(cell: Cell) -> list[str]:
    """The strokes of the push that succeeded."""
    (event,) = (e for e in cell.events if isinstance(e, PushEvent))
    return list(event.strokes)


def test_a_stroke_is_six_centimetres_long_at_most_unless_few_are_allowed() -> None:
    for more, first in (("", "50 mm"), (", strokes: 1", "100 mm")):
        cell = beside(block=(0.50, 0.0, 0.0))
        ports = f"object: {named(cell, 'block')}, direction: [-1, 0], distance: 100 mm, tolerance: 4 mm{more}"
        assert push(cell, ports) == ""
        strokes = made(cell)
        assert strokes[0].startswith(f"side 3 180 deg {first}: pushed for ")
        assert len(strokes) == (1 if more else 2)


def test_what_is_there_already_is_looked_at_five_times_and_left() -> None:
    cell = beside(block=(0.50, 0.0, 0.0))
    looks, look = list[tuple[str, bool]](), cell.world.vision.observe

    def looking(camera: str, *, fresh: bool = False) -> Any:
        looks.append((camera, fresh))
        return look(camera, fresh=fresh)

    cell.world.vision.observe = looking  # type: ignore[method-assign]
    assert push(cell, f"object: {named(cell, 'block')}, to: [0.5, 0.0], camera: overhead") == ""
    assert (made(cell), looks) == ([], [("overhead", True)] * 5)


def test_with_no_side_left_there_is_no_stroke() -> None:
    """The only side that helps did not give way."""
    cell = beside(block=(0.50, 0.0, 0.0))
    block = named(cell, "block")
    failure = Patchy(cell, 0.001, 50.0).push(f"object: {block}, direction: [-1, 0], distance: 40 mm")
    assert (str(failure.cause), failure.message) == (
        "push.no_stroke",
        f"no stroke brings {block} nearer to where it is to be: no side can be pushed that way",
    )
    assert failure.evidence == {"object": block, "refused": []}


def test_a_dozen_pushes_are_considered_to_make_room(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = Cell(mission(LOOK), load_scene("touching"), seed=0)
    cell.finish()
    hemmed = next(o.id for o in cell.world.scene.objects if not has_room(cell.world, o))
    asked: list[str] = []

    def refused(world: object, belief: BeliefObject, stroke: PushStroke, touching: object = ()) -> str:
        asked.append(stroke.name)
        return "the arm does not reach it"

    monkeypatch.setattr("picktree.robot.manipulation.closed_loop_pushing.plan_stroke", refused)
    assert push(cell, f"object: {hemmed}, singulate: true") == "push.no_stroke"
    failure = cell.failure
    why = failure.evidence["refused"]
    assert isinstance(why, list)
    assert len(asked) == len(why) == 12
    told = "; ".join(str(one) for one in why[:4])
    assert failure.message == f"no stroke makes room for the hand around {hemmed}: {told}"
    assert all(str(one).endswith(": the arm does not reach it") for one in why)


class Patchy:
    """A table on which the only item slides as usual for `way` m from where each stroke began, and then with
    another friction."""

    def __init__(self, cell: Cell, way: float, friction: float) -> None:
        assert isinstance(cell.hardware, KinematicHardware)
        self.hardware, self.cell = cell.hardware, cell
        self._way, self._friction = way, friction
        (self._body,) = self.hardware.bodies.items
        self._put = self.hardware.bodies.put
        self.hardware.bodies.put = self._slides  # type: ignore[method-assign]

    def _slides(self, body: KinematicBody) -> None:
        off = math.dist(body.pose.position[:2], self._body.pose.position[:2])
        self._put(body if off < self._way else replace(body, friction=self._friction))

    def push(self, ports: str) -> FailureReport:
        """Run a push and return its failure. A stroke begins when the hand was high above the table."""
        self.cell.start(mission(f"Push: {{{ports}}}"))
        self.cell.tick()
        while self.cell.running:
            if self.hardware.true_tcp().position[2] > 0.2:
                (now,) = self.hardware.bodies.items
                self._body = replace(now, friction=self._body.friction)
                self._put(self._body)
            self.cell.tick()
        return self.cell.tree.failure


def strokes_of(failure: FailureReport) -> list[str]:
    strokes = failure.evidence["strokes"]
    assert isinstance(strokes, list)
    return [str(stroke) for stroke in strokes]


def test_what_is_too_heavy_to_be_pushed_has_stalled() -> None:
    cell = beside(block=(0.50, 0.0, 0.0))
    (body,) = cell.hardware.truth()
    assert isinstance(cell.hardware, KinematicHardware)
    cell.hardware.change_dynamics(body.id, mass=10.0)
    block = named(cell, "block")
    assert push(cell, f"object: {block}, to: [0.45, 0.05]") == "push.stalled"
    failure = cell.failure
    first, second = strokes_of(failure)
    assert re.fullmatch(r"side 3 180 deg 39 mm: blocked at 2\d\.\d N after [0-3] mm", first)
    # The side that did not give way is not tried again.
    assert re.fullmatch(r"side 2 90 deg 39 mm: blocked at 2\d\.\d N after [0-3] mm", second)
    assert failure.message == f"{block} does not move: {second}"


@pytest.mark.parametrize(("way", "cause"), [(0.0022, "push.stalled"), (0.0055, "push.missed")])
def test_what_moves_by_some_millimetres_has_not_stalled(way: float, cause: str) -> None:
    cell = beside(block=(0.50, 0.0, 0.0))
    table = Patchy(cell, way, 50.0)
    failure = table.push(f"object: {named(cell, 'block')}, to: [0.45, 0.05], strokes: 3")
    assert (str(failure.cause), len(strokes_of(failure))) == (cause, 2 if cause == "push.stalled" else 3)


def test_what_escapes_from_the_fingers_twice_is_lost() -> None:
    cell = beside(block=(0.50, 0.0, 0.0))
    block = named(cell, "block")
    failure = Patchy(cell, 0.005, 0.0).push(f"object: {block}, to: [0.45, 0.05]")
    first, second = strokes_of(failure)
    assert all(
        re.fullmatch(r"side 3 1\d\d deg \d\d mm: contact lost after 2\d mm", s) for s in (first, second)
    )
    assert (
        f"{failure.cause}: {failure.message}"
        == f"push.lost_contact: {block} does not stay at the fingers: {second}"
    )


def test_what_is_gone_after_a_stroke_is_lost() -> None:
    cell = beside(block=(0.50, 0.0, 0.0))
    block = named(cell, "block")
    cell.start(mission(f"Push: {{object: {block}, direction: [-1, 0], distance: 40 mm}}"))
    hardware = cell.kinematic
    (body,) = hardware.bodies.items
    while hardware.bodies[body.id].pose == body.pose:
        cell.tick()
    hardware.remove(body.id)
    cell.finish()
    failure = cell.failure
    assert cell.told == f"push.lost_contact: {block} is not seen where it was pushed (pushed for 40 mm)"
    assert failure.evidence == {"object": block, "touched": True, "reached": pytest.approx(0.04)}


@pytest.mark.parametrize("seen", [True, False])
def test_what_the_arm_hides_is_looked_at_from_aside(seen: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first pictures do not show it; the arm goes to where it hides nothing before the next."""
    cell = beside(block=(0.50, 0.0, 0.0))
    block = named(cell, "block")
    cell.do("GoTo: {pose: rest}")
    poses, robot = list[str](), cell.world.robot

    def looking(world: World, camera: str, name: ObjectId, pictures: int) -> Doing[BeliefObject | None]:
        q = world.control.state.position
        poses.append(next((p for p in ("rest", "observe") if abs(q - robot.named(p)).max() < 2e-3), ""))
        if len(poses) == 1 or not seen:
            return None
        return (yield from observe_closely(world, camera, name, pictures))

    monkeypatch.setattr("picktree.robot.manipulation.closed_loop_pushing.observe_closely", looking)
    cause = push(cell, f"object: {block}, to: [0.5, 0.0]")
    assert poses[0] == "rest"
    assert poses[1] not in ("rest",)
    assert len(poses) == 2
    assert cause == ("" if seen else "perception.not_found")
    if not seen:
        failure = cell.failure
        assert failure.message == f"{block} is not in the view of overhead"
        assert failure.evidence == {"object": block}


def test_what_nobody_knows_is_not_pushed_and_not_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = beside(block=(0.50, 0.0, 0.0))
    for ports, looks in (("singulate: true", 1), ("to: [0.5, 0.0]", 0)):
        looked, look = list[str](), type(cell.world.vision).observe

        def looking(camera: str, looked: list[str] = looked, look: Any = look) -> Any:
            looked.append(camera)
            return look(cell.world.vision, camera)

        monkeypatch.setattr(cell.world.vision, "observe", looking)
        assert push(cell, f"object: red_nut_9, {ports}") == "world.unknown_object"
        assert len(looked) == looks


def test_what_is_round_has_no_heading() -> None:
    cell = beside(can=(0.50, 0.05, 0.0))
    can = named(cell, "can")
    for ports in ("yaw: 1.0", "to: [0.50, 0.05], yaw: 1.0", "to: [0.50, 0.05]"):
        cell.events.clear()
        assert push(cell, f"object: {can}, {ports}") == ""
        assert made(cell) == []


def ending_nowhere(*_: Any) -> tuple[PushStroke, ...]:
    return ()


def offered(cell: Cell, ports: str, monkeypatch: pytest.MonkeyPatch, *ends: PlanarPose) -> list[PlanarPose]:
    """Return the ends of strokes for which the push requests a check, among strokes with these ends."""
    asked = list[PlanarPose]()
    strokes = push_strokes

    def ending(belief: BeliefObject, aim: PushGoal, *more: Any) -> list[PushStroke]:
        like = strokes(belief, PushGoal(0.45, 0.0), *more)[0]
        return [replace(like, ends=end) for end in ends]

    def refused(_: object, __: object, stroke: PushStroke) -> str:
        asked.append(stroke.ends)
        return "not free"

    monkeypatch.setattr("picktree.robot.manipulation.closed_loop_pushing.push_strokes", ending)
    monkeypatch.setattr(
        "picktree.robot.manipulation.closed_loop_pushing.turning_room_strokes", ending_nowhere
    )
    monkeypatch.setattr("picktree.robot.manipulation.closed_loop_pushing.stroke_refusal", refused)
    assert push(cell, ports) == "push.no_stroke"
    return asked


def test_a_stroke_helps_that_leaves_less_to_be_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two centimetres to go: a radian of heading is worth as much as a way of two centimetres."""
    cell = beside(block=(0.50, 0.0, 0.0))
    (block,) = cell.world.scene.objects
    yaw = planar(block.shape, block.pose).yaw
    ends = [
        PlanarPose(0.48, 0.0, yaw),
        PlanarPose(0.49, 0.0, yaw + 0.45),
        PlanarPose(0.49, 0.0, yaw + 0.55),
        PlanarPose(0.485, 0.0, yaw + 0.7),
        PlanarPose(0.49, 0.0, yaw - 0.45),
        PlanarPose(0.52, 0.0, yaw),
    ]
    asked = offered(cell, f"object: {block.id}, direction: [-1, 0], distance: 20 mm", monkeypatch, *ends)
    assert asked == [ends[0], ends[1], ends[3], ends[4]]
    failure = cell.failure
    assert failure.message.count("not free") == 4


def test_a_line_is_pushed_as_long_as_it_is_said_whatever_its_direction_s_length() -> None:
    cell = beside(block=(0.50, 0.0, 0.2))
    assert push(cell, f"object: {named(cell, 'block')}, direction: [-0.001, 0], distance: 30 mm") == ""
    at = where(cell)
    assert math.hypot(at.x - 0.47, at.y) < 0.0016
    assert abs(wrap_angle(at.yaw - 0.2, math.pi / 2)) < math.radians(1.6)  # its heading is kept


@pytest.mark.parametrize(
    ("ports", "fault"),
    [
        ("object: x", "one of 'to' (or 'yaw' alone), 'direction' and 'singulate' must be given"),
        ("object: x, to: [0, 0], singulate: true", "one of 'to' (or 'yaw' alone), 'direction' and"),
        ("object: x, direction: [1, 0]", "'direction' and 'distance' belong together"),
        ("object: x, to: [0.5]", "two numbers x, y are wanted, not 1"),
        ("to: [0.5, 0]", "'object' must be given: only with 'singulate' it may be left out"),
    ],
)
def test_what_is_missing_is_told_before_a_run(ports: str, fault: str) -> None:
    with pytest.raises(FileError) as error:
        mission(f"Push: {{{ports}}}")
    assert fault in str(error.value)
