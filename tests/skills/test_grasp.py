"""Grasp: what is planned ahead for a candidate, what a full hand means, and what is said of a miss."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from picktree.robot.manipulation import grasp_candidates
from picktree.robot.manipulation.candidate_search import CandidateSearch
from picktree.robot.manipulation.held_object import GripCheck, LightObject
from picktree.robot.manipulation.pick_candidates import PickPlaceCandidate
from picktree.robot.planning import Request
from picktree.simulation import Backend
from picktree.trees import Doing, NodeStatus
from picktree.world import Array, BeliefObject, Cause, Failure, FailureReport, ObjectId, control, planning
from picktree.world.event_types import PickEvent
from picktree.world.scene import SceneDescription
from picktree.world.world_facts import GRASP, AttemptMemory, Refusal

from .cell import Cell, holding, items, looked, mission, sorting

Change = Callable[[PickPlaceCandidate], PickPlaceCandidate]
Find = Callable[..., Doing[PickPlaceCandidate | None]]


def failed(cell: Cell, body: str) -> FailureReport:
    assert cell.do(body) != ""
    return cell.failure


def feather(scene: SceneDescription, backend: Backend = "kinematic") -> tuple[Cell, BeliefObject]:
    """A cell whose only item was seen."""
    cell = Cell(mission("Observe: {camera: overhead}"), scene, backend)
    cell.finish()
    (item,) = cell.world.scene.objects
    return cell, item


def far_away(cell: Cell, block: str) -> BeliefObject:
    """The block is believed where no arm reaches."""
    near = cell.world.scene.get(ObjectId(block))
    far = replace(near, pose=near.pose.shifted((0.5, 0.0, 0.0)))
    cell.world.scene.put(far, "moved away")
    return far


def unchanged(pick: PickPlaceCandidate) -> PickPlaceCandidate:
    return pick


def nowhere(pick: PickPlaceCandidate) -> PickPlaceCandidate:
    return replace(pick, landing=None)


def not_over(pick: PickPlaceCandidate) -> PickPlaceCandidate:
    return replace(pick, above=None)


def flat(pick: PickPlaceCandidate) -> PickPlaceCandidate:
    return replace(pick, grasp=replace(pick.grasp, flat=True))


@pytest.mark.parametrize(
    ("change", "onward", "ahead", "later", "handed_over"),
    [
        (unchanged, True, 1, 1, True),
        (unchanged, False, 0, 0, False),
        (nowhere, True, 0, 0, False),
        (not_over, True, 0, 1, True),
        (flat, True, 0, 1, True),
    ],
)
def test_the_transfer_is_planned_ahead_where_it_is_known(
    change: Change, onward: bool, ahead: int, later: int, handed_over: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Plans made while the arm approaches, and in all until the object is lifted."""
    cell, (block,) = looked(block=1)
    find, plans, think = CandidateSearch.find, list[bool](), cell.world.plan.ahead

    def finding(self: CandidateSearch, **how: Any) -> Doing[PickPlaceCandidate | None]:
        pick = yield from find(self, **how)
        return None if pick is None else change(pick)

    def thinking(legs: Any, **how: Any) -> Any:
        plans.append(bool(cell.world.scene.held) or cell.world.control.tcp.position[2] < 0.05)
        return think(legs, **how)

    monkeypatch.setattr(CandidateSearch, "find", finding)
    monkeypatch.setattr(cell.world.plan, "ahead", thinking)
    assert cell.do(f"Grasp: {{object: {block}, onward: {str(onward).lower()}}}") == ""
    assert (plans.count(False), len(plans)) == (ahead, later)
    assert (cell.world.handover.take() is not None) is handed_over


def test_another_object_in_the_hand_is_told() -> None:
    cell, names = looked(block=1, can=1)
    first, second = names
    cell.do(f"Grasp: {{object: {first}, onward: false}}")
    failure = failed(cell, f"Grasp: {{object: {second}}}")
    assert cell.told == f"grasp.no_candidate: the hand is not free: it holds {first}"
    assert failure.evidence == {"object": second, "held": first}


@pytest.mark.parametrize(("gone", "opening"), [(True, "0."), (False, "40.")])
def test_what_was_in_the_hand_and_weighs_nothing_has_slipped(
    gone: bool, opening: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell, block = holding()
    if gone:
        cell.kinematic.remove("item_00")
        for _ in range(20):
            cell.wait()
    else:
        monkeypatch.setattr(cell.world.control, "load", lambda: 0.0)
    slipped = f"grasp.slipped: {block} was in the hand and is gone: opening {opening}"
    assert cell.do(f"Grasp: {{object: {block}}}").startswith(slipped)
    assert cell.world.scene.held is None


def test_a_planner_s_refusal_to_begin_gets_the_arm_clear_once(monkeypatch: pytest.MonkeyPatch) -> None:
    for cause, cleared in ((planning.START_IN_COLLISION, 1), (planning.NO_PATH, 0)):
        cell, (block,) = looked(block=1)
        escapes, refused, find = list[str](), list[Failure](), CandidateSearch.find

        def finding(
            self: CandidateSearch,
            *,
            cause: Cause = cause,
            refused: list[Failure] = refused,
            find: Find = find,
            **how: Any,
        ) -> Doing[PickPlaceCandidate | None]:
            if not refused:
                refused.append(Failure(cause, "it stands in something"))
                raise refused[0]
            return (yield from find(self, **how))

        def escaping(*given: Any, escapes: list[str] = escapes) -> Doing[None]:
            escapes.append("out")
            yield

        with monkeypatch.context() as patch:
            patch.setattr(CandidateSearch, "find", finding)
            patch.setattr("picktree.robot.manipulation.replanning.escape_contact", escaping)
            cell.do(f"Grasp: {{object: {block}, onward: false}}")
        assert len(escapes) == cleared
        assert (cell.tree.failure is None) is bool(cleared)


@pytest.mark.parametrize("kind", ["gone", "slips"])
def test_a_miss_is_told_with_what_was_felt_and_remembered(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    cell, (block,) = looked(block=1)
    hardware = cell.kinematic
    monkeypatch.setattr("picktree.robot.manipulation.object_pick.relocate_object", _nothing)
    if kind == "gone":
        hardware.remove(str(hardware.truth()[0].id))
    else:
        monkeypatch.setattr(cell.world.control, "load", lambda: 0.0)
    failure = failed(cell, f"Grasp: {{object: {block}, onward: false}}")
    (pick,) = (e for e in cell.events if isinstance(e, PickEvent))
    told = {
        "gone": ("grasp.missed", "the fingers met and hold nothing"),
        "slips": ("grasp.slipped", "it was between the fingers and slipped out"),
    }
    cause, words = told[kind]
    assert str(failure.cause) == cause
    assert failure.message.startswith(f"{block}: {words} (opening ")
    assert failure.evidence["candidate"] == pick.candidate
    assert (pick.message, pick.held, pick.first_try) == (f"{block}: not held", False, True)
    assert pick.object == block
    assert cell.world.attempts.count("Main/Grasp", block) == 1
    assert cell.world.scene.held is None
    cell.wait()
    assert cell.world.gripper.width > 0.07


def _nothing(*_: Any) -> Doing[None]:
    yield


@pytest.mark.parametrize("cause", [control.TRACKING, planning.NO_PATH])
def test_what_stops_the_approach_counts_against_the_candidate(
    cause: Cause, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell, (block,) = looked(block=1)
    told = Failure(cause, "it went wrong")

    def refused(*given: Any, **how: Any) -> Doing[None]:
        yield
        raise told

    monkeypatch.setattr(cell.world.move, "along", refused)
    failure = failed(cell, f"Grasp: {{object: {block}}}")
    assert (str(failure.cause), failure.message) == (cause.name, "it went wrong")
    assert cell.world.attempts.count("Main/Grasp", block) == 1


def feathers(**counts: int) -> SceneDescription:
    """The scene with these items, of which each block weighs 3 g."""
    scene = items(**counts)
    light = tuple(replace(e, mass=0.003) if e.kind == "block" else e for e in scene.catalogue)
    return replace(scene, catalogue=light)


@pytest.mark.parametrize("backend", ["kinematic", "physics"])
def test_what_is_too_light_to_be_felt_is_held_and_placed(backend: Backend) -> None:
    cell, block = feather(feathers(block=1), backend)
    into = cell.world.scene.destination(block.id)
    place = f"{{Place: {{object: {block.id}, into: {into}}}}}"
    assert cell.do(f"Sequence: [{{Grasp: {{object: {block.id}}}}}, {place}]") == ""
    assert [e.held for e in cell.events if isinstance(e, PickEvent)] == [True]
    while any(math.hypot(*body.velocity) > 0.01 for body in cell.hardware.truth()):
        cell.wait()
    assert cell.score().count.sorted == 1


@pytest.mark.parametrize(
    ("width", "load", "held"),
    [
        (0.04, 0.0, True),
        (0.037, -0.05, True),
        (0.04, 0.2, True),
        (0.033, 0.0, False),
        (0.047, 0.0, False),
        (0.001, 0.2, False),
        (0.04, 0.9, False),
    ],
)
def test_opening_and_load_tell_a_light_object_from_others(width: float, load: float, held: bool) -> None:
    """A load that the catalogue cannot explain is that of something else."""
    assert GripCheck(width, load, LightObject(0.003, (0.04, 0.04, 0.04))).held is held


def test_a_light_object_that_falls_on_the_way_is_found_out() -> None:
    cell, block = feather(feathers(block=1))
    assert cell.do(f"Grasp: {{object: {block.id}, onward: false}}") == ""
    cell.world.gripper.start(0.0, 0.0)
    assert cell.do(f"Place: {{object: {block.id}, into: red_bin}}").startswith("grasp.slipped: ")
    assert cell.world.scene.held is None


@pytest.mark.parametrize("kind", ["can", "nut"])
def test_a_neighbour_between_the_fingers_is_not_the_light_object(kind: str) -> None:
    """The believed block of 3 g is another thing, which the fingers do hold."""
    scene = feathers(**{kind: 1})
    cell, other = feather(scene)
    cell.world.scene.put(
        replace(other, kind="block", form="box", shape=scene.entry("block").shape), "mistaken"
    )
    failure = failed(cell, f"Grasp: {{object: {other.id}, onward: false}}")
    assert str(failure.cause) in ("grasp.missed", "grasp.slipped")
    assert cell.world.scene.held is None
    assert {e.held for e in cell.events if isinstance(e, PickEvent)} == {False}


def test_what_cannot_be_grasped_is_tried_again_when_something_has_changed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cell, (block,) = looked(block=1)
    far = far_away(cell, block)
    asked, reached = list[object](), cell.world.plan.reached

    def reaching(request: Request) -> Any:
        asked.append(request)
        return reached(request)

    monkeypatch.setattr(cell.world.plan, "reached", reaching)
    first = failed(cell, f"Grasp: {{object: {block}}}")
    searched = len(asked)
    assert str(first.cause) == "grasp.no_candidate" and searched > 10

    cell.world.scene.put(replace(far, pose=far.pose.shifted((0.001, 0.001, 0.0))), "seen again")
    again = failed(cell, f"Grasp: {{object: {block}}}")
    assert again.message == f"{first.message}; nothing has changed around it since"
    assert len(asked) == searched and again.evidence["unchanged"] is True

    cell.world.scene.put(replace(far, pose=far.pose.shifted((0.02, 0.0, 0.0))), "moved")
    failed(cell, f"Grasp: {{object: {block}}}")
    assert len(asked) > searched


def test_the_hand_leans_away_from_a_wall_beside_the_object() -> None:
    scene = items(ball=1)
    at_the_red_bin = replace(scene.spawn[0], area=((0.42, 0.337), (0.48, 0.38)), gap=0.0)
    cell = Cell(sorting(), replace(scene, spawn=(at_the_red_bin,)), "physics")
    assert cell.finish() is NodeStatus.SUCCESS
    (pick,) = (event for event in cell.events if isinstance(event, PickEvent))
    assert "lean" in pick.candidate and pick.held
    assert cell.score().count.sorted == 1


def test_a_search_among_the_untried_grasps_alone_refuses_nothing() -> None:
    """Grasps that failed in contact may hold later, though no other one is in reach."""
    cell, (block,) = looked(block=1)
    far = far_away(cell, block)
    ranked = grasp_candidates(far, cell.world.robot.description.gripper)
    cell.world.attempts.failed("Main/Grasp", block, ranked[0].name)
    failure = failed(cell, f"Grasp: {{object: {block}}}")
    assert str(failure.cause) == "grasp.no_candidate" and failure.evidence["tried_before"] == 1
    assert cell.world.attempts.refusal(GRASP, far, cell.world.scene) is None


def test_refusals_are_part_of_a_checkpoint() -> None:
    cell, (block,) = looked(block=1)
    belief = cell.world.scene.get(ObjectId(block))
    cell.world.attempts.refuse("grasp", belief, cell.world.scene, "it is too far away")
    saved = TypeAdapter(dict[str, Refusal]).dump_json(cell.world.attempts.refusals)
    other = AttemptMemory()
    other.refusals = TypeAdapter(dict[str, Refusal]).validate_json(saved)
    assert other.refusal("grasp", belief, cell.world.scene) == "it is too far away"
    other.forget(block)
    assert other.refusal("grasp", belief, cell.world.scene) is None


def test_recovery_gives_up_what_nothing_has_changed() -> None:
    cell, (block,) = looked(block=1)
    far_away(cell, block)
    recover = f"Recover: {{attempts: 6, do: {{Grasp: {{object: {block}}}}}, otherwise: AlwaysSuccess}}"
    for handled in (2, 0):
        cell.events.clear()
        failure = failed(cell, recover)
        assert str(failure.cause) == "grasp.no_candidate" and failure.evidence["unchanged"] is True
        assert len(cell.happened("recovery")) == handled


def test_a_grasp_is_approached_from_another_posture_when_the_nearest_leads_nowhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its elbow may touch something on the straight way down, in that posture alone."""
    cell, (block,) = looked(block=1)
    asked, through = list[Array](), cell.world.plan.through

    def blocked_once(legs: Any, **options: Any) -> Any:
        over = legs[0].target.position
        asked.append(over)
        if np.abs(over - asked[0]).max() < 0.1:
            raise Failure(planning.NO_PATH, "the elbow is in the way")
        return (yield from through(legs, **options))

    monkeypatch.setattr(cell.world.plan, "through", blocked_once)
    cell.do(f"Grasp: {{object: {block}, onward: false}}")
    assert cell.tree.failure is None and cell.world.scene.held is not None
    robot = cell.world.robot
    assert len(asked) == 2
    assert robot.tcp(asked[1]).distance(robot.tcp(asked[0])) < 1e-3, "it is the same grasp"


def test_postures_are_tried_for_a_few_grasps_only(monkeypatch: pytest.MonkeyPatch) -> None:
    cell, (block,) = looked(block=1)
    postures, turned = cell.world.plan.postures, list[Request]()

    def blocked(legs: Any, **options: Any) -> Any:
        raise Failure(planning.NO_PATH, "nothing is free")
        yield

    def counted(request: Request) -> list[Array]:
        turned.append(request)
        return postures(request)

    monkeypatch.setattr(cell.world.plan, "through", blocked)
    monkeypatch.setattr(cell.world.plan, "postures", counted)
    assert str(failed(cell, f"Grasp: {{object: {block}}}").cause) == "planning.no_path"
    assert 1 < len(turned) <= 4
