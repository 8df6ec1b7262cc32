"""Taking stock: what is felt, put down, seen and counted before a run goes on as things stand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from picktree.recovery import ResyncReport, resync_belief
from picktree.recovery.belief_restart import _recognise  # pyright: ignore[reportPrivateUsage]
from picktree.simulation.fault_entries import AtTime, CameraDrop, GripperJam
from picktree.simulation.kinematic import KinematicHardware
from picktree.world import BeliefObject, Box, Failure, JournalEvent, ObjectId, Pose, control, safety

from ..skills.cell import LIMIT, Cell, items, mission

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.trees import Doing

FIRST = "the run goes on as things stand: it looks first, with the belief of before"


def cell(**counts: int) -> tuple[Cell, KinematicHardware]:
    made = Cell(mission("Observe: {camera: overhead}"), items(**counts))
    made.finish()
    made.events.clear()
    assert isinstance(made.hardware, KinematicHardware)
    return made, made.hardware


def stock(cell: Cell, watch: Callable[[], object] = lambda: None) -> tuple[ResyncReport, list[str]]:
    """What is found, and what is said on the way. `watch` is called after each tick."""
    taking = resync_belief(cell.world)
    cell.world.journal.take()
    while cell.world.clock.now < LIMIT:
        try:
            next(taking)
        except StopIteration as end:
            found = end.value
            assert isinstance(found, ResyncReport)
            break
        cell.wait()
        watch()
    else:
        raise AssertionError("it hangs")
    events = [e for e in cell.world.journal.take() if isinstance(e, JournalEvent)]
    return found, [e.message for e in events if e.kind == "took_stock"]


def at_home(cell: Cell) -> bool:
    return float(np.abs(cell.world.control.state.position - cell.world.robot.named("home")).max()) < 2e-3


def grasped(cell: Cell) -> str:
    item = str(next(o.id for o in cell.world.scene.objects))
    assert (
        cell.do(f"Sequence: [{{Grasp: {{object: {item}, onward: false}}}}, {{GoTo: {{pose: rest}}}}]") == ""
    )
    return item


def forget_the_hand(cell: Cell, item: str) -> None:
    """The older belief: the item still lay where it was seen."""
    held = cell.world.scene.get(item)
    cell.world.scene.put(
        replace(held, object_in_tcp=None, pose=Pose((0.5, 0.1, 0.02)), place="table"), "as it was"
    )


def test_with_an_empty_hand_it_goes_home_and_looks() -> None:
    made, _ = cell(block=1, can=1)
    made.do("GoTo: {pose: rest}")
    looks = made.world.vision.observations
    found, notes = stock(made)
    assert found == ResyncReport((), (), False)
    assert notes == [FIRST, "looked: nothing more is done; 2 to be done"]
    assert at_home(made)
    assert made.world.vision.observations > looks
    assert made.world.gripper.width > 0.07


def test_what_is_in_the_hand_is_felt_put_down_and_known_again() -> None:
    made, hardware = cell(block=1)
    item = grasped(made)
    forget_the_hand(made, item)
    made.world.attempts.failed("Main/Grasp", item, "top 0")
    width, before = 1000 * made.world.gripper.width, made.world.attempts.state()
    found, notes = stock(made)
    assert found == ResyncReport((), (), True)
    assert notes == [
        FIRST,
        f"something is in the hand: opening {width:.1f} mm, load 0.98 N",
        "looked: nothing more is done; 1 to be done",
    ]
    assert hardware.bodies.held is None
    assert made.world.scene.held is None
    (body,) = hardware.truth()
    (known,) = made.world.scene.objects
    assert (known.id, known.place) == (item, "table")
    assert known.pose.distance(body.pose) < 0.005
    assert at_home(made)
    assert made.world.attempts.state() == before


def test_what_was_done_meanwhile_counts_and_what_is_gone_does_not() -> None:
    made, hardware = cell(block=1, can=1)
    block, can = (next(o.id for o in made.world.scene.objects if o.kind == k) for k in ("block", "can"))
    into = made.world.scene.destination(block)
    assert into is not None
    (there,) = (b for b in made.world.scene.bins.values() if b.id == into)
    (body,) = (b for b in hardware.bodies.items if b.entry.kind == "block")
    hardware.bodies.put(replace(body, pose=there.pose.shifted((0.0, 0.0, there.wall + 0.02))))
    hardware.remove(next(b.id for b in hardware.bodies.items if b.entry.kind == "can"))
    made.world.journal.items_done = 3
    found, notes = stock(made)
    assert found == ResyncReport((block,), (can,), False)
    assert made.world.journal.items_done == 4
    assert notes == [
        FIRST,
        f"looked: {block} is done; {can} is seen nowhere, and not counted as done; 0 to be done",
    ]


def test_of_several_that_are_alike_the_nearest_is_the_same() -> None:
    made, hardware = cell(block=1)
    (block,) = made.world.scene.objects
    far = replace(block, id=ObjectId("red_block_8"), pose=Pose((0.5, -0.3, 0.02)))
    other = replace(block, id=ObjectId("red_can_1"), kind="can", pose=Pose((0.5, 0.19, 0.02)))
    near = replace(block, id=ObjectId("red_block_9"), pose=Pose((0.45, 0.2, 0.02)))
    scene = made.world.scene
    scene.remove(block.id, "test")
    for one in (far, other, near):
        scene.put(one, "as it was")
    (body,) = hardware.bodies.items
    hardware.bodies.put(replace(body, pose=Pose((0.45, 0.24, 0.02)), colour=block.colour))
    stock(made)
    assert [o.id for o in scene.objects if o.role == "item"] == ["red_block_9"]


def test_fingers_that_do_not_close_have_something_between_them() -> None:
    """Jammed they seem to hold something that weighs nothing: it is let down, and the hand told to open."""
    made, hardware = cell(block=1)
    hardware.gripper.width = hardware.gripper.target = 0.03
    hardware.afflict(0, GripperJam(AtTime(0.0)))
    heights = [made.world.control.tcp.position[2]]
    found, notes = stock(made, lambda: heights.append(made.world.control.tcp.position[2]))
    assert found == ResyncReport((), (), True)
    said = (
        "something is between the fingers, and weighs next to nothing: opening 30.0 mm, load 0.00 N",
        "the arm does not get home: the fingers opened 30 mm of 80 mm",
    )
    assert notes == [FIRST, *said, *said, "looked: nothing more is done; 1 to be done"]
    assert made.world.scene.find("in_hand") is None
    # Twice it is let down, as nothing is touched by as much as is allowed.
    assert min(heights) == pytest.approx(heights[0] - 0.3, abs=0.02)


def test_what_is_held_is_not_held_any_more_gently_while_it_is_felt() -> None:
    made, hardware = cell(block=1)
    forget_the_hand(made, grasped(made))
    pressed = hardware.gripper.force
    assert pressed > 5.0
    forces: list[float] = []

    def watch() -> None:
        if hardware.bodies.held is not None and hardware.gripper.target < hardware.gripper.width:
            forces.append(hardware.gripper.force)

    stock(made, watch)
    assert min(forces) >= pressed - 1e-9


def test_fingers_that_close_have_nothing_between_them() -> None:
    made, hardware = cell(block=1)
    hardware.gripper.width = hardware.gripper.target = 0.03
    forces = set[float]()
    found, notes = stock(made, lambda: forces.add(hardware.gripper.force))
    assert found == ResyncReport((), (), False)
    assert forces == {5.0}
    assert notes == [FIRST, "looked: nothing more is done; 1 to be done"]


def test_a_camera_that_shows_nothing_is_told() -> None:
    made, hardware = cell(block=1)
    hardware.afflict(0, CameraDrop(AtTime(0.0)))
    found, notes = stock(made)
    assert found == ResyncReport((), (), False)
    assert notes[1].startswith("overhead shows nothing: ")
    assert notes[2] == "looked: nothing more is done; 1 to be done"


def test_an_arm_that_does_not_come_to_rest_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    made, _ = cell(block=1)

    def moves_on() -> Doing[None]:
        yield
        raise Failure(control.TIMEOUT, "it swings")

    rest = made.world.move.rest

    def resting() -> Doing[None]:
        monkeypatch.setattr(made.world.move, "rest", rest)
        return moves_on()

    monkeypatch.setattr(made.world.move, "rest", resting)
    _, notes = stock(made)
    assert notes[:2] == [FIRST, "the arm does not come to rest: it swings"]


def jammed(width: float) -> Cell:
    """A hand whose fingers stay where they are."""
    made, hardware = cell(block=1)
    hardware.gripper.width = hardware.gripper.target = width
    hardware.afflict(0, GripperJam(AtTime(0.0)))
    return made


@pytest.mark.parametrize(("width", "across"), [(0.03, 0.03), (0.003, 0.005)])
def test_what_is_felt_is_believed_in_the_hand_as_something_unknown(width: float, across: float) -> None:
    made = jammed(width)
    seen = list[BeliefObject]()

    def watch() -> None:
        believed = made.world.scene.find(ObjectId("in_hand"))
        if believed is not None and believed.attached:
            seen.append(believed)

    stock(made, watch)
    felt = seen[0]
    assert (felt.role, felt.kind, felt.form, felt.colour) == ("item", "unknown", "unknown", "unknown")
    assert isinstance(felt.shape, Box)
    assert felt.shape.size == pytest.approx((0.1, across, 0.1))
    assert felt.object_in_tcp == Pose()
    assert (felt.sigma_position, felt.sigma_angle, felt.confidence) == (0.02, 0.2, 0.5)


@pytest.mark.parametrize(
    ("width", "reached", "held"),
    [(0.03, 0.0279, False), (0.03, 0.0281, True), (0.0030, 0.0014, False), (0.0030, 0.0016, True)],
)
def test_fingers_that_come_half_of_the_way_have_nothing_between_them(
    width: float, reached: float, held: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, hardware = cell(block=1)
    hardware.gripper.width = hardware.gripper.target = width
    asked = list[tuple[float, float]]()

    def moving(to: float, force: float) -> Doing[float]:
        asked.append((to, force))
        yield
        return reached

    monkeypatch.setattr(made.world.gripper, "move", moving)
    found, _ = stock(made)
    assert found.held is held
    assert asked[0] == (pytest.approx(max(width - 0.004, 0.0)), 5.0)


@pytest.mark.parametrize("weighs", [True, False])
def test_the_hand_is_emptied_twice_at_most_and_by_what_it_weighs(
    weighs: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What weighs is put down first, and let go where that fails; what weighs nothing is lowered."""
    made = jammed(0.03)
    did, world = list[str](), made.world
    guarded, settle = world.move.guarded, world.control.settle

    def lowering(direction: Any, distance: float, force: float, speed: float, **more: Any) -> Any:
        did.append(f"lower {[*direction]} {distance} {force} {speed}")
        return guarded(direction, distance, force, speed, **more)

    def carried_out(text: str, _: World) -> Doing[None]:
        did.append("put down" if "put_down" in text else "open" if "open" in text else "home")
        yield

    def settling() -> Doing[None]:
        did.append("settle")
        return settle()

    def load() -> float:
        did.append("weigh")
        return 0.98 if weighs else 0.0

    monkeypatch.setattr(world.move, "guarded", lowering)
    monkeypatch.setattr(world.control, "settle", settling)
    monkeypatch.setattr(world.control, "load", load)
    monkeypatch.setattr("picktree.recovery.belief_restart._carry_out", carried_out)
    found, _ = stock(made)
    assert found.held
    lower = "lower [0.0, 0.0, -1.0] 0.15 5.0 0.05"
    did = [word for n, word in enumerate(did) if word != "settle" or did[n + 1 : n + 2] == ["weigh"]]
    first = ["settle", "weigh", *(["put down"] if weighs else [lower, "open"])]
    assert did == [*first, "settle", "weigh", lower, "open"]


def test_what_cannot_be_let_down_is_let_go_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    made = jammed(0.03)

    def refused(*given: Any, **more: Any) -> Doing[None]:
        yield
        raise Failure(safety.WORKSPACE, "it would leave the workspace")

    monkeypatch.setattr(made.world.move, "guarded", refused)
    _, notes = stock(made)
    assert notes.count("it is not let down any further: it would leave the workspace") == 2


def believed(cell: Cell, **items: tuple[str, str, float]) -> None:
    """Items by name: kind, colour, and where along the table they lie."""
    (like,) = cell.world.scene.objects
    cell.world.scene.remove(like.id, "test")
    for name, (kind, colour, y) in items.items():
        at = Pose((0.45, y, 0.02))
        cell.world.scene.put(replace(like, id=ObjectId(name), kind=kind, colour=colour, pose=at), "test")


def recognised(cell: Cell, **seen: tuple[str, str, float]) -> dict[str, float]:
    """Items by name and place after others were seen where these are known from before."""
    known = {o.id: o for o in cell.world.scene.objects if o.role == "item"}
    for name in known:
        cell.world.scene.remove(name, "no longer seen")
    like = next(iter(known.values()))
    for name, (kind, colour, y) in seen.items():
        at = Pose((0.45, y, 0.02))
        cell.world.scene.put(replace(like, id=ObjectId(name), kind=kind, colour=colour, pose=at), "seen")
    _recognise(cell.world, known)
    return {str(o.id): o.pose.position[1] for o in cell.world.scene.objects if o.role == "item"}


def test_each_is_recognised_once_the_nearest_first_and_only_as_what_it_looks_like() -> None:
    made, _ = cell(block=1)
    believed(made, a=("block", "red", 0.0), b=("block", "red", 0.1), c=("can", "red", 0.0))
    found = recognised(made, x=("block", "red", 0.09), y=("block", "red", 0.12), z=("can", "blue", 0.0))
    # b lies nearest to x; what is left is a; another colour is another thing.
    assert found == {"b": 0.09, "a": 0.12, "z": 0.0}


def test_what_is_still_known_is_not_taken_for_another() -> None:
    made, _ = cell(block=1)
    believed(made, a=("block", "red", 0.0), b=("block", "red", 0.1))
    assert recognised(made, a=("block", "red", 0.3), x=("block", "red", -0.2)) == {"a": 0.3, "b": -0.2}
    assert recognised(made, a=("block", "red", 0.3), b=("block", "red", 0.2)) == {"a": 0.3, "b": 0.2}
