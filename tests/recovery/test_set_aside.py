"""SetAside: the first times are counted, then the item is given up where it lies."""

from __future__ import annotations

from pathlib import Path

from picktree.simulation.fault_entries import AtTime, CameraDrop
from picktree.simulation.kinematic import KinematicHardware
from picktree.trees.loading import NodeRegistry, parse_mission

from ..skills.cell import Cell, items, mission


def cell() -> tuple[Cell, str]:
    made = Cell(mission("Observe: {camera: overhead}"), items(block=1, can=1))
    made.finish()
    return made, str(made.world.scene.objects[0].id)


def give_up(cell: Cell, item: str, ports: str = "") -> str:
    return cell.do(f"SetAside: {{object: {item}{ports}}}")


def test_an_item_that_is_given_up_is_not_to_be_done() -> None:
    made, item = cell()
    world = made.world
    world.attempts.failed("Main/Grasp", item, "top 0")
    before = world.scene.get(item)
    assert give_up(made, item) == ""
    now = world.scene.get(item)
    assert (now.place, now.pose) == ("aside", before.pose)
    assert item not in {o.id for o in world.to_do()}
    assert world.attempts.state() == {}
    (told,) = (e for e in made.events if e.kind == "set_aside")
    x, y, _ = before.pose.position
    assert (told.message, told.node) == (f"{item} is left where it lies", "Main/SetAside")
    assert told.data == {"object": item, "form": now.form, "x": x, "y": y, "times": 1}


def test_before_its_time_it_is_counted_only() -> None:
    made, item = cell()
    for time in (1, 2):
        assert give_up(made, item, ", after: 3") == ""
        assert made.world.scene.get(item).place == "table", time
    assert made.happened("set_aside") == []
    assert give_up(made, item, ", after: 3") == ""
    assert made.world.scene.get(item).place == "aside"


def test_an_item_is_set_aside_in_the_end_although_waiting_may_help() -> None:
    made, item = cell()
    assert isinstance(made.hardware, KinematicHardware)
    made.hardware.afflict(0, CameraDrop(AtTime(0.0)))
    text = (
        "picktree: 1\nkind: mission\ninclude: [library/sorting]\ntrees:\n  Main:\n"
        f"    SortTirelessly: {{item: {item}, attempts: 1, rounds: 1, patience: 3}}\n"
    )
    places: list[str] = []
    for _ in range(3):
        made.start(parse_mission(text, Path("mission.yaml"), NodeRegistry()))
        made.finish()
        places.append(made.world.scene.get(item).place)
    assert places == ["table", "table", "aside"]
