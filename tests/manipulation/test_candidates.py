"""The stream of whole candidates, and what its trail tells of those that dropped out."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import TypeVar

import pytest

from picktree.robot import World
from picktree.robot.manipulation import grasp_candidates
from picktree.robot.manipulation.candidate_search import CandidateSearch
from picktree.robot.manipulation.grasps import GraspCandidate
from picktree.robot.manipulation.pick_candidates import (
    APPROACH_STAGE,
    GRASP_STAGE,
    HAND_STAGE,
    PLACE_STAGE,
    PRE_GRASP_STAGE,
    RANKED_STAGE,
    ROOM_STAGE,
    PickPlaceCandidate,
    count_rejections,
    describe_rejections,
)
from picktree.session import assemble_world
from picktree.simulation import build_hardware
from picktree.world import (
    BeliefObject,
    Box,
    Candidates,
    Cylinder,
    Failure,
    ObjectId,
    Plan,
    Pose,
    planning,
)
from picktree.world.robot_model import load_robot
from picktree.world.scene import load_scene

T = TypeVar("T")
BLOCK = ObjectId("red_block_1")
(RED_BIN,) = (each.pose.position for each in load_scene("sort_small").bins if each.id == "red_bin")


def believed(
    name: str, at: tuple[float, float, float], *, size: float = 0.04, place: str = "table"
) -> BeliefObject:
    """A red block of 4 cm height and that width."""
    known = ("block", "box", Box((size, size, 0.04)), "red", Pose(at), 0.001, 0.01, 1.0, 0.0)
    return BeliefObject(*known, id=ObjectId(name), place=place)


def world_with(*beliefs: BeliefObject) -> World:
    """The small sorting scene without physics, and a belief of its own."""
    scene, robot = load_scene("sort_small"), load_robot("panda")
    world = assemble_world(build_hardware("kinematic", scene, robot, 3), scene, robot, 3)
    for belief in beliefs:
        world.scene.put(belief, "test")
    return world


def stream(world: World) -> CandidateSearch:
    return CandidateSearch(world, world.scene.get(BLOCK), grasps(world), "Grasp")


def nothing_found(*beliefs: BeliefObject) -> Candidates:
    """The trail of a search for the block among these that finds nothing."""
    world = world_with(*beliefs)
    assert answer(stream(world).find()) is None
    return trail(world)


def grasps(world: World) -> list[GraspCandidate]:
    return grasp_candidates(world.scene.get(BLOCK), world.robot.description.gripper)


def answer(steps: Generator[None, None, T]) -> T:
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def trail(world: World) -> Candidates:
    """The last choice in the journal."""
    return [entry for entry in world.journal.take() if isinstance(entry, Candidates)][-1]


def counts(ranked: Candidates) -> dict[str, int]:
    """Number of grasps that reached each stage."""
    return {stage.name: stage.count for stage in ranked.stages}


def reasons(ranked: Candidates) -> str:
    return describe_rejections(count_rejections(ranked.tried, ranked.into))


def test_the_best_candidate_is_proven_up_to_its_approach() -> None:
    world = world_with(believed(BLOCK, (0.5, 0.0, 0.02)))
    pick = answer(stream(world).find())
    assert pick is not None
    assert pick.landing is not None
    assert pick.above is not None
    assert pick.landing.into == "red_bin"
    plan = pick.approach
    assert world.robot.tcp(plan.trajectory.end).distance(pick.grasp.tcp_in_world) < 1e-4
    assert world.robot.tcp(pick.over).distance(pick.grasp.tcp_in_world) == pytest.approx(0.08, abs=1e-4)
    assert world.robot.tcp(pick.above).distance(pick.landing.above) < 1e-4
    assert len(plan.passes) == 2
    ranked = trail(world)
    assert (ranked.purpose, ranked.object, ranked.into) == ("grasp by Grasp", BLOCK, "red_bin")
    assert counts(ranked)[RANKED_STAGE] == len(grasps(world))
    assert counts(ranked)[APPROACH_STAGE] == 1
    (accepted,) = (tried for tried in ranked.tried if tried.verdict == "accepted")
    assert (accepted.name, accepted.place, accepted.stage) == (
        pick.grasp.name,
        pick.landing.name,
        APPROACH_STAGE,
    )


def test_cheap_tests_are_made_of_many_and_dear_ones_of_few() -> None:
    world = world_with(believed(BLOCK, (0.5, 0.0, 0.02)))
    assert answer(stream(world).find()) is not None
    entries = world.journal.take()
    reached = list(counts(next(e for e in entries if isinstance(e, Candidates))).values())
    assert reached == sorted(reached, reverse=True)
    assert reached[0] > reached[-2] == 1
    assert sum(isinstance(entry, Plan) for entry in entries) == 1


def test_what_cannot_be_carried_on_makes_room_for_the_next() -> None:
    world = world_with(believed(BLOCK, (0.5, 0.0, 0.02)))
    candidates = stream(world)
    found: list[PickPlaceCandidate] = []
    for _ in range(4):
        pick = answer(candidates.find())
        assert pick is not None
        candidates.refuse(pick, Failure(planning.NO_PATH, "a test says no"))
        found.append(pick)
    assert len({(p.grasp.name, p.landing.name if p.landing else "") for p in found}) == 4
    assert found[0].cost < min(pick.cost for pick in found) + 0.2, "the guess of a way is no bound"
    verdicts = [t.verdict for t in trail(world).tried if t.stage == "transfer planned"]
    assert verdicts[0] == "no way to the place: a test says no"


def test_a_neighbour_that_the_hand_would_touch_is_named_with_its_distance() -> None:
    beside = ((0.548, 0.0), (0.452, 0.0), (0.5, 0.048), (0.5, -0.048))
    walls = [believed(f"wall_{k}", (x, y, 0.02)) for k, (x, y) in enumerate(beside)]
    ranked = nothing_found(believed(BLOCK, (0.5, 0.0, 0.02)), *walls)
    assert counts(ranked)[HAND_STAGE] == 0
    assert {tried.stage for tried in ranked.tried} == {HAND_STAGE}
    assert all(tried.by.startswith("wall_") and tried.gap < 0.003 for tried in ranked.tried)
    fates = count_rejections(ranked.tried, ranked.into)
    assert fates[0].words.startswith("the hand would touch wall_")
    assert fates[0].words.endswith("mm deep in it at best)")
    assert sum(fate.count for fate in fates) == counts(ranked)[RANKED_STAGE]


def test_an_object_out_of_reach() -> None:
    ranked = nothing_found(believed(BLOCK, (0.98, 0.5, 0.02)))
    assert (counts(ranked)[HAND_STAGE], counts(ranked)[PRE_GRASP_STAGE]) == (counts(ranked)[RANKED_STAGE], 0)
    assert reasons(ranked) == f"{counts(ranked)[RANKED_STAGE]} the pre-grasp is out of reach"


def test_a_full_bin() -> None:
    x, y, _ = RED_BIN
    towers = [
        replace(
            believed(f"tower_{k}", (x + (k // 3 - 1) * 0.07, y + (k % 3 - 1) * 0.055, 0.09), place="red_bin"),
            shape=Cylinder(0.01, 0.16),
        )
        for k in range(9)
    ]
    ranked = nothing_found(believed(BLOCK, (0.5, 0.0, 0.02)), *towers)
    assert reasons(ranked) == f"{counts(ranked)[RANKED_STAGE]} red_bin is full"
    assert counts(ranked)[PRE_GRASP_STAGE] == 0, "the arm is not asked for what leads nowhere"


def test_a_place_that_is_covered_is_told_with_what_covers_it() -> None:
    x, y, z = RED_BIN
    lid = replace(believed("lid_1", (x, y, z + 0.23)), role="obstacle", shape=Box((0.4, 0.4, 0.2)))
    ranked = nothing_found(believed(BLOCK, (0.5, 0.0, 0.02)), lid)
    assert counts(ranked)[GRASP_STAGE] > 0
    assert (counts(ranked)[ROOM_STAGE], counts(ranked)[PLACE_STAGE]) == (0, 0)
    covered = "from there red_bin cannot be reached (over red_bin red_block_1 would touch lid_1)"
    assert reasons(ranked).startswith(f"{counts(ranked)[GRASP_STAGE]} {covered}")
    assert len(ranked.tried) < 2 * counts(ranked)[RANKED_STAGE], "places that fail alike are one row"


def test_an_object_that_belongs_nowhere_is_grasped_all_the_same() -> None:
    world = world_with(replace(believed(BLOCK, (0.5, 0.0, 0.02)), colour="white"))
    pick = answer(stream(world).find())
    assert pick is not None
    assert (pick.landing, pick.above) == (None, None)


def test_the_stream_depends_on_the_belief_alone() -> None:
    def found() -> tuple[list[float], list[float], Candidates]:
        world = world_with(believed(BLOCK, (0.5, 0.1, 0.02)), believed("red_block_2", (0.56, 0.1, 0.02)))
        pick = answer(stream(world).find())
        assert pick is not None
        assert pick.above is not None
        return list(pick.above), list(pick.approach.trajectory.position.ravel()), trail(world)

    assert found() == found()
