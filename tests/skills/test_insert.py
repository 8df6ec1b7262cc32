"""Insert: what it needs, what it leaves, and what it says when the hole is not there."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from picktree.world import ObjectId, Pose
from picktree.world.event_types import ItemDoneEvent
from picktree.world.scene import SceneDescription, load_scene

from .cell import Cell, mission

LOOK = "- Observe: {camera: overhead, objects: '{items}'}\n"


def pegs(**counts: int) -> SceneDescription:
    """The scene `pegs` with these only."""
    scene = load_scene("pegs")
    return replace(scene, spawn=(replace(scene.spawn[0], counts=counts),))


def inserting(ports: str = "", grasp: bool = True) -> str:
    """A tree that looks, grasps what it sees first, and inserts it."""
    do = "          - Grasp: {object: '{item}'}\n" if grasp else ""
    each = "- ForEach:\n    in: '{items}'\n    out: '{item}'\n    most: 1\n    do:\n"
    body = f"{LOOK}{each}      - Sequence:\n{do}          - Insert: {{object: '{{item}}'{ports}}}\n"
    return "Sequence:\n" + "".join(f"  {line}\n" for line in body.splitlines())


@pytest.mark.parametrize(
    ("kind", "hole", "seed"),
    [("dowel_30", "board/round_31", 1), ("post_40", "board/square_41", 1), ("key_36", "board/slot_38", 1)],
)
def test_a_peg_goes_into_the_hole_that_it_fits(kind: str, hole: str, seed: int) -> None:
    """The slot is searched for; the others are met at once."""
    cell = Cell(mission(inserting()), pegs(**{kind: 1}), seed=seed)
    assert cell.finish().value == "SUCCESS", cell.tree.failure
    (believed,) = cell.world.scene.objects
    assert (believed.place, believed.attached) == (hole, False)
    (done,) = (e for e in cell.events if e.kind == "item_done")
    assert done.message == f"{believed.id} inserted into {hole}"
    assert cell.world.control.period == pytest.approx(1 / 240)
    for _ in range(10):
        cell.wait()
    assert cell.score().count.sorted == 1


def test_a_hole_that_is_not_there_is_not_found() -> None:
    cell = Cell(mission(inserting(", search: none, attempts: 1")), pegs(post_30=1))
    board = cell.world.scene.fixtures["board"]
    # Wider than it is by a little that nobody could measure: what is told is rounded to hundredths of a mm.
    holes = tuple(replace(h, size=(h.size[0] + 1.2345e-5, h.size[1] + 1.2345e-5)) for h in board.holes)
    away = replace(board, holes=holes, pose=board.pose.shifted((0.03, 0.0, 0.0)))
    cell.world.scene.fixtures = {**cell.world.scene.fixtures, "board": away}
    cell.finish()
    report = cell.failure
    assert report.cause.name == "insert.not_found"
    assert report.message == (
        f"{cell.world.scene.objects[0].id} is not in board/square_32: the surface was felt, but no mouth "
        "within 0.0 mm"
    )
    told = report.evidence
    assert (told["hole"], told["tried"], told["wanted"]) == ("board/square_32", ["straight down"], 0.03)
    assert abs(told["surface"]) < 0.002  # type: ignore[arg-type]
    assert (told["clearance"], told["pulled_back"], told["object"]) == (
        0.00201,
        0,
        cell.world.scene.objects[0].id,
    )
    for name, digits in (("depth", 5), ("force", 2), ("searched", 5), ("surface", 5)):
        value = told[name]
        assert isinstance(value, float)
        assert value == round(value, digits)
    assert set(told) == {
        "object", "hole", "depth", "wanted", "force", "searched", "surface", "tried", "pulled_back",
        "clearance",
    }  # fmt: skip
    assert cell.world.scene.held is not None
    assert cell.world.control.at_rest
    # It ends with the peg out of the hole and the arm above it.
    assert cell.world.scene.held.pose.position[2] > board.pose.position[2] + 0.02 + 0.03


def test_an_empty_hand_has_nothing_to_insert() -> None:
    cell = Cell(mission(inserting(grasp=False)), pegs(post_30=1))
    cell.finish()
    report = cell.failure
    item = cell.world.scene.objects[0].id
    assert (report.cause.name, report.message) == ("grasp.slipped", f"{item} is not in the hand")


@pytest.mark.parametrize(
    ("into", "cause", "message"),
    [
        ("board/slot_52", "insert.missed", "{} does not fit into board/slot_52"),
        ("board/square_32", "place.occupied", "board/square_32 is taken already"),
        ("board/none", "world.unknown_object", "the scene has no hole 'board/none'"),
    ],
)
def test_a_hole_that_will_not_do(into: str, cause: str, message: str) -> None:
    cell = Cell(mission(inserting(f", into: {into}")), pegs(post_30=1))
    while cell.world.scene.held is None:
        cell.tick()
    held = cell.world.scene.held
    other = replace(held, id=ObjectId("other"), object_in_tcp=None, place="board/square_32")
    cell.world.scene.put(other, "it was there before")
    cell.finish()
    report = cell.failure
    assert (report.cause.name, report.message) == (cause, message.format(held.id))


def test_where_all_fitting_holes_are_taken_the_board_is_full() -> None:
    cell = Cell(mission(inserting()), pegs(post_40=1))
    while cell.world.scene.held is None:
        cell.tick()
    held = cell.world.scene.held
    other = replace(held, id=ObjectId("other"), object_in_tcp=None, place="board/square_41")
    cell.world.scene.put(other, "it was there before")
    cell.finish()
    report = cell.failure
    assert (report.cause.name, report.message) == (
        "place.full",
        f"board has no free hole that {held.id} fits",
    )


def test_a_peg_that_sticks_to_the_opened_fingers_is_not_inserted(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = Cell(mission(inserting()), pegs(post_40=1), seed=2)
    hardware = cell.kinematic
    monkeypatch.setattr(hardware.bodies, "let_go", lambda: None)
    cell.finish()
    report = cell.failure
    cell.wait()
    held = cell.world.scene.held
    assert held is not None
    assert (report.cause.name, report.message) == (
        "insert.missed",
        f"{held.id} still hangs on the open fingers (load 1.47 N, then 1.47 N)",
    )
    assert report.evidence["hole"] == "board/square_41"
    assert cell.happened("item_done") == []


def test_in_physics_a_square_peg_finds_its_hole_by_feeling() -> None:
    cell = Cell(mission(inserting()), pegs(post_30=1), "physics", seed=5)
    cell.hardware.penetrations.every = 1  # type: ignore[union-attr]
    assert cell.finish().value == "SUCCESS", cell.tree.failure
    (done,) = (e for e in cell.events if isinstance(e, ItemDoneEvent))
    assert done.found_by == "tilt"
    assert 5.0 < (done.force or 0.0) < 40.0
    for _ in range(20):
        cell.wait()
    assert cell.world.control.period == pytest.approx(1 / 240)
    score = cell.score()
    assert (score.count.sorted, score.items[0].reason) == (1, "")
    assert max(cell.hardware.penetrations.lasting.values()) < 0.15e-3  # type: ignore[union-attr]


def turn_in_hand(cell: Cell, degrees: float) -> None:
    """Turn the post about the vertical between the fingers: they open for its corners."""
    hardware = cell.kinematic
    gripper, turn = hardware.gripper, math.radians(degrees)
    assert gripper.item_in_tcp is not None
    gripper.item_in_tcp = gripper.item_in_tcp @ Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, turn))
    wider = 0.03 * (math.cos(turn) + math.sin(turn) - 1.0)
    gripper.width = gripper.gripped = gripper.gripped + wider


@pytest.mark.parametrize(
    ("degrees", "cause", "message"),
    [
        (
            4.5, "grasp.slipped",
            "{item} has turned in the hand at board/square_32: the fingers stood {before:.1f} mm apart, "
            "now {after:.1f} mm",
        ),
        (
            1.5, "insert.not_found",
            "{item} is not in board/square_32: the surface was felt, but no mouth within 0.0 mm",
        ),
    ],
)  # fmt: skip
def test_a_peg_that_turned_in_the_hand_is_no_hole_that_was_not_found(
    degrees: float, cause: str, message: str
) -> None:
    """It is turned while it is felt with, beside its hole."""
    cell = Cell(mission(inserting(", search: none, attempts: 1")), pegs(post_30=1))
    board = cell.world.scene.fixtures["board"]
    away = replace(board, pose=board.pose.shifted((0.03, 0.0, 0.0)))
    cell.world.scene.fixtures = {**cell.world.scene.fixtures, "board": away}
    while cell.world.control.controller != "CartesianImpedance":
        cell.tick()
        assert cell.running
    for _ in range(4):
        cell.tick()
    before = 1000 * cell.world.gripper.width
    turn_in_hand(cell, degrees)
    after = 1000 * cell.world.gripper.width
    cell.finish()
    report = cell.failure
    held = cell.world.scene.held
    assert held is not None
    told = message.format(item=held.id, before=before, after=after)
    assert (report.cause.name, report.message) == (cause, told)
