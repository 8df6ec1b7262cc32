"""A cell: single nodes, belief, plans and pictures, with failures as values and faults as sentences."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

import picktree as pt
from picktree.analysis import Run, resimulate
from picktree.robot.planning import NamedGoal
from picktree.simulation import Backend
from picktree.trees import BehaviourTree
from picktree.world import Failure, Pose


@pytest.fixture
def cell() -> Iterator[pt.Cell]:
    with pt.Cell("sort_small", backend="kinematic", seed=3) as cell:
        yield cell


def test_skills_run_one_after_another(cell: pt.Cell) -> None:
    assert len(cell.belief) == 0
    seen = cell.run(pt.Observe(camera="overhead", objects="{items}"))
    assert (seen.status, seen.node, seen.cause) == ("SUCCESS", "Observe", "")
    listed = seen.outputs["items"]
    assert isinstance(listed, list)
    assert seen.outputs["objects"] == listed
    assert sorted(map(str, listed)) == sorted(str(item.id) for item in cell.belief)
    began, item = cell.time, cell.belief.find(colour="red", kind="block")
    grasped = cell.run(pt.Grasp(object=item.id))
    assert grasped
    assert cell.time == pytest.approx(began + grasped.seconds)
    assert cell.belief.held is not None
    assert cell.belief.held.id == item.id
    assert cell.run(pt.Place(object=item.id, into=str(item.destination)))
    assert (item.place, cell.belief.find(item.id).place) == ("table", "red_bin")
    assert cell.belief.held is None


def test_same_calls_give_the_same_run() -> None:
    def poses() -> list[Pose]:
        with pt.Cell("sort_small", backend="kinematic", seed=5) as cell:
            cell.run(pt.Observe(camera="overhead"))
            cell.run(pt.Grasp(object=cell.belief[0].id))
            return [item.pose for item in cell.belief]

    assert poses() == poses()


def test_failure_is_a_value(cell: pt.Cell) -> None:
    result = cell.run(pt.Sequence(pt.Grasp(object="nothing")))
    assert not result
    assert (result.status, result.cause, result.failed_at) == (
        "FAILURE", "world.unknown_object", "Main/Sequence/Grasp",
    )  # fmt: skip
    assert result.evidence == {"object": "nothing", "known": []}
    assert repr(result).splitlines() == [
        "Sequence: FAILURE after 0.00 s",
        "  world.unknown_object at Main/Sequence/Grasp: no object 'nothing' in the planning scene",
        "  to try: observe",
    ]


FAULTS = {
    "name of the scene": (
        lambda: pt.Sequence(pt.Observe(), pt.Observe(camera="overhed")),
        "mission: Main/Sequence/Observe#2: port 'camera': the scene 'sort_small' has no camera 'overhed' "
        "(did you mean 'overhead'?)",
    ),
    "unit": (
        lambda: pt.nodes.GoTo(pose="home", speed="fast"),
        "mission: Main/GoTo: port 'speed': 'fast' is not a number (share of the joints' speed limits: 1 for "
        "the full limits)",
    ),
    "key that nobody writes": (
        lambda: pt.Grasp(object="{item}"),
        "mission: Main/Grasp: port 'object': nothing has written 'item' when it is read",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faulty_tree_is_refused_with_its_place(cell: pt.Cell, fault: str) -> None:
    make, message = FAULTS[fault]
    with pytest.raises(pt.PicktreeError) as raised:
        cell.run(make())
    assert str(raised.value).startswith(message)
    assert cell.time == 0.0


def test_limit_ends_a_tree(cell: pt.Cell) -> None:
    endless = pt.nodes.Repeat(pt.nodes.Delay(pt.nodes.AlwaysSuccess(), delay_msec="1 s"), num_cycles=-1)
    result = cell.run(endless, limit=2.0)
    assert (result.status, result.seconds) == ("TIMEOUT", pytest.approx(2.0))
    assert cell.run(pt.nodes.GoTo(pose="home"))


def test_question_to_a_person_ends_as_paused(cell: pt.Cell) -> None:
    assert cell.run(pt.nodes.AskForHelp(reason="which one?")).status == "PAUSED"


def test_interrupt_brings_the_arm_to_rest(cell: pt.Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = iter(range(100))
    tick = BehaviourTree.tick

    def interrupted(tree: BehaviourTree) -> object:
        if next(ticks) == 12:
            raise KeyboardInterrupt
        return tick(tree)

    cell.run(pt.Observe(camera="overhead"))
    monkeypatch.setattr(BehaviourTree, "tick", interrupted)
    result = cell.run(pt.Grasp(object=cell.belief[0].id))
    assert result.status == "INTERRUPTED"
    assert cell.world.control.at_rest
    monkeypatch.undo()
    assert cell.run(pt.nodes.GoTo(pose="home"))


def test_recorded_skill_has_a_log(cell: pt.Cell, tmp_path: Path) -> None:
    cell.run(pt.Observe(camera="overhead"))
    item = cell.belief[0].id
    result = cell.run(pt.Grasp(object=item), log=tmp_path / "try")
    assert result
    assert result.log is not None
    assert result.log.is_relative_to(tmp_path / "try")
    with Run(result.log) as run:
        (visit,) = (visit for visit in run.visits if visit.id == "Grasp")
        assert (visit.item, visit.outcome) == (item, "SUCCESS")
        assert run.ticks.times[0] == pytest.approx(cell.time - result.seconds)
        assert run.result is not None
        assert run.result.status == "success"  # though eleven items are not where they belong


@pytest.mark.parametrize("backend", ["kinematic", "physics"])
def test_log_of_a_used_cell_runs_again(backend: Backend, tmp_path: Path) -> None:
    with pt.Cell("sort_small", backend=backend, seed=3) as cell:
        cell.run(pt.Observe(camera="overhead"))
        item = cell.belief.find(kind="block")
        sort = pt.Sequence(pt.Grasp(object=item.id), pt.Place(object=item.id, into=str(item.destination)))
        logs = [cell.run(sort, log=tmp_path).log, cell.run(pt.nodes.GoTo(pose="home"), log=tmp_path).log]
    for log in logs:
        assert log is not None
        again = resimulate(log)
        assert (again.difference, again.exact, again.ticks) == (None, True, again.recorded_ticks)
        assert again.ticks > 10
        with Run(log) as run:
            first = next(run.log.beliefs())
            assert len(first.record.bodies) == 4  # though the camera looked before
            assert again.digest == run.log.digest()


def test_log_that_begins_with_a_full_hand_cannot_run_again(cell: pt.Cell, tmp_path: Path) -> None:
    cell.run(pt.Observe(camera="overhead"))
    item = cell.belief.find(kind="block")
    cell.run(pt.Grasp(object=item.id))
    began = cell.time
    log = cell.run(pt.Place(object=item.id, into=str(item.destination)), log=tmp_path).log
    assert log is not None
    with pytest.raises(pt.PicktreeError) as raised:
        resimulate(log)
    assert str(raised.value) == (
        f"{log}: the log begins at {began:.2f} s, after the arm had moved or the hand had "
        "taken something, and it does not contain these actions; record all of them as one tree, "
        "`cell.run(pt.Sequence(…), log=…)`"
    )


def test_limit_of_a_used_cell_counts_from_its_start(cell: pt.Cell, tmp_path: Path) -> None:
    cell.run(pt.nodes.GoTo(pose="home"))
    cell.run(pt.Observe(camera="overhead"))
    began = cell.time
    result = cell.run(pt.nodes.Delay(pt.Observe(camera="overhead"), delay_msec=9000), limit=2.0, log=tmp_path)
    assert result.status == "TIMEOUT"
    assert cell.time == pytest.approx(began + 2.0, abs=0.06)


def test_belief_says_what_there_is(cell: pt.Cell) -> None:
    with pytest.raises(
        pt.PicktreeError, match=r"^nothing is believed to be colour=red; believed: nothing; run"
    ):
        cell.belief.find(colour="red")
    cell.run(pt.Observe(camera="overhead"))
    known = ", ".join(item.id for item in cell.belief)
    with pytest.raises(pt.PicktreeError, match=f"^nothing is believed to be kind=mug; believed: {known}$"):
        cell.belief.find(kind="mug")
    with pytest.raises(TypeError, match=r"^an object has no attribute 'color' \(did you mean 'colour'\?\)$"):
        cell.belief.find(color="red")
    assert {item.colour for item in cell.belief.all(destination="red_bin")} == {"red"}
    assert cell.belief._repr_html_().count("<tr>") == 1 + len(cell.belief)


def test_plan_is_found_and_followed(cell: pt.Cell) -> None:
    cell.run(pt.Observe(camera="overhead"))
    item = cell.belief.find(colour="red")
    poses = item.grasp(above=0.08)
    before = cell.world.control.tcp
    plan = cell.plan(pt.PoseGoal(poses))
    assert plan
    assert (plan.cause, plan.message) == ("", "")
    assert cell.world.control.tcp == before
    cell.move(plan)
    assert min(pose.distance(cell.world.control.tcp) for pose in poses) < 2e-3
    cell.move(cell.plan(NamedGoal("home")))


def test_plan_that_there_is_none_of_is_explained(cell: pt.Cell) -> None:
    cell.run(pt.Observe(camera="overhead"))
    orientation = cell.belief[0].grasp()[0].orientation
    bin_ = cell.world.scene.bins["red_bin"]
    in_its_wall = bin_.pose.shifted((bin_.size[0] / 2, 0.0, 0.02)).position
    refused = cell.plan(pt.PoseGoal((Pose(in_its_wall, orientation),)))
    assert not refused
    assert refused.cause == "planning.goal_in_collision"
    assert "red_bin" in refused.message
    assert refused.show(size=(160, 100)).pixels.shape == (100, 160, 3)
    assert repr(refused).startswith("no plan: planning.goal_in_collision\n")
    with pytest.raises(pt.PicktreeError, match=r"^there is no plan to move along:\nno plan: planning"):
        cell.move(refused)


def test_generator_of_the_world_is_run_to_its_end(cell: pt.Cell) -> None:
    cell.perform(cell.world.gripper.close(force=10.0))
    assert cell.world.gripper.width < 0.002
    with pytest.raises(Failure) as raised:
        cell.perform(cell.world.plan.to(pt.PoseGoal((Pose((0.4, 0.0, -0.3)),))))
    assert raised.value.cause.name == "planning.workspace"


def test_pictures_show_what_is_believed(cell: pt.Cell, tmp_path: Path) -> None:
    empty = cell.show(size=(160, 100))
    cell.run(pt.Observe(camera="overhead"))
    full = cell.show(size=(160, 100))
    assert full.pixels.shape == (100, 160, 3)
    assert np.abs(full.pixels.astype(int) - empty.pixels).max() > 60
    read = cv2.imread(str(full.save(tmp_path / "new" / "scene.png")))
    assert read is not None
    assert (read[:, :, ::-1] == full.pixels).all()


def test_closed_cell_says_so() -> None:
    with pt.Cell("sort_small", backend="kinematic") as cell:
        pass
    with pytest.raises(pt.PicktreeError, match=r"^the cell is closed; build another one$"):
        cell.run(pt.Observe())


def test_unknown_scene_has_the_nearest_name() -> None:
    with pytest.raises(pt.PicktreeError, match=r"unknown scene 'sort_smal' .*did you mean 'sort_small'"):
        pt.Cell("sort_smal")
