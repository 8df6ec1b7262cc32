"""The result of a run as text and as JSON, whole."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

from picktree.logs import CrushedItem, FeedCount, HoleItem, PickCount, RunResult
from picktree.logs.episode_counts import CureCount, PlantedCount
from picktree.robot.operator_desk import OperatorQuestion
from picktree.world import FormCount, ItemCount


def test_text(result: RunResult) -> None:
    assert (
        result.to_text()
        == """\
success: the goal is reached
items       2 of 4 sorted, 1 misplaced, 1 left
  box       2 of 3
  sphere    0 of 1
grasps      5 tried, 4 held; 3 of 4 objects held at the first try
failures    control.tracking 1, grasp.missed 2
recovery    grasp.missed      2 seen, 1 cured by RetreatAndLook after 2 tries, 1 given up, 9.5 s lost
            control.tracking  1 seen, nobody handled it
planted     1 slip, then grasp.missed (cured)
            1 jam, then nothing failed
simulated   20.1 s, 5.0 s a pick
wall        2.5 s: physics 1.2, planning 0.5, perception 0.3, logging 0.2; CPU 2.3 s
seed        7, digest 0123456789abcdef
log         /runs/a run/log.mcap
look at it  picktree explain '/runs/a run'"""
    )


def test_text_of_a_run_without_a_pick(result: RunResult) -> None:
    poor = replace(
        result,
        status="failure",
        message="perception.not_found: no item is in view",
        items=ItemCount(1, 0, 0, 1, {"box": FormCount(1, 0)}),
        picks=PickCount(0, 0, 0, 0),
        sim_seconds=3.0,
        failures={},
        recoveries={},
        cures=(),
        planted=(),
        thinking_charged=False,
        folder=Path("/runs/1"),
        log=Path("/runs/1/log.mcap"),
    )
    lines = poor.to_text().splitlines()
    assert lines[0] == "failure: the tree ended in FAILURE: perception.not_found: no item is in view"
    assert "failures    none" in lines
    assert not any(line.startswith(("recover", "planted")) for line in lines)
    assert "simulated   3.0 s (planning and perception took no simulated time)" in lines
    assert lines[-1] == "look at it  picktree explain /runs/1"


def test_text_tells_apart_what_counts_as_sorted_and_what_does_not(result: RunResult) -> None:
    items = replace(result.items, without_destination=3, elsewhere=2, set_aside=1)
    assert replace(result, items=items).to_text().splitlines()[1] == (
        "items       2 of 4 sorted, 1 misplaced, 1 left; 2 put elsewhere, 1 set aside, "
        "3 without a destination"
    )


def test_json_has_every_field_by_its_name_and_reads_back(result: RunResult) -> None:
    asked = OperatorQuestion("Main/Ask", "the can slips", ("go on", "give up"), "can_1", "the hand is empty")
    full = replace(
        result,
        log=Path("runs/1/log.mcap"),
        folder=Path("runs/1"),
        items=replace(result.items, without_destination=3, elsewhere=2, set_aside=1),
        holes=(HoleItem("item_00", "dowel", "board/left", "sorted", 0.0298, 0.03, 0.01, 2e-5, ""),),
        crushed=(CrushedItem("item_03", "can", "red", 65.2, 60.0),),
        feed=FeedCount(1, 3, 0),
        asked=asked,
        cpu_seconds=2.346,
        as_believed=True,
    )
    text = full.to_json_text()
    told = json.loads(text)
    assert text.endswith("}\n")
    assert told.keys() == {field.name for field in fields(RunResult)}
    for part, kind in (("cures", CureCount), ("planted", PlantedCount), ("holes", HoleItem)):
        assert all(each.keys() == {field.name for field in fields(kind)} for each in told[part])
    assert told["items"]["by_form"] == {
        "box": {"total": 3, "sorted": 2}, "sphere": {"total": 1, "sorted": 0}
    }  # fmt: skip
    assert (told["status"], told["sim_seconds"], told["wall_seconds"]["physics"]) == ("success", 20.05, 1.25)
    assert replace(full, cpu_seconds=2.34567).to_json()["cpu_seconds"] == 2.346
    here = Path.cwd()
    absolute = replace(full, log=here / full.log, folder=here / full.folder)
    assert RunResult.from_json_text(text, Path("x")) == absolute


def test_of_a_run_with_a_feed(result: RunResult) -> None:
    lines = replace(result, feed=FeedCount(1, 3, 0)).to_text().splitlines()
    assert "feed        1 delivery, 3 bins exchanged, 0 items set aside" in lines
    assert "simulated   20.1 s, 5.0 s a pick" in lines


def test_of_a_run_with_holes(result: RunResult) -> None:
    right = HoleItem("item_00", "dowel", "board/left", "sorted", 0.0298, 0.03, 0.01, 2e-5, "")
    why = "it is 0.40 mm deep in a wall of board/right"
    wrong = HoleItem("item_01", "post", "board/right", "misplaced", 0.03, 0.03, 0.0, 4e-4, why)
    felt = replace(result, holes=(right, wrong))
    lines = felt.to_text().splitlines()
    told = lines.index(
        "holes       dowel in board/left: 29.8 of 30.0 mm deep, leans 0.6 deg, 0.020 mm in the wall; sorted"
    )
    assert lines[told + 1] == (
        "            post in board/right: 30.0 of 30.0 mm deep, leans 0.0 deg, 0.400 mm in the wall; "
        "misplaced: it is 0.40 mm deep in a wall of board/right"
    )


def test_of_an_older_log(result: RunResult) -> None:
    older = json.loads(result.to_json_text())
    del older["cures"], older["planted"], older["feed"]
    read = RunResult.from_json_text(json.dumps(older), Path("log.mcap"))
    assert (read.cures, read.feed) == (None, None)
    assert "recoveries  grasp.missed 2" in read.to_text().splitlines()


def test_crushed_items_are_told(result: RunResult) -> None:
    crushed = (
        CrushedItem("item_03", "can", "red", 65.2, 60.0),
        CrushedItem("item_05", "egg", "blue", 9.4, 6.0),
    )
    told = replace(result, crushed=crushed)
    assert [line for line in told.to_text().splitlines() if "pressed" in line] == [
        "crushed     item_03, a red can: a finger pressed with 65 N, and the item withstands 60 N",
        "            item_05, a blue egg: a finger pressed with 9 N, and the item withstands 6 N",
    ]
